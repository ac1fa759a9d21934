//! A twin whose stage carries rendered cameras, in a mounting that the calibration does not get.

use super::{CalibrateStageOptions, Pass, StageBench};
use crate::commands::failure::Failure;
use nalgebra::{Matrix3, Rotation3, Vector3};
use trinocular_client::stage::setpoint;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::images::{FrameSet, Scene};

/// Longest duration of a pass, ms.
const PASS_MS: u64 = 400;

/// Time between two frame sets of a pass, ms.
const PICTURE_MS: u64 = 16;

/// Twin and rendered scene.
pub struct Simulated {
    twin: Twin,
    scene: Scene,
    /// Motion of the cameras per mm of commanded motion of the stage.
    mounted: Matrix3<f64>,
    seed: u64,
    /// Time stamp minus capture time, µs.
    late_us: i64,
}

/// Switches the twin on, at zero.
pub fn bench(
    options: &CalibrateStageOptions,
    rig: &RigFile,
    stage: &Stage,
) -> Result<Simulated, Failure> {
    let [x, y, z] = *options.turned.as_slice() else {
        return Err(Failure::Usage("--turned takes three angles".to_owned()));
    };
    if !(options.scaled >= 0.5 && options.scaled <= 2.0)
        || [x, y, z].iter().any(|d| !(d.abs() <= 30.0))
    {
        return Err(Failure::Usage(
            "--scaled must be from 0.5 to 2, --turned -30 to 30 degrees".to_owned(),
        ));
    }
    let turn = Rotation3::new(Vector3::new(x, y, z).map(f64::to_radians));
    let mut axes = Vector3::repeat(options.scaled);
    if let Some(axis) = options.mirrored {
        axes[axis as usize] = -axes[axis as usize];
    }
    Ok(Simulated {
        twin: Twin::start(stage, "twin", Mounting::OnStage)
            .map_err(|error| Failure::of_station(None, error))?,
        scene: options.scene.scene(&rig.rig)?,
        mounted: turn.matrix() * Matrix3::from_diagonal(&axes),
        seed: options.scene.seed,
        late_us: (options.late * 1e3).round() as i64,
    })
}

impl StageBench for Simulated {
    fn position_mm(&mut self) -> Result<[f64; 3], Failure> {
        Ok(self.twin.position_mm())
    }

    fn go(&mut self, position_mm: [f64; 3]) -> Result<[f64; 3], Failure> {
        let gone = self.twin.go(position_mm);
        gone.map_err(|error| Failure::of_station(None, error))?;
        self.position_mm()
    }

    fn pass(&mut self, position_mm: [f64; 3]) -> Result<Option<Pass>, Failure> {
        self.twin
            .command("setpoint", setpoint(position_mm))
            .map_err(|error| Failure::of_station(None, error))?;
        let mut pass = Pass::default();
        for ms in 0..PASS_MS {
            self.twin.advance(self.twin.now().plus_micros(1_000));
            let now_s = self.twin.now().micros() as f64 * 1e-6;
            pass.path.push((now_s, self.twin.position_mm()));
            if ms % PICTURE_MS == 0 {
                let mut capture = self.look()?;
                capture.time_us = capture.time_us.saturating_add_signed(self.late_us);
                pass.captures.push(capture);
            }
        }
        Ok(Some(pass))
    }

    fn look(&mut self) -> Result<FrameSet, Failure> {
        self.seed = self.seed.wrapping_mul(1_000_003).wrapping_add(1);
        let cameras_mm = self.mounted * Vector3::from(self.twin.position_mm());
        let relative_mm = (-cameras_mm).into();
        Ok(self
            .scene
            .render(relative_mm, self.twin.now().micros(), self.seed))
    }
}
