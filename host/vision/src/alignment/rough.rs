//! Rough offsets of many pixels, to about one pixel: corners are searched in a wide band around
//! their epipolar lines, and the offset with the most votes wins.

use trinocular_core::rig::Rig;

use super::fit::{Point, Sample, corrected};
use super::{AlignmentRefusal, AlignmentSettings};
use crate::images::{FrameSet, Image};
use crate::matching::corner::{self, CornerSettings};
use crate::matching::geometry::RigGeometry;
use crate::matching::pyramid::Pyramid;
use crate::matching::zncc::{OUTSIDE, ZnccPatch, ZnccPlane};
use crate::thread_pool::ThreadPool;

/// Largest width of the searched pyramid level, px.
const WIDTH: usize = 240;
/// Number of corners per frame set.
const CORNERS: usize = 150;
/// Least correlation of a match that may vote.
const MIN_ZNCC: f32 = 0.75;
/// Largest disparity to any camera, in image widths.
const LARGEST_DISPARITY: f64 = 0.5;
/// Largest distance of votes for the same offset, px of the searched level.
const ALIKE_PX: f64 = 1.5;
/// Least number of votes for an offset, and their least share of all.
const LEAST_VOTES: usize = 8;
const LEAST_SHARE: f64 = 0.15;

/// Corrects the principal points of `rig` to about a pixel, as far as the images show them.
///
/// # Errors
/// [`AlignmentRefusal::WrongRig`], [`AlignmentRefusal::NoRoughOffset`].
pub fn align(
    rig: &Rig,
    frame_sets: &[FrameSet],
    settings: &AlignmentSettings,
) -> Result<Rig, AlignmentRefusal> {
    let reach_px = settings.reach_px;
    let geometry = RigGeometry::new(rig).ok_or(AlignmentRefusal::WrongRig)?;
    let level = (1..)
        .find(|level| rig.image_size_px[0] as usize >> level <= WIDTH)
        .unwrap_or(1);
    let scale = (1 << level) as f64;
    let mut samples = Vec::new();
    for frame_set in frame_sets {
        let points = matches(&geometry, frame_set, level, settings);
        samples.extend(points.iter().map(|point| Sample::of(&geometry, point)));
    }
    let alike = ALIKE_PX * scale / geometry.focal_px;
    let agree = |a: &Sample, b: &Sample| {
        let components = a.components.iter().zip(&b.components);
        components.into_iter().all(|(a, b)| (a - b).abs() < alike)
    };
    let votes = |candidate: &Sample| samples.iter().filter(|s| agree(candidate, s)).count();
    let best = samples.iter().max_by_key(|candidate| votes(candidate));
    let agreeing: Vec<&Sample> = best
        .map(|best| samples.iter().filter(|s| agree(best, s)).collect())
        .unwrap_or_default();
    let count = agreeing.len();
    if count < LEAST_VOTES || (count as f64) < LEAST_SHARE * samples.len() as f64 {
        return Err(AlignmentRefusal::NoRoughOffset {
            reach_px,
            agree: count,
            found: samples.len(),
        });
    }
    let components = agreeing.first().map_or(0, |s| s.components.len());
    let mean: Vec<f64> = (0..components)
        .map(|c| agreeing.iter().map(|s| s.components[c]).sum::<f64>() / count as f64)
        .collect();
    Ok(corrected(rig, geometry.reference, &mean))
}

/// Matches corners of the reference image in every other camera, each at the best correlation
/// within the search range around its epipolar line.
fn matches(
    geometry: &RigGeometry,
    frame_set: &FrameSet,
    level: usize,
    settings: &AlignmentSettings,
) -> Vec<Point> {
    let sides = geometry.rig.image_size_px.map(|side| side as usize);
    let is_whole = |image: &Image| [image.width, image.height] == sides;
    if frame_set.images.len() != geometry.cameras() || !frame_set.images.iter().all(is_whole) {
        return Vec::new();
    }
    let mut levels = Vec::new();
    for image in &frame_set.images {
        levels.extend(Pyramid::new(image, level + 1).levels.pop());
    }
    let planes: Vec<ZnccPlane> = levels.iter().map(ZnccPlane::new).collect();
    let scale = (1 << level) as f64;
    let Some(base) = levels.get(geometry.reference) else {
        return Vec::new();
    };
    let chosen = CornerSettings {
        margin: 8,
        spacing_px: 6.0,
        min_gradient: 1.0,
        count: CORNERS,
    };
    let is_within = |at: [usize; 2]| {
        let pixel = at.map(|c| c as f64 * scale);
        settings.regions.allow_start(geometry.reference, pixel)
    };
    let corners = corner::corners_within(base, &chosen, &ThreadPool::default(), is_within);
    let found = corners.into_iter().filter_map(|corner| {
        let patch = planes[geometry.reference].patch(corner[0] as i64, corner[1] as i64)?;
        let corner_px = corner.map(|c| c as f64 * scale);
        let mut pixels = vec![corner_px; geometry.cameras()];
        for k in (0..geometry.cameras()).filter(|k| *k != geometry.reference) {
            let band = EpipolarBand::new(geometry, k, corner_px, scale, settings.reach_px);
            let (zncc, place) = band.best_match(&planes[k], &patch);
            if zncc < MIN_ZNCC {
                return None;
            }
            pixels[k] = place.map(|p| p as f64 * scale);
        }
        Some(Point { pixels })
    });
    found.collect()
}

/// Band around an epipolar line, px of the searched level.
struct EpipolarBand {
    start: [f64; 2],
    along: [f64; 2],
    length: f64,
    reach: f64,
}

impl EpipolarBand {
    fn new(geometry: &RigGeometry, k: usize, corner: [f64; 2], scale: f64, reach_px: f64) -> Self {
        let [reference, other] = [geometry.reference, k].map(|k| geometry.rig.cameras[k].offset_mm);
        let baseline = (other[0] - reference[0]).hypot(other[1] - reference[1]);
        let px_per_inverse_mm = geometry.focal_px * baseline;
        let at = geometry.normalise(geometry.reference, corner);
        let side = geometry.rig.image_size_px.into_iter().max().unwrap_or(0);
        let farthest = LARGEST_DISPARITY * f64::from(side) / px_per_inverse_mm;
        // Disparities below zero too: the offset along the line is as unknown as the one across.
        let ends = [-reach_px / px_per_inverse_mm, farthest]
            .map(|depth| geometry.transfer(k, at, depth).map(|p| p / scale));
        let way = [0, 1].map(|i| ends[1][i] - ends[0][i]);
        let length = way[0].hypot(way[1]);
        Self {
            start: ends[0],
            along: way.map(|w| w / length),
            length,
            reach: reach_px / scale,
        }
    }

    /// Finds the place in the band that correlates best with `patch`, and its zncc.
    fn best_match(&self, plane: &ZnccPlane, patch: &ZnccPatch) -> (f32, [i64; 2]) {
        let size = plane.size();
        let extent = |i: usize| {
            let ends = [self.start[i], self.start[i] + self.length * self.along[i]];
            let low = ends[0].min(ends[1]) - self.reach;
            let high = ends[0].max(ends[1]) + self.reach;
            (
                low.floor().max(0.0) as i64,
                high.ceil().min(size[i] as f64 - 1.0) as i64,
            )
        };
        let ((left, right), (top, bottom)) = (extent(0), extent(1));
        let mut best = (OUTSIDE, [0, 0]);
        let mut row = vec![OUTSIDE; usize::try_from(right - left + 1).unwrap_or(0)];
        for y in top..=bottom {
            plane.correlate(patch, left, y, &mut row);
            for (x, zncc) in (left..).zip(&row) {
                if *zncc > best.0 && self.contains([x, y]) {
                    best = (*zncc, [x, y]);
                }
            }
        }
        best
    }

    fn contains(&self, at: [i64; 2]) -> bool {
        let [x, y] = [0, 1].map(|i| at[i] as f64 - self.start[i]);
        let along = x * self.along[0] + y * self.along[1];
        let across = y * self.along[0] - x * self.along[1];
        across.abs() <= self.reach && (0.0..=self.length).contains(&along)
    }
}
