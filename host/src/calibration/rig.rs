//! The rig from boards that several cameras saw at the same instant.
//!
//! Each camera's own calibration says where the board was before it; two cameras that saw the same board thus know how they stand to each
//! other. The medians of all such answers are the start of a bundle adjustment over the cameras' places and the board's, with
//! lenses held as calibrated: they used every image of their camera, this uses the simultaneous ones.
//!
//! *Sigma* has two parts, which do not correlate (a lens's error comes from residuals that no place of the board could take up, those of the rig from
//! residuals that it did): the scatter of this adjustment, and the lenses' covariance through the response of the places to the lenses.
//!
//! *The rig's axes* are chosen so that the estimators' rig, a plane of parallel cameras, comes as near to the real one as it can: the plane's
//! x runs along the line of the cameras, or, if they are not in line, along the mean of their x axes; z is the mean of their optical
//! axes, put at right angles to the line or, for cameras that spread in two directions, the plane's normal. What is left is a rotation per camera,
//! which [`shared::rig::Camera`] undoes exactly, and an offset along z, which nothing undoes: it is reported.

use nalgebra::{DMatrix, Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use shared::rig::{Camera, MAX_CAMERAS, Rig, Rotation};

use super::adjust::{Bundle, PER_CAMERA, Sight, Unsolved, View, moved};
use super::blur::median;
use super::board::Board;
use super::intrinsics::pose;
use super::lens::{Lens, PARAMETERS};

/// Cameras spread in a second direction if they reach this far across their line, as a share of its length.
const SPREAD: f64 = 0.1;
/// The line of the cameras is the x axis if it is this near to it, as a cosine.
const ALONG_X: f64 = 0.8;
/// The fewest instants a rig can be told from.
pub const LEAST_INSTANTS: usize = 3;

/// A camera as the rig needs it.
#[derive(Clone, Debug)]
pub struct Eye {
    /// Its lens, from its own calibration.
    pub lens: Lens,
    /// The lens's covariance.
    pub covariance: DMatrix<f64>,
}

/// One instant: per camera the board's corners, if it saw them.
pub type Instant = Vec<Option<Vec<[f64; 2]>>>;

/// How a camera stands in the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stand {
    /// Right, down and forward of the rig's origin, along the rig's axes, mm. A plane rig has no third component.
    pub offset_mm: [f64; 3],
    /// Against the rig's axes: axis times angle, degrees.
    pub rotation_deg: [f64; 3],
}

impl Stand {
    /// The camera with this lens that stands here, as near as a plane rig has it.
    pub fn camera(&self, lens: &Lens) -> Camera {
        let [x, y, _] = self.offset_mm;
        // What rounding has left beside the axis is cut off at the picometre: cameras in line are in line.
        let offset_mm = [x, y].map(|offset| (offset * 1e9).round() / 1e9 + 0.0);
        Camera {
            offset_mm,
            rotation: Rotation::from_degrees(self.rotation_deg),
            ..lens.camera()
        }
    }
}

/// A calibrated rig.
#[derive(Clone, Debug)]
pub struct RigSolution {
    /// The camera whose place is the origin.
    pub reference: usize,
    /// Per camera.
    pub stands: Vec<Stand>,
    /// Their standard deviations.
    pub sigma: Vec<Stand>,
    /// Root mean square residual over all used images, px.
    pub rms_px: f64,
    /// Per instant: the root mean square residual in px, or why it was not used.
    pub instants: Vec<Result<f64, String>>,
}

/// Why there is no rig.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// One camera, or too many.
    #[error("{0} cameras, but a rig has 2 to {MAX_CAMERAS}")]
    Count(usize),
    /// A camera that has too little in common with the reference camera.
    #[error(
        "camera number {camera} and the reference camera saw the board at {instants} common instants, but it takes {LEAST_INSTANTS} (files of the same name)"
    )]
    Apart {
        /// Index of the camera.
        camera: usize,
        /// Instants both saw.
        instants: usize,
    },
    /// No solution.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

impl RigSolution {
    /// Distance of a camera from the origin's, with its standard deviation, mm.
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

    /// The rig as a rig file holds it: offsets in the plane, rotations, no offset along z.
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

/// Places the cameras. Instants whose residual is larger than `outlier` times the median instant's are left out.
///
/// # Errors
/// [`Refusal`].
pub fn calibrate(
    board: &Board,
    eyes: &[Eye],
    reference: usize,
    instants: &[Instant],
    outlier: f64,
) -> Result<RigSolution, Refusal> {
    let count = eyes.len();
    if !(2..=MAX_CAMERAS).contains(&count) {
        return Err(Refusal::Count(count));
    }
    let mut verdicts: Vec<Result<f64, String>> = instants
        .iter()
        .map(|instant| match instant.iter().flatten().count() {
            0 | 1 => Err("fewer than two cameras have a usable image".to_owned()),
            _ => Ok(f64::NAN),
        })
        .collect();
    loop {
        let kept: Vec<usize> = (0..instants.len())
            .filter(|i| verdicts[*i].is_ok())
            .collect();
        let sights: Vec<Vec<Sighting>> = kept
            .iter()
            .map(|i| sightings(board, eyes, &instants[*i]))
            .collect();
        let motions = initial_motions(count, reference, &sights)?;
        let views = kept
            .iter()
            .zip(sights)
            .filter_map(|(index, sights)| Some((*index, view(&motions, sights)?)));
        let (kept, views): (Vec<usize>, Vec<View>) = views.unzip();
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
            Some((index, rms_px)) if *rms_px > outlier * middle => {
                verdicts[*index] = Err(format!(
                    "the cameras disagree: residual {rms_px:.3} px, {:.1} times the median instant's {middle:.3} px",
                    rms_px / middle
                ));
            }
            _ => {
                let covariance = solution.covariance + through_lenses(&solution.response, eyes);
                let squares: f64 = rms.iter().map(|r| r * r).sum();
                return Ok(RigSolution {
                    reference,
                    stands: stands(&numbers(&bundle.motions)),
                    sigma: stands(&deviations(&bundle.motions, reference, &covariance)),
                    rms_px: (squares / rms.len().max(1) as f64).sqrt(),
                    instants: verdicts,
                });
            }
        }
    }
}

/// One camera's image of the board at one instant.
#[derive(Clone)]
struct Sighting {
    camera: usize,
    corners: Vec<[f64; 2]>,
    /// From the board's axes to the camera's.
    pose: Isometry3<f64>,
}

/// All cameras' sightings, the corners numbered alike: on boards that look the same after a turn, each camera's numbers are turned so
/// that its view of the board is turned least against the first one's.
fn sightings(board: &Board, eyes: &[Eye], instant: &Instant) -> Vec<Sighting> {
    let mut all: Vec<Sighting> = Vec::new();
    for (camera, (eye, corners)) in eyes.iter().zip(instant).enumerate() {
        let Some(corners) = corners else { continue };
        let turned = board.symmetries().iter().filter_map(|quarters| {
            let mut named = corners.clone();
            for (index, at) in corners.iter().enumerate() {
                named[board.turned(index, *quarters)] = *at;
            }
            Some(Sighting {
                camera,
                pose: pose(board, &eye.lens, &named)?,
                corners: named,
            })
        });
        let angle = |sighting: &Sighting| match all.first() {
            Some(first) => sighting.pose.rotation.angle_to(&first.pose.rotation),
            None => 0.0,
        };
        let best = turned.min_by(|a, b| angle(a).total_cmp(&angle(b)));
        all.extend(best);
    }
    all
}

/// From the reference camera's axes to each camera's: medians over the instants that both saw.
fn initial_motions(
    count: usize,
    reference: usize,
    instants: &[Vec<Sighting>],
) -> Result<Vec<Isometry3<f64>>, Refusal> {
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
            return Err(Refusal::Apart {
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

/// A view whose board is where its first camera says; the adjustment asks the others.
fn view(motions: &[Isometry3<f64>], sightings: Vec<Sighting>) -> Option<View> {
    let first = sightings.first()?;
    let pose = motions[first.camera].inverse() * first.pose;
    let sights = sightings
        .into_iter()
        .map(|s| Sight {
            camera: s.camera,
            corners: s.corners,
        })
        .collect();
    Some(View { pose, sights })
}

/// What the lenses' uncertainty adds to the covariance of the motions.
fn through_lenses(response: &DMatrix<f64>, eyes: &[Eye]) -> DMatrix<f64> {
    let free = response.nrows();
    let mut sum = DMatrix::zeros(free, free);
    for (k, eye) in eyes.iter().enumerate() {
        let block = response.columns(PER_CAMERA * k, PARAMETERS);
        sum += block * &eye.covariance * block.transpose();
    }
    sum
}

/// Standard deviations of [`numbers`], from the covariance of all motions but the reference's.
fn deviations(motions: &[Isometry3<f64>], reference: usize, covariance: &DMatrix<f64>) -> Vec<f64> {
    /// Far above rounding, far below any curvature: mm and rad.
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
    let spread = &slopes * covariance * slopes.transpose();
    spread
        .diagonal()
        .iter()
        .map(|variance| variance.max(0.0).sqrt())
        .collect()
}

fn stands(numbers: &[f64]) -> Vec<Stand> {
    let of_camera = |six: &[f64]| Stand {
        offset_mm: std::array::from_fn(|i| six[i]),
        rotation_deg: std::array::from_fn(|i| six[3 + i]),
    };
    numbers.chunks_exact(6).map(of_camera).collect()
}

/// Cameras placed by others, given by the motions from some common axes to theirs. Axes in whose plane the cameras are stay as they
/// are; otherwise new ones are chosen as for calibrated rigs.
pub fn placed(motions: &[Isometry3<f64>]) -> Vec<Stand> {
    /// Above what rounding leaves of a shared plane, below what anybody can build.
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

/// What a user should know of cameras that stand like this, with standard deviations `sigma`, before trusting them as a rig.
pub fn doubts(names: &[&str], stands: &[Stand], sigma: &[Stand]) -> Vec<String> {
    /// Farther out of the plane than this share of the longest baseline.
    const OUT_OF_PLANE: f64 = 0.01;
    const TURNED_DEG: f64 = 5.0;
    let mut doubts = Vec::new();
    let reach = |stand: &Stand| stand.offset_mm[0].hypot(stand.offset_mm[1]);
    let longest = stands.iter().map(reach).fold(0.0, f64::max);
    for ((name, stand), sigma) in names.iter().zip(stands).zip(sigma) {
        let [z, sigma] = [stand, sigma].map(|s| s.offset_mm[2]);
        if z.abs() > (OUT_OF_PLANE * longest).max(2.0 * sigma) {
            let side = if z > 0.0 { "before" } else { "behind" };
            doubts.push(format!(
                "{name} stands {:.2} mm {side} the plane of the cameras; a rig file cannot say so, and displacements err by about that over the \
                 distance to the target",
                z.abs()
            ));
        }
        let turned = stand.rotation_deg.iter().map(|d| d * d).sum::<f64>().sqrt();
        if turned > TURNED_DEG {
            doubts.push(format!(
                "{name} is turned by {turned:.1} degrees; that is rectified, but the cameras see less in common"
            ));
        }
    }
    doubts
}

/// Per camera: offset in mm, rotation in degrees, along the rig's axes.
pub(super) fn numbers(motions: &[Isometry3<f64>]) -> Vec<f64> {
    along(&axes(motions), motions)
}

/// As [`numbers`], along the axes that are the columns of `axes`.
fn along(axes: &Matrix3<f64>, motions: &[Isometry3<f64>]) -> Vec<f64> {
    let stand = |motion: &Isometry3<f64>| {
        let offset = axes.transpose() * centre(motion);
        let rotation = motion.rotation.to_rotation_matrix().into_inner() * axes;
        let rotation = Rotation3::from_matrix_unchecked(rotation).scaled_axis();
        let [x, y, z] = rotation.map(f64::to_degrees).into();
        [offset.x, offset.y, offset.z, x, y, z]
    };
    motions.iter().flat_map(stand).collect()
}

/// Where the camera is, along the axes the motion starts from.
fn centre(motion: &Isometry3<f64>) -> Vector3<f64> {
    motion.inverse_transform_vector(&-motion.translation.vector)
}

/// The rig's x, y and z as columns, along the reference camera's axes.
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
            .normalize()
    };
    let (right, ahead) = (own(Vector3::x()), own(Vector3::z()));
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
    let along = line.dot(&right);
    let x = if !is_flat && along.abs() > ALONG_X {
        line * along.signum()
    } else {
        right
    };
    let x = (x - z * z.dot(&x)).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}
