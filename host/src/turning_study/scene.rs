//! Layouts of the study: one or two objects in the picture, and their motions.
//!
//! Everything is before the paper's rig. An object is a rectangle on a poster, which may be larger
//! than the picture; the nearer object covers the farther one.

use nalgebra::{Rotation3, Vector3};
use trinocular_core::rig::Rig;
use trinocular_rig::random::Random;
use trinocular_vision::images::{
    Exposure, FrameSet, Pose, Scene, SceneError, SceneSettings, Texture,
};

/// Distances of the nearer and the farther object at the keyframe, mm.
const DEPTHS_MM: [f64; 2] = [850.0, 1000.0];
/// Half of the width and of the height of the picture, in tangents of the angle from its middle.
const HALF_PICTURE: [f64; 2] = [0.30, 0.225];
/// Largest displacement along x, y and z, mm.
const MOST_MM: [f64; 3] = [10.0, 10.0, 10.0];
/// Largest rotation, degrees.
const MOST_DEG: f64 = 12.0;
/// Share of the picture from which an object may count as the target. The margin of the picture has
/// no points, and cells at the edge of an object count whole: a rectangle in the middle of the
/// picture that takes two fifths of it is half of what counts.
pub const LEAST_TARGET: f64 = 0.4;

/// Arrangement of the objects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Name in the table.
    pub name: &'static str,
    /// Least and largest share of the picture that the nearer object takes.
    pub share: [f64; 2],
    /// True if the nearer object turns.
    pub near_turns: bool,
    /// True if the farther object turns.
    pub far_turns: bool,
    /// Least and largest difference of the displacements of two objects that move without turning,
    /// mm; `None` if an object that does not turn rests.
    pub apart_mm: Option<[f64; 2]>,
}

impl Layout {
    /// Returns true if two objects move apart by less than what makes an outlier. A step in depth
    /// between them looks like a rotation, so that nothing is claimed.
    pub fn is_close(&self) -> bool {
        self.apart_mm.is_some_and(|[least, _]| least < 0.1)
    }
}

/// All layouts, in the order of the table.
pub const LAYOUTS: [Layout; 5] = [
    Layout {
        name: "alone",
        share: [1.0, 1.0],
        near_turns: true,
        far_turns: false,
        apart_mm: None,
    },
    Layout {
        name: "before-background",
        share: [0.3, 0.8],
        near_turns: true,
        far_turns: false,
        apart_mm: None,
    },
    Layout {
        name: "covered",
        share: [0.2, 0.7],
        near_turns: false,
        far_turns: true,
        apart_mm: None,
    },
    Layout {
        name: "apart",
        share: [0.3, 0.7],
        near_turns: false,
        far_turns: false,
        // Half a pixel to eight.
        apart_mm: Some([0.8, 12.0]),
    },
    Layout {
        name: "close",
        share: [0.35, 0.65],
        near_turns: false,
        far_turns: false,
        // Less than what makes an outlier.
        apart_mm: Some([0.02, 1.5]),
    },
];

/// Motion of one object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Point of the object whose displacement is known, mm.
    pub pivot_mm: [f64; 3],
    /// Displacement of the pivot, mm.
    pub moved_mm: [f64; 3],
    /// Rotation vector, degrees.
    pub turned_deg: [f64; 3],
    /// Share of the picture that the object takes.
    pub share: f64,
}

impl Truth {
    /// Returns the rotation.
    pub fn rotation(&self) -> Rotation3<f64> {
        Rotation3::new(Vector3::from(self.turned_deg.map(f64::to_radians)))
    }

    fn pose(&self) -> Pose {
        Pose {
            relative_mm: self.moved_mm,
            turned_deg: self.turned_deg,
        }
    }
}

/// Images at the keyframe and now, with the truth about every object.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// Images at the keyframe.
    pub before: FrameSet,
    /// Images now.
    pub now: FrameSet,
    /// The objects, the nearer one first.
    pub objects: Vec<Truth>,
}

/// Posters of one seed, at both distances.
pub struct Bench {
    rig: Rig,
    posters: [Scene; 2],
    random: Random,
}

impl Bench {
    /// Draws the posters.
    ///
    /// # Errors
    /// If they cannot be rendered.
    pub fn new(seed: u64) -> Result<Self, SceneError> {
        let rig = Rig::paper();
        let poster = |depth_mm, texture: u64| {
            let settings = SceneSettings {
                depth_mm,
                ..SceneSettings::default()
            };
            Scene::new(&rig, &Texture::natural(texture), settings)
        };
        let [near, far] = DEPTHS_MM;
        let posters = [poster(near, 2 * seed)?, poster(far, 2 * seed + 1)?];
        Ok(Self {
            rig,
            posters,
            random: Random::new(seed, 77),
        })
    }

    /// Returns the rig.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Renders another scene of a layout, with noise of `noise_grey` grey levels.
    pub fn render(&mut self, layout: &Layout, noise_grey: f64) -> Rendering {
        let [low, high] = layout.share;
        let share = self.random.between(low, high);
        for poster in &mut self.posters {
            poster.look_at([(); 2].map(|()| self.random.between(-250.0, 250.0)));
        }
        let near = self.motion(layout, layout.near_turns, DEPTHS_MM[0], share);
        let mut far = self.motion(layout, layout.far_turns, DEPTHS_MM[1], 1.0 - share);
        if let Some([least, most]) = layout.apart_mm {
            let way = self.random.between(0.0, core::f64::consts::TAU);
            let length = self.random.between(least, most);
            let [x, y, z] = near.moved_mm;
            let away = self.random.between(-0.3, 0.3) * length;
            far.moved_mm = [x + length * way.cos(), y + length * way.sin(), z + away];
        }
        let corners = (share < 1.0).then(|| self.rectangle(share));
        let still = Truth {
            moved_mm: [0.0; 3],
            turned_deg: [0.0; 3],
            ..near
        };
        let [seed, next] = [(); 2].map(|()| self.random.next_u64());
        let before = self.picture([still; 2], corners, noise_grey, seed);
        let mut now = self.picture([near, far], corners, noise_grey, next);
        now.time_us = 33_333;
        let objects = match corners {
            Some(_) => vec![near, far],
            None => vec![near],
        };
        Rendering {
            before,
            now,
            objects,
        }
    }

    fn motion(&mut self, layout: &Layout, turns: bool, depth_mm: f64, share: f64) -> Truth {
        let random = &mut self.random;
        let mut truth = Truth {
            pivot_mm: [0.0, 0.0, depth_mm],
            moved_mm: [0.0; 3],
            turned_deg: [0.0; 3],
            share,
        };
        if turns || layout.apart_mm.is_some() {
            truth.moved_mm = MOST_MM.map(|most| random.between(-most, most));
        }
        if turns {
            let axis = Vector3::from([(); 3].map(|()| random.gaussian())).normalize();
            truth.turned_deg = (axis * random.between(0.0, MOST_DEG)).into();
        }
        truth
    }

    /// Returns the corners on its poster of a nearer object that takes a share of the picture, mm:
    /// one side of the picture, or a rectangle in it.
    fn rectangle(&mut self, share: f64) -> [[f64; 2]; 4] {
        let [width, height] = HALF_PICTURE.map(|half| 2.0 * half * DEPTHS_MM[0]);
        let far = 2.0 * width;
        let (left, right, top, bottom) = match self.random.below(3) {
            0 => (-far, (share - 0.5) * width, -far, far),
            1 => (-far, far, (0.5 - share) * height, far),
            _ => {
                let [w, h] = [width, height].map(|side| side * share.sqrt());
                let [x, y] =
                    [width - w, height - h].map(|room| 0.5 * self.random.between(-room, room));
                (x - 0.5 * w, x + 0.5 * w, y - 0.5 * h, y + 0.5 * h)
            }
        };
        [[left, top], [right, top], [right, bottom], [left, bottom]]
    }

    /// Renders both objects, the nearer one within its corners; without corners it is everywhere.
    fn picture(
        &self,
        [near, far]: [Truth; 2],
        corners: Option<[[f64; 2]; 4]>,
        noise_grey: f64,
        seed: u64,
    ) -> FrameSet {
        let render = |poster: &Scene, truth: &Truth, seed| {
            let shot = Exposure::of(truth.pose(), noise_grey);
            poster.render_exposures(&vec![shot; self.rig.cameras.len()], 0, seed)
        };
        let front = render(&self.posters[0], &near, seed);
        let Some(corners) = corners else {
            return front;
        };
        let mut picture = render(&self.posters[1], &far, seed ^ 1);
        let rotation = near.rotation();
        let places = corners.map(|[u, v]| {
            let place = rotation * Vector3::new(u, v, 0.0);
            let place = place + Vector3::from(near.pivot_mm) + Vector3::from(near.moved_mm);
            <[f64; 3]>::from(place)
        });
        let views = picture.images.iter_mut().zip(front.images);
        for ((view, front), camera) in views.zip(&self.rig.cameras) {
            let corners = places.map(|place| camera.project(place));
            for (i, (grey, front)) in view.grey.iter_mut().zip(front.grey).enumerate() {
                let pixel = [(i % view.width) as f64, (i / view.width) as f64];
                // A pixel on the edge is a mixture of both.
                let share = (inside_px(&corners, pixel) + 0.5).clamp(0.0, 1.0);
                let [front, behind] = [front, *grey].map(f64::from);
                *grey = (behind + share * (front - behind)).round() as u8;
            }
        }
        picture
    }
}

/// Returns the distance of a pixel from the nearest side of a convex polygon, whose corners are
/// clockwise as seen in the image; negative outside.
fn inside_px(corners: &[[f64; 2]; 4], [x, y]: [f64; 2]) -> f64 {
    let sides = (0..4).map(|i| {
        let ([ax, ay], [bx, by]) = (corners[i], corners[(i + 1) % 4]);
        ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / (bx - ax).hypot(by - ay)
    });
    sides.fold(f64::INFINITY, f64::min)
}
