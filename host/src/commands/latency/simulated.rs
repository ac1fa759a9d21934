//! A twin whose stage carries rendered cameras, with stamps that are late.

use super::{AFTER_MS, Bench, LatencyOptions, See};
use crate::commands::cameras::per_camera_delays_ms;
use crate::commands::failure::Failure;
use trinocular_client::stage::setpoint;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::Mounting;
use trinocular_core::machine::TICK_US;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::hand_eye::delay::Path;
use trinocular_vision::images::Scene;

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
    Ok(Simulated {
        twin: Twin::start(stage, "twin", Mounting::OnStage)
            .map_err(|error| Failure::of_station(None, error))?,
        scene: options.scene.scene(&rig.rig)?,
        seed: options.scene.seed,
        period_us: (1e6 / options.fps).round() as u64,
        next_us: 0,
        delays_s: delays_ms.into_iter().map(|ms| 1e-3 * ms).collect(),
    })
}

impl Simulated {
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
        let gone = self.twin.go(position_mm);
        gone.map_err(|error| Failure::of_station(None, error))
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
        let sent = self.twin.command("setpoint", setpoint(position_mm));
        sent.map_err(|error| Failure::of_station(None, error))?;
        let mut path = Path::default();
        let (mut moved_us, mut last_mm) = (self.twin.now().micros(), self.twin.position_mm());
        loop {
            let now_us = self.twin.now().micros();
            let at_mm = self.twin.position_mm();
            path.push(now_us as f64 * 1e-6, at_mm);
            if at_mm != last_mm {
                (moved_us, last_mm) = (now_us, at_mm);
            }
            if now_us - moved_us >= 1_000 * AFTER_MS {
                return Ok(Some((path, 0.0)));
            }
            if self.tick() {
                self.shoot(see);
            }
        }
    }
}
