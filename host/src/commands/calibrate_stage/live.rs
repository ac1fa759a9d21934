//! A station on a port, and live cameras on its stage.

use super::{CalibrateStageOptions, Pass, StageBench};
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::driven::Driven;
use crate::commands::failure::Failure;
use crate::commands::live_cameras::{self, Free};
use crate::commands::stage_model::{Anchor, StageModel};
use crate::commands::warnings;
use std::path::PathBuf;
use std::time::Duration;
use trinocular::servo::serial_station;
use trinocular::servo::triggering::{TriggerWatch, Triggering};
use trinocular_client::StationError;
use trinocular_core::time::Instant;
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

/// Station on a port, live cameras, and the model of the stage's path.
pub struct Live {
    driven: Driven,
    cameras: LiveCameras,
    model: StageModel,
    /// Watch of the triggers, if the station triggers the cameras.
    watch: Option<TriggerWatch>,
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
    let triggering = live_cameras::triggering(rig, true, &[])?;
    let opened = cameras::open(&devices, (rig, path), FPS)?;
    let free = Free {
        window: WINDOW,
        delay_ms: None,
        rig,
    };
    let cameras = live_cameras::start(opened, triggering.as_ref(), &free, on_interrupt()?, None)?;
    let model = StageModel::start(stage)?;
    let mut live = Live {
        driven: driven()?,
        cameras,
        model,
        watch: None,
        source: live_cameras::source(&devices),
    };
    let start_mm = live.driven.position_mm()?;
    live.model.go(start_mm, AFTER_MS)?;
    if let Some(triggering) = triggering {
        live.trigger(triggering)?;
    }
    Ok(live)
}

impl Live {
    /// Starts the triggers of the cameras.
    fn trigger(&mut self, triggering: Triggering) -> Result<(), Failure> {
        let listener = triggering.listener(None);
        self.driven.hand.serial().set_observer(Some(listener));
        let started = triggering.start(self.driven.serial_mut());
        started.map_err(|error| Failure::of_servo(Some(self.driven.hand.port()), error))?;
        self.watch = Some(TriggerWatch::new(triggering));
        Ok(())
    }

    /// Returns the present time on the clock of the capture times, µs.
    fn now_us(&self) -> Result<u64, Failure> {
        if self.watch.is_none() {
            return Ok(self.cameras.now_us());
        }
        let serial = self.driven.hand.serial();
        let now = Instant::from_micros(serial.now_us());
        match serial_station::station_time(serial, now) {
            Ok(now) => Ok(now.micros()),
            Err(error) => Err(self.driven.hand.failed(error)),
        }
    }

    /// Returns the instant at which a motion began, on the clock of the capture times, µs.
    fn begun_us(&self, tick: Option<u32>) -> Result<i64, Failure> {
        let serial = self.driven.hand.serial();
        let anchor = Anchor::of(serial, tick, &self.source)?;
        Ok(match self.watch {
            Some(_) => anchor.station_us,
            None => anchor.line_us - offset_us(|| serial.now_us(), || self.cameras.now_us()),
        })
    }

    fn next(&mut self) -> Result<FrameSet, Failure> {
        let set = match &mut self.watch {
            Some(watch) => {
                let serial = self.driven.hand.serial_mut();
                let images =
                    watch.next_images(serial, &mut self.cameras, |news| warnings::raise(news));
                images.map_err(|error| Failure::of_servo(Some(self.driven.hand.port()), error))?
            }
            None => {
                let line = self.driven.hand.serial().check();
                line.map_err(|error| self.driven.hand.failed(error))?;
                self.cameras.next().transpose()?
            }
        };
        set.ok_or_else(|| self.driven.hand.failed(StationError::Cancelled))
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if self.watch.is_some() {
            Triggering::end(self.driven.serial_mut());
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
        self.model.go(position_mm, AFTER_MS)?;
        Ok(stands_mm)
    }

    fn look(&mut self) -> Result<FrameSet, Failure> {
        let from_us = self.now_us()? + SETTLED_US;
        loop {
            let set = self.next()?;
            if set.time_us >= from_us {
                return Ok(set);
            }
        }
    }

    fn pass(&mut self, position_mm: [f64; 3]) -> Result<Option<Pass>, Failure> {
        let path = self.model.go(position_mm, AFTER_MS)?;
        let jumps_before = self.driven.clock_jumps();
        let until_us = self.now_us()? + path.lasts_us();
        let begun = self.driven.begin(position_mm)?;
        let mut pass = Pass::default();
        while self.now_us()? < until_us {
            pass.captures.push(self.next()?);
        }
        self.driven.arrive()?;
        // The times of triggers need no comparison of clocks.
        if self.watch.is_none() && self.driven.clock_jumps() != jumps_before {
            warnings::raise(
                "the station's clock jumped while the stage moved, because the station or \
                 this computer was held up: the delay may be wrong; run this again",
            );
        }
        for (at_us, at_mm) in path.from(self.begun_us(begun)?) {
            pass.path.push((at_us as f64 * 1e-6, at_mm));
        }
        Ok(Some(pass))
    }
}
