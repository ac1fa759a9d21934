//! Camera poses, expressed in the rig's axes.
//!
//! *The rig's axes* are chosen so that the estimators' rig, a plane of parallel cameras, comes as
//! near to the real one as it can. The plane's x axis runs along the line of the cameras,
//! or, if they are not in line, along the mean of their x axes. If the cameras are turned against
//! each other about their optical axes, such as one that is mounted upside down, it runs along the
//! line whatever their x axes, in the direction of most of them. Its z axis is the mean of
//! their optical axes, put at right angles to the line or, for cameras that spread in two
//! directions, the plane's normal. The rest is a rotation per camera, which
//! [`trinocular_core::rig::Camera`] undoes exactly, and an offset along z, which is reported
//! because nothing undoes it.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use trinocular_core::rig::{Camera, Rotation};

use super::lens::Lens;
use trinocular_rig::rig_file::turned_too_far;

/// Cameras spread in a second direction if they reach this far across their line, as a share of its
/// length.
const SPREAD: f64 = 0.1;
/// Length of the mean of the cameras' x axes below which they point in different directions: two of
/// them 60 degrees apart, or one of several turned by more.
const ALIKE: f64 = 0.87;
/// The line of the cameras is the x axis if it is this near to it, as a cosine.
const ALONG_X: f64 = 0.8;

/// Pose of a camera in the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraPose {
    /// Offset from the rig's origin along the rig's axes, mm: right, down, forward. A plane rig has
    /// no third component.
    pub offset_mm: [f64; 3],
    /// Rotation against the rig's axes: axis times angle, degrees.
    pub rotation_deg: [f64; 3],
}

impl CameraPose {
    /// Returns the camera of a plane rig with this pose and lens.
    pub fn camera(&self, lens: &Lens) -> Camera {
        let [x, y, _] = self.offset_mm;
        // Rounding errors beside the axis are cut off at the picometre, so that cameras in line
        // stay in line.
        let offset_mm = [x, y].map(|offset| (offset * 1e9).round() / 1e9 + 0.0);
        Camera {
            offset_mm,
            rotation: Rotation::from_degrees(self.rotation_deg),
            ..lens.camera()
        }
    }
}

/// Groups [`numbers`] by camera.
pub(super) fn stands(numbers: &[f64]) -> Vec<CameraPose> {
    let of_camera = |six: &[f64]| CameraPose {
        offset_mm: std::array::from_fn(|i| six[i]),
        rotation_deg: std::array::from_fn(|i| six[3 + i]),
    };
    numbers.chunks_exact(6).map(of_camera).collect()
}

/// Converts given camera poses: motions from common axes to each camera's. If the cameras are in a
/// plane of these axes, the axes stay; otherwise new ones are chosen as for calibrated rigs.
pub fn placed(motions: &[Isometry3<f64>]) -> Vec<CameraPose> {
    /// Tolerance of a common plane, above rounding and below any construction.
    const IN_PLANE_MM: f64 = 1e-6;
    let is_plane = motions
        .iter()
        .all(|motion| centre(motion).z.abs() < IN_PLANE_MM);
    let axes = if is_plane {
        Matrix3::identity()
    } else {
        axes(motions)
    };
    stands(&along(&axes, motions))
}

/// Formats warnings about poses that are unusual for a rig, given their standard deviations.
pub fn doubts(names: &[&str], stands: &[CameraPose], sigma: &[CameraPose]) -> Vec<String> {
    /// Largest distance from the plane, as a share of the longest baseline.
    const OUT_OF_PLANE: f64 = 0.01;
    const TURNED_DEG: f64 = 5.0;
    let mut doubts = Vec::new();
    let reach = |stand: &CameraPose| stand.offset_mm[0].hypot(stand.offset_mm[1]);
    let longest = stands.iter().map(reach).fold(0.0, f64::max);
    for ((name, stand), sigma) in names.iter().zip(stands).zip(sigma) {
        let [z, sigma] = [stand, sigma].map(|s| s.offset_mm[2]);
        if z.abs() > (OUT_OF_PLANE * longest).max(2.0 * sigma) {
            let side = if z > 0.0 { "before" } else { "behind" };
            doubts.push(format!(
                "{name} stands {:.2} mm {side} the plane of the cameras; a rig file cannot say \
                 so, and displacements err by about that over the distance to the target",
                z.abs()
            ));
        }
        let turned = stand.rotation_deg.iter().map(|d| d * d).sum::<f64>().sqrt();
        if let Some(reason) = turned_too_far(stand.rotation_deg) {
            doubts.push(format!("{name} is {reason}; no rig file can be written"));
        } else if turned > TURNED_DEG {
            doubts.push(format!(
                "{name} is turned by {turned:.1} degrees; that is rectified, but the cameras see \
                 less in common"
            ));
        }
    }
    doubts
}

/// Returns offset in mm and rotation in degrees along the rig's axes, camera by camera.
pub(super) fn numbers(motions: &[Isometry3<f64>]) -> Vec<f64> {
    along(&axes(motions), motions)
}

/// Returns [`numbers`] along the columns of `axes`.
fn along(axes: &Matrix3<f64>, motions: &[Isometry3<f64>]) -> Vec<f64> {
    let stand = |motion: &Isometry3<f64>| {
        let offset = axes.transpose() * centre(motion);
        let rotation = motion.rotation.to_rotation_matrix().into_inner() * axes;
        // A quaternion keeps every digit of a small angle, and the axis of a half turn.
        let rotation = Rotation3::from_matrix_unchecked(rotation);
        let rotation = UnitQuaternion::from_rotation_matrix(&rotation).scaled_axis();
        let [x, y, z] = rotation.map(f64::to_degrees).into();
        [offset.x, offset.y, offset.z, x, y, z]
    };
    motions.iter().flat_map(stand).collect()
}

/// Returns the position of the camera in the axes from which the motion starts.
fn centre(motion: &Isometry3<f64>) -> Vector3<f64> {
    motion.inverse_transform_vector(&-motion.translation.vector)
}

/// Returns the axes x, y and z of the rig as columns, in the reference camera's axes.
fn axes(motions: &[Isometry3<f64>]) -> Matrix3<f64> {
    let centres: Vec<Vector3<f64>> = motions.iter().map(centre).collect();
    let count = centres.len() as f64;
    let mean = centres.iter().sum::<Vector3<f64>>() / count;
    let scatter: Matrix3<f64> = centres
        .iter()
        .map(|c| (c - mean) * (c - mean).transpose())
        .sum();
    let svd = scatter.svd(true, false);
    let own = |axis: Vector3<f64>| -> Vector3<f64> {
        motions
            .iter()
            .map(|m| m.inverse_transform_vector(&axis))
            .sum::<Vector3<f64>>()
    };
    let right = own(Vector3::x()) / count;
    let ahead = own(Vector3::z()).normalize();
    let Some(u) = svd.u else {
        return Matrix3::identity();
    };
    let line: Vector3<f64> = u.column(0).into_owned();
    // Singular values of the scatter are squares of lengths.
    let is_flat = svd.singular_values[1] > SPREAD * SPREAD * svd.singular_values[0];
    let z = if is_flat {
        let normal: Vector3<f64> = u.column(2).into_owned();
        normal * normal.dot(&ahead).signum()
    } else {
        (ahead - line * line.dot(&ahead)).normalize()
    };
    let is_mixed = right.norm() < ALIKE;
    let along = line.dot(&right);
    let x = if !is_flat && is_mixed {
        line * majority(motions, &line)
    } else if !is_flat && along.abs() > ALONG_X * right.norm() {
        line * along.signum()
    } else if is_mixed {
        first_right(motions, &right)
    } else {
        right
    };
    let x = (x - z * z.dot(&x)).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

/// Returns the sign of `line` along which most cameras' x axes point. Of as many in both directions,
/// the first camera's counts; if all are across the line, it runs from the first camera to the last.
fn majority(motions: &[Isometry3<f64>], line: &Vector3<f64>) -> f64 {
    /// Cosine below which an x axis is across the line.
    const ACROSS: f64 = 0.5;
    let rights = motions
        .iter()
        .map(|motion| line.dot(&motion.inverse_transform_vector(&Vector3::x())));
    let rights: Vec<f64> = rights.filter(|along| along.abs() > ACROSS).collect();
    let sum: f64 = rights.iter().map(|along| along.signum()).sum();
    match rights.first() {
        Some(first) if sum == 0.0 => first.signum(),
        Some(_) => sum.signum(),
        None => {
            let ends = [motions.first(), motions.last()].map(|motion| motion.map(centre));
            match ends {
                [Some(first), Some(last)] => line.dot(&(last - first)).signum(),
                _ => 1.0,
            }
        }
    }
}

/// Returns the mean of the cameras' x axes, or the first camera's if they cancel each other.
fn first_right(motions: &[Isometry3<f64>], mean: &Vector3<f64>) -> Vector3<f64> {
    /// Length of the mean that still is a direction.
    const LEAST: f64 = 0.2;
    match motions.first() {
        Some(first) if mean.norm() < LEAST => first.inverse_transform_vector(&Vector3::x()),
        _ => *mean,
    }
}
