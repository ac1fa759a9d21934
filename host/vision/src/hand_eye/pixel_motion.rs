//! Motion of the points of one camera's keyframe, without any other camera.
//!
//! A point that is not found in an image is never used again, in that image and in those before.
//! Each image then shows the same points, and their mean position moves as the camera does.

use crate::images::Image;
use crate::matching::MatchSettings;
use crate::matching::corner::corners;
use crate::matching::lucas_kanade::{CoarseTemplate, FineTemplate};
use crate::matching::pyramid::Pyramid;
use crate::median::median;
use crate::thread_pool::ThreadPool;
use thiserror::Error;

/// Largest number of points. Noise of the mean is then far below that of the stage's own motion.
const MOST: usize = 80;

/// Least number of points.
const FEWEST: usize = 8;

/// Least distance between two points, px.
const SPACING_PX: f64 = 10.0;

/// Pyramid levels: those above 0 find a point that has moved by up to 15 px since the last image.
const LEVELS: usize = 3;

/// Largest number of Lucas-Kanade steps.
const STEPS: usize = 16;

/// Least share of the points that an image must show.
const LEAST_SHARE: f64 = 0.7;

/// Reason why a camera's points cannot be followed.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum PointsRefusal {
    /// The keyframe has too few corners.
    #[error(
        "its image has {found} points that can be followed, {FEWEST} are needed: show it a target \
         with texture, in focus and well lit"
    )]
    Plain {
        /// Number of corners.
        found: usize,
    },
    /// Too few points were found in all images.
    #[error(
        "only {left} of its points were seen in all images, {FEWEST} are needed: use a shorter \
         --reach, or a target that fills the view"
    )]
    Lost {
        /// Number of points that were found in all images.
        left: usize,
    },
}

/// Point of the keyframe.
struct Point {
    /// Pixel at the keyframe.
    at: [f64; 2],
    fine: Box<FineTemplate>,
    is_lost: bool,
}

/// Points of one camera's keyframe, and where later images show them.
pub struct PixelMotion {
    points: Vec<Point>,
    keyframe: Pyramid,
    now: Pyramid,
    /// Motion from the keyframe to the last image that showed the points, px.
    last_px: [f64; 2],
    /// Motion of each point, image by image, px; `None` if it was not found.
    images: Vec<Vec<Option<[f64; 2]>>>,
}

impl PixelMotion {
    /// Takes the keyframe.
    ///
    /// # Errors
    /// [`PointsRefusal::Plain`] if it has too few corners.
    pub fn start(keyframe: &Image) -> Result<Self, PointsRefusal> {
        let pyramid = Pyramid::new(keyframe, LEVELS);
        let plane = &pyramid.levels[0];
        let margin = FineTemplate::MARGIN;
        let found = corners(plane, margin, SPACING_PX, MOST, &ThreadPool::default());
        let point = |[x, y]: [usize; 2]| {
            let fine = FineTemplate::new(plane, [x as f32, y as f32])?;
            let at = [x as f64, y as f64];
            let is_lost = false;
            Some(Point { at, fine, is_lost })
        };
        let points: Vec<Point> = found.into_iter().filter_map(point).collect();
        match points.len() < FEWEST {
            true => Err(PointsRefusal::Plain {
                found: points.len(),
            }),
            false => Ok(Self {
                points,
                keyframe: pyramid,
                now: Pyramid::default(),
                last_px: [0.0; 2],
                images: Vec::new(),
            }),
        }
    }

    /// Follows the points into an image; returns false, and does not count the image, if it does
    /// not show most of them.
    pub fn look(&mut self, image: &Image) -> bool {
        self.now.refill(image, LEVELS);
        let mut motions = self.follow(self.last_px);
        if !self.is_enough(&motions) {
            motions = self.follow(self.search());
        }
        if !self.is_enough(&motions) {
            return false;
        }
        for (point, motion) in self.points.iter_mut().zip(&motions) {
            point.is_lost |= motion.is_none();
        }
        self.last_px = middle(motions.iter().flatten());
        self.images.push(motions);
        true
    }

    /// Returns the mean motion of the points in each image that counts, px.
    ///
    /// # Errors
    /// [`PointsRefusal::Lost`] if too few points were found in all of them.
    pub fn means(&self) -> Result<Vec<[f64; 2]>, PointsRefusal> {
        let left = self.points.iter().filter(|point| !point.is_lost).count();
        if left < FEWEST {
            return Err(PointsRefusal::Lost { left });
        }
        let mean = |motions: &Vec<Option<[f64; 2]>>| {
            let seen = motions.iter().zip(&self.points);
            let seen = seen.filter(|(_, point)| !point.is_lost);
            let sum = seen.fold([0.0; 2], |[x, y], (motion, _)| {
                let [dx, dy] = motion.unwrap_or_default();
                [x + dx, y + dy]
            });
            sum.map(|sum| sum / left as f64)
        };
        Ok(self.images.iter().map(mean).collect())
    }

    fn is_enough(&self, motions: &[Option<[f64; 2]>]) -> bool {
        let kept = self.points.iter().zip(motions);
        let kept = kept.filter(|(point, _)| !point.is_lost);
        let (found, all) = kept.fold((0, 0), |(found, all): (usize, usize), (_, motion)| {
            (found + usize::from(motion.is_some()), all + 1)
        });
        found >= FEWEST && found as f64 >= LEAST_SHARE * all as f64
    }

    /// Follows the points from where a common motion puts them.
    fn follow(&self, moved_px: [f64; 2]) -> Vec<Option<[f64; 2]>> {
        let plane = &self.now.levels[0];
        let settings = MatchSettings::default();
        let follow = |point: &Point| {
            if point.is_lost {
                return None;
            }
            let start = moved(point.at, moved_px, 1.0);
            let found = point.fine.find(plane, start, UNWARPED, STEPS)?;
            let found = found.checked(&settings).ok()?.at.map(f64::from);
            Some([found[0] - point.at[0], found[1] - point.at[1]])
        };
        self.points.iter().map(follow).collect()
    }

    /// Returns the common motion by the coarse levels; none if they do not show it.
    fn search(&self) -> [f64; 2] {
        let mut moved_px = self.last_px;
        for level in (1..LEVELS).rev() {
            let scale = (1 << level) as f64;
            let [before, now] = [&self.keyframe, &self.now].map(|images| &images.levels[level]);
            let motion = |point: &Point| {
                let template = CoarseTemplate::new(before, moved(point.at, [0.0; 2], scale))?;
                let start = moved(point.at, moved_px, scale);
                let found = template.find(now, start, UNWARPED, STEPS)?;
                let found = found.checked(&MatchSettings::default()).ok()?;
                let found = found.at.map(|p| f64::from(p) * scale);
                Some([found[0] - point.at[0], found[1] - point.at[1]])
            };
            let motions: Vec<_> = self.points.iter().filter_map(motion).collect();
            moved_px = middle(motions.iter());
        }
        moved_px
    }
}

/// Warp of a window that is only moved.
const UNWARPED: [[f32; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

/// Returns the pixel of a level at which a motion puts a point.
fn moved(at: [f64; 2], by: [f64; 2], scale: f64) -> [f32; 2] {
    [0, 1].map(|axis| ((at[axis] + by[axis]) / scale) as f32)
}

/// Returns the median motion; none without motions.
fn middle<'a>(motions: impl Iterator<Item = &'a [f64; 2]> + Clone) -> [f64; 2] {
    [0, 1].map(|axis| median(motions.clone().map(|motion| motion[axis]).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::{Scene, SceneSettings, Texture};
    use trinocular_core::rig::Rig;

    fn scene() -> Scene {
        let settings = SceneSettings::default();
        Scene::new(&Rig::paper(), &Texture::natural(1), settings).expect("in range")
    }

    /// One mm is 0.6 px here.
    fn image(scene: &Scene, x_mm: f64, seed: u64) -> Image {
        let mut images = scene.render([x_mm, 0.0, 0.0], 0, seed).images;
        images.swap_remove(1)
    }

    #[test]
    fn points_move_with_the_target() {
        let scene = scene();
        let mut motion = PixelMotion::start(&image(&scene, 0.0, 1)).expect("texture");
        let places_mm = [1.0, 2.5, 20.0, 1.0];
        for (seed, x_mm) in (2..).zip(places_mm) {
            assert!(motion.look(&image(&scene, x_mm, seed)), "{x_mm} mm");
        }
        let means = motion.means().expect("points");
        let px_per_mm = means[2][0] / 20.0;
        assert!((0.55..0.7).contains(&px_per_mm), "{px_per_mm}");
        for ([x, y], x_mm) in means.iter().zip(places_mm) {
            assert!((x - px_per_mm * x_mm).abs() < 0.02, "{x_mm} mm: {x} px");
            assert!(y.abs() < 0.02, "{x_mm} mm: {y} px");
        }
    }

    #[test]
    fn image_without_the_points_is_not_counted() {
        let scene = scene();
        let mut motion = PixelMotion::start(&image(&scene, 0.0, 1)).expect("texture");
        let mut dark = image(&scene, 0.0, 2);
        dark.grey.fill(7);
        assert!(!motion.look(&dark));
        assert!(motion.look(&image(&scene, 3.0, 3)));
        assert_eq!(motion.means().expect("points").len(), 1);
    }

    #[test]
    fn plain_image_is_refused() {
        let plain = Image {
            width: 320,
            height: 240,
            grey: vec![90; 320 * 240],
        };
        let refused = PixelMotion::start(&plain).err();
        assert_eq!(refused, Some(PointsRefusal::Plain { found: 0 }));
    }
}
