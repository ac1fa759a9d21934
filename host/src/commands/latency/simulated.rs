//! A twin whose stage carries rendered cameras, with stamps that are late.

use super::{Bench, LatencyOptions, See};
use crate::commands::cameras::per_camera_delays_ms;
use crate::commands::failure::Failure;
use trinocular_client::stage::setpoint;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::Mounting;
use trinocular_core::safety::State;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::hand_eye::delay::Path;
use trinocular_vision::images::{Scene, Texture};

/// Time for which the stage rests after a motion, µs: the longest delay.
const AFTER_US: u64 = 400_000;

/// Longest motion, µs.
const LONGEST_US: u64 = 10_000_000;

/// Time between two points of the path, µs.
const TICK_US: u64 = 1_000;

/// Twin and rendered scene.
pub struct Simulated {
    twin: Twin,
    scene: Scene,
    seed: u64,
    period_us: u64,
    /// Instant of the next image, µs.
    next_us: u64,
    /// Stamp minus exposure of each camera, s.
    delays_s: Vec<f64>,
}

/// Switches the twin on, at zero.
pub fn bench(options: &LatencyOptions, rig: &RigFile, stage: &Stage) -> Result<Simulated, Failure> {
    let delays_ms = per_camera_delays_ms(options.camera_delay.as_deref(), rig)?;
    let texture = Texture::of_kind(options.scene.texture, options.scene.seed);
    let scene = Scene::new(&rig.rig, &texture, options.scene.settings())
        .map_err(|error| Failure::Usage(crate::commands::scene::reason(&error)))?;
    Ok(Simulated {
        twin: Twin::start(stage, "twin", Mounting::OnStage)
            .map_err(|error| Failure::of_station(None, error))?,
        scene,
        seed: options.scene.seed,
        period_us: (1e6 / options.fps).round() as u64,
        next_us: 0,
        delays_s: delays_ms.into_iter().map(|ms| 1e-3 * ms).collect(),
    })
}

impl Simulated {
    fn send(&mut self, position_mm: [f64; 3]) -> Result<(), Failure> {
        self.twin
            .command("setpoint", setpoint(position_mm))
            .map_err(|error| Failure::of_station(None, error))
    }

    /// Lets a tick pass; returns true if it ends with images.
    fn tick(&mut self) -> bool {
        let end_us = self.twin.now().micros() + TICK_US;
        // The cameras do not keep the station's ticks.
        let shot_us = self.next_us.max(self.twin.now().micros());
        let is_due = shot_us <= end_us;
        let to_us = if is_due { shot_us } else { end_us };
        let now = self.twin.now();
        self.twin.advance(now.plus_micros(to_us - now.micros()));
        is_due
    }

    fn shoot(&mut self, see: &mut See<'_>) {
        let now_us = self.twin.now().micros();
        self.next_us = now_us + self.period_us;
        self.seed = self.seed.wrapping_mul(1_000_003).wrapping_add(1);
        let relative_mm = self.twin.position_mm().map(|mm| -mm);
        let set = self.scene.render(relative_mm, now_us, self.seed);
        for (camera, (image, delay_s)) in set.images.iter().zip(&self.delays_s).enumerate() {
            see(camera, now_us as f64 * 1e-6 + delay_s, image);
        }
    }
}

impl Bench for Simulated {
    fn position_mm(&mut self) -> Result<[f64; 3], Failure> {
        Ok(self.twin.position_mm())
    }

    fn go(&mut self, position_mm: [f64; 3]) -> Result<(), Failure> {
        self.send(position_mm)?;
        loop {
            self.twin.advance(self.twin.now().plus_micros(110_000));
            let status = self.twin.status().map(|status| status.state);
            if status != Some(State::Moving) {
                return Ok(());
            }
        }
    }

    fn rest(&mut self, count: usize, see: &mut See<'_>) -> Result<(), Failure> {
        for _ in 0..count {
            while !self.tick() {}
            self.shoot(see);
        }
        Ok(())
    }

    fn pass(
        &mut self,
        position_mm: [f64; 3],
        see: &mut See<'_>,
    ) -> Result<Option<(Path, f64)>, Failure> {
        self.send(position_mm)?;
        let start_us = self.twin.now().micros();
        let mut path = Path::default();
        let (mut moved_us, mut last_mm) = (start_us, self.twin.position_mm());
        loop {
            let now_us = self.twin.now().micros();
            let at_mm = self.twin.position_mm();
            path.push(now_us as f64 * 1e-6, at_mm);
            if at_mm != last_mm {
                (moved_us, last_mm) = (now_us, at_mm);
            }
            if now_us - moved_us >= AFTER_US || now_us - start_us >= LONGEST_US {
                return Ok(Some((path, 0.0)));
            }
            if self.tick() {
                self.shoot(see);
            }
        }
    }
}
