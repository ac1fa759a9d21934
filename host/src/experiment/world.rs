//! Two stations on one virtual clock, and what the cameras on B see of the poster on A.

use super::Error;
use crate::images::{Capture, Scene, SceneSettings, Texture};
use crate::rig_file::Stage;
use crate::station::twin::Twin;
use shared::frame::message::Mounting;
use shared::rig::Rig;
use shared::time::Instant;

/// Both stations, the poster and the cameras.
#[derive(Debug)]
pub struct World {
    /// Carries the poster; driven by setpoints.
    pub a: Twin,
    /// Carries the cameras; driven by flow frames.
    pub b: Twin,
    scene: Scene,
    seed: u64,
    captures: u64,
}

impl World {
    /// Switches both stations on, at zero, with the poster at an unknown distance before the cameras.
    ///
    /// # Errors
    /// If the scene cannot be rendered or a station refuses the stage.
    pub fn new(
        rig: &Rig,
        stage: &Stage,
        texture: &Texture,
        settings: SceneSettings,
        seed: u64,
    ) -> Result<Self, Error> {
        let mut world = Self {
            a: Twin::start(stage, "twin A", Mounting::OnStage)?,
            b: Twin::start(stage, "twin B", Mounting::OnStage)?,
            scene: Scene::new(rig, texture, settings)?,
            seed,
            captures: 0,
        };
        world.advance(world.a.now().max(world.b.now()));
        Ok(world)
    }

    /// The common clock.
    pub fn now(&self) -> Instant {
        self.a.now().max(self.b.now())
    }

    /// Lets time pass for both.
    pub fn advance(&mut self, end: Instant) {
        self.a.advance(end);
        self.b.advance(end);
    }

    /// Where the poster is, and where the cameras are, mm from where they were switched on: counted edges.
    pub fn positions_mm(&self) -> [[f64; 3]; 2] {
        [self.a.position_mm(), self.b.position_mm()]
    }

    /// How the poster has moved as seen from the cameras, mm.
    pub fn relative_mm(&self) -> [f64; 3] {
        let [a, b] = self.positions_mm();
        std::array::from_fn(|i| a[i] - b[i])
    }

    /// All cameras take a picture now.
    pub fn capture(&mut self) -> Capture {
        self.captures += 1;
        let seed = self
            .seed
            .wrapping_mul(1_000_003)
            .wrapping_add(self.captures);
        self.scene
            .render(self.relative_mm(), self.now().micros(), seed)
    }
}
