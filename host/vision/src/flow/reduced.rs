//! Soft images: matched and tracked at half the resolution, or at a quarter.
//!
//! A window of a defocused image is smooth, so it correlates at several depths although the image as
//! a whole fits at one only. A soft image loses nothing when it is halved, and then a window of as
//! many pixels sees four times the area: each corner is decided together with its surroundings.
//! Texture that repeats does so at any resolution and is refused at all of them.
//!
//! A [`Flow`] whose keyframe is refused for its texture therefore creates another one for images of
//! half the size, which may create a third. Displacements and normalised coordinates need no
//! conversion; pixels are those of the whole image.

use super::region::{Region, Regions};
use super::{
    Correspondence, FilteredFrameSet, Flow, FlowRefusal, FlowSettings, Measurement, Offered,
    PoseMeasurement, RejectedPoint, StageObserver,
};
use crate::images::Image;
use crate::matching::MatchSettings;
use crate::matching::geometry::RigGeometry;
use crate::matching::pyramid::FramePyramid;
use std::sync::Arc;
use trinocular_core::rig::Rig;

/// Least side of a reduced image, px.
const LEAST_SIDE_PX: u32 = 60;
/// Least distance between two corners of a reduced image, px.
const LEAST_SPACING_PX: f64 = 4.0;
/// Ratio of the least gradients of corners in a halved image and in the whole one: halving leaves
/// less than this of the noise.
const GRADIENT_RATIO: f32 = 0.6;

impl FlowRefusal {
    /// Returns true if a keyframe of half the resolution may be accepted.
    fn may_be_of_soft_images(&self) -> bool {
        matches!(
            self,
            Self::FewCorners { .. } | Self::FewMatches { .. } | Self::AmbiguousDepth { .. }
        )
    }
}

impl Flow {
    /// Creates a tracker for images of half the size, with `filtered` as its keyframe. Returns
    /// `None` if that is refused, too, or cannot be the remedy for `refusal`.
    pub(super) fn with_reduced_keyframe(
        &self,
        filtered: &FilteredFrameSet,
        refusal: &FlowRefusal,
        observer: &mut dyn StageObserver,
    ) -> Option<Box<Self>> {
        let rig = halved_rig(&self.geometry.rig);
        let is_large = rig.image_size_px.iter().all(|side| *side >= LEAST_SIDE_PX);
        if !(is_large && refusal.may_be_of_soft_images()) {
            return None;
        }
        let spacing_px = (self.settings.min_spacing_px / 2.0).max(LEAST_SPACING_PX);
        let mut reduced = Self {
            geometry: RigGeometry::new(&rig)?,
            settings: FlowSettings {
                min_spacing_px: spacing_px.min(self.settings.min_spacing_px),
                min_gradient: GRADIENT_RATIO * self.settings.min_gradient,
                // As large in the scene as before: a rig that is not aligned stays refused.
                matching: MatchSettings {
                    max_view_residual_px: self.settings.matching.max_view_residual_px / 2.0,
                    ..self.settings.matching.clone()
                },
                ..self.settings.clone()
            },
            regions: self.regions.halved(),
            pivot: None,
            keyframe: None,
            last_pose: None,
            reduced: None,
            frozen_cameras: Default::default(),
            pyramid_pool: Default::default(),
            thread_pool: self.thread_pool.clone(),
        };
        let halved = reduced.halved(filtered);
        reduced.set_filtered_keyframe(halved, observer).ok()?;
        Some(Box::new(reduced))
    }

    /// Returns a frame set of twice the size as this tracker filters it.
    pub(super) fn halved(&self, filtered: &FilteredFrameSet) -> FilteredFrameSet {
        let levels = self.levels();
        let pyramids = filtered.pyramids.iter().collect();
        let halved = |pyramid: &FramePyramid| pyramid.halved(levels);
        FilteredFrameSet {
            pyramids: self.thread_pool.map(pyramids, halved),
            camera_refusals: filtered.camera_refusals.clone(),
            fingerprints: filtered.fingerprints.clone(),
        }
    }
}

/// Returns the rig with images of half the size. Pixel `(x, y)` of a half image lies at `(2x, 2y)` of
/// the whole one.
fn halved_rig(rig: &Rig) -> Rig {
    let mut halved = rig.clone();
    halved.image_size_px = rig.image_size_px.map(|side| side.div_ceil(2));
    for camera in &mut halved.cameras {
        camera.focal_px = camera.focal_px.map(|px| px / 2.0);
        camera.principal_px = camera.principal_px.map(|px| px / 2.0);
    }
    halved
}

impl Regions {
    /// Returns the regions of images of half the size.
    pub(super) fn halved(&self) -> Self {
        Self(self.0.iter().map(Region::halved).collect())
    }
}

impl Region {
    fn halved(&self) -> Self {
        // Rounded inwards, so that no point lies outside the rectangle.
        let rectangle = |[left, top, width, height]: [u32; 4]| {
            let [(x, columns), (y, rows)] =
                [(left, width), (top, height)].map(|(start, length)| {
                    let first = start.div_ceil(2);
                    let end = start.saturating_add(length) / 2;
                    (first, end.saturating_sub(first))
                });
            [x, y, columns, rows]
        };
        Self {
            rectangle_px: self.rectangle_px.map(rectangle),
            mask: self.mask.as_ref().map(|mask| Arc::new(halved_mask(mask))),
        }
    }
}

/// Returns every second pixel of every second row.
fn halved_mask(mask: &Image) -> Image {
    let rows = mask.grey.chunks(mask.width.max(1)).step_by(2);
    Image {
        width: mask.width.div_ceil(2),
        height: mask.height.div_ceil(2),
        grey: rows
            .flat_map(|row| row.iter().step_by(2).copied())
            .collect(),
    }
}

fn doubled(pixel: [f64; 2]) -> [f64; 2] {
    pixel.map(|c| 2.0 * c)
}

impl Correspondence {
    /// Returns the same points in images of twice the size.
    fn enlarged(mut self) -> Self {
        for pixels in &mut self.pixels {
            *pixels = pixels.map(doubled);
        }
        self
    }
}

impl Measurement {
    /// Returns the measurement with pixels of images of twice the size.
    pub(super) fn enlarged(mut self) -> Self {
        self.correspondences = enlarged(self.correspondences);
        enlarge(&mut self.rejected_points);
        self
    }
}

impl PoseMeasurement {
    /// Returns the measurement with pixels of images of twice the size.
    pub(super) fn enlarged(mut self) -> Self {
        self.correspondences = enlarged(self.correspondences);
        enlarge(&mut self.rejected_points);
        self
    }
}

impl Offered {
    /// Returns the measurement with pixels of images of twice the size.
    pub(super) fn enlarged(self) -> Self {
        match self {
            Self::Pose(seen) => Self::Pose(Box::new(seen.enlarged())),
            Self::Displacement(seen) => Self::Displacement(Box::new(seen.enlarged())),
        }
    }
}

fn enlarge(points: &mut [RejectedPoint]) {
    let pixels = points.iter_mut().flat_map(|point| &mut point.pixels);
    for pixel in pixels {
        *pixel = doubled(*pixel);
    }
}

fn enlarged(points: Vec<Correspondence>) -> Vec<Correspondence> {
    points.into_iter().map(Correspondence::enlarged).collect()
}

#[cfg(test)]
mod tests;
