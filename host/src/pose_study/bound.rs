//! The Cramér-Rao bound of rotation and displacement.
//!
//! As in [`crate::paper::validation::bound`], the points are unknown too. With `A_i` and `B_i` the
//! information of the pixels before and after about a point's place at that instant, and `R` the
//! rotation, the place after is known with the variance `R A_i^-1 R' + B_i^-1` relative to the
//! motion. A small displacement and rotation about the moved pivot change it by `L_i = [I,
//! -[p_i - pivot]×]`:
//!
//! ```text
//! bound = s² (Σ_i L_i' (R A_i^-1 R' + B_i^-1)^-1 L_i)^-1
//! ```

use super::scene::{Motion, PIVOT_MM};
use crate::paper::validation::bound::position_information;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};
use trinocular_core::rig::Rig;

/// Returns the least variances of the pivot's displacement, mm², and of the rotation, rad², for
/// noise of `noise_px` in every coordinate; `None` if the points do not determine them.
pub fn variance(
    rig: &Rig,
    points_mm: &[[f64; 3]],
    motion: &Motion,
    noise_px: f64,
) -> Option<Vector6<f64>> {
    let pivot = Vector3::from(motion.apply(PIVOT_MM));
    let rotation = motion.rotation.matrix();
    let mut information = Matrix6::zeros();
    for at in points_mm {
        let to = motion.apply(*at);
        let before = position_information(rig, *at).try_inverse()?;
        let after = position_information(rig, to).try_inverse()?;
        let weight = (rotation * before * rotation.transpose() + after).try_inverse()?;
        let mut lever = Matrix3x6::zeros();
        lever
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&Matrix3::identity());
        let arm = (Vector3::from(to) - pivot).cross_matrix();
        lever.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-arm));
        information += lever.transpose() * weight * lever;
    }
    Some(information.try_inverse()?.diagonal() * (noise_px * noise_px))
}

#[cfg(test)]
mod tests {
    use super::super::scene::{TARGETS, points, rig};
    use super::*;
    use crate::paper::validation::bound::variance_mm2;
    use trinocular_rig::random::Random;

    /// Knowing that the target does not turn can only help, and for a deep target hardly does.
    #[test]
    fn bound_is_above_that_of_displacement() {
        let (rig, motion) = (rig(), Motion::slanted(0.0));
        for target in &TARGETS {
            let points = points(target, 100, &mut Random::seeded(1));
            let six = variance(&rig, &points, &motion, 0.05).expect("100 points");
            let moved = super::super::scene::MOVED_MM;
            let three = variance_mm2(&rig, &points, moved, 0.05).expect("100 points");
            for axis in 0..3 {
                let price = (six[axis] / three[axis]).sqrt();
                assert!((0.9999..1.3).contains(&price), "{}: {price}", target.name);
            }
        }
    }

    /// Figures of another program for a poster of 200 x 150 mm: 0.0078 0.0073 0.061 mm, 81 62 5.2
    /// millidegrees.
    #[test]
    fn bound_of_a_poster_is_as_known() {
        let points = points(&TARGETS[0], 100, &mut Random::seeded(2));
        let bound = variance(&rig(), &points, &Motion::slanted(0.0), 0.05).expect("100 points");
        let sigma = bound.map(f64::sqrt);
        let known = [0.0078, 0.0073, 0.061, 0.081, 0.062, 0.0052];
        for (i, known) in known.into_iter().enumerate() {
            let got = if i < 3 {
                sigma[i]
            } else {
                sigma[i].to_degrees()
            };
            assert!(
                (got / known - 1.0).abs() < 0.15,
                "{i}: {got} instead of {known}"
            );
        }
    }
}
