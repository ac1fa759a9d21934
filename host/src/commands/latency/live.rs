//! A station on a port, and live cameras, each on its own: their images are not put together, since
//! their delays are not known yet.

use super::{AFTER_MS, Bench, LatencyOptions, See};
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::driven::Driven;
use crate::commands::failure::Failure;
use crate::commands::live_cameras;
use crate::commands::stage_model::{Anchor, StageModel};
use std::path::PathBuf;
use std::time::Duration;
use trinocular_client::StationError;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::hand_eye::delay::Path;
use trinocular_vision::images::cameras::live::LiveCameras;
use trinocular_vision::images::cameras::stamp::offset_us;

/// Time from a stage at rest to an image of it, µs: vibrations fade, and stamps are late.
const SETTLED_US: u64 = 500_000;

/// Time from the start of cameras with a clock of their own until their stamps have settled, µs.
const OWN_CLOCK_US: u64 = 8_000_000;

/// Camera, and the lead of the line's clock over its own, µs.
struct LiveCamera {
    camera: LiveCameras,
    line_ahead_us: i64,
}

/// Station on a port, live cameras, and the model of the stage's path.
pub struct Live {
    driven: Driven,
    cameras: Vec<LiveCamera>,
    model: StageModel,
    source: PathBuf,
    /// Instant of the line's clock from which on stamps have settled, µs.
    settled_us: u64,
}

/// Opens the cameras, and then the station by `driven`, so that nothing moves without cameras.
pub fn bench(
    options: &LatencyOptions,
    devices: &[PathBuf],
    rig: &RigFile,
    stage: &Stage,
    driven: impl FnOnce() -> Result<Driven, Failure>,
) -> Result<Live, Failure> {
    let path = options.stage.path()?;
    let devices = cameras::per_camera(devices, options.port.as_deref(), (rig, path))?;
    let opened = cameras::open(&devices, (rig, path), options.fps)?;
    let stop = on_interrupt()?;
    let start = |camera| {
        let window = Duration::ZERO;
        let nothing_to_tell = |_: &InputError| ();
        LiveCameras::start(vec![camera], window, &[], stop.clone(), nothing_to_tell)
    };
    let started: Vec<LiveCameras> = opened.into_iter().map(start).collect::<Result<_, _>>()?;
    let model = StageModel::start(stage)?;
    let driven = driven()?;
    let serial = driven.hand.serial();
    let cameras = started.into_iter().map(|camera| LiveCamera {
        line_ahead_us: offset_us(|| serial.now_us(), || camera.now_us()),
        camera,
    });
    let own_clock_us = match cameras::have_own_clock(&devices) {
        true => OWN_CLOCK_US,
        false => 0,
    };
    let mut live = Live {
        settled_us: serial.now_us() + own_clock_us,
        cameras: cameras.collect(),
        driven,
        model,
        source: live_cameras::source(&devices),
    };
    let start_mm = live.driven.position_mm()?;
    live.model.go(start_mm, AFTER_MS)?;
    Ok(live)
}

impl Live {
    fn now_us(&self) -> u64 {
        self.driven.hand.serial().now_us()
    }

    /// Gives `see` the newest image of each camera whose stamp is from `from_us` on, by the line's
    /// clock.
    fn look(&mut self, from_us: u64, see: &mut See<'_>) -> Result<(), Failure> {
        for (index, live) in self.cameras.iter_mut().enumerate() {
            let line = self.driven.hand.serial().check();
            line.map_err(|error| self.driven.hand.failed(error))?;
            let set = match live.camera.next() {
                Some(set) => set?,
                None => return Err(self.driven.hand.failed(StationError::Cancelled)),
            };
            let stamp_us = set.time_us as i64 + live.line_ahead_us;
            if stamp_us < from_us as i64 {
                continue;
            }
            for image in &set.images {
                see(index, stamp_us as f64 * 1e-6, image);
            }
        }
        Ok(())
    }
}

impl Bench for Live {
    fn position_mm(&mut self) -> Result<[f64; 3], Failure> {
        self.driven.position_mm()
    }

    fn go(&mut self, position_mm: [f64; 3]) -> Result<(), Failure> {
        self.driven.send(position_mm)?;
        self.driven.arrive()?;
        self.model.go(position_mm, AFTER_MS)?;
        Ok(())
    }

    fn rest(&mut self, count: usize, see: &mut See<'_>) -> Result<(), Failure> {
        let from_us = self.settled_us.max(self.now_us() + SETTLED_US);
        let mut seen = vec![0; self.cameras.len()];
        while seen.iter().any(|seen| *seen < count) {
            self.look(from_us, &mut |camera, stamp_s, image| {
                seen[camera] += 1;
                if seen[camera] <= count {
                    see(camera, stamp_s, image);
                }
            })?;
        }
        Ok(())
    }

    fn pass(
        &mut self,
        position_mm: [f64; 3],
        see: &mut See<'_>,
    ) -> Result<Option<(Path, f64)>, Failure> {
        let path = self.model.go(position_mm, AFTER_MS)?;
        let jumps_before = self.driven.clock_jumps();
        let begun = self.driven.begin(position_mm)?;
        let from_us = self.now_us();
        let until_us = from_us + path.lasts_us();
        while self.now_us() < until_us {
            self.look(from_us, see)?;
        }
        self.driven.arrive()?;
        if self.driven.clock_jumps() != jumps_before {
            return Ok(None);
        }
        let anchor = Anchor::of(self.driven.hand.serial(), begun, &self.source)?;
        let mut passed = Path::default();
        for (line_us, at_mm) in path.from(anchor.line_us) {
            passed.push(line_us as f64 * 1e-6, at_mm);
        }
        Ok(Some((passed, anchor.bound_us as f64 * 1e-3)))
    }
}
