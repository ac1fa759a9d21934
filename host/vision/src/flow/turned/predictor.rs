//! Prediction of places and windows by a pose, for a surface of many points.

use crate::flow::Correspondence;
use crate::flow::temporal::TemporalMatcher;
use crate::matching::Reject;
use crate::matching::geometry::RigGeometry;
use crate::matching::lucas_kanade::PlaneWarp;
use crate::matching::stereo::{self, StereoMatch};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use trinocular_core::estimate::pose::Estimate;
use trinocular_core::sums::View;

/// Largest difference of two windows that counts as none, px at their border.
const SAME_PX: f64 = 0.01;
/// Number of windows of which one is compared.
const SAMPLED: usize = 8;
/// Half of the distance over which the change of an image is measured, px.
const STEP_PX: f64 = 4.0;

/// Plane of all points at the keyframe, `ρ = a + b α + c β`: planes in space are planes in
/// direction and inverse depth, too.
#[derive(Clone, Copy)]
pub(super) struct Surface([f64; 3]);

impl Surface {
    pub fn of(matches: &[StereoMatch]) -> Self {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for StereoMatch { ray, .. } in matches {
            let row = Vector3::new(1.0, ray.direction[0], ray.direction[1]);
            normal += row * row.transpose();
            right += row * ray.inverse_depth;
        }
        let solved = normal.cholesky().map(|normal| normal.solve(&right));
        Self(solved.map_or([0.0; 3], Into::into))
    }

    /// Creates the plane across the axes of the cameras at this inverse depth, 1/mm.
    #[cfg(test)]
    pub fn frontal(inverse_depth: f64) -> Self {
        Self([inverse_depth, 0.0, 0.0])
    }

    /// Returns `ν`, with which a camera at the arm `arm_mm` sees the inverse depth `ν·(x, y, 1)` at
    /// the normalised position `(x, y)`.
    pub fn inverse_depth_seen_from(&self, arm_mm: [f64; 2]) -> [f64; 3] {
        let Self([a, b, c]) = *self;
        // ρ = a + b α + c β with α = x + ρ arm.
        let scale = 1.0 / (1.0 - b * arm_mm[0] - c * arm_mm[1]);
        [b * scale, c * scale, a * scale]
    }

    /// Returns the slope of inverse depth at a point, on a plane through it that is parallel.
    fn slope(&self, [alpha, beta]: [f64; 2], rho: f64) -> [f64; 2] {
        let Self([a, b, c]) = *self;
        let there = a + b * alpha + c * beta;
        let scale = if there > 0.0 { rho / there } else { 0.0 };
        [scale * b, scale * c]
    }
}

/// Point of the keyframe on its own part of the surface, as one camera sees it.
pub(super) struct Anchor {
    pixel: [f64; 2],
    normalised: [f64; 2],
    direction: [f64; 2],
    inverse_depth: f64,
}

impl Anchor {
    fn of(matched: &StereoMatch, k: usize) -> Self {
        Self {
            pixel: matched.pixels[k],
            normalised: matched.normalised[k],
            direction: matched.ray.direction,
            inverse_depth: matched.ray.inverse_depth,
        }
    }

    /// Creates the anchor of a pixel of camera `k` whose inverse depth is known, 1/mm.
    pub fn at(geometry: &RigGeometry, k: usize, pixel: [f64; 2], inverse_depth: f64) -> Self {
        let normalised = geometry.normalise(k, pixel);
        let arm = geometry.arms.arms_mm()[k];
        Self {
            pixel,
            normalised,
            direction: [0, 1].map(|i| normalised[i] + inverse_depth * arm[i]),
            inverse_depth,
        }
    }
}

/// Prediction of places and windows by a pose.
pub(super) struct Predictor<'a> {
    pub geometry: &'a RigGeometry,
    pub pose: &'a Estimate,
    pub surface: Surface,
}

impl<'a> Predictor<'a> {
    pub fn new(geometry: &'a RigGeometry, surface: Surface, pose: &'a Estimate) -> Self {
        Self {
            geometry,
            pose,
            surface,
        }
    }

    /// Tracks one point in all cameras with turned windows, and checks that the cameras see one
    /// point.
    pub fn track(
        &self,
        matcher: &TemporalMatcher<'_>,
        matched: &StereoMatch,
    ) -> Result<Correspondence, Reject> {
        let tracked = self.track_per_camera(matcher, matched)?;
        let ends: Vec<[f64; 2]> = tracked.views.iter().map(|v| v.end).collect();
        stereo::check(self.geometry, &matcher.settings.matching, &ends)?;
        Ok(tracked)
    }

    /// Tracks one point in each camera on its own with turned windows, without the tests between
    /// cameras.
    pub fn track_per_camera(
        &self,
        matcher: &TemporalMatcher<'_>,
        matched: &StereoMatch,
    ) -> Result<Correspondence, Reject> {
        self.track_by(matched, |k, [at, to], warp| {
            matcher.track_turned(k, at, to, warp)
        })
    }

    /// Tracks one point in each camera on its own with turned windows at `level`, from 1 on,
    /// without the tests between cameras.
    pub fn track_coarse(
        &self,
        matcher: &TemporalMatcher<'_>,
        level: usize,
        matched: &StereoMatch,
    ) -> Result<Correspondence, Reject> {
        self.track_by(matched, |k, places, warp| {
            let found = matcher.track_turned_at(level, k, places, warp);
            let is_alike = |zncc: f32| zncc >= matcher.settings.matching.min_zncc;
            let (pixel, _) = found
                .filter(|(_, zncc)| is_alike(*zncc))
                .ok_or(Reject::Dissimilar)?;
            Ok(pixel)
        })
    }

    /// Tracks one point in each camera by `find`, which is given the places before and expected
    /// now, and the window's warp.
    fn track_by(
        &self,
        matched: &StereoMatch,
        find: impl Fn(usize, [[f64; 2]; 2], &PlaneWarp) -> Result<[f64; 2], Reject>,
    ) -> Result<Correspondence, Reject> {
        let cameras = self.geometry.cameras();
        let mut pixels = Vec::with_capacity(cameras);
        let mut views = Vec::with_capacity(cameras);
        for k in 0..cameras {
            let anchor = Anchor::of(matched, k);
            let at = anchor.pixel;
            let to = self.to(k, &anchor, at).ok_or(Reject::OutOfView)?;
            let warp = self.warp(k, &anchor, to).ok_or(Reject::OutOfView)?;
            let found = find(k, [at, to], &warp)?;
            pixels.push([at, found]);
            views.push(View {
                start: matched.normalised[k],
                end: self.geometry.normalise(k, found),
            });
        }
        Ok(Correspondence { pixels, views })
    }

    /// Returns the pixel in each camera at which the pose puts a point; `None` if it is behind one.
    pub fn expected_pixels(&self, matched: &StereoMatch) -> Option<Vec<[f64; 2]>> {
        let expected = |k: usize| {
            let anchor = Anchor::of(matched, k);
            self.to(k, &anchor, anchor.pixel)
        };
        (0..self.geometry.cameras()).map(expected).collect()
    }

    /// Returns where the pose puts the pixel `at` of camera `k`, on the surface at an anchor.
    pub fn to(&self, k: usize, anchor: &Anchor, at: [f64; 2]) -> Option<[f64; 2]> {
        let arm = self.geometry.arms.arms_mm()[k];
        let slope = self.surface.slope(anchor.direction, anchor.inverse_depth);
        // ρ = ρ0 + slope (α - α0) with α = ξ + ρ arm.
        let xi = self.geometry.normalise(k, at);
        let own = anchor.normalised;
        let along: f64 = (0..2).map(|i| slope[i] * (xi[i] - own[i])).sum();
        let across: f64 = (0..2).map(|i| slope[i] * arm[i]).sum();
        let rho = anchor.inverse_depth + along / (1.0 - across);
        let start = [xi[0] + rho * arm[0], xi[1] + rho * arm[1], rho];
        let [alpha, beta, rho] = self.pose.moved(&self.geometry.arms, start)?;
        let end = [alpha - rho * arm[0], beta - rho * arm[1]];
        Some(self.geometry.pixel(k, end))
    }

    /// Returns true if the pose `other` turns windows of the reference camera in the same way.
    pub fn turns_as(&self, other: &Estimate, matches: &[StereoMatch]) -> bool {
        let k = self.geometry.reference;
        let other = Predictor::new(self.geometry, self.surface, other);
        matches.iter().step_by(SAMPLED).all(|matched| {
            let anchor = Anchor::of(matched, k);
            let warp = |by: &Predictor<'_>| by.warp(k, &anchor, by.to(k, &anchor, anchor.pixel)?);
            match [warp(self), warp(&other)] {
                [Some(own), Some(others)] => own.difference_px(&others) < SAME_PX,
                _ => false,
            }
        })
    }

    /// Returns the window of the image now, around the place `to` of an anchor, in the keyframe's
    /// image.
    ///
    /// Offsets of the keyframe are moved by `J δ / (1 + q·δ)`, which four places around the point
    /// determine. The inverse is `J^-1 d / (1 - (q J^-1)·d)`.
    pub fn warp(&self, k: usize, anchor: &Anchor, to: [f64; 2]) -> Option<PlaneWarp> {
        let centre = Vector2::from(to);
        let mut jacobian = Matrix2::zeros();
        let mut shrink = Vector2::zeros();
        for axis in 0..2 {
            let off = |sign: f64| {
                let mut place = anchor.pixel;
                place[axis] += sign * STEP_PX;
                Some(Vector2::from(self.to(k, anchor, place)?) - centre)
            };
            let (ahead, behind) = (off(1.0)?, off(-1.0)?);
            let lengths = [behind.norm(), ahead.norm()];
            let share = (lengths[0] - lengths[1]) / (lengths[0] + lengths[1]);
            shrink[axis] = share / STEP_PX;
            let column = 0.5 * (ahead * (1.0 + share) - behind * (1.0 - share)) / STEP_PX;
            jacobian.set_column(axis, &column);
        }
        // The back of a surface is not seen.
        let inverse = jacobian
            .try_inverse()
            .filter(|inverse| inverse.determinant() > 0.0)?;
        let shrink = -inverse.transpose() * shrink;
        Some(PlaneWarp {
            linear: [0, 1].map(|i| [0, 1].map(|j| inverse[(i, j)] as f32)),
            shrink: [0, 1].map(|i| shrink[i] as f32),
        })
    }
}
