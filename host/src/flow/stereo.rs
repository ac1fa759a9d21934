//! Which pixel of every camera shows the same point, without any idea of its depth.
//!
//! One inverse depth predicts a point's place in all cameras at once. So every corner of the reference image is tried at all inverse
//! depths, in steps of half a pixel of a coarse level, and the likenesses in all cameras are averaged: what looks
//! right to one camera by chance looks wrong to the others. Every depth that is nearly as good as the best is refined by Lucas and
//! Kanade at full resolution; if two survive that are alike, the texture repeats and the corner is dropped as ambiguous.

use super::geometry::{Geometry, Ray};
use super::likeness::{Field, OUTSIDE};
use super::lucas_kanade::{Large, Small};
use super::pyramid::Pyramid;
use super::{Reason, Settings};

/// Disparities below zero that are tried, px: principal points are not known better.
const BEYOND_INFINITY_PX: f64 = 3.0;
/// The largest disparity to the farthest camera, in image widths: nearer points are outside some camera anyway.
const LARGEST_DISPARITY: f64 = 0.5;
/// The least disparity of a point that is of use, px: depth is not known beyond.
const LEAST_DISPARITY_PX: f64 = 1.0;
/// Depths whose mean likeness at the coarse level is this close to the best are tried at full resolution. Large,
/// since a coarse pixel may hit one repetition squarely and the other by half.
const RIVAL: f32 = 0.25;
/// As [`RIVAL`], for depths at which some camera would not see the point: they cannot be tried, only feared.
const HIDDEN_RIVAL: f32 = 0.12;
/// A corner with more rivals than this is ambiguous without trying them.
const MOST_RIVALS: usize = 5;
/// Steps of the iteration at each level.
const STEPS: usize = 12;

/// A point matched in all cameras at one instant.
#[derive(Clone, Debug)]
pub struct Match {
    /// Per camera, px as seen.
    pub pixels: Vec<[f64; 2]>,
    /// The same, normalised.
    pub views: Vec<[f64; 2]>,
    /// The point that fits them.
    pub ray: Ray,
}

/// All cameras' images at one instant, and the rig.
#[derive(Debug)]
pub struct Stereo<'a> {
    /// The rig.
    pub geometry: &'a Geometry,
    /// Thresholds.
    pub settings: &'a Settings,
    /// Per camera.
    pub pyramids: &'a [Pyramid],
    /// Per camera: the level that is searched.
    pub fields: &'a [Field],
    /// Which level that is.
    pub level: usize,
}

/// A depth that explains the coarse images.
#[derive(Clone, Debug)]
struct Candidate {
    inverse_depth: f64,
    score: f32,
    /// Per camera: offset across the epipolar line, coarse px.
    offsets: Vec<[f64; 2]>,
}

/// A candidate at full resolution.
struct Refined {
    matched: Match,
    likeness: f32,
}

impl Stereo<'_> {
    /// The views of what the reference camera sees at `corner`.
    ///
    /// # Errors
    /// Why there are none that can be trusted.
    pub fn find(&self, corner: [f64; 2]) -> Result<Match, Reason> {
        let candidates = self.candidates(corner)?;
        let mut best: Option<(Refined, f32)> = None;
        let mut second = f32::NEG_INFINITY;
        let mut failed: Option<(f32, Reason)> = None;
        for candidate in candidates {
            match self.refine(corner, &candidate) {
                Err(reason) => {
                    if failed.is_none_or(|(score, _)| candidate.score > score) {
                        failed = Some((candidate.score, reason));
                    }
                }
                Ok(refined) => match &mut best {
                    Some((found, score)) => {
                        // Two candidates may lead to the same place.
                        let apart = (found.matched.ray.inverse_depth
                            - refined.matched.ray.inverse_depth)
                            * self.px_per_inverse_mm();
                        if apart.abs() < 1.0 {
                            continue;
                        }
                        second = second.max(found.likeness.min(refined.likeness));
                        if refined.likeness > found.likeness {
                            (*found, *score) = (refined, candidate.score);
                        }
                    }
                    None => best = Some((refined, candidate.score)),
                },
            }
        }
        match (best, failed) {
            (None, failed) => Err(failed.map_or(Reason::Unlike, |(_, reason)| reason)),
            (Some((found, _)), _) if second > found.likeness - self.settings.rival_likeness => {
                Err(Reason::Ambiguous)
            }
            // A better one that could not be refined: an occlusion, not a match.
            (Some((_, score)), Some((better, reason))) if better > score + 0.05 => Err(reason),
            (Some((found, _)), _) => Ok(found.matched),
        }
    }

    /// Disparity to the farthest camera per unit of inverse depth.
    fn px_per_inverse_mm(&self) -> f64 {
        self.geometry.focal_px * self.geometry.reach_mm
    }

    /// All inverse depths that explain the coarse images nearly as well as the best one.
    fn candidates(&self, corner: [f64; 2]) -> Result<Vec<Candidate>, Reason> {
        let scale = (1 << self.level) as f64;
        let reference = self.geometry.reference;
        let coarse = corner.map(|c| (c / scale).round());
        let probe = self.fields[reference]
            .probe(coarse[0] as i64, coarse[1] as i64)
            .ok_or(Reason::Unlike)?;
        let at = self
            .geometry
            .normalise(reference, coarse.map(|c| c * scale));
        let step = 0.5 * scale / self.px_per_inverse_mm();
        let first = -BEYOND_INFINITY_PX / self.px_per_inverse_mm();
        let width =
            f64::from(self.geometry.rig.image_size_px[0].max(self.geometry.rig.image_size_px[1]));
        let last = LARGEST_DISPARITY * width / self.px_per_inverse_mm();
        let count = ((last - first) / step).ceil() as usize + 1;

        let mut total = vec![0.0_f32; count];
        let mut seen = vec![0_u8; count];
        let mut offsets = vec![vec![[0_i8; 2]; self.geometry.cameras()]; count];
        for k in (0..self.geometry.cameras()).filter(|k| *k != reference) {
            let line: Vec<[i64; 2]> = (0..count)
                .map(|h| {
                    let pixel = self.geometry.transfer(k, at, first + step * h as f64);
                    pixel.map(|p| (p / scale).round() as i64)
                })
                .collect();
            let strip = Strip::around(&line, &self.fields[k], &probe);
            for (h, place) in line.iter().enumerate() {
                let (likeness, offset) = strip.best(*place);
                if likeness > OUTSIDE {
                    total[h] += likeness;
                    seen[h] += 1;
                    offsets[h][k] = offset;
                }
            }
        }
        let others = self.geometry.cameras() as u8 - 1;
        let score: Vec<f32> = (total.iter().zip(&seen))
            .map(|(sum, n)| {
                if *n == 0 {
                    OUTSIDE
                } else {
                    sum / f32::from(*n)
                }
            })
            .collect();
        let complete = |h: &usize| seen[*h] == others;
        let best = (0..count)
            .filter(complete)
            .max_by(|a, b| score[*a].total_cmp(&score[*b]))
            .ok_or(Reason::OutOfView)?;
        if score[best] < self.settings.least_likeness - 0.15 {
            return Err(Reason::Unlike);
        }
        let mut found = Vec::new();
        for peak in peaks(&score, score[best] - RIVAL) {
            if complete(&peak) {
                found.push(Candidate {
                    inverse_depth: first + step * (peak as f64 + vertex(&score, peak)),
                    score: score[peak],
                    offsets: offsets[peak].iter().map(|o| o.map(f64::from)).collect(),
                });
            } else if score[peak] > score[best] - HIDDEN_RIVAL {
                return Err(Reason::Ambiguous);
            }
        }
        if found.len() > MOST_RIVALS {
            return Err(Reason::Ambiguous);
        }
        Ok(found)
    }

    /// The match at full resolution, checked by every test there is.
    fn refine(&self, corner: [f64; 2], candidate: &Candidate) -> Result<Refined, Reason> {
        let geometry = self.geometry;
        let reference = geometry.reference;
        let at = geometry.normalise(reference, corner);
        let mut pixels = vec![corner; geometry.cameras()];
        let mut views = vec![at; geometry.cameras()];
        let mut likeness = 0.0;
        for k in (0..geometry.cameras()).filter(|k| *k != reference) {
            let scale = (1 << self.level) as f64;
            let on_line = geometry.transfer(k, at, candidate.inverse_depth);
            let start = [0, 1].map(|i| on_line[i] + scale * candidate.offsets[k][i]);
            let warp = geometry.stretch(k, corner, candidate.inverse_depth);
            let mut place = start.map(|p| p as f32);
            for level in (1..self.level).rev() {
                let scale = (1 << level) as f32;
                let levels = [reference, k].map(|k| &self.pyramids[k].levels[level]);
                let template = Small::new(levels[0], corner.map(|c| c as f32 / scale), warp);
                let found = template
                    .and_then(|t| t.find(levels[1], place.map(|p| p / scale), STEPS))
                    .ok_or(Reason::Unlike)?;
                place = found.at.map(|p| p * scale);
            }
            let [base, other] = [reference, k].map(|k| &self.pyramids[k].levels[0]);
            let template = Large::new(base, corner.map(|c| c as f32), warp).ok_or(Reason::Flat)?;
            let found = template.find(other, place, STEPS).ok_or(Reason::Unlike)?;
            if found.likeness < self.settings.least_likeness {
                return Err(Reason::Unlike);
            }
            let back = Large::new(other, found.at, invert(warp)).ok_or(Reason::Flat)?;
            let start = [0, 1].map(|i| corner[i] as f32 + found.at[i] - place[i]);
            let returned = back.find(base, start, STEPS).ok_or(Reason::NoReturn)?;
            let miss = [0, 1].map(|i| f64::from(returned.at[i]) - corner[i]);
            if miss[0].hypot(miss[1]) > self.settings.return_px {
                return Err(Reason::NoReturn);
            }
            likeness += found.likeness / (geometry.cameras() - 1) as f32;
            pixels[k] = found.at.map(f64::from);
            views[k] = geometry.normalise(k, pixels[k]);
        }
        check(geometry, self.settings, &views)?;
        let ray = geometry.fit(&views);
        if ray.inverse_depth * self.px_per_inverse_mm() < LEAST_DISPARITY_PX {
            return Err(Reason::TooFar);
        }
        Ok(Refined {
            matched: Match { pixels, views, ray },
            likeness,
        })
    }
}

/// Constraint (3) and the vertical test on one point's views.
///
/// # Errors
/// Which of the two failed.
pub fn check(geometry: &Geometry, settings: &Settings, views: &[[f64; 2]]) -> Result<(), Reason> {
    if geometry.vertical_offset_px(views) > settings.view_residual_px {
        return Err(Reason::Vertical);
    }
    if geometry.disparity_disagreement_px(views) > settings.view_residual_px {
        return Err(Reason::Disparity);
    }
    Ok(())
}

/// Likenesses along a line of places and one pixel to either side of it.
struct Strip {
    /// Whether neighbours across the line are above and below.
    flat: bool,
    top: i64,
    /// Per row: first column and likenesses.
    rows: Vec<(i64, Vec<f32>)>,
}

impl Strip {
    fn around(line: &[[i64; 2]], field: &Field, probe: &super::likeness::Probe) -> Self {
        let extent = |axis: usize| {
            let low = line.iter().map(|p| p[axis]).min().unwrap_or(0);
            (low, line.iter().map(|p| p[axis]).max().unwrap_or(0))
        };
        let ((left, right), (top, bottom)) = (extent(0), extent(1));
        let flat = right - left >= bottom - top;
        let (grow_x, grow_y) = if flat { (0, 1) } else { (1, 0) };
        let [width, height] = field.size().map(|s| s as i64);
        // Places outside the image are known to be so without looking.
        let (top, bottom) = ((top - grow_y).max(0), (bottom + grow_y).min(height - 1));
        let mut spans = vec![(i64::MAX, i64::MIN); (bottom - top + 1).max(0) as usize];
        for [x, y] in line {
            for row in y - grow_y..=y + grow_y {
                let index = usize::try_from(row - top).unwrap_or(usize::MAX);
                if let Some(span) = spans.get_mut(index) {
                    span.0 = span.0.min((x - grow_x).max(0));
                    span.1 = span.1.max((x + grow_x).min(width - 1));
                }
            }
        }
        let rows = (top..)
            .zip(&spans)
            .map(|(y, (first, last))| {
                let mut row = vec![OUTSIDE; (last.saturating_sub(*first) + 1).max(0) as usize];
                field.compare(probe, *first, y, &mut row);
                (*first, row)
            })
            .collect();
        Self { flat, top, rows }
    }

    fn at(&self, x: i64, y: i64) -> f32 {
        let row = usize::try_from(y - self.top)
            .ok()
            .and_then(|r| self.rows.get(r));
        row.and_then(|(first, values)| values.get(usize::try_from(x - first).ok()?))
            .copied()
            .unwrap_or(OUTSIDE)
    }

    /// The best of a place and its neighbours across the line, and its offset. [`OUTSIDE`] if the place itself is.
    fn best(&self, [x, y]: [i64; 2]) -> (f32, [i8; 2]) {
        let mut best = (self.at(x, y), [0, 0]);
        if best.0 == OUTSIDE {
            return best;
        }
        for side in [-1_i8, 1] {
            let offset = if self.flat { [0, side] } else { [side, 0] };
            let likeness = self.at(x + i64::from(offset[0]), y + i64::from(offset[1]));
            if likeness > best.0 {
                best = (likeness, offset);
            }
        }
        best
    }
}

/// Indices of the local maxima above `least`. Of a plateau, the first.
fn peaks(score: &[f32], least: f32) -> Vec<usize> {
    (0..score.len())
        .filter(|&i| {
            let before = i.checked_sub(1).map_or(OUTSIDE, |b| score[b]);
            let after = score.get(i + 1).copied().unwrap_or(OUTSIDE);
            // Half steps of a rounded position may repeat a value.
            score[i] > least && score[i] > before && score[i] >= after
        })
        .collect()
}

/// Where the parabola through a peak and its neighbours has its vertex, in steps from the peak.
fn vertex(score: &[f32], peak: usize) -> f64 {
    let before = peak.checked_sub(1).map_or(OUTSIDE, |b| score[b]);
    let after = score.get(peak + 1).copied().unwrap_or(OUTSIDE);
    let bend = before - 2.0 * score[peak] + after;
    let offset = 0.5 * (before - after) / bend;
    if offset.is_finite() {
        f64::from(offset.clamp(-0.5, 0.5))
    } else {
        0.0
    }
}

/// The inverse of a matrix near the identity.
fn invert([[a, b], [c, d]]: [[f32; 2]; 2]) -> [[f32; 2]; 2] {
    let determinant = a * d - b * c;
    [
        [d / determinant, -b / determinant],
        [-c / determinant, a / determinant],
    ]
}
