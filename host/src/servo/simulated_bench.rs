//! Rendered cameras on the stage of a station in real time, for a [workbench](super::workbench).

use super::ServoError;
use super::path::TargetPath;
use super::station_link::StationLink;
use super::workbench::{Bench, Shot};
use super::world::SimulatedWorld;
use trinocular_client::stage::setpoint;
use trinocular_core::time::Instant;

/// Time between two setpoints of the target, µs.
const SETPOINT_US: u64 = 10_000;

/// Bench whose cameras are rendered: they stand on the stage and see a poster that moves.
#[derive(Debug)]
pub struct SimulatedBench {
    world: SimulatedWorld,
    path: TargetPath,
    /// Time from the last frame set to the earliest next one, µs.
    grace_us: u64,
    start: Instant,
    last: Instant,
}

impl SimulatedBench {
    /// Makes a bench with up to `frames_per_s` frame sets per second; the poster moves along
    /// `path`, from now on. The station of `world` must be on a port, because a workbench takes its
    /// time.
    pub fn new(world: SimulatedWorld, path: TargetPath, frames_per_s: f64) -> Self {
        let now = world.now();
        Self {
            world,
            path,
            // A frame set comes with the report that follows the last frame.
            grace_us: (0.5e6 / frames_per_s) as u64,
            start: now,
            last: now,
        }
    }
}

impl Bench for SimulatedBench {
    fn next_shot(&mut self) -> Result<Option<Shot>, ServoError> {
        let (start, path) = (self.start, self.path);
        let due = self.last.plus_micros(self.grace_us);
        // The frame sets come at uneven intervals, but the target moves evenly.
        let exposure = self.world.expose_driven(due, |target, end| {
            while target.now() < end {
                let next = target.now().plus_micros(SETPOINT_US).min(end);
                target.send(setpoint(path.at(next.since(start) as f64 * 1e-6)));
                target.advance(next);
            }
        })?;
        self.last = exposure.moment.at;
        Ok(Some(Shot {
            images: exposure.capture,
            taken: exposure.moment.station,
        }))
    }

    fn station(&mut self) -> &mut StationLink {
        &mut self.world.b
    }
}
