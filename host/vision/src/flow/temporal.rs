//! Tracking between two instants: every point in every camera, from a predicted start.
//!
//! The displacement of the search predicts the motion of all points, so Lucas-Kanade starts within
//! a fraction of a pixel and needs no pyramid of its own. A point that comes nearer is seen larger;
//! its template is warped accordingly.

use std::ops::RangeInclusive;
use trinocular_core::sums::View;

use super::consensus::{self, PointFlow};
use super::{Correspondence, FlowSettings};
use crate::matching::Reject;
use crate::matching::geometry::RigGeometry;
use crate::matching::lucas_kanade::{CoarseTemplate, FineTemplate, PlaneWarp, Registration};
use crate::matching::pyramid::FramePyramid;
use crate::matching::stereo::{self, StereoMatch};
use crate::thread_pool::ThreadPool;

/// Largest number of Lucas-Kanade steps.
const MAX_STEPS: usize = 12;

/// Images of two instants, with the rig that took them.
#[derive(Debug)]
pub struct TemporalMatcher<'a> {
    /// Geometry of the active cameras.
    pub geometry: &'a RigGeometry,
    /// Limits.
    pub settings: &'a FlowSettings,
    /// Pyramids of the keyframe, per active camera.
    pub before: &'a [&'a FramePyramid],
    /// Pyramids of the frame set now, per active camera.
    pub now: &'a [&'a FramePyramid],
    /// Threads that share the work.
    pub thread_pool: &'a ThreadPool,
}

/// Displacement refined from a hypothesis.
#[derive(Clone, Copy, Debug)]
pub struct RefinedDisplacement {
    /// Displacement, mm.
    pub displacement_mm: [f64; 3],
    /// Mean zncc of the points in view; points that are not found or disagree count as 0.
    pub zncc: f32,
}

impl TemporalMatcher<'_> {
    /// Refines a displacement in the reference camera, from the coarsest of some levels down to the
    /// finest. Returns `None` if too few points are found.
    pub fn refine(
        &self,
        matches: &[StereoMatch],
        hypothesis_mm: [f64; 3],
        levels: RangeInclusive<usize>,
    ) -> Option<RefinedDisplacement> {
        let mut refined = RefinedDisplacement {
            displacement_mm: hypothesis_mm,
            zncc: 0.0,
        };
        for level in levels.rev() {
            refined = self.refine_at(matches, refined.displacement_mm, level)?;
        }
        Some(refined)
    }

    fn refine_at(
        &self,
        matches: &[StereoMatch],
        hypothesis_mm: [f64; 3],
        level: usize,
    ) -> Option<RefinedDisplacement> {
        let k = self.geometry.reference;
        let [before, now] = [self.before, self.now].map(|p| p[k].level(level));
        let (before, now) = (before?, now?);
        let scale = (1 << level) as f64;

        // Lucas-Kanade of every point in view, from the place that the hypothesis predicts.
        let track = |matched: &StereoMatch| {
            let rho = matched.ray.inverse_depth;
            let from = matched.pixels[k].map(|p| (p / scale) as f32);
            let expected = PointFlow::predicted(matched.normalised[k], rho, hypothesis_mm);
            let to = self.geometry.pixel(k, expected).map(|p| (p / scale) as f32);
            if !CoarseTemplate::fits(before, from) || !CoarseTemplate::fits(now, to) {
                return None;
            }
            let template = CoarseTemplate::new(before, from)?;
            let found = template.find(now, to, magnification(rho, hypothesis_mm), MAX_STEPS);
            Some(found.map(|found| {
                let pixel = found.at.map(|p| f64::from(p) * scale);
                let flow = PointFlow {
                    before: matched.normalised[k],
                    now: self.geometry.normalise(k, pixel),
                    inverse_depth: rho,
                };
                (flow, found.zncc)
            }))
        };
        let tracked = self.thread_pool.map(matches.iter().collect(), track);
        let in_view = tracked.iter().flatten().count();
        let (flows, scores): (Vec<PointFlow>, Vec<f32>) =
            tracked.into_iter().flatten().flatten().unzip();
        if flows.len() < self.settings.min_points {
            return None;
        }

        // Robust fit of the displacement, and the mean correlation of its inliers.
        let least = 0.5 * scale / self.geometry.focal_px;
        let displacement_mm = consensus::fit(&flows, hypothesis_mm, least)?;
        let mut sum = 0.0;
        for (flow, zncc) in flows.iter().zip(&scores) {
            if flow.residual(displacement_mm) < 2.0 * least {
                sum += zncc.max(0.0);
            }
        }
        Some(RefinedDisplacement {
            displacement_mm,
            zncc: sum / in_view as f32,
        })
    }

    /// Tracks one point in all cameras at full resolution, and checks that the cameras see one
    /// point.
    ///
    /// # Errors
    /// [`Reject`], for the first test that failed.
    pub fn track_point(
        &self,
        matched: &StereoMatch,
        displacement_mm: [f64; 3],
    ) -> Result<Correspondence, Reject> {
        let tracked = self.track_per_camera(matched, displacement_mm)?;
        let ends: Vec<[f64; 2]> = tracked.views.iter().map(|v| v.end).collect();
        stereo::check(self.geometry, &self.settings.matching, &ends)?;
        Ok(tracked)
    }

    /// Tracks one point in each camera on its own, without the tests between cameras.
    ///
    /// # Errors
    /// [`Reject`], for the first test that failed.
    pub fn track_per_camera(
        &self,
        matched: &StereoMatch,
        displacement_mm: [f64; 3],
    ) -> Result<Correspondence, Reject> {
        let cameras = self.geometry.cameras();
        let mut pixels = Vec::with_capacity(cameras);
        let mut views = Vec::with_capacity(cameras);
        for k in 0..cameras {
            let found = self.track_in(k, matched, displacement_mm)?;
            let pixel = found.at.map(f64::from);
            pixels.push([matched.pixels[k], pixel]);
            views.push(View {
                start: matched.normalised[k],
                end: self.geometry.normalise(k, pixel),
            });
        }
        Ok(Correspondence { pixels, views })
    }

    /// Returns the pixel in each camera at which the displacement puts a point.
    pub(super) fn expected_pixels(
        &self,
        matched: &StereoMatch,
        displacement_mm: [f64; 3],
    ) -> Vec<[f64; 2]> {
        let rho = matched.ray.inverse_depth;
        let expected = |k: usize| PointFlow::predicted(matched.normalised[k], rho, displacement_mm);
        let cameras = 0..self.geometry.cameras();
        cameras
            .map(|k| self.geometry.pixel(k, expected(k)))
            .collect()
    }

    /// Tracks an unmatched corner of the reference camera at `level`: from `start` on, looks for
    /// the window that was at `at`. Returns pixel and zncc.
    pub(super) fn track_corner(
        &self,
        level: usize,
        at: [f64; 2],
        start: [f64; 2],
        inverse_depth: f64,
        displacement_mm: [f64; 3],
    ) -> Option<([f64; 2], f32)> {
        let k = self.geometry.reference;
        let scale = (1 << level) as f64;
        let on_level = |pixel: [f64; 2]| pixel.map(|c| (c / scale) as f32);
        let [before, now] = [self.before, self.now].map(|p| p[k].level(level));
        let template = CoarseTemplate::new(before?, on_level(at))?;
        let warp = magnification(inverse_depth, displacement_mm);
        let found = template.find(now?, on_level(start), warp, MAX_STEPS)?;
        Some((found.at.map(|c| f64::from(c) * scale), found.zncc))
    }

    /// Tracks the window of the keyframe at `at` in camera `k` from `start` on, at `level`. `warp`
    /// takes offsets in the image now to offsets in the keyframe's image, at full resolution.
    /// Returns pixel and zncc.
    pub(super) fn track_turned_at(
        &self,
        level: usize,
        k: usize,
        [at, start]: [[f64; 2]; 2],
        warp: &PlaneWarp,
    ) -> Option<([f64; 2], f32)> {
        let scale = (1 << level) as f64;
        let on_level = |pixel: [f64; 2]| pixel.map(|c| (c / scale) as f32);
        let [before, now] = [self.before, self.now].map(|p| p[k].level(level));
        let warp = PlaneWarp {
            shrink: warp.shrink.map(|s| s * scale as f32),
            ..*warp
        };
        let template = CoarseTemplate::turned(before?, on_level(at), &warp)?;
        let still = [[1.0, 0.0], [0.0, 1.0]];
        let found = template.find(now?, on_level(start), still, MAX_STEPS)?;
        Some((found.at.map(|c| f64::from(c) * scale), found.zncc))
    }

    /// Tracks the window of the keyframe at `at` in camera `k` from `to` on, at full resolution.
    /// `warp` takes offsets in the image now to offsets in the keyframe's image.
    pub(super) fn track_turned(
        &self,
        k: usize,
        at: [f64; 2],
        to: [f64; 2],
        warp: &PlaneWarp,
    ) -> Result<[f64; 2], Reject> {
        let (before, now) = (self.before[k].fine(), self.now[k].finest());
        let (at, to) = (at.map(|p| p as f32), to.map(|p| p as f32));
        if !FineTemplate::fits(now, to) {
            return Err(Reject::OutOfView);
        }
        let template = FineTemplate::turned(before, at, warp).ok_or(Reject::OutOfView)?;
        let found = template.find(now, to, [[1.0, 0.0], [0.0, 1.0]], MAX_STEPS);
        let found = found.ok_or(Reject::Dissimilar)?;
        Ok(found.checked(&self.settings.matching)?.at.map(f64::from))
    }

    /// Tracks one point in camera `k` at full resolution.
    fn track_in(
        &self,
        k: usize,
        matched: &StereoMatch,
        displacement_mm: [f64; 3],
    ) -> Result<Registration, Reject> {
        let now = self.now[k].finest();
        let rho = matched.ray.inverse_depth;
        let expected = PointFlow::predicted(matched.normalised[k], rho, displacement_mm);
        let start = self.geometry.pixel(k, expected).map(|p| p as f32);
        if !FineTemplate::fits(now, start) {
            return Err(Reject::OutOfView);
        }
        let warp = magnification(rho, displacement_mm);
        let found = matched.templates[k].find(now, start, warp, MAX_STEPS);
        found
            .ok_or(Reject::Dissimilar)?
            .checked(&self.settings.matching)
    }
}

/// Returns the warp of a template by the change of depth. A point that is nearer by `Tz` (negative)
/// is seen larger, so the template's offsets shrink by the ratio of the depth now to the depth
/// before.
fn magnification(inverse_depth: f64, displacement_mm: [f64; 3]) -> [[f32; 2]; 2] {
    let factor = (1.0 + inverse_depth * displacement_mm[2]) as f32;
    [[factor, 0.0], [0.0, factor]]
}
