//! Path of a moving stage, by a model of its station.
//!
//! The path is not read from the station's reports, which come ten times a second. The twin plans
//! the same motion as the station, to the step; the control tick at which the command took effect,
//! by the station's answer, tells when.

use crate::commands::failure::Failure;
use std::path::Path;
use trinocular_client::serial::Serial;
use trinocular_client::stage::setpoint;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::Mounting;
use trinocular_core::machine::TICK_US;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::Stage;

/// Time between two points of a path, µs: a whole part of a control tick.
const POINT_US: u64 = 250;

/// Model of a station and its stage.
pub struct StageModel(Twin);

impl StageModel {
    /// Starts the model, at zero.
    pub fn start(stage: &Stage) -> Result<Self, Failure> {
        let twin = Twin::start(stage, "model", Mounting::OnStage);
        let twin = twin.map_err(|error| Failure::of_station(None, error))?;
        Ok(Self(twin))
    }

    /// Sends the model to a position, mm from zero; returns its path to there, and for `after_ms`
    /// more.
    pub fn go(&mut self, position_mm: [f64; 3], after_ms: u64) -> Result<ModelPath, Failure> {
        let model = &mut self.0;
        model
            .command("setpoint", setpoint(position_mm))
            .map_err(|error| Failure::of_station(None, error))?;
        let tick = model.client().answered_tick().unwrap_or_default();
        let start_us = u64::from(tick) * TICK_US;
        let (mut path, mut still_ms, mut before_mm) = (Vec::new(), 0, None);
        while still_ms < after_ms {
            let at_mm = model.position_mm();
            still_ms = if before_mm.replace(at_mm) == Some(at_mm) {
                still_ms + 1
            } else {
                0
            };
            // Steps lie between ticks.
            for _ in 0..TICK_US / POINT_US {
                let since_us = model.now().micros() as i64 - start_us as i64;
                path.push((since_us, model.position_mm()));
                model.advance(model.now().plus_micros(POINT_US));
            }
        }
        Ok(ModelPath(path))
    }
}

/// Path of a motion: times since the control tick of the command, µs, and positions, mm.
pub struct ModelPath(Vec<(i64, [f64; 3])>);

impl ModelPath {
    /// Returns the duration of the path, µs.
    pub fn lasts_us(&self) -> u64 {
        let last = self.0.last();
        last.map_or(0, |(since_us, _)| since_us.unsigned_abs())
    }

    /// Returns the path of a motion that begins at `start_us`, with the times of that clock, µs.
    pub fn from(self, start_us: i64) -> impl Iterator<Item = (i64, [f64; 3])> {
        let points = self.0.into_iter();
        points.map(move |(since_us, at_mm)| (start_us + since_us, at_mm))
    }
}

/// Instant at which a command took effect.
pub struct Anchor {
    /// The instant on the station's clock, µs.
    pub station_us: i64,
    /// The instant on the line's clock, µs.
    pub line_us: i64,
    /// Bound of the error of the station's clock, µs.
    pub bound_us: u64,
}

impl Anchor {
    /// Returns the instant of the control tick at which the station answered. `source` is named if
    /// the station's clock is unknown.
    pub fn of(serial: &Serial, tick: Option<u32>, source: &Path) -> Result<Self, Failure> {
        let unknown = || InputError::file(source, "the station's clock is not known yet");
        let (lead_us, bound_us) = serial.offset_us().ok_or_else(unknown)?;
        let now_us = serial.now_us().saturating_add_signed(lead_us);
        let start_us = instant_of_tick(tick.ok_or_else(unknown)?, now_us);
        Ok(Self {
            station_us: start_us as i64,
            line_us: start_us as i64 - lead_us,
            bound_us,
        })
    }
}

/// Returns the instant of a control tick, which is known modulo 2³², µs of the station's clock.
fn instant_of_tick(tick: u32, now_us: u64) -> u64 {
    let now = now_us / TICK_US;
    let age = (now as u32).wrapping_sub(tick);
    now.saturating_sub(u64::from(age)) * TICK_US
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_client::stage::default_stage;

    #[test]
    fn model_comes_to_the_end_of_a_long_motion() {
        let stage = Stage {
            max_speed_mm_s: [5.0; 3],
            ..default_stage()
        };
        let path = StageModel::start(&stage).and_then(|mut model| model.go([58.0, 0.0, 0.0], 50));
        let Ok(path) = path else {
            panic!("the model refuses to start or to move");
        };
        assert!(path.lasts_us() > 11_000_000);
        let (_, end_mm) = path.0.last().expect("a path");
        assert_eq!(*end_mm, [58.0, 0.0, 0.0]);
    }

    #[test]
    fn tick_is_found_across_its_wrap() {
        assert_eq!(instant_of_tick(5, 9_500), 5_000);
        let wrap_us = (1u64 << 32) * TICK_US;
        assert_eq!(
            instant_of_tick(u32::MAX, wrap_us + 7_000),
            wrap_us - TICK_US
        );
        assert_eq!(instant_of_tick(3, wrap_us + 7_000), wrap_us + 3_000);
    }
}
