//! Principal-point alignment of a rig from images of any textured scene: the paper's section 4.1.
//!
//! A principal point that is off by `δ_k` px moves all points of camera `k` by `e_k = δ_k/f_k`.
//! Between parallel cameras in a plane the positions of one point are `ξ_k = α - ρ c_k + e_k`, with
//! the point's direction `α`, inverse depth `ρ` and the camera positions `c_k`. Fitting `α` and `ρ`
//! leaves a residual that is the same for every point of every scene: the part of `e` that is
//! neither a common shift nor proportional to `c`. For the paper's three cameras these are its two
//! tests: equal heights (eq. 2), and disparities in the ratio of the baselines (eq. 3).
//!
//! A scene of unknown depth does not show two parts of the offsets, which stay as they were:
//!
//! * a common shift of all images: the reference camera (the one in the middle) keeps its principal
//!   point;
//! * a shift in proportion to the cameras' places, which is a common error of all disparities: the
//!   correction changes no depth. With a flat target at a known distance it is found too.
//!
//! In a scene of one depth, cameras that are not at their stated `offset_mm` look like offsets too.
//!
//! Cameras in line also show their roll against each other, up to a degree or so; beyond, too few
//! windows match. A significant roll goes into the corrected rig's rotations ([`roll`]).
//!
//! The steps: [`rough`] finds offsets of many pixels by a search across the epipolar lines;
//! [`crate::flow`] matches points to hundredths of a pixel with the rig corrected so far; [`fit`]
//! takes a robust mean of their residuals, with its sigma. [`penalty`] computes the error that the
//! offsets cause in each estimator, [`rewrite`] writes the result into the user's own rig file.

pub mod fit;
pub mod penalty;
pub mod present;
pub mod rewrite;
pub mod roll;
pub mod rough;

use serde::Serialize;
use trinocular_core::rig::Rig;

use crate::flow::region::Regions;
use crate::flow::{self, Flow, mistake};
use crate::images::FrameSet;
use crate::matching::MatchSettings;
use crate::matching::geometry::RigGeometry;
use fit::{Fit, Point};
use penalty::Penalty;
use trinocular_rig::rig_file::RigFile;

/// Limits of an alignment.
#[derive(Clone, Debug, PartialEq)]
pub struct AlignmentSettings {
    /// Largest offset across the epipolar line that is searched, px.
    pub reach_px: f64,
    /// Distance of a flat target along the reference camera's axis, mm, if it is known.
    pub depth_mm: Option<f64>,
    /// Parts of the images in which points may be.
    pub regions: Regions,
}

impl Default for AlignmentSettings {
    fn default() -> Self {
        Self {
            reach_px: 16.0,
            depth_mm: None,
            regions: Regions::default(),
        }
    }
}

/// Reason why there is no alignment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlignmentRefusal {
    /// The rig does not have two cameras in different places.
    #[error("the rig needs two cameras in different places")]
    WrongRig,
    /// Two cameras have the same images.
    #[error(
        "`{}` and `{}` have the same images, so one camera's images are there twice: give each \
         camera its own",
        cameras[0],
        cameras[1]
    )]
    SameImages {
        /// Names of the two cameras.
        cameras: [String; 2],
    },
    /// No offset within the search range explains the images.
    #[error(
        "no offset of up to {reach_px} px explains the images: {agree} of {found} rough matches \
         agree (raise --reach, or show a scene with more texture, of a kind that does not repeat)"
    )]
    NoRoughOffset {
        /// Search range, px.
        reach_px: f64,
        /// Matches that agree with the best offset.
        agree: usize,
        /// All rough matches.
        found: usize,
    },
    /// No frame set could be matched.
    #[error("no frame set can be matched; the first: {0}")]
    Flow(flow::FlowRefusal),
    /// Too few points for a mean with a sigma.
    #[error("{found} matched points; at least {least} are needed")]
    FewPoints {
        /// Points matched.
        found: usize,
        /// Points needed.
        least: usize,
    },
    /// A depth was given, but the scene is not flat.
    #[error(
        "a known depth needs a flat target, but disparities differ from a plane's by \
         {residual_px:.2} px (root mean square)"
    )]
    NotFlat {
        /// Scatter of the disparity to the farthest camera, px.
        residual_px: f64,
    },
    /// Only offsets beyond the search range could explain the given depth.
    #[error(
        "a target at {depth_mm} mm would need an offset of {offset_px:.1} px in camera \
         `{camera}`, more than the {reach_px} px of --reach; without --depth it is seen at \
         {seen_mm:.0} mm: measure again, or raise --reach"
    )]
    WrongDepth {
        /// Depth as given, mm.
        depth_mm: f64,
        /// Depth by the rig without it, mm.
        seen_mm: f64,
        /// Camera with the largest offset.
        camera: String,
        /// Largest offset, px.
        offset_px: f64,
        /// Search range, px.
        reach_px: f64,
    },
}

/// Alignment of one camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Datum {
    /// Name of the camera.
    pub name: String,
    /// New principal point minus the rig file's, px.
    pub offset_px: [f64; 2],
    /// Standard deviation of the offset, px; 0 where the offset is 0 by choice.
    pub sigma_px: [f64; 2],
    /// New principal point, px.
    pub principal_px: [f64; 2],
    /// Roll against the reference camera in excess of the rig file's rotation, degrees, positive
    /// clockwise as seen in the image, and its standard deviation; only for rigs in line.
    pub roll_deg: Option<[f64; 2]>,
    /// New `rotation_deg` of the rig file, which undoes the roll; `None` if the roll may be zero
    /// ([`roll::SIGNIFICANT`]), so that the old rotation stays.
    pub rotation_deg: Option<[f64; 3]>,
    /// Magnification across the line of cameras against the reference camera, per cent, and its
    /// standard deviation; only for rigs in line.
    pub scale_percent: Option<[f64; 2]>,
}

/// Alignment of a rig.
///
/// ```
/// use trinocular_rig::rig_file::RigFile;
/// use trinocular_vision::alignment::{Alignment, AlignmentSettings};
/// use trinocular_vision::images::{Scene, SceneSettings, Texture};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let file = RigFile::paper();
/// let scene = Scene::new(&file.rig, &Texture::natural(1), SceneSettings::default())?;
/// let frame_set = scene.render([0.0; 3], 0, 1);
///
/// // A rig file whose right camera has its principal point 3 px too low.
/// let mut wrong = file.clone();
/// wrong.rig.cameras[2].principal_px[1] += 3.0;
/// let found = Alignment::of(&wrong, &[frame_set], &AlignmentSettings::default())?;
/// assert!((found.cameras[2].offset_px[1] + 3.0).abs() < 0.1);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Alignment {
    /// Alignment of each camera, in the rig's order.
    pub cameras: Vec<Datum>,
    /// Name of the camera that keeps its principal point.
    pub reference: String,
    /// Number of frame sets that could be matched, and of all.
    pub captures: [usize; 2],
    /// Number of inliers.
    pub points: usize,
    /// Number of outliers.
    pub outliers: usize,
    /// Scatter of the points' residuals, px (standard deviation of the worst component).
    pub scatter_px: f64,
    /// Median distance of the points, mm, as the corrected rig sees it.
    pub depth_mm: f64,
    /// Errors that the offsets cause.
    pub penalty: Penalty,
    /// True if the common error of all disparities was found from a known depth.
    pub depth_known: bool,
    /// Names of two cameras that see all points at the same pixels, as one camera does.
    #[serde(skip)]
    pub same_view: Option<[String; 2]>,
    /// Corrected rig.
    #[serde(skip)]
    pub rig: Rig,
}

/// Least number of points.
const LEAST_POINTS: usize = 20;

/// Tolerance of the first matching, px: the largest error of the rough offsets.
const FIRST_TOLERANCE_PX: f64 = 3.0;

/// Tolerance of later matchings, in scatters of the matching before, and its least value, px. It is
/// wider than the noise, so that a rolled camera is not cut to its middle rows.
const SECOND_TOLERANCE: f64 = 6.0;
const LEAST_TOLERANCE_PX: f64 = 0.5;

/// Number of times that a rig with rolled cameras is corrected and matched again, because a roll of
/// some degrees first shows only in the middle of the image.
const TURNS: usize = 3;

impl Alignment {
    /// Aligns the rig of `file` by frame sets of a scene.
    ///
    /// # Errors
    /// [`AlignmentRefusal`], with the figures found.
    pub fn of(
        file: &RigFile,
        frame_sets: &[FrameSet],
        settings: &AlignmentSettings,
    ) -> Result<Self, AlignmentRefusal> {
        let original = &file.rig;
        if let Some(pair) = frame_sets.iter().find_map(mistake::same_image) {
            return Err(AlignmentRefusal::SameImages {
                cameras: pair.map(|k| file.names[k].clone()),
            });
        }
        let roughly = rough::align(original, frame_sets, settings)?;
        let first = refine(&roughly, frame_sets, FIRST_TOLERANCE_PX, settings)?;
        let mut last = refine(&first.rig, frame_sets, first.tolerance_px(), settings)?;
        let mut turned_rad = vec![0.0; original.cameras.len()];
        for _ in 0..TURNS {
            let Some(rig) = roll::undone(&last.rig, &last.fit.turns, &mut turned_rad) else {
                break;
            };
            last = refine(&rig, frame_sets, last.tolerance_px(), settings)?;
        }
        let geometry = RigGeometry::new(original).ok_or(AlignmentRefusal::WrongRig)?;
        let cameras: Vec<Datum> = (0..original.cameras.len())
            .map(|k| last.datum(k, file, turned_rad[k]))
            .collect();
        if let Some(depth_mm) = settings.depth_mm {
            let size = |datum: &Datum| datum.offset_px[0].abs().max(datum.offset_px[1].abs());
            let worst = cameras.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
            // The rough offsets may be off by the tolerance of the first matching.
            let most_px = settings.reach_px + FIRST_TOLERANCE_PX;
            if let Some(worst) = worst.filter(|datum| size(datum) > most_px) {
                return Err(AlignmentRefusal::WrongDepth {
                    depth_mm,
                    seen_mm: seen_mm(&roughly, frame_sets, settings)?,
                    camera: worst.name.clone(),
                    offset_px: size(worst),
                    reach_px: settings.reach_px,
                });
            }
        }
        Ok(Self {
            cameras,
            reference: file.names[geometry.reference].clone(),
            captures: [last.captures, frame_sets.len()],
            points: last.fit.used,
            outliers: last.fit.outliers,
            scatter_px: last.scatter_px,
            depth_mm: last.fit.median_depth_mm,
            penalty: Penalty::of(
                original,
                &last.rig,
                &last.sigma_px(),
                last.fit.median_depth_mm,
                settings.depth_mm.is_some(),
            ),
            depth_known: settings.depth_mm.is_some(),
            same_view: last
                .same_view
                .map(|pair| pair.map(|k| file.names[k].clone())),
            rig: last.rig,
        })
    }
}

/// Computes the median distance of the points by the rig's own disparities, mm.
fn seen_mm(
    rig: &Rig,
    frame_sets: &[FrameSet],
    settings: &AlignmentSettings,
) -> Result<f64, AlignmentRefusal> {
    let settings = AlignmentSettings {
        depth_mm: None,
        ..settings.clone()
    };
    let seen = refine(rig, frame_sets, FIRST_TOLERANCE_PX, &settings)?;
    Ok(seen.fit.median_depth_mm)
}

/// Rig corrected by points that were matched with it.
struct Refined {
    rig: Rig,
    fit: Fit,
    captures: usize,
    scatter_px: f64,
    same_view: Option<[usize; 2]>,
}

/// Matches all frame sets with `rig` and corrects it.
fn refine(
    rig: &Rig,
    frame_sets: &[FrameSet],
    tolerance_px: f64,
    settings: &AlignmentSettings,
) -> Result<Refined, AlignmentRefusal> {
    let (points, overlap, matched) = matched(rig, frame_sets, tolerance_px, &settings.regions)?;
    if points.len() < LEAST_POINTS {
        return Err(AlignmentRefusal::FewPoints {
            found: points.len(),
            least: LEAST_POINTS,
        });
    }
    let (rig, fit) = fit::settle(rig, &points, overlap, settings.depth_mm)?;
    let scatter_px = fit.scatter * rig.mean_focal_px();
    Ok(Refined {
        rig,
        fit,
        captures: matched,
        scatter_px,
        same_view: same_view(&points),
    })
}

/// Largest distance of a point's pixels in two cameras that are one camera, px.
const SAME_PIXEL_PX: f64 = 0.25;
/// Least share of the points with the same pixels in two cameras that are one camera.
const SAME_PIXEL_SHARE: f64 = 0.95;

/// Returns two cameras that see nearly all points at the same pixels. Cameras in different places
/// do so only if their images were shifted for a flat target at just this distance.
fn same_view(points: &[Point]) -> Option<[usize; 2]> {
    let count = points.first()?.pixels.len();
    let mut pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
    pairs.find(|&[a, b]| {
        let is_same = |point: &&Point| {
            let [p, q] = [point.pixels[a], point.pixels[b]];
            (p[0] - q[0]).hypot(p[1] - q[1]) <= SAME_PIXEL_PX
        };
        let same = points.iter().filter(is_same).count();
        same as f64 >= SAME_PIXEL_SHARE * points.len() as f64
    })
}

/// Returns points matched in all cameras, the mean overlap of their windows, and the number of
/// frame sets that could be matched.
fn matched(
    rig: &Rig,
    frame_sets: &[FrameSet],
    tolerance_px: f64,
    regions: &Regions,
) -> Result<(Vec<Point>, f64, usize), AlignmentRefusal> {
    let settings = flow::FlowSettings {
        matching: MatchSettings {
            max_view_residual_px: tolerance_px,
            ..MatchSettings::default()
        },
        ..flow::FlowSettings::default()
    };
    let mut flow = Flow::new(rig, settings).map_err(AlignmentRefusal::Flow)?;
    flow.set_regions(regions.clone());
    let (mut points, mut overlap, mut matched) = (Vec::new(), 0.0, 0);
    let mut refused = None;
    for frame_set in frame_sets {
        // Measured against itself, a frame set gives the matches between its cameras.
        let seen = flow
            .set_keyframe(frame_set)
            .and_then(|()| flow.measure(frame_set));
        match seen {
            Ok(seen) if seen.cameras.len() < rig.cameras.len() => {
                let left = seen.cameras.len();
                refused.get_or_insert(flow::FlowRefusal::FewCameras { left });
            }
            Ok(seen) => {
                overlap += seen.variance_inflation.window_overlap;
                matched += 1;
                let starts = seen.correspondences.iter().map(|track| Point {
                    pixels: track.pixels.iter().map(|[start, _]| *start).collect(),
                });
                points.extend(starts);
            }
            Err(refusal) => {
                refused.get_or_insert(refusal);
            }
        }
    }
    match refused {
        Some(refusal) if matched == 0 => Err(AlignmentRefusal::Flow(refusal)),
        _ => Ok((points, overlap / matched.max(1) as f64, matched)),
    }
}

impl Refined {
    /// Returns the standard deviation of each camera's offset, px.
    fn sigma_px(&self) -> Vec<[f64; 2]> {
        let cameras = self.rig.cameras.iter().zip(&self.fit.sigma);
        cameras
            .map(|(camera, sigma)| [0, 1].map(|i| camera.focal_px[i] * sigma[i]))
            .collect()
    }

    /// Returns the tolerance of the next matching, px.
    fn tolerance_px(&self) -> f64 {
        (SECOND_TOLERANCE * self.scatter_px).clamp(LEAST_TOLERANCE_PX, FIRST_TOLERANCE_PX)
    }

    /// Assembles the alignment of camera `k`. `turned_rad` is the roll that has been corrected; the
    /// roll that the fit still shows is added to it.
    fn datum(&self, k: usize, file: &RigFile, turned_rad: f64) -> Datum {
        let (before, now) = (&file.rig.cameras[k], &self.rig.cameras[k]);
        let turn = self.fit.turns.get(k).copied().flatten();
        let roll_deg = |[roll, sigma]: [f64; 2]| [roll + turned_rad, sigma].map(f64::to_degrees);
        Datum {
            name: file.names[k].clone(),
            offset_px: [0, 1].map(|i| now.principal_px[i] - before.principal_px[i]),
            sigma_px: self.sigma_px()[k],
            principal_px: now.principal_px,
            roll_deg: turn.map(|turn| roll_deg(turn.roll_rad)),
            rotation_deg: (turned_rad != 0.0).then_some(now.rotation.degrees()),
            scale_percent: turn.map(|turn| turn.scale.map(|s| 100.0 * s)),
        }
    }
}

#[cfg(test)]
mod tests;
