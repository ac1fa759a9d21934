//! The matrix from what was seen, by least squares.
//!
//! A stage at `p` shows a target at rest displaced by `d = b - A p` along the cameras' axes: `A`
//! says how the stage's axes move the cameras, `b` what the reference picture is off by. The steps
//! are exact beside the pictures, so each camera axis is an ordinary regression of its `d` on `p`.
//! The rig file's matrix takes a displacement along the cameras' axes to one along the stage's:
//! `M = A⁻¹`.
//!
//! The scatter about the fit is that of one picture; if the pictures' own sigma is larger, that is
//! taken. With `C_r` the covariance of row `r` of `A`, and since `dM = -M dA M`:
//!
//! ```text
//! var M_ij = Σ_r M_ir² m_jᵀ C_r m_j      m_j the column j of M
//! ```

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use serde::Serialize;

/// What one stop showed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Where the stage stood, mm along its axes.
    pub position_mm: [f64; 3],
    /// The target's displacement since the reference, mm along the cameras' axes.
    pub displacement_mm: [f64; 3],
    /// Its standard deviation as the pictures have it, mm.
    pub sigma_mm: [f64; 3],
}

/// Fewer samples leave nothing to judge the fit by.
pub const FEWEST: usize = 8;

/// A scatter beyond this many times the pictures' own sigma, and beyond [`ROUGH`], is no noise.
const SIGMAS: f64 = 6.0;

/// Scatter that is borne in any case, as a share of the way that the stage went.
const ROUGH: f64 = 0.002;

/// Largest standard deviation of an element.
const VAGUE: f64 = 0.02;

/// The mounting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Camera axes to stage axes, row by row.
    pub matrix: [[f64; 3]; 3],
    /// Standard deviation of each element.
    pub sigma: [[f64; 3]; 3],
    /// What each sample is off by, mm along the cameras' axes.
    pub residuals_mm: Vec<[f64; 3]>,
    /// Their scatter, mm along the cameras' axes.
    pub scatter_mm: [f64; 3],
    /// What the cameras move by for a mm that the stage is sent, along each stage axis.
    pub scale: [f64; 3],
    /// The stage's axes are mirrored as the cameras see them.
    pub mirrored: bool,
}

/// Why there is no matrix.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Too few stops could be used.
    #[error("{used} of {stops} stops showed the target; {FEWEST} are needed")]
    TooFew {
        /// Stops with a displacement.
        used: usize,
        /// Stops.
        stops: usize,
    },
    /// The positions leave an axis open.
    #[error("the stops that showed the target do not reach along all axes")]
    Flat,
    /// The cameras did not see an axis move.
    #[error(
        "the cameras do not see the stage move along three directions: is a motor off, or do the cameras stand beside the stage?"
    )]
    Unseen,
    /// No matrix explains what was seen.
    #[error(
        "no matrix explains what was seen: along camera axis {axis} it scatters by {scatter_mm:.4} mm, and {allowed_mm:.4} mm could be noise; the target moved, steps were lost or the stage has lost motion"
    )]
    Scattered {
        /// Which camera axis is worst.
        axis: char,
        /// Its scatter, mm.
        scatter_mm: f64,
        /// What could be noise, mm.
        allowed_mm: f64,
    },
    /// The matrix would be too uncertain.
    #[error(
        "the matrix is known to {sigma:.4} only; use a longer --reach, a nearer target or better pictures"
    )]
    Vague {
        /// Standard deviation of its worst element.
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
    use crate::mounting::plan::stops;
    use crate::random::Random;

    /// Turned by 5 degrees about an oblique axis, 1.02 times as far as it is sent, the second axis
    /// the wrong way round.
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
    fn without_noise_the_matrix_is_exact() {
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

    /// Over many sets of noise the errors are as large as the fit says: neither more nor less.
    #[test]
    fn the_standard_deviations_are_those_of_the_errors() {
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
    fn what_no_matrix_explains_is_refused() {
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
