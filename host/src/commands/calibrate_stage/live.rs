//! A station on a port, and live cameras on its stage.
//!
//! The path of a moving stage is not read from the station's reports, which come ten times a second.
//! The twin plans the same motion as the station, to the step; the control tick at which the command
//! took effect, by the station's answer, tells when.

use super::driven::Driven;
use super::{CalibrateStageOptions, Pass, StageBench};
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::failure::Failure;
use std::path::PathBuf;
use std::time::Duration;
use trinocular_client::StationError;
use trinocular_client::stage::setpoint;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::cameras::live::LiveCameras;
use trinocular_vision::images::cameras::stamp::offset_us;

/// Rate that V4L2 cameras are set to, per second.
const FPS: f64 = 30.0;

/// Largest difference of capture times within a frame set.
const WINDOW: Duration = Duration::from_millis(5);

/// Time from a stage at rest to an image of it, µs: vibrations fade, and stamps may be late.
const SETTLED_US: u64 = 300_000;

/// Time beyond the motion for which a pass lasts, ms.
const AFTER_MS: u64 = 200;

/// Longest pass, ms.
const LONGEST_MS: u64 = 10_000;

/// Length of a control tick, µs.
const TICK_US: u64 = 1_000;

/// Station on a port, live cameras, and the model of the stage's path.
pub struct Live {
    driven: Driven,
    cameras: LiveCameras,
    model: Twin,
    source: PathBuf,
}

/// Opens the cameras, and then the station by `driven`, so that nothing moves without cameras.
pub fn bench(
    options: &CalibrateStageOptions,
    devices: &[PathBuf],
    rig: &RigFile,
    stage: &Stage,
    driven: impl FnOnce() -> Result<Driven, Failure>,
) -> Result<Live, Failure> {
    let path = options.stage.path()?;
    let devices = cameras::per_camera(devices, options.port.as_deref(), (rig, path))?;
    let opened = cameras::open(&devices, (rig, path), FPS)?;
    let stop = on_interrupt()?;
    let tell = |loss: &InputError| notice!("warning: {loss}; the others carry on");
    let cameras = LiveCameras::start(opened, WINDOW, 0, stop, tell)?;
    let model = Twin::start(stage, "model", Mounting::OnStage)
        .map_err(|error| Failure::of_station(None, error))?;
    let names: Vec<String> = devices
        .iter()
        .map(|name| name.display().to_string())
        .collect();
    let mut live = Live {
        driven: driven()?,
        cameras,
        model,
        source: PathBuf::from(names.join(",")),
    };
    let start_mm = live.driven.position_mm()?;
    live.model_path(start_mm)?;
    Ok(live)
}

impl Live {
    /// Sends the model to a position; returns its path, as times since the control tick of the
    /// command, µs, and positions, mm.
    fn model_path(&mut self, position_mm: [f64; 3]) -> Result<Vec<(i64, [f64; 3])>, Failure> {
        let failed = |error| Failure::of_station(None, error);
        self.model
            .command("setpoint", setpoint(position_mm))
            .map_err(failed)?;
        let tick = self.model.client().answered_tick().unwrap_or_default();
        let start_us = u64::from(tick) * TICK_US;
        let (mut path, mut still_ms) = (Vec::new(), 0);
        while still_ms < AFTER_MS && path.len() < LONGEST_MS as usize {
            let at_mm = self.model.position_mm();
            let before = path.last().map(|(_, before_mm)| *before_mm);
            still_ms = if before == Some(at_mm) {
                still_ms + 1
            } else {
                0
            };
            let since_us = self.model.now().micros() as i64 - start_us as i64;
            path.push((since_us, at_mm));
            self.model.advance(self.model.now().plus_micros(TICK_US));
        }
        Ok(path)
    }

    fn next(&mut self) -> Result<FrameSet, Failure> {
        let line = self.driven.hand.serial().check();
        line.map_err(|error| self.driven.hand.failed(error))?;
        match self.cameras.next() {
            Some(set) => Ok(set?),
            None => Err(self.driven.hand.failed(StationError::Cancelled)),
        }
    }
}

impl StageBench for Live {
    fn position_mm(&mut self) -> Result<[f64; 3], Failure> {
        self.driven.position_mm()
    }

    fn go(&mut self, position_mm: [f64; 3]) -> Result<[f64; 3], Failure> {
        self.driven.send(position_mm)?;
        let stands_mm = self.driven.arrive()?;
        self.model_path(position_mm)?;
        Ok(stands_mm)
    }

    fn look(&mut self) -> Result<FrameSet, Failure> {
        let from_us = self.cameras.now_us() + SETTLED_US;
        loop {
            let set = self.next()?;
            if set.time_us >= from_us {
                return Ok(set);
            }
        }
    }

    fn pass(&mut self, position_mm: [f64; 3]) -> Result<Option<Pass>, Failure> {
        let path = self.model_path(position_mm)?;
        let jumps = |live: &Self| live.driven.hand.serial().client().clock().jumps();
        let jumps_before = jumps(self);
        let lasts_us = path
            .last()
            .map_or(0, |(since_us, _)| (*since_us).unsigned_abs());
        let until_us = self.cameras.now_us() + lasts_us;
        self.driven.send(position_mm)?;
        let tick = self.driven.hand.serial().client().answered_tick();
        let mut pass = Pass::default();
        while self.cameras.now_us() < until_us {
            pass.captures.push(self.next()?);
        }
        self.driven.arrive()?;
        if jumps(self) != jumps_before {
            notice!(
                "warning: the station's clock jumped while the stage moved, because the station or \
                 this computer was held up: the delay may be wrong; run this again"
            );
        }
        let serial = self.driven.hand.serial();
        let unknown = || InputError::file(&self.source, "the station's clock is not known yet");
        let (station_us, _) = serial.offset_us().ok_or_else(unknown)?;
        let now_us = serial.now_us().saturating_add_signed(station_us);
        let start_us = instant_of_tick(tick.ok_or_else(unknown)?, now_us);
        // From the station's clock to the cameras', by way of the line's.
        let ahead_us = station_us + offset_us(|| serial.now_us(), || self.cameras.now_us());
        for (since_us, at_mm) in path {
            let time_us = start_us as i64 + since_us - ahead_us;
            pass.path.push((time_us as f64 * 1e-6, at_mm));
        }
        Ok(Some(pass))
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
