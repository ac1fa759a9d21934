//! Least-squares fit of the hand-eye matrix.
//!
//! With the stage at `p`, a target at rest appears displaced by `d = b - A p` along the cameras'
//! axes: `A` maps the stage's motion to the cameras', `b` is the error of the keyframe. The steps
//! are exact compared with the images, so each camera axis is an ordinary regression of its `d` on
//! `p`. The rig file's matrix maps a displacement along the cameras' axes to one along the stage's:
//! `M = A⁻¹`.
//!
//! The noise of one image is the scatter about the fit, or the images' own sigma if that is larger.
//! With `C_r` the covariance of row `r` of `A`, and because `dM = -M dA M`:
//!
//! ```text
//! var M_ij = Σ_r M_ir² m_jᵀ C_r m_j      m_j the column j of M
//! ```

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use serde::Serialize;

/// Displacement at one stop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Position of the stage, mm along its axes.
    pub position_mm: [f64; 3],
    /// Displacement of the target since the keyframe, mm along the cameras' axes.
    pub displacement_mm: [f64; 3],
    /// Standard deviation of the displacement as the images give it, mm.
    pub sigma_mm: [f64; 3],
}

/// Fewest samples: fewer leave no redundancy to judge the fit.
pub const FEWEST: usize = 8;

/// Largest scatter that counts as noise, in units of the images' own sigma; see [`ROUGH`].
const SIGMAS: f64 = 6.0;

/// Scatter that counts as noise in any case, as a share of the stage's path.
const ROUGH: f64 = 0.002;

/// Largest standard deviation of an element.
const VAGUE: f64 = 0.02;

/// Fitted hand-eye matrix.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Map from camera axes to stage axes, row by row.
    pub matrix: [[f64; 3]; 3],
    /// Standard deviation of each element.
    pub sigma: [[f64; 3]; 3],
    /// Residual of each sample, mm along the cameras' axes.
    pub residuals_mm: Vec<[f64; 3]>,
    /// Scatter of the residuals, mm along the cameras' axes.
    pub scatter_mm: [f64; 3],
    /// Motion of the cameras per mm of commanded motion, along each stage axis.
    pub scale: [f64; 3],
    /// True if the stage's axes are mirrored with respect to the cameras'.
    pub mirrored: bool,
}

/// Reason for a missing matrix.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Too few stops could be used.
    #[error("{used} of {stops} stops showed the target; {FEWEST} are needed")]
    TooFew {
        /// Number of stops with a displacement.
        used: usize,
        /// Number of all stops.
        stops: usize,
    },
    /// The positions leave at least one axis undetermined.
    #[error("the stops that showed the target do not reach along all axes")]
    Flat,
    /// The cameras did not see an axis move.
    #[error(
        "the cameras do not see the stage move along three directions: is a motor off, or do the \
         cameras stand beside the stage?"
    )]
    Unseen,
    /// No matrix explains the displacements.
    #[error(
        "no matrix explains what was seen: along camera axis {axis} it scatters by {scatter_mm:.4} \
         mm, and {allowed_mm:.4} mm could be noise; the target moved, steps were lost or the stage \
         has lost motion"
    )]
    Scattered {
        /// Camera axis with the largest scatter.
        axis: char,
        /// Scatter along that axis, mm.
        scatter_mm: f64,
        /// Largest scatter that counts as noise, mm.
        allowed_mm: f64,
    },
    /// The matrix would be too uncertain.
    #[error(
        "the matrix is known to {sigma:.4} only; use a longer --reach, a nearer target or better \
         images"
    )]
    Vague {
        /// Standard deviation of the worst element.
        sigma: f64,
    },
}

/// Fits the matrix to the samples of `stops` stops.
///
/// # Errors
/// [`Refusal`].
pub fn fit(samples: &[Sample], stops: usize) -> Result<Fit, Refusal> {
    let used = samples.len();
    if used < FEWEST {
        return Err(Refusal::TooFew { used, stops });
    }
    // About their mean, where the offset is independent of the slopes.
    let count = used as f64;
    let mean: [f64; 3] =
        std::array::from_fn(|i| samples.iter().map(|s| s.position_mm[i]).sum::<f64>() / count);
    let row = |sample: &Sample| {
        let [x, y, z] = std::array::from_fn(|i| mean[i] - sample.position_mm[i]);
        Vector4::new(x, y, z, 1.0)
    };
    let normal = samples
        .iter()
        .map(|s| row(s) * row(s).transpose())
        .sum::<Matrix4<f64>>();
    let reach = (0..3).map(|i| normal[(i, i)]).fold(f64::INFINITY, f64::min);
    let inverse = normal.try_inverse().ok_or(Refusal::Flat)?;
    let mut a = Matrix3::zeros();
    let mut offsets = [0.0; 3];
    for (camera, offset) in offsets.iter_mut().enumerate() {
        let right = samples
            .iter()
            .map(|s| row(s) * s.displacement_mm[camera])
            .sum::<Vector4<f64>>();
        let found = inverse * right;
        a.set_row(camera, &found.fixed_rows::<3>(0).transpose());
        *offset = found[3];
    }
    let residuals_mm: Vec<[f64; 3]> = samples
        .iter()
        .map(|sample| {
            let row = row(sample);
            std::array::from_fn(|camera| {
                let fitted =
                    a.row(camera).transpose().dot(&row.fixed_rows::<3>(0)) + offsets[camera];
                sample.displacement_mm[camera] - fitted
            })
        })
        .collect();
    let freedom = count - 4.0;
    let scatter_mm: [f64; 3] = std::array::from_fn(|camera| {
        (residuals_mm
            .iter()
            .map(|r| r[camera] * r[camera])
            .sum::<f64>()
            / freedom)
            .sqrt()
    });
    let stated_mm: [f64; 3] = std::array::from_fn(|camera| {
        (samples
            .iter()
            .map(|s| s.sigma_mm[camera].powi(2))
            .sum::<f64>()
            / count)
            .sqrt()
    });
    // Root mean square of the way along the shortest axis.
    let way_mm = (reach / count).sqrt();
    for (camera, axis) in ['x', 'y', 'z'].into_iter().enumerate() {
        let allowed_mm = (SIGMAS * stated_mm[camera]).max(ROUGH * way_mm);
        if !(scatter_mm[camera] <= allowed_mm) {
            return Err(Refusal::Scattered {
                axis,
                scatter_mm: scatter_mm[camera],
                allowed_mm,
            });
        }
    }
    let scale: [f64; 3] = std::array::from_fn(|stage| a.column(stage).norm());
    let volume = a.determinant() / scale.iter().product::<f64>();
    if !(volume.abs() > 0.1 && scale.iter().all(|scale| *scale > 0.1)) {
        return Err(Refusal::Unseen);
    }
    let m = a.try_inverse().ok_or(Refusal::Unseen)?;
    let slopes: Matrix3<f64> = inverse.fixed_view::<3, 3>(0, 0).into_owned();
    let variance = |i: usize, j: usize| -> f64 {
        let column: Vector3<f64> = m.column(j).into_owned();
        let spread = (column.transpose() * slopes * column)[(0, 0)];
        let each = |camera: usize| {
            m[(i, camera)].powi(2) * scatter_mm[camera].max(stated_mm[camera]).powi(2)
        };
        (0..3).map(each).sum::<f64>() * spread
    };
    let sigma: [[f64; 3]; 3] =
        std::array::from_fn(|i| std::array::from_fn(|j| variance(i, j).sqrt()));
    let worst = sigma.iter().flatten().copied().fold(0.0, f64::max);
    if !(worst <= VAGUE) {
        return Err(Refusal::Vague { sigma: worst });
    }
    Ok(Fit {
        matrix: std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)])),
        sigma,
        residuals_mm,
        scatter_mm,
        scale,
        mirrored: volume < 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hand_eye::plan::stops;
    use trinocular_rig::random::Random;

    /// Makes a mounting that is turned by 5 degrees about an oblique axis, moves 1.02 times as far
    /// as commanded, and has the second axis reversed.
    fn mounted() -> Matrix3<f64> {
        let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, -2.0, 3.0));
        let turn = nalgebra::Rotation3::from_axis_angle(&axis, 5f64.to_radians());
        turn.matrix() * 1.02 * Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0))
    }

    fn samples(a: &Matrix3<f64>, noise_mm: [f64; 3], seed: u64) -> Vec<Sample> {
        let mut random = Random::seeded(seed);
        let looks = stops([10.0, 0.0, -3.0], 5.0)
            .into_iter()
            .filter(|stop| stop.looks);
        looks
            .map(|stop| {
                let seen = -(a * Vector3::from(stop.position_mm));
                Sample {
                    position_mm: stop.position_mm,
                    displacement_mm: std::array::from_fn(|i| {
                        seen[i] + 1.0 + noise_mm[i] * random.gaussian()
                    }),
                    sigma_mm: noise_mm,
                }
            })
            .collect()
    }

    #[test]
    fn matrix_is_exact_without_noise() {
        let a = mounted();
        let found = fit(&samples(&a, [0.0; 3], 1), 19).unwrap();
        let m = a.try_inverse().unwrap();
        for i in 0..3 {
            for j in 0..3 {
                assert!((found.matrix[i][j] - m[(i, j)]).abs() < 1e-12);
            }
            assert!((found.scale[i] - 1.02).abs() < 1e-12);
        }
        assert!(found.mirrored);
    }

    /// Over many sets of noise the errors are as large as the stated standard deviations.
    #[test]
    fn errors_match_standard_deviations() {
        let (a, noise_mm) = (mounted(), [0.004, 0.003, 0.02]);
        let m = a.try_inverse().unwrap();
        let (mut squares, mut beyond, mut count) = (0.0, 0, 0);
        for seed in 0..400 {
            let found = fit(&samples(&a, noise_mm, seed), 19).unwrap();
            for i in 0..3 {
                for j in 0..3 {
                    let off = (found.matrix[i][j] - m[(i, j)]) / found.sigma[i][j];
                    squares += off * off;
                    beyond += usize::from(off.abs() > 3.0);
                    count += 1;
                }
            }
        }
        let ratio = (squares / f64::from(count)).sqrt();
        println!("error over sigma {ratio:.3}, {beyond} of {count} beyond three");
        // The larger of two estimates of the noise is somewhat too large.
        assert!((0.85..=1.05).contains(&ratio), "{ratio}");
        assert!(beyond <= count as usize / 100, "{beyond}");
    }

    #[test]
    fn inexplicable_samples_are_refused() {
        let noise_mm = [0.004, 0.003, 0.02];
        let mut slipped = samples(&mounted(), noise_mm, 3);
        for sample in slipped.iter_mut().skip(12) {
            sample.displacement_mm[1] += 0.2;
        }
        let refusal = fit(&slipped, 19).unwrap_err();
        assert!(
            matches!(refusal, Refusal::Scattered { axis: 'y', .. }),
            "{refusal}"
        );
        let few = &samples(&mounted(), noise_mm, 3)[..7];
        assert_eq!(fit(few, 19), Err(Refusal::TooFew { used: 7, stops: 19 }));
        // One axis only: the others are open.
        let line = &samples(&mounted(), noise_mm, 3)[..7];
        let line: Vec<Sample> = line.iter().chain(line).copied().collect();
        assert_eq!(fit(&line, 19), Err(Refusal::Flat));
        // The third motor is off.
        let mut off = mounted();
        off.set_column(2, &Vector3::zeros());
        assert_eq!(fit(&samples(&off, noise_mm, 4), 19), Err(Refusal::Unseen));
        let vague = fit(&samples(&mounted(), [0.5; 3], 5), 19);
        assert!(matches!(vague, Err(Refusal::Vague { .. })), "{vague:?}");
    }
}
