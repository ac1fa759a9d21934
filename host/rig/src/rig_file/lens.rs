//! Lens of a camera: focal lengths, principal point, distortion, and whether images of it can be
//! rectified.

use super::field::Field;
use crate::error::InputError;
use trinocular_core::rig::{Camera, Rotation};

/// Largest focal length, px. Longer ones belong to telescopes.
const LIMIT_FOCAL_PX: f64 = 1e6;
/// Least focal length over the image's side. A shorter one would see more than 168 degrees, which
/// no lens that keeps straight lines straight does.
const LEAST_FOCAL_SHARE: f64 = 0.05;
/// Largest ratio of the two focal lengths, because pixels are nearly square.
const LARGEST_ASPECT: f64 = 10.0;
/// Reason that the refusals by [`can_undistort`] state.
pub const NOT_A_LENS: &str =
    "this lens model cannot be inverted everywhere in the image, so it is not the lens's";
/// Largest coefficient of a lens model. Those of long lenses are large, because they belong to
/// powers of a small radius.
const LIMIT_DISTORTION: f64 = 1e6;

/// Reads the coefficients of a lens: Brown's five, or the rational model's eight.
pub(super) fn coefficients(field: &Field<'_>) -> Result<([f64; 5], [f64; 3]), InputError> {
    let count = field.elements()?.len();
    if count != 8 {
        let brown = field.each(|k| k.number(LIMIT_DISTORTION));
        let brown = brown.map_err(|mut error| {
            if count != 5 {
                error.reason += "; the rational model has 8";
            }
            error
        });
        return Ok((brown?, [0.0; 3]));
    }
    let [k1, k2, p1, p2, k3, k4, k5, k6] = field.each(|k| k.number(LIMIT_DISTORTION))?;
    Ok(([k1, k2, p1, p2, k3], [k4, k5, k6]))
}

/// Returns the index of an impossible focal length, along x or y, and the reason.
pub fn focal_fault(focal_px: [f64; 2], image_size_px: [u32; 2]) -> Option<(usize, String)> {
    for (index, (focal, side)) in focal_px.into_iter().zip(image_size_px).enumerate() {
        let least = (LEAST_FOCAL_SHARE * f64::from(side)).max(1.0);
        if !(focal > 0.0) {
            return Some((index, format!("{focal} must be greater than 0")));
        }
        if !(least..=LIMIT_FOCAL_PX).contains(&focal) {
            let reason = format!(
                "{focal} is out of range ({least} to {LIMIT_FOCAL_PX} px for an image of {side} px)"
            );
            return Some((index, reason));
        }
    }
    let [fx, fy] = focal_px;
    if fx.max(fy) > LARGEST_ASPECT * fx.min(fy) {
        let reason = format!(
            "{fx} and {fy} px differ by more than a factor of {LARGEST_ASPECT}: no pixel is so long"
        );
        return Some((1, reason));
    }
    None
}

/// Returns true if removing and applying the distortion leads back to the same pixel, all around
/// the image's border, and if a rational model neither folds nor has a pole within.
pub fn can_undistort(camera: &Camera, image_size_px: [u32; 2]) -> bool {
    const STEPS: u32 = 16;
    /// Tolerance of the round trip: far below the resolution of any tracker, far above rounding.
    const TOLERANCE_PX: f64 = 1e-3;
    let [width, height] = image_size_px.map(|size| f64::from(size) - 1.0);
    let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
    if camera.is_rational() && !is_rising(camera, corners) {
        return false;
    }
    (0..=STEPS)
        .map(|step| f64::from(step) / f64::from(STEPS))
        .flat_map(|share| {
            let (x, y) = (share * width, share * height);
            [[x, 0.0], [x, height], [0.0, y], [width, y]]
        })
        .all(|pixel| {
            let back = camera.denormalise(camera.normalise(pixel));
            (back[0] - pixel[0]).hypot(back[1] - pixel[1]) < TOLERANCE_PX
        })
}

/// Returns true if the radial distortion rises all the way to the farthest of these pixels, which
/// says that each pixel belongs to one direction.
fn is_rising(camera: &Camera, pixels: [[f64; 2]; 4]) -> bool {
    const STEPS: u32 = 256;
    let upright = Camera {
        rotation: Rotation::NONE,
        ..*camera
    };
    let radius = |pixel: [f64; 2]| {
        let [x, y] = upright.normalise(pixel);
        x.hypot(y)
    };
    let farthest = pixels.map(radius).into_iter().fold(0.0, f64::max);
    let mut last = 0.0;
    farthest.is_finite()
        && (1..=STEPS).all(|step| {
            let r = farthest * f64::from(step) / f64::from(STEPS);
            let seen = r * camera.radial(r * r);
            let is_higher = camera.denominator(r * r) > 0.0 && seen > last;
            last = seen;
            is_higher
        })
}
