//! One camera from its images of the board: Zhang's method (2000).
//!
//! Each view gives a homography `H = [h1 h2 h3]` of the board. Its first two columns, seen through
//! the lens, are two sides of a square: `h1ᵀ ω h2 = 0` and `h1ᵀ ω h1 = h2ᵀ ω h2` with
//! `ω = diag(1/fx², 1/fy², 1)` once the principal point, to begin with the middle of the image, has
//! been taken out. That is linear in `1/fx²` and `1/fy²`; poses follow from `H`, and
//! [`super::adjust`] does the rest with all nine parameters.
//!
//! *k3 is held at zero* if the lens would fold the image over with k3 and does not without it: the
//! board was not seen far enough from the centre to determine k3, and extrapolation would do harm.
//!
//! *Images are rejected* if no board is found, if the edges are much more blurred than in the other
//! images, or if residuals are much larger than those of the others. The worst image is rejected
//! first, then everything is solved again.

use nalgebra::{DMatrix, Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::adjust::{BoardImage, BoardView, Bundle, Unsolved};
use super::board::Board;
use super::find::FoundBoard;
use super::homography;
use super::lens::{Lens, NAMES, PARAMETERS};
use super::rejection::ImageRejection;
use crate::median::median;
use trinocular_rig::rig_file::can_undistort;

/// Least number of images that determines nine parameters and leaves a test of them.
pub const LEAST_IMAGES: usize = 3;
/// Largest blur of an image, in multiples of the median image's.
const BLURRED: f64 = 2.0;
/// Blur that rejects no image, px.
const SHARP_PX: f64 = 2.0;
/// Residual that rejects no image, px.
const HARMLESS_PX: f64 = 0.02;

/// Indices of the free parameters: all, or all but k3.
const MODELS: [&[usize]; 2] = [&[0, 1, 2, 3, 4, 5, 6, 7, 8], &[0, 1, 2, 3, 4, 5, 6, 7]];

/// Verdict on an image.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The image was used.
    Used {
        /// Root mean square residual of its corners, px.
        rms_px: f64,
    },
    /// Rejected, with the reason.
    Rejected(ImageRejection),
}

/// Calibrated camera.
#[derive(Clone, Debug)]
pub struct Intrinsics {
    /// Focal lengths, principal point, distortion.
    pub lens: Lens,
    /// Covariance of the lens's parameters; zero for fixed ones.
    pub covariance: DMatrix<f64>,
    /// Names of the coefficients that are held at zero.
    pub held: Vec<&'static str>,
    /// Root mean square residual over all used images, px.
    pub rms_px: f64,
    /// Verdict on each given image.
    pub verdicts: Vec<Verdict>,
    /// Motion from the board's axes to the camera's, mm, per given image that was used.
    pub poses: Vec<Option<Isometry3<f64>>>,
}

impl Intrinsics {
    /// Returns the standard deviations of the lens's parameters.
    pub fn sigma(&self) -> [f64; PARAMETERS] {
        std::array::from_fn(|i| self.covariance[(i, i)].sqrt())
    }

    /// Returns the number of images used.
    pub fn used(&self) -> usize {
        self.poses.iter().flatten().count()
    }
}

/// Reason why a camera cannot be calibrated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IntrinsicsRefusal {
    /// Too few images are left.
    #[error("{used} of {given} images can be used, but a calibration takes {LEAST_IMAGES} or more")]
    Few {
        /// Images that were not rejected.
        used: usize,
        /// All images.
        given: usize,
    },
    /// The adjustment has no solution.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
    /// The solution is not plausible.
    #[error(
        "{name} comes out as {value} with a standard deviation of {sigma}: the views of the board \
         are too alike; tilt it more, in more directions"
    )]
    Vague {
        /// Name of the parameter.
        name: &'static str,
        /// Value of the parameter, rounded.
        value: i64,
        /// Standard deviation of the parameter, rounded up.
        sigma: i64,
    },
}

/// Calibrates a camera from boards found in its images, given per image with the reason if there is
/// none. Images whose residual is larger than `outlier` times the median image's are rejected.
///
/// # Errors
/// [`IntrinsicsRefusal`], with the verdicts so far.
pub fn calibrate(
    board: &Board,
    size_px: [u32; 2],
    images: &[Result<FoundBoard, ImageRejection>],
    outlier: f64,
) -> Result<Intrinsics, (IntrinsicsRefusal, Vec<Verdict>)> {
    let mut verdicts: Vec<Verdict> = images.iter().map(first_verdict).collect();
    reject_blurred(images, &mut verdicts);
    let (mut model, mut is_last) = (0, false);
    loop {
        let kept: Vec<usize> = (0..images.len())
            .filter(|i| matches!(verdicts[*i], Verdict::Used { .. }))
            .collect();
        let corners: Vec<&[[f64; 2]]> = kept
            .iter()
            .filter_map(|i| {
                images[*i]
                    .as_ref()
                    .ok()
                    .map(|found| found.corners.as_slice())
            })
            .collect();
        let (bundle, covariance) = match solve(board, size_px, &corners, MODELS[model]) {
            Ok(solved) => solved,
            Err(IntrinsicsRefusal::Few { used, .. }) => {
                let given = images.len();
                return Err((IntrinsicsRefusal::Few { used, given }, verdicts));
            }
            Err(refusal) => return Err((refusal, verdicts)),
        };
        let rms: Vec<f64> = bundle
            .views
            .iter()
            .map(|view| bundle.rms_px(view, &view.sights[0]))
            .collect();
        let middle = median(rms.clone());
        let mut worst = None;
        for (index, rms_px) in kept.iter().zip(&rms) {
            verdicts[*index] = Verdict::Used { rms_px: *rms_px };
            if *rms_px > (outlier * middle).max(HARMLESS_PX)
                && worst.is_none_or(|(_, most)| *rms_px > most)
            {
                worst = Some((*index, *rms_px));
            }
        }
        let Some((index, rms_px)) = worst else {
            let lens = bundle.lenses[0];
            if !is_last && !can_undistort(&lens.camera(), size_px) {
                // First without k3, then with it if that does not help.
                is_last = model == 1;
                model = 1 - model;
                continue;
            }
            let mut poses = vec![None; images.len()];
            for (index, view) in kept.iter().zip(&bundle.views) {
                poses[*index] = Some(view.pose);
            }
            let squares: f64 = rms.iter().map(|r| r * r).sum();
            return Ok(Intrinsics {
                lens,
                held: (0..PARAMETERS)
                    .filter(|i| !MODELS[model].contains(i))
                    .map(|i| NAMES[i])
                    .collect(),
                covariance,
                rms_px: (squares / rms.len() as f64).sqrt(),
                verdicts,
                poses,
            });
        };
        verdicts[index] = Verdict::Rejected(ImageRejection::Residual {
            rms_px,
            median_px: middle,
        });
    }
}

fn first_verdict(image: &Result<FoundBoard, ImageRejection>) -> Verdict {
    match image {
        Ok(_) => Verdict::Used { rms_px: f64::NAN },
        Err(reason) => Verdict::Rejected(reason.clone()),
    }
}

fn reject_blurred(images: &[Result<FoundBoard, ImageRejection>], verdicts: &mut [Verdict]) {
    let blurs = images
        .iter()
        .filter_map(|image| image.as_ref().ok())
        .map(|found| found.blur_px);
    let middle = median(blurs.collect());
    for (image, verdict) in images.iter().zip(verdicts) {
        let blur_px = image.as_ref().map_or(0.0, |found| found.blur_px);
        if blur_px > SHARP_PX && blur_px > BLURRED * middle {
            *verdict = Verdict::Rejected(ImageRejection::Blurred {
                blur_px,
                median_px: middle,
            });
        }
    }
}

/// Solves lens and poses of these images, with the lens's covariance.
fn solve(
    board: &Board,
    size_px: [u32; 2],
    images: &[&[[f64; 2]]],
    free: &[usize],
) -> Result<(Bundle, DMatrix<f64>), IntrinsicsRefusal> {
    let used = images.len();
    if used < LEAST_IMAGES {
        return Err(IntrinsicsRefusal::Few { used, given: used });
    }
    let lens = initial_lens(board, size_px, images).ok_or(Unsolved::Open)?;
    let views = images
        .iter()
        .map(|corners| {
            let sight = BoardImage {
                camera: 0,
                corners: corners.to_vec(),
            };
            let pose = pose(board, &lens, corners).ok_or(Unsolved::Behind)?;
            Ok(BoardView {
                pose,
                sights: vec![sight],
            })
        })
        .collect::<Result<_, Unsolved>>()?;
    let mut bundle = Bundle {
        board_mm: board.points_mm(),
        lenses: vec![lens],
        motions: vec![Isometry3::identity()],
        views,
    };
    let solution = bundle.adjust(free)?;
    for (i, name) in ["fx", "fy"].into_iter().enumerate() {
        let (value, sigma) = (bundle.lenses[0].0[i], solution.covariance[(i, i)].sqrt());
        if !(value > 0.0 && sigma < 0.1 * value) {
            return Err(IntrinsicsRefusal::Vague {
                name,
                value: value.round() as i64,
                sigma: sigma.ceil() as i64,
            });
        }
    }

    let mut covariance = DMatrix::zeros(PARAMETERS, PARAMETERS);
    for (i, row) in free.iter().enumerate() {
        for (j, column) in free.iter().enumerate() {
            covariance[(*row, *column)] = solution.covariance[(i, j)];
        }
    }
    Ok((bundle, covariance))
}

/// Computes initial focal lengths by the two constraints per image of Zhang (2000), without
/// distortion.
fn initial_lens(board: &Board, size_px: [u32; 2], images: &[&[[f64; 2]]]) -> Option<Lens> {
    let middle = size_px.map(|side| (f64::from(side) - 1.0) / 2.0);
    // Scaled to the order of 1, so that both conditions have equal weights.
    let scale = middle[0] + middle[1];
    let (mut aa, mut ab, mut bb, mut ac, mut bc) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for corners in images {
        let centred: Vec<[f64; 2]> = corners
            .iter()
            .map(|c| [0, 1].map(|i| (c[i] - middle[i]) / scale))
            .collect();
        let h = homography::fit(&board.points_mm(), &centred)?;
        let (u, v) = (h.column(0), h.column(1));
        let size = u.norm() * v.norm();
        for (a, b, c) in [
            (u[0] * v[0], u[1] * v[1], u[2] * v[2]),
            (
                u[0] * u[0] - v[0] * v[0],
                u[1] * u[1] - v[1] * v[1],
                u[2] * u[2] - v[2] * v[2],
            ),
        ] {
            let [a, b, c] = [a / size, b / size, c / size];
            aa += a * a;
            ab += a * b;
            bb += b * b;
            ac -= a * c;
            bc -= b * c;
        }
    }
    let determinant = aa * bb - ab * ab;
    let separate = [
        (bb * ac - ab * bc) / determinant,
        (aa * bc - ab * ac) / determinant,
    ];
    // Boards tilted about one axis only leave one of the two undetermined, and noise may turn its
    // sign; then both are set equal.
    let equal = (ac + bc) / (aa + 2.0 * ab + bb);
    let inverse = if separate.iter().all(|s| *s > 0.0) {
        separate
    } else {
        [equal; 2]
    };
    let [fx, fy] = inverse.map(|s| scale / s.sqrt());
    let is_plausible = |f: f64| f > 0.1 * scale && f < 100.0 * scale;
    (is_plausible(fx) && is_plausible(fy)).then_some(Lens([
        fx, fy, middle[0], middle[1], 0.0, 0.0, 0.0, 0.0, 0.0,
    ]))
}

/// Computes the initial pose of the board in a camera's axes, from the homography of the
/// undistorted corners.
pub fn pose(board: &Board, lens: &Lens, corners: &[[f64; 2]]) -> Option<Isometry3<f64>> {
    let camera = lens.camera();
    let seen: Vec<[f64; 2]> = corners.iter().map(|c| camera.normalise(*c)).collect();
    let h = homography::fit(&board.points_mm(), &seen)?;
    // The board lies in front of the camera.
    let sign = if h[(2, 2)] > 0.0 { 1.0 } else { -1.0 };
    let scale = sign * 2.0 / (h.column(0).norm() + h.column(1).norm());
    let (u, v, t) = (
        h.column(0) * scale,
        h.column(1) * scale,
        h.column(2) * scale,
    );
    let w: Vector3<f64> = u.cross(&v);
    let rough = Matrix3::from_columns(&[u.into_owned(), v.into_owned(), w]);
    // The nearest rotation.
    let svd = rough.svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let rotation = Rotation3::from_matrix_unchecked(rotation);
    let is_finite = rotation
        .matrix()
        .iter()
        .chain(t.iter())
        .all(|e| e.is_finite());
    is_finite.then(|| {
        Isometry3::from_parts(
            Translation3::from(t.into_owned()),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    })
}
