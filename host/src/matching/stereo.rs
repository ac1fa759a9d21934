//! Which pixel of every camera shows the same point, without any idea of its depth.
//!
//! One inverse depth predicts a point's place in all cameras at once. So every corner of the
//! reference image is tried at all inverse depths, in steps of half a pixel of a coarse level, and
//! the likenesses in all cameras are averaged: what looks right to one camera by chance looks wrong
//! to the others. Every depth that is nearly as good as the best is refined by Lucas and Kanade at
//! full resolution; if two survive that are alike, the texture repeats and the corner is dropped as
//! ambiguous.

use super::epipolar::{Strip, line, peaks, vertex};
use super::geometry::{Geometry, Ray};
use super::lucas_kanade::{Large, Small};
use super::pyramid::Pyramid;
use super::zncc::{Field, OUTSIDE};
use crate::flow::{Reason, Settings};
use std::sync::Arc;

/// Disparities below zero that are tried, px: principal points are not known better.
const BEYOND_INFINITY_PX: f64 = 3.0;
/// The largest disparity to the farthest camera, in image widths: nearer points are outside some
/// camera anyway.
const LARGEST_DISPARITY: f64 = 0.5;
/// The least disparity of a point that is of use, px: depth is not known beyond.
const LEAST_DISPARITY_PX: f64 = 1.0;
/// Depths whose mean likeness at the coarse level is this close to the best are tried at full
/// resolution. Large, since a coarse pixel may hit one repetition squarely and the other by half.
const RIVAL: f32 = 0.25;
/// As [`RIVAL`], for depths at which some camera would not see the point: they cannot be tried,
/// only feared.
const HIDDEN_RIVAL: f32 = 0.12;
/// The same, of likenesses interpolated between coarse pixels: what is left is noise and fine
/// detail.
const CLOSE_RIVAL: f32 = 0.15;
/// A corner with more rivals than this is ambiguous without trying them.
const MOST_RIVALS: usize = 5;
/// Steps of the iteration at each level.
const STEPS: usize = 12;

/// The nearest and the farthest depth at which points are matched, mm: disparities to the farthest
/// camera from half the image's longer side down to one pixel.
pub fn matched_depths_mm(geometry: &Geometry) -> [f64; 2] {
    let px_mm = geometry.focal_px * geometry.reach_mm;
    [
        px_mm / (LARGEST_DISPARITY * longer_side_px(geometry)),
        px_mm / LEAST_DISPARITY_PX,
    ]
}

fn longer_side_px(geometry: &Geometry) -> f64 {
    let [width, height] = geometry.rig.image_size_px;
    f64::from(width.max(height))
}

/// A point matched in all cameras at one instant.
#[derive(Clone, Debug)]
pub struct Match {
    /// Per camera, px as seen.
    pub pixels: Vec<[f64; 2]>,
    /// The same, normalised.
    pub views: Vec<[f64; 2]>,
    /// The point that fits them.
    pub ray: Ray,
    /// Per camera: what is followed from there.
    pub templates: Vec<Arc<Large>>,
}

/// All cameras' images at one instant, and the rig.
#[derive(Debug)]
pub struct Stereo<'a> {
    /// The rig.
    pub geometry: &'a Geometry,
    /// Thresholds.
    pub settings: &'a Settings,
    /// Per camera.
    pub pyramids: &'a [&'a Pyramid],
    /// Per camera: the level that is searched.
    pub fields: &'a [Field],
    /// Which level that is.
    pub level: usize,
}

/// A depth that explains the coarse images.
#[derive(Clone, Debug)]
struct Candidate {
    inverse_depth: f64,
    /// Mean likeness at the coarse level, between its pixels.
    score: f32,
    /// Per camera: where to look, px.
    starts: Vec<[f64; 2]>,
}

impl Candidate {
    /// Whether the search would begin at nearly the same places.
    fn leads_to(&self, starts: &[[f64; 2]]) -> bool {
        (self.starts.iter().zip(starts))
            .all(|(a, b)| (a[0] - b[0]).abs() < 1.0 && (a[1] - b[1]).abs() < 1.0)
    }
}

/// A corner of the reference image, ready to be looked for in the others.
struct Corner {
    at: [f64; 2],
    /// From level 1 to the one below that which is searched.
    coarse: Vec<Small>,
    template: Box<Large>,
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
        let corner = self.corner(corner).ok_or(Reason::Flat)?;
        let mut best: Option<(Refined, f32)> = None;
        let mut second = f32::NEG_INFINITY;
        let mut failed: Option<(f32, Reason)> = None;
        for candidate in candidates {
            match self.refine(&corner, &candidate) {
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
            (Some((found, _)), _) => self.complete(corner, found.matched),
        }
    }

    /// `None` if it cannot be looked for.
    fn corner(&self, at: [f64; 2]) -> Option<Corner> {
        let levels = &self.pyramids[self.geometry.reference].levels;
        let coarse = (1..self.level).map(|level| {
            let scale = (1 << level) as f64;
            Small::new(&levels[level], at.map(|c| (c / scale) as f32)).map(|template| *template)
        });
        Some(Corner {
            at,
            coarse: coarse.collect::<Option<_>>()?,
            template: Large::new(&levels[0], at.map(|c| c as f32))?,
        })
    }

    /// Takes the templates that will be followed.
    fn complete(&self, corner: Corner, mut matched: Match) -> Result<Match, Reason> {
        let mut own = Some(corner.template);
        for (k, pixel) in matched.pixels.iter().enumerate() {
            let template = if k == self.geometry.reference {
                own.take()
            } else {
                Large::new(&self.pyramids[k].levels[0], pixel.map(|p| p as f32))
            };
            matched
                .templates
                .push(Arc::from(template.ok_or(Reason::Flat)?));
        }
        Ok(matched)
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
        let last = LARGEST_DISPARITY * longer_side_px(self.geometry) / self.px_per_inverse_mm();
        let count = ((last - first) / step).ceil() as usize + 1;

        let cameras = self.geometry.cameras();
        let mut total = vec![0.0_f32; count];
        let mut seen = vec![0_u8; count];
        let mut strips = Vec::with_capacity(cameras);
        for k in (0..cameras).filter(|k| *k != reference) {
            let place = |h: usize| {
                let pixel = self.geometry.transfer(k, at, first + step * h as f64);
                pixel.map(|p| (p / scale) as f32)
            };
            let strip = Strip::around(line(count, place), &self.fields[k], &probe);
            strip.add_to(&mut total, &mut seen);
            strips.push((k, strip));
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
                let inverse_depth = first + step * (peak as f64 + vertex(&score, peak));
                let mut starts = vec![corner; cameras];
                let mut likeness = 0.0;
                for (k, strip) in &strips {
                    let on_line = self.geometry.transfer(*k, at, inverse_depth);
                    let (start, there) =
                        strip.start(peak, on_line, scale, self.settings.view_residual_px);
                    // From the probe's whole pixel to the corner itself.
                    starts[*k] = [0, 1].map(|i| start[i] + corner[i] - scale * coarse[i]);
                    likeness += there / f32::from(others);
                }
                // Half steps of a rounded line may show one place as two peaks.
                if !found.iter().any(|c: &Candidate| c.leads_to(&starts)) {
                    found.push(Candidate {
                        inverse_depth,
                        score: likeness,
                        starts,
                    });
                }
            } else if score[peak] > score[best] - HIDDEN_RIVAL {
                return Err(Reason::Ambiguous);
            }
        }
        let likest = found.iter().map(|c| c.score).fold(OUTSIDE, f32::max);
        found.retain(|c| c.score > likest - CLOSE_RIVAL);
        if found.len() > MOST_RIVALS {
            return Err(Reason::Ambiguous);
        }
        Ok(found)
    }

    /// The match at full resolution, checked by every test there is.
    fn refine(&self, corner: &Corner, candidate: &Candidate) -> Result<Refined, Reason> {
        let geometry = self.geometry;
        let reference = geometry.reference;
        let at = geometry.normalise(reference, corner.at);
        let mut pixels = vec![corner.at; geometry.cameras()];
        let mut views = vec![at; geometry.cameras()];
        let mut likeness = 0.0;
        for k in (0..geometry.cameras()).filter(|k| *k != reference) {
            let warp = geometry.stretch(k, corner.at, candidate.inverse_depth);
            let mut place = candidate.starts[k].map(|p| p as f32);
            let levels = &self.pyramids[k].levels;
            for (level, template) in (1..self.level).zip(&corner.coarse).rev() {
                let scale = (1 << level) as f32;
                let start = place.map(|p| p / scale);
                let found = template.find(&levels[level], start, warp, STEPS);
                place = found.ok_or(Reason::Unlike)?.at.map(|p| p * scale);
            }
            let found = corner.template.find(&levels[0], place, warp, STEPS);
            let found = found.ok_or(Reason::Unlike)?;
            if found.likeness < self.settings.least_likeness {
                return Err(Reason::Unlike);
            }
            if !(f64::from(found.miss) <= self.settings.return_px) {
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
        let templates = Vec::with_capacity(geometry.cameras());
        Ok(Refined {
            matched: Match {
                pixels,
                views,
                ray,
                templates,
            },
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
