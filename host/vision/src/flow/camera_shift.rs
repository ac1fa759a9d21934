//! Cameras that were moved against each other since the keyframe.
//!
//! Each instant by itself gives the misfit of a camera's pixel against the point that all cameras
//! see. What the mean over all points has changed is not of the target, whose motion does not
//! enter, but of the cameras. Errors of the calibration are in both instants, up to a small share
//! of the points' motion in the image. A part of a shift along the baseline looks like a change of
//! depth and stays unseen.

use super::Correspondence;
use super::active_cameras::ActiveCameras;
use super::sync::mean_flow;
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;

/// Least shift that counts, px, of a target at rest.
const LEAST_PX: f64 = 0.02;
/// Least shift that counts, as a share of the motion in the image: more than focal lengths that are
/// wrong by half a percent make of it.
const LEAST_SHARE: f64 = 0.005;
/// Least shift that counts, in standard deviations of the mean.
const LEAST_SIGMAS: f64 = 6.0;

/// Camera whose misfit has changed most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraShift {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Change of its mean misfit, px.
    pub shift_px: [f64; 2],
    /// The same at the target, mm: the order of the error of the displacement.
    pub at_target_mm: f64,
}

impl CameraShift {
    /// Finds the largest significant change in the inliers of a measurement by `cameras`; `None`
    /// if there is none.
    pub fn find(rig: &Rig, cameras: &[usize], inliers: &[Correspondence]) -> Option<Self> {
        let active = ActiveCameras::of(rig, |k| cameras.contains(&k))?;
        let arms = &active.geometry.arms;
        let count = inliers.len() as f64;
        let mut sums = vec![[[0.0; 2]; 2]; arms.cameras()];
        let (mut inverse_depths, mut flow) = (0.0, [0.0; 2]);
        for inlier in inliers {
            let instant = |of: fn(&View) -> [f64; 2]| {
                let (inverse_depth, direction) = arms.fit(inlier.views.iter().map(of));
                let views = arms.arms_mm().iter().zip(&inlier.views);
                let misfits: Vec<[f64; 2]> = views
                    .map(|(arm, view)| {
                        [0, 1].map(|i| of(view)[i] - direction[i] + arm[i] * inverse_depth)
                    })
                    .collect();
                (inverse_depth, misfits)
            };
            let (_, before) = instant(|view| view.start);
            let (inverse_depth, now) = instant(|view| view.end);
            inverse_depths += inverse_depth / count;
            for (sum, mean) in flow.iter_mut().zip(mean_flow(inlier)) {
                *sum += mean / count;
            }
            for (sums, (before, now)) in sums.iter_mut().zip(before.iter().zip(now)) {
                for axis in 0..2 {
                    let change = now[axis] - before[axis];
                    sums[0][axis] += change / count;
                    sums[1][axis] += change * change / count;
                }
            }
        }
        let focal_px = active.geometry.focal_px;
        let least_px = LEAST_PX.max(LEAST_SHARE * flow[0].hypot(flow[1]) * focal_px);
        let shifts = sums
            .iter()
            .zip(&active.cameras)
            .filter_map(|(sums, camera)| {
                let [mean, squares] = *sums;
                let variance = [0, 1].map(|i| (squares[i] - mean[i] * mean[i]).max(0.0) / count);
                let size = mean[0].hypot(mean[1]);
                let is_significant = size > LEAST_SIGMAS * (variance[0] + variance[1]).sqrt();
                let shift_px = mean.map(|mean| mean * focal_px);
                let shift = Self {
                    camera: *camera,
                    shift_px,
                    at_target_mm: size / inverse_depths,
                };
                (is_significant && shift.size_px() > least_px).then_some(shift)
            });
        shifts.max_by(|a, b| a.size_px().total_cmp(&b.size_px()))
    }

    /// Returns the size of the shift, px.
    pub fn size_px(&self) -> f64 {
        self.shift_px[0].hypot(self.shift_px[1])
    }

    /// Returns the warning, given the names of the rig's cameras.
    pub fn warning(&self, names: &[String]) -> String {
        let name = names.get(self.camera).map_or("?", String::as_str);
        format!(
            "the cameras do not agree as they did at the keyframe, {name} by {:.2} px: one of them \
             was moved against the others, and the displacement may be wrong by {:.2} mm",
            self.size_px(),
            self.at_target_mm
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};

    /// Returns what is found if a camera's pixels are shifted now, px.
    fn found(moved: Option<(usize, [f64; 2])>) -> Option<CameraShift> {
        let cloud = Cloud::new();
        let displaced =
            |_: usize, place: [f64; 3]| [place[0] + 9.0, place[1] - 6.0, place[2] + 5.0];
        let mut points = cloud.points(displaced, independent(0.02, 3));
        if let Some((camera, shift_px)) = moved {
            for point in &mut points {
                let end = &mut point.views[camera].end;
                for axis in 0..2 {
                    end[axis] += shift_px[axis] / cloud.geometry.focal_px;
                }
            }
        }
        CameraShift::find(&cloud.geometry.rig, &[0, 1, 2], &points)
    }

    #[test]
    fn cameras_that_stand_still_have_no_shift() {
        assert_eq!(found(None), None);
    }

    /// The motion of 30 mm is 19 px in the image, across the baseline.
    #[test]
    fn wrong_focal_length_is_no_shift() {
        let cloud = Cloud::new();
        let displaced = |_: usize, [x, y, z]: [f64; 3]| [x, y + 30.0, z];
        let mut points = cloud.points(displaced, independent(0.0, 3));
        for view in points.iter_mut().map(|point| &mut point.views[0]) {
            view.start = view.start.map(|at| 1.005 * at);
            view.end = view.end.map(|at| 1.005 * at);
        }
        let found = CameraShift::find(&cloud.geometry.rig, &[0, 1, 2], &points);
        assert_eq!(found, None);
    }

    #[test]
    fn shifted_camera_is_found() {
        for camera in 0..3 {
            let shift = found(Some((camera, [0.0, 0.3]))).expect("a shift");
            assert_eq!(shift.camera, camera);
            // A third of it moves the point that all cameras see.
            assert!((shift.shift_px[1] - 0.2).abs() < 0.02, "{shift:?}");
        }
        // Along the baseline it looks like a change of depth in part.
        assert!(found(Some((1, [0.3, 0.0]))).is_some());
        let left = found(Some((0, [0.5, 0.0]))).expect("a shift");
        assert!(left.at_target_mm > 0.05, "{left:?}");
    }
}
