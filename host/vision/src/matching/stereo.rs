//! Multi-view stereo matching without a depth prior.
//!
//! One inverse depth predicts a point's place in all cameras at once (M. Okutomi and T. Kanade, *A
//! Multiple-Baseline Stereo*, 1993). Every corner of the reference image is therefore tried at all
//! inverse depths, in steps of half a pixel of a coarse level, and the correlations in all cameras
//! are averaged: a chance match in one camera is a mismatch in the others. Every depth that is
//! nearly as good as the best is refined by Lucas-Kanade at full resolution. If two refined depths
//! correlate equally well, the texture repeats and the corner is rejected as ambiguous.

use super::epipolar::{EpipolarScores, line, peaks, vertex};
use super::geometry::{Ray, RigGeometry};
use super::lucas_kanade::{CoarseTemplate, FineTemplate};
use super::pyramid::FramePyramid;
use super::zncc::{OUTSIDE, ZnccPlane};
use super::{MatchSettings, Reject};
use std::sync::Arc;

/// Largest negative disparity that is tried, px, because principal points are uncertain.
const BEYOND_INFINITY_PX: f64 = 3.0;
/// Largest disparity to the farthest camera, in image widths. Nearer points are out of view of some
/// camera anyway.
const MAX_DISPARITY: f64 = 0.5;
/// Least disparity of a useful point, px. The depth of farther points is unknown.
const MIN_DISPARITY_PX: f64 = 1.0;
/// Margin of the rivals: depths whose mean coarse zncc is this close to the best are tried at full
/// resolution. It is large, because a coarse pixel may hit one repetition in the middle and the
/// next one between two pixels.
const RIVAL_MARGIN: f32 = 0.25;
/// Margin of rivals at depths at which some camera does not see the point: they cannot be tried, so
/// they make the corner ambiguous.
const HIDDEN_RIVAL_MARGIN: f32 = 0.12;
/// Margin of the rivals after interpolation between coarse pixels: the rest is noise and fine
/// detail.
const CLOSE_RIVAL_MARGIN: f32 = 0.15;
/// Amount by which a coarse zncc may be below the least zncc of a match.
const COARSE_LOSS: f32 = 0.15;
/// Amount by which a depth that failed must be better than the match to count as an occlusion.
const OCCLUSION_MARGIN: f32 = 0.05;
/// Largest number of rivals. A corner with more is ambiguous without trying them.
const MAX_RIVALS: usize = 5;
/// Largest number of Lucas-Kanade steps at each level.
const MAX_STEPS: usize = 12;

/// Returns the nearest and the farthest depth of a match, mm: disparities to the farthest camera
/// from half the image's longer side down to one pixel.
pub fn matched_depths_mm(geometry: &RigGeometry) -> [f64; 2] {
    let px_mm = geometry.focal_px * geometry.longest_baseline_mm;
    [
        px_mm / (MAX_DISPARITY * longer_side_px(geometry)),
        px_mm / MIN_DISPARITY_PX,
    ]
}

fn longer_side_px(geometry: &RigGeometry) -> f64 {
    let [width, height] = geometry.rig.image_size_px;
    f64::from(width.max(height))
}

/// Point matched in all active cameras at one instant.
#[derive(Clone, Debug)]
pub struct StereoMatch {
    /// Pixels as seen, per camera.
    pub pixels: Vec<[f64; 2]>,
    /// Normalised coordinates of the pixels, per camera.
    pub normalised: Vec<[f64; 2]>,
    /// Point in space that fits the normalised coordinates.
    pub ray: Ray,
    /// Templates to track from the pixels, per camera.
    pub templates: Vec<Arc<FineTemplate>>,
}

/// Images of all active cameras at one instant.
#[derive(Debug)]
pub struct StereoMatcher<'a> {
    /// Geometry of the active cameras.
    pub geometry: &'a RigGeometry,
    /// Tests of a match.
    pub settings: &'a MatchSettings,
    /// Pyramids, per camera.
    pub pyramids: &'a [&'a FramePyramid],
    /// Coarse level to search, per camera.
    pub planes: &'a [ZnccPlane],
    /// Number of the coarse level.
    pub level: usize,
}

/// Depth that explains the coarse images.
#[derive(Clone, Debug)]
struct DepthCandidate {
    inverse_depth: f64,
    /// Mean zncc at the coarse level, interpolated between its pixels.
    score: f32,
    /// Starts of the refinement, px, per camera.
    starts: Vec<[f64; 2]>,
}

impl DepthCandidate {
    /// Returns true if the refinement would start at nearly the same places.
    fn has_starts(&self, starts: &[[f64; 2]]) -> bool {
        (self.starts.iter().zip(starts))
            .all(|(a, b)| (a[0] - b[0]).abs() < 1.0 && (a[1] - b[1]).abs() < 1.0)
    }
}

/// Templates of a corner of the reference image, for the refinement.
struct CornerTemplates {
    at: [f64; 2],
    /// Templates from level 1 to the one below the coarse level.
    coarse: Vec<CoarseTemplate>,
    fine: Box<FineTemplate>,
}

/// Match at full resolution, without templates.
#[derive(Clone, Debug)]
pub struct RefinedMatch {
    /// Point of the match.
    pub matched: StereoMatch,
    /// Mean zncc over the cameras.
    pub zncc: f32,
}

impl StereoMatcher<'_> {
    /// Matches the window of the reference camera at `corner`, px, in all other cameras.
    ///
    /// # Errors
    /// [`Reject`], if there is no match or more than one.
    pub fn find(&self, corner: [f64; 2]) -> Result<StereoMatch, Reject> {
        let candidates = self.candidates(corner)?;
        let corner = self.templates(corner).ok_or(Reject::LowTexture)?;
        let mut best: Option<(RefinedMatch, f32)> = None;
        let mut second = f32::NEG_INFINITY;
        let mut failed: Option<(f32, Reject)> = None;
        for candidate in candidates {
            match self.refine(&corner, &candidate) {
                Err(reject) => {
                    if failed.is_none_or(|(score, _)| candidate.score > score) {
                        failed = Some((candidate.score, reject));
                    }
                }
                Ok(refined) => match &mut best {
                    Some((found, score)) => {
                        // Two candidates may converge to the same depth.
                        let apart_px = (found.matched.ray.inverse_depth
                            - refined.matched.ray.inverse_depth)
                            * self.px_per_inverse_mm();
                        if apart_px.abs() < 1.0 {
                            continue;
                        }
                        second = second.max(found.zncc.min(refined.zncc));
                        if refined.zncc > found.zncc {
                            (*found, *score) = (refined, candidate.score);
                        }
                    }
                    None => best = Some((refined, candidate.score)),
                },
            }
        }
        match (best, failed) {
            (None, failed) => Err(failed.map_or(Reject::Dissimilar, |(_, reject)| reject)),
            (Some((found, _)), _) if second > found.zncc - self.settings.rival_zncc_margin => {
                Err(Reject::Ambiguous)
            }
            // A better depth that could not be refined: the match is a mistake by occlusion.
            (Some((_, score)), Some((better, reject))) if better > score + OCCLUSION_MARGIN => {
                Err(reject)
            }
            (Some((found, _)), _) => self.complete(corner, found.matched),
        }
    }

    /// Finds all matches of the window of the reference camera at `corner`, px, at different
    /// depths. Returns none if some camera does not see the place of one of them.
    pub fn find_all(&self, corner: [f64; 2]) -> Vec<RefinedMatch> {
        let (Ok(candidates), Some(corner)) = (self.candidates(corner), self.templates(corner))
        else {
            return Vec::new();
        };
        let mut found: Vec<RefinedMatch> = Vec::new();
        for candidate in candidates {
            let Ok(refined) = self.refine(&corner, &candidate) else {
                continue;
            };
            let is_same = |other: &&mut RefinedMatch| {
                let apart = other.matched.ray.inverse_depth - refined.matched.ray.inverse_depth;
                (apart * self.px_per_inverse_mm()).abs() < 1.0
            };
            match found.iter_mut().find(is_same) {
                Some(same) if same.zncc < refined.zncc => *same = refined,
                Some(_) => {}
                None => found.push(refined),
            }
        }
        found
    }

    /// Takes the templates to track from a match of [`Self::find_all`].
    ///
    /// # Errors
    /// [`Reject::LowTexture`] if the window has too little contrast in some camera.
    pub fn completed(&self, refined: RefinedMatch) -> Result<StereoMatch, Reject> {
        let at = refined.matched.pixels[self.geometry.reference];
        let corner = self.templates(at).ok_or(Reject::LowTexture)?;
        self.complete(corner, refined.matched)
    }

    /// Takes the templates of the refinement. Returns `None` without texture.
    fn templates(&self, at: [f64; 2]) -> Option<CornerTemplates> {
        let pyramid = self.pyramids[self.geometry.reference];
        let coarse = (1..self.level).map(|level| {
            let scale = (1 << level) as f64;
            CoarseTemplate::new(pyramid.level(level)?, at.map(|c| (c / scale) as f32))
                .map(|template| *template)
        });
        Some(CornerTemplates {
            at,
            coarse: coarse.collect::<Option<_>>()?,
            fine: FineTemplate::new(pyramid.finest(), at.map(|c| c as f32))?,
        })
    }

    /// Takes the templates to track from a match.
    fn complete(
        &self,
        corner: CornerTemplates,
        mut matched: StereoMatch,
    ) -> Result<StereoMatch, Reject> {
        let mut own = Some(corner.fine);
        for (k, pixel) in matched.pixels.iter().enumerate() {
            let template = if k == self.geometry.reference {
                own.take()
            } else {
                FineTemplate::new(self.pyramids[k].finest(), pixel.map(|p| p as f32))
            };
            matched
                .templates
                .push(Arc::from(template.ok_or(Reject::LowTexture)?));
        }
        Ok(matched)
    }

    /// Returns the disparity to the farthest camera per unit of inverse depth, px mm.
    pub fn px_per_inverse_mm(&self) -> f64 {
        self.geometry.focal_px * self.geometry.longest_baseline_mm
    }

    /// Finds all inverse depths that explain the coarse images nearly as well as the best one.
    fn candidates(&self, corner: [f64; 2]) -> Result<Vec<DepthCandidate>, Reject> {
        let scale = (1 << self.level) as f64;
        let reference = self.geometry.reference;
        let coarse = corner.map(|c| (c / scale).round());
        let patch = self.planes[reference]
            .patch(coarse[0] as i64, coarse[1] as i64)
            .ok_or(Reject::Dissimilar)?;
        let at = self
            .geometry
            .normalise(reference, coarse.map(|c| c * scale));
        let step = 0.5 * scale / self.px_per_inverse_mm();
        let first = -BEYOND_INFINITY_PX / self.px_per_inverse_mm();
        let last = MAX_DISPARITY * longer_side_px(self.geometry) / self.px_per_inverse_mm();
        let count = ((last - first) / step).ceil() as usize + 1;

        // Mean correlation over the cameras that see the place, for every inverse depth.
        let cameras = self.geometry.cameras();
        let mut total = vec![0.0_f32; count];
        let mut seen = vec![0_u8; count];
        let mut lines = Vec::with_capacity(cameras);
        for k in (0..cameras).filter(|k| *k != reference) {
            let place = |h: usize| {
                let pixel = self.geometry.transfer(k, at, first + step * h as f64);
                pixel.map(|p| (p / scale) as f32)
            };
            let scores = EpipolarScores::around(line(count, place), &self.planes[k], &patch);
            scores.add_to(&mut total, &mut seen);
            lines.push((k, scores));
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
        // The best depth at which all cameras see the point.
        let complete = |h: &usize| seen[*h] == others;
        let best = (0..count)
            .filter(complete)
            .max_by(|a, b| score[*a].total_cmp(&score[*b]))
            .ok_or(Reject::OutOfView)?;
        if score[best] < self.settings.min_zncc - COARSE_LOSS {
            return Err(Reject::Dissimilar);
        }
        // Local maxima nearly as good: candidates, with a sub-pixel start in every camera.
        let mut found = Vec::new();
        for peak in peaks(&score, score[best] - RIVAL_MARGIN) {
            if complete(&peak) {
                let inverse_depth = first + step * (peak as f64 + vertex(&score, peak));
                let mut starts = vec![corner; cameras];
                let mut zncc = 0.0;
                for (k, scores) in &lines {
                    let on_line = self.geometry.transfer(*k, at, inverse_depth);
                    let (start, there) =
                        scores.start(peak, on_line, scale, self.settings.max_view_residual_px);
                    // The patch was taken at a whole pixel: add the corner's fraction.
                    starts[*k] = [0, 1].map(|i| start[i] + corner[i] - scale * coarse[i]);
                    zncc += there / f32::from(others);
                }
                // Half steps of a rounded line may give one place two peaks.
                if !found.iter().any(|c: &DepthCandidate| c.has_starts(&starts)) {
                    found.push(DepthCandidate {
                        inverse_depth,
                        score: zncc,
                        starts,
                    });
                }
            } else if score[peak] > score[best] - HIDDEN_RIVAL_MARGIN {
                return Err(Reject::Ambiguous);
            }
        }
        let best_match = found.iter().map(|c| c.score).fold(OUTSIDE, f32::max);
        found.retain(|c| c.score > best_match - CLOSE_RIVAL_MARGIN);
        if found.len() > MAX_RIVALS {
            return Err(Reject::Ambiguous);
        }
        Ok(found)
    }

    /// Refines a candidate to full resolution and applies all tests to it.
    fn refine(
        &self,
        corner: &CornerTemplates,
        candidate: &DepthCandidate,
    ) -> Result<RefinedMatch, Reject> {
        let geometry = self.geometry;
        let reference = geometry.reference;
        let at = geometry.normalise(reference, corner.at);
        let mut pixels = vec![corner.at; geometry.cameras()];
        let mut normalised = vec![at; geometry.cameras()];
        let mut zncc = 0.0;
        for k in (0..geometry.cameras()).filter(|k| *k != reference) {
            // Lucas-Kanade from the candidate's start, coarse to fine.
            let warp = geometry.warp(k, corner.at, candidate.inverse_depth);
            let mut place = candidate.starts[k].map(|p| p as f32);
            let pyramid = self.pyramids[k];
            for (level, template) in (1..self.level).zip(&corner.coarse).rev() {
                let scale = (1 << level) as f32;
                let start = place.map(|p| p / scale);
                let plane = pyramid.level(level).ok_or(Reject::Dissimilar)?;
                let found = template.find(plane, start, warp, MAX_STEPS);
                place = found.ok_or(Reject::Dissimilar)?.at.map(|p| p * scale);
            }
            let found = corner.fine.find(pyramid.finest(), place, warp, MAX_STEPS);
            let found = found.ok_or(Reject::Dissimilar)?.checked(self.settings)?;
            zncc += found.zncc / (geometry.cameras() - 1) as f32;
            pixels[k] = found.at.map(f64::from);
            normalised[k] = geometry.normalise(k, pixels[k]);
        }
        check(geometry, self.settings, &normalised)?;
        // Multi-view fit of the inverse depth.
        let ray = geometry.fit(&normalised);
        if ray.inverse_depth * self.px_per_inverse_mm() < MIN_DISPARITY_PX {
            return Err(Reject::TooFar);
        }
        let templates = Vec::with_capacity(geometry.cameras());
        Ok(RefinedMatch {
            matched: StereoMatch {
                pixels,
                normalised,
                ray,
                templates,
            },
            zncc,
        })
    }
}

/// Applies the paper's vertical test (2) and constraint (3) to one point's normalised coordinates.
///
/// # Errors
/// [`Reject::Vertical`] or [`Reject::Disparity`].
pub fn check(
    geometry: &RigGeometry,
    settings: &MatchSettings,
    normalised: &[[f64; 2]],
) -> Result<(), Reject> {
    if geometry.vertical_offset_px(normalised) > settings.max_view_residual_px {
        return Err(Reject::Vertical);
    }
    if geometry.disparity_disagreement_px(normalised) > settings.max_view_residual_px {
        return Err(Reject::Disparity);
    }
    Ok(())
}
