//! One trial: a keyframe, a motion, and a measurement.

use super::condition::{Change, Condition, Failure};
use trinocular_core::estimate::midpoint;
use trinocular_core::rig::Rig;
use trinocular_rig::random::Random;
use trinocular_vision::flow::CameraRefusal;
use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings, Measurement};
use trinocular_vision::images::{
    Exposure, FrameSet, Image, Pose, Scene, SceneError, SceneSettings, Texture, TextureKind,
};
use trinocular_vision::sums::Sums;

/// Number of motions tried with every poster and noise level.
pub const MOVES: usize = 4;

/// Result of a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// The trial gave a displacement.
    Measured {
        /// Measured minus true displacement, mm.
        error_mm: [f64; 3],
        /// Stated sigma, mm.
        sigma_mm: [f64; 3],
        /// Number of points in the measurement.
        points: usize,
        /// True if the measurement refused exactly the cameras at fault.
        said: bool,
    },
    /// The trial gave no displacement, for this reason.
    Refused(&'static str),
}

/// Posters by kind, of one seed. Each is drawn once and used in many trials.
#[derive(Debug)]
pub struct Posters {
    seed: u64,
    drawn: Vec<(TextureKind, Texture)>,
}

impl Posters {
    /// Creates a collection without posters.
    pub fn new(seed: u64) -> Self {
        Self {
            seed,
            drawn: Vec::new(),
        }
    }

    /// Returns the poster of this kind with its contrast scaled by `contrast`.
    pub fn of(&mut self, kind: TextureKind, contrast: f64) -> Texture {
        let found = self.drawn.iter().find(|(drawn, _)| *drawn == kind);
        let mut texture = if let Some((_, texture)) = found {
            texture.clone()
        } else {
            let texture = Texture::of_kind(kind, self.seed);
            self.drawn.push((kind, texture.clone()));
            texture
        };
        for grey in &mut texture.grey {
            // Reduce the contrast around a grey that leaves room for more light.
            *grey = (100.0 + contrast * (f64::from(*grey) - 128.0) + 28.0 * contrast) as f32;
        }
        texture
    }
}

/// Scene of one condition with the poster of one seed.
pub struct TrialBench<'a> {
    condition: &'a Condition,
    rig: Rig,
    scene: Scene,
    /// Scene in front of the target, or in its place.
    other: Option<Scene>,
    depth_mm: f64,
    random: Random,
}

/// Depth of the covering object as a share of the target's depth.
const COVER: f64 = 0.82;

impl<'a> TrialBench<'a> {
    /// Sets up the scene.
    ///
    /// # Errors
    /// If the condition's scene cannot be rendered.
    pub fn new(condition: &'a Condition, posters: &mut Posters) -> Result<Self, SceneError> {
        let rig = (condition.rig)();
        let stream = condition.name.bytes().fold(7_u64, |hash, byte| {
            hash.wrapping_mul(1_099_511_628_211) ^ u64::from(byte)
        });
        let mut random = Random::new(posters.seed, stream);
        let [low, high] = condition.depth_mm;
        let depth_mm = random.between(low, high);
        let about = random.between(0.0, core::f64::consts::TAU);
        let tilt = random.unit().sqrt() * condition.tilt_deg.to_radians();
        let settings = SceneSettings {
            depth_mm,
            tilt_rad: [tilt * about.cos(), tilt * about.sin()],
            ..SceneSettings::default()
        };
        let texture = posters.of(condition.texture, condition.contrast);
        let scene = Scene::new(&rig, &texture, settings)?;
        let other = match condition.change {
            Change::Cover { texture, .. } => Some((texture, COVER * depth_mm)),
            Change::Replaced => Some((condition.texture, depth_mm)),
            _ => None,
        };
        let hang = |(kind, depth_mm)| {
            let settings = SceneSettings {
                depth_mm,
                ..settings
            };
            let other = Texture::of_kind(kind, posters.seed ^ 0x5eed);
            Scene::new(&rig, &other, settings)
        };
        let other = other.map(hang).transpose()?;
        Ok(Self {
            condition,
            rig,
            scene,
            other,
            depth_mm,
            random,
        })
    }

    /// Runs all noise levels and motions.
    pub fn run(&mut self) -> Vec<(f64, Outcome)> {
        let mut outcomes = Vec::new();
        for noise_grey in self.condition.noise_grey {
            for _ in 0..MOVES {
                let outcome = self.trial(*noise_grey);
                let outcome = outcome.unwrap_or_else(|refusal| Outcome::Refused(refusal.name()));
                outcomes.push((*noise_grey, outcome));
            }
        }
        outcomes
    }

    /// Returns a random motion of the target, mm.
    fn motion(&mut self) -> [f64; 3] {
        let mm_per_px = self.depth_mm / self.rig.mean_focal_px();
        let [low, high] = self.condition.move_px.map(|px| px * mm_per_px);
        let away = self.condition.away * self.depth_mm;
        let length = self.random.between(low, high);
        let angle = self.random.between(0.0, core::f64::consts::TAU);
        let z = self.random.between(-away, away);
        [length * angle.cos(), length * angle.sin(), z]
    }

    fn trial(&mut self, noise_grey: f64) -> Result<Outcome, FlowRefusal> {
        let moved = self.motion();
        // View another part of the poster in every trial, at every phase.
        let place = [(); 2].map(|()| self.random.between(-300.0, 300.0));
        self.scene.look_at(place);
        if let Some(other) = &mut self.other {
            other.look_at(place);
        }
        let seed = self.random.next_u64();
        let cameras = self.rig.cameras.len();
        let which = self.random.below(cameras);

        let still = Exposure::of(Pose::default(), noise_grey);
        let mut shots = vec![Exposure::of(Pose::at(moved), noise_grey); cameras];
        let random = &mut self.random;
        match self.condition.change {
            Change::Light { per_camera } => {
                let mut light = || (random.between(0.7, 1.4), random.between(-20.0, 20.0));
                let common = light();
                for shot in &mut shots {
                    (shot.gain, shot.offset_grey) = if per_camera { light() } else { common };
                }
            }
            Change::Smear { px } => {
                let half = 0.5 * random.unit() * px * self.depth_mm / self.rig.mean_focal_px();
                let angle = random.between(0.0, core::f64::consts::TAU);
                let along = [half * angle.cos(), half * angle.sin(), 0.0];
                let ends =
                    [-1.0, 1.0].map(|s| Pose::at(std::array::from_fn(|i| moved[i] + s * along[i])));
                for shot in &mut shots {
                    shot.poses = ends;
                }
            }
            Change::Turn {
                axis,
                degrees: [low, high],
            } => {
                let angle = random.between(low, high);
                let way = if random.unit() < 0.5 { -1.0 } else { 1.0 };
                let mut pose = Pose::at(moved);
                pose.turned_deg[axis] = way * angle;
                for shot in &mut shots {
                    shot.poses = [pose; 2];
                }
            }
            Change::Late { share: [low, high] } => {
                let share = 1.0 + random.between(low, high);
                shots[which].poses = [Pose::at(moved.map(|m| share * m)); 2];
            }
            Change::Nothing | Change::Cover { .. } | Change::Replaced | Change::Fail(_) => {}
        }
        let mut before = self.scene.render_exposures(&vec![still; cameras], 0, seed);
        let mut now = self.scene.render_exposures(&shots, 33_333, seed ^ 1);
        match (self.condition.change, &self.other) {
            (Change::Cover { own, .. }, Some(cover)) => {
                let own = if own {
                    moved
                } else {
                    self.motion_of_cover(moved)
                };
                let front = cover.render_exposures(&vec![still; cameras], 0, seed ^ 2);
                self.cover(&mut before, front, [0.0; 3]);
                let shot = Exposure::of(Pose::at(own), noise_grey);
                let front = cover.render_exposures(&vec![shot; cameras], 0, seed ^ 3);
                self.cover(&mut now, front, own);
            }
            (Change::Replaced, Some(other)) => {
                now = other.render_exposures(&shots, 33_333, seed ^ 1)
            }
            (Change::Fail(failure), _) => {
                let view = &mut now.images[which];
                match failure {
                    Failure::Missing => *view = Image::missing(),
                    Failure::Frozen => view.clone_from(&before.images[which]),
                    Failure::Dark => {
                        let noise = Random::new(seed, 99);
                        *view = dark(view, noise_grey, noise);
                    }
                }
            }
            _ => {}
        }
        let mut flow = Flow::new(&self.rig, FlowSettings::default())?;
        flow.set_keyframe(&before)?;
        let seen = flow.measure(&now)?;
        let sums = Sums::of(&self.rig, &seen).map_err(|_| FlowRefusal::WrongRig)?;
        let estimate = midpoint::solve(&sums.centred).map_err(|_| FlowRefusal::WrongRig)?;
        Ok(Outcome::Measured {
            error_mm: std::array::from_fn(|i| estimate.displacement_mm[i] - moved[i]),
            sigma_mm: estimate.sigma_mm(),
            points: seen.correspondences.len(),
            said: says(&seen, self.condition, which),
        })
    }

    /// Returns a motion that differs from the target's by at least two pixels.
    fn motion_of_cover(&self, moved: [f64; 3]) -> [f64; 3] {
        let mut random = self.random.clone();
        let px = self.depth_mm / self.rig.mean_focal_px();
        let angle = random.between(0.0, core::f64::consts::TAU);
        let length = random.between(2.0, 15.0) * px;
        [
            moved[0] + length * angle.cos(),
            moved[1] + length * angle.sin(),
            moved[2] + random.between(-5.0, 5.0),
        ]
    }

    /// Covers the right two fifths of the middle image with `front`, whose left edge is a vertical
    /// line in space.
    fn cover(&self, capture: &mut FrameSet, front: FrameSet, moved: [f64; 3]) {
        let z = COVER * self.depth_mm;
        let middle = &self.rig.cameras[self.rig.cameras.len() / 2];
        let [x, _] = middle.normalise([0.6 * f64::from(self.rig.image_size_px[0]), 0.0]);
        let edge_mm = [x * z + moved[0], 0.0, z + moved[2]];
        let views = capture.images.iter_mut().zip(front.images);
        for ((view, front), camera) in views.zip(&self.rig.cameras) {
            let [edge, _] = camera.project(edge_mm);
            for (i, (grey, front)) in view.grey.iter_mut().zip(front.grey).enumerate() {
                // The pixel on the edge is a mixture of both.
                let share = ((i % view.width) as f64 + 0.5 - edge).clamp(0.0, 1.0);
                let [front, behind] = [front, *grey].map(f64::from);
                *grey = (behind + share * (front - behind)).round() as u8;
            }
        }
    }
}

/// Returns an image of the inside of a lens cap.
fn dark(like: &Image, noise_grey: f64, mut random: Random) -> Image {
    let grey = || (5.0 + noise_grey * random.gaussian()).round() as u8;
    Image {
        grey: std::iter::repeat_with(grey).take(like.grey.len()).collect(),
        ..*like
    }
}

/// Returns true if the measurement refused exactly the cameras it must. `which` is the camera at
/// fault.
fn says(seen: &Measurement, condition: &Condition, which: usize) -> bool {
    let expected = |absence: &CameraRefusal| match (condition.change, absence) {
        (Change::Fail(failure), absence) => matches!(
            (failure, absence),
            (Failure::Missing, CameraRefusal::Missing)
                | (Failure::Dark, CameraRefusal::Blank)
                | (Failure::Frozen, CameraRefusal::Frozen)
        ),
        (Change::Late { .. }, CameraRefusal::Unsynchronised { share }) => *share > 0.0,
        _ => false,
    };
    match seen.refused_cameras.as_slice() {
        [] => !condition.change.is_of_one_camera(),
        [(camera, absence)] => *camera == which && expected(absence),
        _ => false,
    }
}
