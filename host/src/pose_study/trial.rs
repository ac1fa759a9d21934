//! One estimate by either method.

use super::scene::{self, Motion, PIVOT_MM, Target};
use super::{bound, kabsch};
use nalgebra::{Rotation3, Vector3, Vector6};
use trinocular_core::estimate::pose::{self, Observation, Refusal};
use trinocular_core::rig::Rig;
use trinocular_core::sums::centred::Geometry;
use trinocular_rig::random::Random;

/// Errors of one trial: the pivot's displacement, mm, and the rotation, rad.
pub struct Trial {
    /// Error of the pose estimator.
    pub pose: Vector6<f64>,
    /// Variance that it states.
    pub stated: Vector6<f64>,
    /// Error of Kabsch's alignment.
    pub kabsch: Vector6<f64>,
    /// Least variance of any unbiased estimator.
    pub bound: Vector6<f64>,
}

/// Draws points and noise, and estimates once.
pub fn run(
    rig: &Rig,
    (target, count): (&Target, usize),
    motion: &Motion,
    noise_px: f64,
    random: &mut Random,
) -> Result<Trial, Refusal> {
    let geometry = Geometry::new(rig).map_err(|_| Refusal::Degenerate)?;
    let points = scene::points(target, count, random);
    let observed = points.iter().filter_map(|at| {
        let views = scene::views(rig, motion, *at, noise_px, random);
        Observation::new(&geometry, &views)
    });
    let observed: Vec<Observation> = observed.collect();
    let error = |moved: Vector3<f64>, rotation: Rotation3<f64>| {
        let moved = moved - motion.moved_mm;
        let turned = (rotation * motion.rotation.inverse()).scaled_axis();
        Vector6::new(moved.x, moved.y, moved.z, turned.x, turned.y, turned.z)
    };

    let estimate = pose::solve(&geometry, &observed)?;
    let there = estimate.displacement_of(PIVOT_MM);
    let rotation = Rotation3::new(estimate.rotation_rad().into());
    let (moved, turned) = (there.covariance_mm2, estimate.rotation_covariance_rad2());
    let variance = |i: usize| {
        if i < 3 {
            moved[i][i]
        } else {
            turned[i - 3][i - 3]
        }
    };

    let before: Vec<_> = observed.iter().map(Observation::start_mm).collect();
    let after: Vec<_> = observed.iter().map(Observation::end_mm).collect();
    let (aligned, shift) = kabsch::align(&before, &after).ok_or(Refusal::Degenerate)?;
    // About the mean camera, as the observations are.
    let [x, y] = geometry.centre_mm();
    let pivot = Vector3::from(PIVOT_MM) - Vector3::new(x, y, 0.0);
    Ok(Trial {
        pose: error(there.displacement_mm.into(), rotation),
        stated: Vector6::from_fn(|i, _| variance(i)),
        kabsch: error(aligned * pivot + shift - pivot, aligned),
        bound: bound::variance(rig, &points, motion, noise_px).ok_or(Refusal::Degenerate)?,
    })
}
