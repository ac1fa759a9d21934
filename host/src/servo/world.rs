//! Two stations on one clock, and the images that the cameras on B take of the poster on A.

use super::ServoError;
use super::station_link::{Moment, StationLink, StationPlace};
use std::sync::Arc;
use trinocular_client::observer::StationObserver;
use trinocular_client::stage::default_stage;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::Mounting;
use trinocular_core::rig::Rig;
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::Stage;
use trinocular_vision::images::{self, FrameSet, Pose, Scene, SceneSettings, Texture};

/// Simulated world of both stations, the poster and the cameras.
///
/// The clock is virtual if B is a twin. If B is on a serial line, the clock is the host's, and A,
/// which has no hardware, catches up with it at each request for its position.
#[derive(Debug)]
pub struct SimulatedWorld {
    /// Station with the poster; driven by setpoints.
    pub a: Twin,
    /// Station with the cameras; driven by flow frames.
    pub b: StationLink,
    scene: Scene,
    swing: Option<(Swing, Instant)>,
    seed: u64,
    captures: u64,
}

/// Rotation of the poster to and fro about its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Largest rotation vector, degrees.
    pub most_deg: [f64; 3],
    /// Periods per second.
    pub per_s: f64,
}

impl Swing {
    /// Returns the rotation vector after `time_s`, degrees.
    fn at(&self, time_s: f64) -> [f64; 3] {
        let share = (core::f64::consts::TAU * self.per_s * time_s).sin();
        self.most_deg.map(|most| share * most)
    }
}

/// Frame set, and the truth about it that the station does not get.
#[derive(Debug)]
pub struct Exposure {
    /// Capture time, and the position of the cameras then.
    pub moment: Moment,
    /// Position of the poster, mm from that at A's power-on.
    pub target_mm: [f64; 3],
    /// Images of all cameras.
    pub capture: FrameSet,
}

impl SimulatedWorld {
    /// Switches both stations on, at zero, with the poster at an unknown distance before the
    /// cameras. `stage` is B's. A has the default stage, so that the target's motion does not
    /// depend on B.
    ///
    /// # Errors
    /// If the scene cannot be rendered, B cannot be reached or a station refuses the stage.
    pub fn new(
        rig: &Rig,
        stage: &Stage,
        place: StationPlace<'_>,
        texture: &Texture,
        settings: SceneSettings,
        seed: u64,
    ) -> Result<Self, ServoError> {
        Self::new_observed(rig, stage, place, texture, settings, seed, None)
    }

    /// Switches both stations on as [`SimulatedWorld::new`] does; `observer` sees every byte
    /// between the host and B.
    ///
    /// # Errors
    /// As [`SimulatedWorld::new`].
    pub fn new_observed(
        rig: &Rig,
        stage: &Stage,
        place: StationPlace<'_>,
        texture: &Texture,
        settings: SceneSettings,
        seed: u64,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, ServoError> {
        // The scene first: drawing it takes a while, and a station that is on has a heartbeat to
        // keep.
        let scene = Scene::new(rig, texture, settings)?;
        let mut world = Self {
            a: Twin::start(&default_stage(), "twin A", Mounting::OnStage)?,
            b: StationLink::start_observed(place, stage, Mounting::OnStage, observer)?,
            scene,
            swing: None,
            seed,
            captures: 0,
        };
        world.advance(world.a.now().max(world.b.now()));
        Ok(world)
    }

    /// Returns the common clock.
    pub fn now(&self) -> Instant {
        match self.b.twin() {
            Some(twin) => self.a.now().max(twin.now()),
            // The host's clock never rests: the time up to which the world has run counts.
            None => self.a.now(),
        }
    }

    /// Lets the poster swing from now on.
    pub fn set_swing(&mut self, swing: Swing) {
        self.swing = Some((swing, self.now()));
    }

    /// Lets time pass for both stations.
    pub fn advance(&mut self, end: Instant) {
        self.b.advance(end);
        self.a.advance(end);
    }

    /// Returns the positions of the poster and of the cameras, mm from those at power-on.
    pub fn positions_mm(&self) -> [[f64; 3]; 2] {
        [self.a.position_mm(), self.b.position_mm()]
    }

    /// Takes a frame set at `due`, or as soon after it as B's position is known.
    ///
    /// # Errors
    /// If B cannot be reached.
    pub fn expose(&mut self, due: Instant) -> Result<Exposure, ServoError> {
        self.expose_driven(due, Twin::advance)
    }

    /// Takes a frame set as [`SimulatedWorld::expose`] does; `drive` lets time pass for A until
    /// then, and may move the poster meanwhile.
    ///
    /// # Errors
    /// As [`SimulatedWorld::expose`].
    pub fn expose_driven(
        &mut self,
        due: Instant,
        drive: impl FnOnce(&mut Twin, Instant),
    ) -> Result<Exposure, ServoError> {
        let moment = self.b.moment(due.max(self.now()))?;
        drive(&mut self.a, moment.at);
        let target_mm = self.a.position_mm();
        let relative_mm = std::array::from_fn(|i| target_mm[i] - moment.camera_mm[i]);
        self.captures += 1;
        let seed = self
            .seed
            .wrapping_mul(1_000_003)
            .wrapping_add(self.captures);
        Ok(Exposure {
            moment,
            target_mm,
            capture: self.render(relative_mm, moment.at, seed),
        })
    }

    fn render(&self, relative_mm: [f64; 3], at: Instant, seed: u64) -> FrameSet {
        let Some((swing, begin)) = &self.swing else {
            return self.scene.render(relative_mm, at.micros(), seed);
        };
        let pose = Pose {
            relative_mm,
            turned_deg: swing.at(at.since(*begin) as f64 * 1e-6),
        };
        let shot = images::Exposure::of(pose, self.scene.settings().noise_grey);
        let shots = vec![shot; self.scene.cameras()];
        self.scene.render_exposures(&shots, at.micros(), seed)
    }
}
