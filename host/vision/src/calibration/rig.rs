//! Rig from boards that several cameras saw at the same instant.
//!
//! Each camera's own calibration gives the pose of the board; two cameras that saw the same board
//! thus determine their relative pose. The medians of all these estimates are the start of a bundle
//! adjustment over the poses of the cameras and of the board. The lenses are held as calibrated,
//! because they used every image of their camera and this adjustment uses only the simultaneous
//! ones.
//!
//! *Sigma* has two uncorrelated parts: the scatter of this adjustment, and the lenses' covariance
//! through the response of the poses to the lenses. They do not correlate, because a lens's error
//! comes from residuals that no pose of the board could absorb, and the rig's error from residuals
//! that it did.
//!
//! The result is expressed in axes of its own ([`super::stand`]).

use nalgebra::{DMatrix, Isometry3, UnitQuaternion, Vector3};
use trinocular_core::rig::{MAX_CAMERAS, Rig};

use crate::median::median;

use super::adjust::{BoardImage, BoardView, Bundle, PER_CAMERA, Unsolved, moved};
use super::board::Board;
use super::intrinsics::pose;
use super::lens::{Lens, PARAMETERS};
use super::rejection::InstantRejection;
use super::stand::{CameraPose, numbers, stands};

/// Residual that rejects no instant, px.
const HARMLESS_PX: f64 = 0.02;
/// Largest number of instants that decide on the roll of a camera.
const MOST_ROLL_INSTANTS: usize = 100;
/// Least number of instants for a rig.
pub const LEAST_INSTANTS: usize = 3;

/// Calibrated camera, for the solution of a rig.
#[derive(Clone, Debug)]
pub struct RigCamera {
    /// Lens, from the camera's own calibration.
    pub lens: Lens,
    /// Covariance of the lens.
    pub covariance: DMatrix<f64>,
}

/// Corners of the board at one instant, per camera that saw it.
pub type Instant = Vec<Option<Vec<[f64; 2]>>>;

/// Calibrated rig.
#[derive(Clone, Debug)]
pub struct RigSolution {
    /// Index of the camera at the origin.
    pub reference: usize,
    /// Pose of each camera.
    pub stands: Vec<CameraPose>,
    /// Standard deviations of the poses.
    pub sigma: Vec<CameraPose>,
    /// Standard deviations of the rotation of the rig's axes against all cameras together, about x,
    /// y and z, degrees. Displacements are rotated by as much. The rotation about y is the least
    /// certain by far, because it depends on the cameras' offsets along z, which boards seen from
    /// the front hardly determine.
    pub axes_sigma_deg: [f64; 3],
    /// Root mean square residual over all used images, px.
    pub rms_px: f64,
    /// Root mean square residual in px of each instant, or the reason why it was left out.
    pub instants: Vec<Result<f64, InstantRejection>>,
}

/// Reason why a rig cannot be calibrated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RigRefusal {
    /// The number of cameras is not 2 to 8.
    #[error("{0} cameras, but a rig has 2 to {MAX_CAMERAS}")]
    Count(usize),
    /// A camera has too few instants in common with the reference camera.
    #[error(
        "camera number {camera} and the reference camera saw the board at {instants} common \
         instants, but it takes {LEAST_INSTANTS} (files of the same name)"
    )]
    Apart {
        /// Index of the camera.
        camera: usize,
        /// Number of instants that both saw.
        instants: usize,
    },
    /// The adjustment has no solution.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

impl RigSolution {
    /// Returns the distance of a camera from the origin, with its standard deviation, mm.
    pub fn baseline_mm(&self, camera: usize) -> (f64, f64) {
        let (Some(stand), Some(sigma)) = (self.stands.get(camera), self.sigma.get(camera)) else {
            return (0.0, 0.0);
        };
        let length = Vector3::from(stand.offset_mm).norm();
        let along = (0..3).map(|i| (stand.offset_mm[i] * sigma.offset_mm[i]).powi(2));
        match length > 0.0 {
            true => (length, along.sum::<f64>().sqrt() / length),
            false => (0.0, 0.0),
        }
    }

    /// Returns the rig in the form of a rig file: offsets in the plane and rotations, without
    /// offsets along z.
    pub fn rig(&self, image_size_px: [u32; 2], lenses: &[Lens]) -> Rig {
        let cameras = self
            .stands
            .iter()
            .zip(lenses)
            .map(|(stand, lens)| stand.camera(lens));
        Rig {
            image_size_px,
            cameras: cameras.take(MAX_CAMERAS).collect(),
        }
    }
}

/// Solves the poses of the cameras. Instants whose residual is larger than `outlier` times the
/// median instant's are left out.
///
/// # Errors
/// [`RigRefusal`], with the reason.
pub fn calibrate(
    board: &Board,
    eyes: &[RigCamera],
    reference: usize,
    instants: &[Instant],
    outlier: f64,
) -> Result<RigSolution, RigRefusal> {
    let count = eyes.len();
    if !(2..=MAX_CAMERAS).contains(&count) {
        return Err(RigRefusal::Count(count));
    }
    let mut verdicts: Vec<Result<f64, InstantRejection>> = instants
        .iter()
        .map(|instant| match instant.iter().flatten().count() {
            0 | 1 => Err(InstantRejection::FewImages),
            _ => Ok(f64::NAN),
        })
        .collect();
    let rolls_rad = rolls(board, eyes, reference, instants);
    loop {
        let kept: Vec<usize> = (0..instants.len())
            .filter(|i| verdicts[*i].is_ok())
            .collect();
        let sights: Vec<Vec<Sighting>> = kept
            .iter()
            .map(|i| sightings(board, eyes, &rolls_rad, &instants[*i]))
            .collect();
        let motions = initial_motions(count, reference, &sights)?;
        let views = kept
            .iter()
            .zip(sights)
            .filter_map(|(index, sights)| Some((*index, view(&motions, sights)?)));
        let (kept, views): (Vec<usize>, Vec<BoardView>) = views.unzip();
        let lenses = eyes.iter().map(|eye| eye.lens).collect();
        let mut bundle = Bundle {
            board_mm: board.points_mm(),
            lenses,
            motions,
            views,
        };
        let free: Vec<usize> = (0..count)
            .filter(|k| *k != reference)
            .flat_map(|k| (PARAMETERS..PER_CAMERA).map(move |i| PER_CAMERA * k + i))
            .collect();
        let solution = bundle.adjust(&free)?;
        let rms = bundle.views.iter().map(|view| {
            let squares: f64 = view
                .sights
                .iter()
                .map(|s| bundle.rms_px(view, s).powi(2))
                .sum();
            (squares / view.sights.len() as f64).sqrt()
        });
        let rms: Vec<f64> = rms.collect();
        let middle = median(rms.clone());
        for (index, rms_px) in kept.iter().zip(&rms) {
            verdicts[*index] = Ok(*rms_px);
        }
        let worst = kept.iter().zip(&rms).max_by(|a, b| a.1.total_cmp(b.1));
        match worst {
            Some((index, rms_px)) if *rms_px > (outlier * middle).max(HARMLESS_PX) => {
                verdicts[*index] = Err(InstantRejection::Residual {
                    rms_px: *rms_px,
                    median_px: middle,
                });
            }
            _ => {
                let covariance = solution.covariance + through_lenses(&solution.response, eyes);
                let squares: f64 = rms.iter().map(|r| r * r).sum();
                let spread = spread(&bundle.motions, reference, &covariance);
                let deviation = |variance: &f64| variance.max(0.0).sqrt();
                let sigma: Vec<f64> = spread.diagonal().iter().map(deviation).collect();
                return Ok(RigSolution {
                    reference,
                    stands: stands(&numbers(&bundle.motions)),
                    sigma: stands(&sigma),
                    axes_sigma_deg: [0, 1, 2].map(|axis| deviation(&of_mean(&spread, 3 + axis))),
                    rms_px: (squares / rms.len().max(1) as f64).sqrt(),
                    instants: verdicts,
                });
            }
        }
    }
}

/// Pose of the board in one camera at one instant.
#[derive(Clone)]
struct Sighting {
    camera: usize,
    corners: Vec<[f64; 2]>,
    /// Motion from the board's axes to the camera's.
    pose: Isometry3<f64>,
}

/// Computes all cameras' sightings with the same numbering of the corners. On boards that look the
/// same after a turn, each camera's corners are renumbered so that its view of the board is turned
/// against the first camera's as nearly as possible by the difference of their `rolls_rad`.
fn sightings(
    board: &Board,
    eyes: &[RigCamera],
    rolls_rad: &[f64],
    instant: &Instant,
) -> Vec<Sighting> {
    let mut all: Vec<Sighting> = Vec::new();
    let cameras = eyes.iter().zip(rolls_rad).zip(instant);
    for (camera, ((eye, roll_rad), corners)) in cameras.enumerate() {
        let Some(corners) = corners else { continue };
        let turned = candidates(board, camera, eye, corners);
        let angle = |sighting: &Sighting| match all.first() {
            Some(first) => {
                let roll = rolled(roll_rad - rolls_rad[first.camera]);
                let expected = roll * first.pose.rotation;
                sighting.pose.rotation.angle_to(&expected)
            }
            None => 0.0,
        };
        let best = turned.min_by(|a, b| angle(a).total_cmp(&angle(b)));
        all.extend(best);
    }
    all
}

/// Computes a camera's sighting with each numbering of the corners that the board's symmetry
/// allows.
fn candidates(
    board: &Board,
    camera: usize,
    eye: &RigCamera,
    corners: &[[f64; 2]],
) -> impl Iterator<Item = Sighting> {
    board.symmetries().iter().filter_map(move |quarters| {
        let mut named = corners.to_vec();
        for (index, at) in corners.iter().enumerate() {
            named[board.turned(index, *quarters)] = *at;
        }
        Some(Sighting {
            camera,
            pose: pose(board, &eye.lens, &named)?,
            corners: named,
        })
    })
}

/// Returns a rotation about the optical axis.
fn rolled(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

/// Finds the rough roll of each camera against the reference camera, rad, for boards that look the
/// same after a turn. Wrongly numbered corners make the cameras' relative rotation depend on the
/// pose of the board: of eight rolls, the one with the most constant relative rotation is chosen,
/// and none unless it is twice as constant as that without a roll.
fn rolls(board: &Board, eyes: &[RigCamera], reference: usize, instants: &[Instant]) -> Vec<f64> {
    let mut rolls_rad = vec![0.0; eyes.len()];
    if board.symmetries().len() < 2 {
        return rolls_rad;
    }
    for camera in (0..eyes.len()).filter(|camera| *camera != reference) {
        let pair = [camera.min(reference), camera.max(reference)];
        let both = instants.iter().filter_map(|instant| {
            let [first, second] = pair.map(|k| instant[k].as_deref());
            Some([first?, second?])
        });
        let both: Vec<[&[[f64; 2]]; 2]> = both.collect();
        let stride = both.len().div_ceil(MOST_ROLL_INSTANTS).max(1);
        // The rotation of the first camera, and all that the second may have.
        let seen = both.into_iter().step_by(stride).filter_map(|corners| {
            let rotations = |i: usize| {
                let found = candidates(board, pair[i], &eyes[pair[i]], corners[i]);
                found.map(|sighting| sighting.pose.rotation).collect()
            };
            let [first, second]: [Vec<UnitQuaternion<f64>>; 2] = [rotations(0), rotations(1)];
            Some((*first.first()?, second))
        });
        let seen: Vec<(UnitQuaternion<f64>, Vec<UnitQuaternion<f64>>)> = seen.collect();
        let scatter_rad = |eighths: u32| {
            let sign = if pair[1] == camera { 1.0 } else { -1.0 };
            let roll = rolled(sign * f64::from(eighths) * std::f64::consts::FRAC_PI_4);
            let relative = seen.iter().filter_map(|(first, second)| {
                let expected = roll * first;
                let angle = |rotation: &&UnitQuaternion<f64>| rotation.angle_to(&expected);
                let best = second.iter().min_by(|a, b| angle(a).total_cmp(&angle(b)))?;
                Some(best * first.inverse())
            });
            let relative: Vec<UnitQuaternion<f64>> = relative.collect();
            let from_others = |one: &UnitQuaternion<f64>| {
                median(relative.iter().map(|r| r.angle_to(one)).collect())
            };
            let scatters = relative.iter().map(from_others);
            scatters.min_by(f64::total_cmp).unwrap_or(0.0)
        };
        let upright = scatter_rad(0);
        let turned = (1..8).map(|eighths| (eighths, scatter_rad(eighths)));
        let best = turned.min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((eighths, scatter)) = best
            && 2.0 * scatter < upright
        {
            rolls_rad[camera] = f64::from(eighths) * std::f64::consts::FRAC_PI_4;
        }
    }
    rolls_rad
}

/// Computes initial motions from the reference camera's axes to each camera's: medians over the
/// instants that both saw.
fn initial_motions(
    count: usize,
    reference: usize,
    instants: &[Vec<Sighting>],
) -> Result<Vec<Isometry3<f64>>, RigRefusal> {
    let motion = |camera: usize| {
        if camera == reference {
            return Ok(Isometry3::identity());
        }
        let common: Vec<Isometry3<f64>> = instants
            .iter()
            .filter_map(|sights| {
                let of = |k: usize| sights.iter().find(|s| s.camera == k).map(|s| s.pose);
                Some(of(camera)? * of(reference)?.inverse())
            })
            .collect();
        if common.len() < LEAST_INSTANTS {
            return Err(RigRefusal::Apart {
                camera,
                instants: common.len(),
            });
        }
        let middle = |part: &dyn Fn(&Isometry3<f64>) -> Vector3<f64>| {
            Vector3::from_fn(|i, _| median(common.iter().map(|m| part(m)[i]).collect()))
        };
        let shift = middle(&|m| m.translation.vector);
        let turn = middle(&|m| m.rotation.scaled_axis());
        Ok(Isometry3::from_parts(
            shift.into(),
            UnitQuaternion::from_scaled_axis(turn),
        ))
    };
    (0..count).map(motion).collect()
}

/// Returns a view whose board has the pose seen by its first camera; the adjustment uses the other
/// cameras too.
fn view(motions: &[Isometry3<f64>], sightings: Vec<Sighting>) -> Option<BoardView> {
    let first = sightings.first()?;
    let pose = motions[first.camera].inverse() * first.pose;
    let sights = sightings
        .into_iter()
        .map(|s| BoardImage {
            camera: s.camera,
            corners: s.corners,
        })
        .collect();
    Some(BoardView { pose, sights })
}

/// Adds the lenses' uncertainty to the covariance of the motions.
fn through_lenses(response: &DMatrix<f64>, eyes: &[RigCamera]) -> DMatrix<f64> {
    let free = response.nrows();
    let mut sum = DMatrix::zeros(free, free);
    for (k, eye) in eyes.iter().enumerate() {
        let block = response.columns(PER_CAMERA * k, PARAMETERS);
        sum += block * &eye.covariance * block.transpose();
    }
    sum
}

/// Computes the covariance of [`numbers`] from that of all motions but the reference camera's.
fn spread(motions: &[Isometry3<f64>], reference: usize, covariance: &DMatrix<f64>) -> DMatrix<f64> {
    /// Step of the numerical derivatives, mm and rad: far above rounding, far below any curvature.
    const STEP: f64 = 1e-6;
    let others: Vec<usize> = (0..motions.len()).filter(|k| *k != reference).collect();
    let slopes: Vec<Vec<f64>> = (0..6 * others.len())
        .map(|i| {
            let shifted = |step: f64| {
                let mut change = nalgebra::SVector::<f64, 6>::zeros();
                change[i % 6] = step;
                let mut motions = motions.to_vec();
                let camera = others[i / 6];
                motions[camera] = moved(&motions[camera], change);
                numbers(&motions)
            };
            let (low, high) = (shifted(-STEP), shifted(STEP));
            let slope = |(low, high)| (high - low) / (2.0 * STEP);
            low.into_iter().zip(high).map(slope).collect()
        })
        .collect();
    let slopes = DMatrix::from_fn(6 * motions.len(), slopes.len(), |row, column| {
        slopes[column][row]
    });
    &slopes * covariance * slopes.transpose()
}

/// Computes the variance of the mean, over the cameras, of one of the six numbers of a camera.
fn of_mean(spread: &DMatrix<f64>, number: usize) -> f64 {
    let cameras = spread.nrows() / 6;
    let pairs = (0..cameras).flat_map(|j| (0..cameras).map(move |k| [j, k]));
    let sum: f64 = pairs
        .map(|[j, k]| spread[(6 * j + number, 6 * k + number)])
        .sum();
    sum / (cameras * cameras).max(1) as f64
}
