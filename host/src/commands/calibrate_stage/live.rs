//! A station on a port, and live cameras on its stage.

use super::{CalibrateStageOptions, Pass, StageBench};
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::driven::Driven;
use crate::commands::failure::Failure;
use crate::commands::stage_model::{Anchor, StageModel};
use crate::commands::warnings;
use std::path::PathBuf;
use std::time::Duration;
use trinocular_client::StationError;
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

/// Station on a port, live cameras, and the model of the stage's path.
pub struct Live {
    driven: Driven,
    cameras: LiveCameras,
    model: StageModel,
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
    let cameras = LiveCameras::start(opened, WINDOW, &cameras::delays_us(None, rig), stop, tell)?;
    let model = StageModel::start(stage)?;
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
    live.model.go(start_mm, AFTER_MS)?;
    Ok(live)
}

impl Live {
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
        self.model.go(position_mm, AFTER_MS)?;
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
        let path = self.model.go(position_mm, AFTER_MS)?;
        let jumps_before = self.driven.clock_jumps();
        let until_us = self.cameras.now_us() + path.lasts_us();
        let begun = self.driven.begin(position_mm)?;
        let mut pass = Pass::default();
        while self.cameras.now_us() < until_us {
            pass.captures.push(self.next()?);
        }
        self.driven.arrive()?;
        if self.driven.clock_jumps() != jumps_before {
            warnings::raise(
                "the station's clock jumped while the stage moved, because the station or \
                 this computer was held up: the delay may be wrong; run this again",
            );
        }
        let serial = self.driven.hand.serial();
        let anchor = Anchor::of(serial, begun, &self.source)?;
        // From the line's clock to the cameras'.
        let ahead_us = offset_us(|| serial.now_us(), || self.cameras.now_us());
        for (line_us, at_mm) in path.from(&anchor) {
            pass.path.push(((line_us - ahead_us) as f64 * 1e-6, at_mm));
        }
        Ok(Some(pass))
    }
}
