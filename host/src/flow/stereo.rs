//! Where one camera's points appear in the others, without knowing their depth.
//!
//! In a parallel rig one unknown per point, its inverse depth `ρ`, says where it appears in *all* cameras at once:
//!
//! ```text
//! ξ_k = ξ_0 - (c_k - c_0) ρ
//! ```
//!
//! So the search runs over `ρ` from infinity to the largest disparity that the images allow, and each try is judged by the mean
//! correlation over all other cameras: what repeats in one pair of views rarely repeats in two with different baselines. A point whose
//! second-best depth is nearly as good as its best is ambiguous and dropped.

use super::patch::{Patch, Scratch};
use super::plane::Pyramid;
use shared::rig::{Camera, Rig};

/// Half side of the square that is compared, px of the level searched.
const RADIUS: usize = 5;

/// Level of the pyramid searched: half the resolution.
const LEVEL: usize = 1;

/// Mean correlation that a match must reach.
const MIN_LIKENESS: f32 = 0.75;

/// Another depth this much less alike is another match: the point is ambiguous.
const MARGIN: f32 = 0.06;

/// The largest disparity between the outermost cameras, as a share of the image's longer side.
const MAX_DISPARITY: f64 = 0.8;

/// How a search for one point ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Match {
    /// At this inverse depth, 1/mm.
    At(f64),
    /// No depth makes the views alike.
    Unmatched,
    /// Several depths do.
    Ambiguous,
}

/// The search for a rig seen from one of its cameras.
#[derive(Clone, Debug)]
pub struct Search {
    cameras: Vec<Camera>,
    home: usize,
    /// Inverse depth between two tries, 1/mm: half a pixel of the level at the longest baseline.
    step: f64,
    tries: usize,
}

impl Search {
    /// For points given in the image of camera `home`.
    pub fn new(rig: &Rig, home: usize) -> Self {
        let cameras = rig.cameras.to_vec();
        let away = |camera: &Camera| {
            let [x, y] = camera.offset_mm;
            let [hx, hy] = cameras[home].offset_mm;
            (x - hx).hypot(y - hy)
        };
        let longest = cameras.iter().map(away).fold(0.0, f64::max);
        let widest = longest_baseline(&cameras);
        let focal = rig.mean_focal_px();
        let pixels_per_step = 0.5 * (1 << LEVEL) as f64;
        let step = pixels_per_step / (focal * longest);
        let largest_px = MAX_DISPARITY * f64::from(rig.image_size_px[0].max(rig.image_size_px[1]));
        let tries = (largest_px / (focal * widest) / step).ceil() as usize + 1;
        Self {
            cameras,
            home,
            step,
            tries,
        }
    }

    /// Finds the inverse depth of the point at `pixel` of the home camera.
    pub fn find(&self, views: &[Pyramid], pixel: [f32; 2], scratch: &mut Scratch) -> Match {
        let level = LEVEL.min(views[self.home].levels.len() - 1);
        let scale = (1usize << level) as f32;
        let centre = pixel.map(|p| p / scale);
        let Some(patch) = Patch::new(&views[self.home].levels[level], centre, RADIUS, scratch)
        else {
            return Match::Unmatched;
        };
        let scores: Vec<f32> = (0..self.tries)
            .map(|i| self.score(views, &patch, pixel, i as f64 * self.step, level, scratch))
            .collect();
        judge(&scores).map_or_else(|failure| failure, |at| Match::At(at * self.step))
    }

    /// Where the point appears in camera `k`, px, if it has inverse depth `rho` (1/mm).
    pub fn project(&self, pixel: [f32; 2], rho: f64, k: usize) -> [f32; 2] {
        let (home, camera) = (&self.cameras[self.home], &self.cameras[k]);
        let seen = home.normalise(pixel.map(f64::from));
        let moved =
            std::array::from_fn(|i| seen[i] - (camera.offset_mm[i] - home.offset_mm[i]) * rho);
        camera.denormalise(moved).map(|p| p as f32)
    }

    /// Mean likeness over the other cameras; -1 if one of them does not see it.
    fn score(
        &self,
        views: &[Pyramid],
        patch: &Patch,
        pixel: [f32; 2],
        rho: f64,
        level: usize,
        scratch: &mut Scratch,
    ) -> f32 {
        let scale = (1usize << level) as f32;
        let mut total = 0.0;
        for k in (0..self.cameras.len()).filter(|k| *k != self.home) {
            let at = self.project(pixel, rho, k).map(|p| p / scale);
            match patch.likeness(&views[k].levels[level], at, scratch) {
                Some(likeness) => total += likeness,
                None => return -1.0,
            }
        }
        total / (self.cameras.len() - 1) as f32
    }
}

/// The best try as a fraction of steps, unless a separate peak is nearly as good.
fn judge(scores: &[f32]) -> Result<f64, Match> {
    let best = (0..scores.len())
        .max_by(|&a, &b| scores[a].total_cmp(&scores[b]))
        .ok_or(Match::Unmatched)?;
    if scores[best] < MIN_LIKENESS {
        return Err(Match::Unmatched);
    }
    // The best peak's own slopes end where the score rises again.
    let mut low = best;
    while low > 0 && scores[low - 1] <= scores[low] {
        low -= 1;
    }
    let mut high = best;
    while high + 1 < scores.len() && scores[high + 1] <= scores[high] {
        high += 1;
    }
    let others = scores[..low].iter().chain(&scores[high..]);
    if others.copied().fold(-1.0, f32::max) > scores[best] - MARGIN {
        return Err(Match::Ambiguous);
    }
    let at = |i: Option<usize>| i.and_then(|i| scores.get(i)).copied();
    let peak = match (at(best.checked_sub(1)), at(Some(best + 1))) {
        (Some(left), Some(right)) if left > -1.0 && right > -1.0 => {
            let bend = left + right - 2.0 * scores[best];
            if bend < 0.0 {
                0.5 * f64::from((left - right) / bend)
            } else {
                0.0
            }
        }
        _ => 0.0,
    };
    Ok(best as f64 + peak.clamp(-0.5, 0.5))
}

fn longest_baseline(cameras: &[Camera]) -> f64 {
    let pairs = cameras
        .iter()
        .flat_map(|a| cameras.iter().map(move |b| (a.offset_mm, b.offset_mm)));
    pairs
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_clear_peak_wins_and_two_are_ambiguous() {
        let peak = |centre: f32, height: f32| {
            move |i: usize| height * (-((i as f32 - centre) / 2.0).powi(2)).exp()
        };
        let one: Vec<f32> = (0..60).map(peak(20.3, 0.95)).collect();
        assert!((judge(&one).unwrap() - 20.3).abs() < 0.05);
        let second = peak(45.0, 0.93);
        let two: Vec<f32> = one
            .iter()
            .enumerate()
            .map(|(i, s)| s.max(second(i)))
            .collect();
        assert_eq!(judge(&two), Err(Match::Ambiguous));
        let low: Vec<f32> = (0..60).map(peak(20.0, 0.5)).collect();
        assert_eq!(judge(&low), Err(Match::Unmatched));
        assert_eq!(judge(&[]), Err(Match::Unmatched));
    }

    #[test]
    fn the_search_covers_300_mm_with_the_papers_rig() {
        let search = Search::new(&Rig::paper(), 1);
        assert!(search.tries as f64 * search.step >= 1.0 / 300.0);
    }
}
