//! Calibration of a rig from a folder of images: everything the command `calibrate` does except its
//! output.

use std::collections::BTreeMap;
use std::path::Path;

use super::board::Board;
use super::find::{FoundBoard, NotFound, find};
use super::intrinsics::{self, Intrinsics, Verdict};
use super::photographs::{self, Photographs};
use super::rejection::ImageRejection;
use super::rig::{self, Instant, RigCamera, RigSolution};
use super::stand::doubts;
use crate::images::Image;
use crate::images::decode::Picture;
use crate::images::rectangle;
use crate::images::series::{Images, Series, pairing};
use trinocular_rig::error::InputError;
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::{RigFile, TRINOCULAR};

/// Largest residual of a rig without a warning, and largest residual of any rig, in multiples of
/// the worst camera's own residual. Images taken with a trembling hand are beyond the first limit,
/// images of different instants far beyond the second.
const DOUBTFUL: f64 = 3.0;
const NONSENSE: f64 = 20.0;

/// Board and limits of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationSettings {
    /// Chessboard in the images.
    pub board: Board,
    /// Half the window for refining corners, px; without, it follows the size of the squares.
    pub half_window: Option<usize>,
    /// Largest residual of an image, in multiples of the median image's; images beyond it are
    /// rejected.
    pub outlier: f64,
    /// Left, top, width and height of the part of each camera's images to search for the board, px;
    /// `None`, or no entry, for whole images.
    pub rectangles_px: Vec<Option<[u32; 4]>>,
}

impl CalibrationSettings {
    /// Returns the rectangle of a camera.
    fn rectangle_px(&self, camera: usize) -> Option<[u32; 4]> {
        self.rectangles_px.get(camera).copied().flatten()
    }

    /// Creates the usual settings for a board.
    pub fn new(board: Board) -> Self {
        Self {
            board,
            half_window: None,
            outlier: 3.0,
            rectangles_px: Vec::new(),
        }
    }
}

/// Calibration of one camera.
#[derive(Clone, Debug)]
pub struct CameraResult {
    /// Name of the camera.
    pub name: String,
    /// Names of the image files, in the order of `intrinsics.verdicts`.
    pub files: Vec<String>,
    /// Width and height of its images, px.
    pub image_size_px: [u32; 2],
    /// Intrinsics of the camera.
    pub intrinsics: Intrinsics,
}

/// Calibrated cameras, with their poses in the rig.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// Cameras in order; left, middle and right come first.
    pub cameras: Vec<CameraResult>,
    /// Names of the instants of `rig.instants`.
    pub instants: Vec<String>,
    /// Poses of the cameras, if there is more than one.
    pub rig: Option<RigSolution>,
}

impl Calibration {
    /// Returns the rig in the form of a rig file. `None` for a single camera. Only cameras with
    /// images of one size form a rig.
    pub fn rig_file(&self) -> Option<RigFile> {
        let lenses: Vec<_> = self
            .cameras
            .iter()
            .map(|camera| camera.intrinsics.lens)
            .collect();
        let rig = self
            .rig
            .as_ref()?
            .rig(self.cameras.first()?.image_size_px, &lenses);
        let names = self
            .cameras
            .iter()
            .map(|camera| camera.name.clone())
            .collect();
        Some(RigFile {
            names,
            rig,
            stage: None,
            rotation: None,
            pivot: Pivot::Centroid,
            trigger: None,
            laser: None,
            targets: Vec::new(),
            capture: Vec::new(),
        })
    }

    /// Formats warnings about the rig for the user.
    pub fn warnings(&self) -> Vec<String> {
        const FEW_IMAGES: usize = 8;
        /// Largest uncertainty of a focal length without a warning, as a share of it. Every depth
        /// has the same relative uncertainty.
        const VAGUE: f64 = 0.01;
        let mut warnings = Vec::new();
        for CameraResult {
            name, intrinsics, ..
        } in &self.cameras
        {
            let used = intrinsics.used();
            if used < FEW_IMAGES {
                warnings.push(format!(
                    "{name}: {used} images are few; {FEW_IMAGES} or more, the board tilted in all \
                     directions, leave less to chance"
                ));
            }
        }
        for CameraResult {
            name, intrinsics, ..
        } in &self.cameras
        {
            let (value, sigma) = (intrinsics.lens.0, intrinsics.sigma());
            let share = (sigma[0] / value[0]).max(sigma[1] / value[1]);
            if share > VAGUE {
                warnings.push(format!(
                    "{name}: the focal lengths are known to {:.1} % only, and depths no better; \
                     tilt the board more, in more directions, and let it fill the view",
                    100.0 * share
                ));
            }
        }
        for CameraResult {
            name, intrinsics, ..
        } in &self.cameras
        {
            if !intrinsics.held.is_empty() {
                warnings.push(format!(
                    "{name}: {} held at 0, since the board does not reach far enough into the \
                     corners to tell",
                    intrinsics.held.join(" and ")
                ));
            }
        }
        if let Some(rig) = &self.rig {
            let own_px = own_rms_px(&self.cameras);
            if rig.rms_px > DOUBTFUL * own_px {
                warnings.push(format!(
                    "together the cameras are {:.3} px off, each alone at most {own_px:.3} px: \
                     images of one name may not be of one instant",
                    rig.rms_px
                ));
            }
            let names: Vec<&str> = self
                .cameras
                .iter()
                .map(|camera| camera.name.as_str())
                .collect();
            warnings.extend(doubts(&names, &rig.stands, &rig.sigma));
        }
        warnings
    }
}

/// Calibrates the cameras whose images are in `dir`. `progress` is called with the share of
/// images that have been searched.
///
/// # Errors
/// [`InputError`] if a camera or the rig cannot be calibrated; single bad images are rejected.
///
/// # Example
/// ```no_run
/// use std::path::Path;
/// use trinocular_vision::calibration::board::Board;
/// use trinocular_vision::calibration::folder::{CalibrationSettings, calibrate};
///
/// let settings = CalibrationSettings::new(Board { corners: [9, 6], square_mm: 25.0 });
/// let calibration = calibrate(Path::new("boards"), &settings, &mut |_share| ())?;
/// for camera in &calibration.cameras {
///     println!("{}: {:.3} px", camera.name, camera.intrinsics.rms_px);
/// }
/// if let Some(rig) = calibration.rig_file() {
///     rig.write(Path::new("rig.toml"))?;
/// }
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
pub fn calibrate(
    dir: &Path,
    settings: &CalibrationSettings,
    progress: &mut dyn FnMut(f64),
) -> Result<Calibration, InputError> {
    calibrate_listed(dir, &photographs::list(dir)?, settings, progress)
}

/// Does the same as [`calibrate`] with listed images; errors name `dir`.
///
/// # Errors
/// See [`calibrate`].
pub fn calibrate_listed(
    dir: &Path,
    photographs: &Photographs,
    settings: &CalibrationSettings,
    progress: &mut dyn FnMut(f64),
) -> Result<Calibration, InputError> {
    let Photographs { series, .. } = photographs;
    let total: usize = series.iter().map(|one| one.stills().len()).sum();
    let mut done = 0;
    let mut next = || {
        done += 1;
        progress((done as f64 / total.max(1) as f64).min(1.0));
    };
    let all = look(dir, series, settings, &mut next)?;
    if !photographs.may_differ
        && let Some(reason) = pairing::differing_rates(series)
    {
        return Err(InputError::file(dir, reason));
    }
    let mut cameras = Vec::with_capacity(series.len());
    let mut instants: BTreeMap<String, Instant> = BTreeMap::new();
    for (index, (one, mut found)) in series.iter().zip(all).enumerate() {
        let rectangle_px = settings.rectangle_px(index);
        let camera = calibrate_camera(dir, one, settings, rectangle_px, &mut found)?;
        let looked = found.instants.into_iter().zip(found.boards);
        for ((instant, found), pose) in looked.zip(&camera.intrinsics.poses) {
            let seen = instants
                .entry(instant)
                .or_insert_with(|| vec![None; series.len()]);
            // An image that its own camera has rejected is not used for the rig either.
            seen[index] = found
                .ok()
                .filter(|_| pose.is_some())
                .map(|found| found.corners);
        }
        cameras.push(camera);
    }
    let (names, instants): (Vec<String>, Vec<Instant>) = instants.into_iter().unzip();
    let rig = match cameras.as_slice() {
        [_] => None,
        cameras => Some(place(dir, cameras, &instants, settings)?),
    };
    Ok(Calibration {
        cameras,
        instants: names,
        rig,
    })
}

/// Boards in the images of one camera.
#[derive(Default)]
struct Looked {
    /// Names of the images' instants.
    instants: Vec<String>,
    /// Names of the images.
    files: Vec<String>,
    boards: Vec<Result<FoundBoard, ImageRejection>>,
    /// Width and height of the images, px, once one has been read.
    size_px: Option<[u32; 2]>,
}

/// Looks for the board in every image of all series, once each: a pipe's come only once. The first
/// images of all cameras come first, because a program that writes several pipes waits if one of
/// them is not read.
fn look(
    dir: &Path,
    series: &[Series],
    settings: &CalibrationSettings,
    next: &mut dyn FnMut(),
) -> Result<Vec<Looked>, InputError> {
    let mut all: Vec<Looked> = series.iter().map(|_| Looked::default()).collect();
    for index in 0.. {
        let mut is_over = true;
        for (camera, (one, looked)) in series.iter().zip(&mut all).enumerate() {
            let number = index + 1;
            let came = match &one.images {
                Images::Stills(stills) => (stills.get(index))
                    .map(|still| (still.instant.clone(), still.name(), still.read(None))),
                Images::Pipe(pipe) => (pipe.next(None))
                    .map(|picture| (number.to_string(), format!("frame {number}"), picture)),
            };
            let Some((instant, file, picture)) = came else {
                continue;
            };
            is_over = false;
            looked.instants.push(instant);
            looked.files.push(file);
            let rectangle_px = settings.rectangle_px(camera);
            let board = corners(picture, settings, rectangle_px, &mut looked.size_px);
            let beyond = rectangle_px.zip(looked.size_px);
            if let Some(reason) = beyond.and_then(|(part, size)| rectangle::beyond(part, size)) {
                let reason = format!("camera `{}`: {reason}", one.name);
                return Err(InputError::file(dir, reason));
            }
            looked.boards.push(board);
            next();
        }
        if is_over {
            break;
        }
    }
    Ok(all)
}

fn calibrate_camera(
    dir: &Path,
    series: &Series,
    settings: &CalibrationSettings,
    rectangle_px: Option<[u32; 4]>,
    looked: &mut Looked,
) -> Result<CameraResult, InputError> {
    let fault =
        |reason: String| InputError::file(dir, format!("camera `{}`: {reason}", series.name));
    let files = looked.files.clone();
    reject_repeated(&files, &mut looked.boards);
    let found = &looked.boards;
    // No readable image counts as too few images.
    let image_size_px = looked.size_px.unwrap_or_default();
    let intrinsics = intrinsics::calibrate(&settings.board, image_size_px, found, settings.outlier)
        .map_err(|(refusal, verdicts)| {
            let searched =
                rectangle_px.map(|[x, y, w, h]| format!("only --roi {x},{y},{w},{h} was searched"));
            let reasons: Vec<String> = std::iter::once(refusal.to_string())
                .chain(searched)
                .chain(by_reason(&files, &verdicts))
                .collect();
            fault(reasons.join("; "))
        })?;
    let name = series.name.clone();
    Ok(CameraResult {
        name,
        files,
        image_size_px,
        intrinsics,
    })
}

/// Returns the largest residual of a camera on its own, px.
fn own_rms_px(cameras: &[CameraResult]) -> f64 {
    let own = cameras.iter().map(|camera| camera.intrinsics.rms_px);
    // Exact corners have zero residual, which cannot serve as a scale.
    own.fold(0.01, f64::max)
}

/// Rejects repeated images, because a second copy adds no information but would count as if it did.
fn reject_repeated(files: &[String], found: &mut [Result<FoundBoard, ImageRejection>]) {
    for index in 1..found.len() {
        let (before, rest) = found.split_at_mut(index);
        let [this, ..] = rest else { continue };
        // Noise moves every corner, so only equal pixels give equal places to the last bit.
        let is_same = |other: &Result<FoundBoard, ImageRejection>| match (other, &*this) {
            (Ok(a), Ok(b)) => a.corners == b.corners,
            _ => false,
        };
        if let Some(first) = before.iter().position(is_same) {
            *this = Err(ImageRejection::Repeated(files[first].clone()));
        }
    }
}

/// Groups rejected images by the reason.
fn by_reason(files: &[String], verdicts: &[Verdict]) -> Vec<String> {
    let mut groups: Vec<(&ImageRejection, Vec<&str>)> = Vec::new();
    for (file, verdict) in files.iter().zip(verdicts) {
        let Verdict::Rejected(reason) = verdict else {
            continue;
        };
        match groups.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, group)) => group.push(file),
            None => groups.push((reason, vec![file])),
        }
    }
    let text =
        |(reason, group): (&ImageRejection, Vec<&str>)| format!("{}: {reason}", group.join(", "));
    groups.into_iter().map(text).collect()
}

/// Finds the board in one image, or in a rectangle of it; `size` is the size of the camera's images,
/// once one has been read.
fn corners(
    picture: Result<Picture, InputError>,
    settings: &CalibrationSettings,
    rectangle_px: Option<[u32; 4]>,
    size: &mut Option<[u32; 2]>,
) -> Result<FoundBoard, ImageRejection> {
    let picture = picture.map_err(|error| ImageRejection::Unreadable(error.reason))?;
    let bits = picture.bits_in_use();
    let image: Image = picture.scaled(bits);
    let own = [image.width, image.height].map(|side| side as u32);
    let first = *size.get_or_insert(own);
    if own != first {
        return Err(ImageRejection::Size { found: own, first });
    }
    let Some(rectangle_px) = rectangle_px else {
        return Ok(find(&image, &settings.board, settings.half_window)?);
    };
    // What lies beyond the rectangle can neither be taken for the board nor hide it.
    let part = image.part(rectangle_px);
    if part.grey.is_empty() {
        return Err(NotFound::Nothing.into());
    }
    let mut found = find(&part, &settings.board, settings.half_window)?;
    let [left, top, ..] = rectangle_px.map(f64::from);
    for [x, y] in &mut found.corners {
        (*x, *y) = (*x + left, *y + top);
    }
    Ok(found)
}

fn place(
    dir: &Path,
    cameras: &[CameraResult],
    instants: &[Instant],
    settings: &CalibrationSettings,
) -> Result<RigSolution, InputError> {
    let [first, ..] = cameras else {
        return Err(InputError::file(dir, rig::RigRefusal::Count(0).to_string()));
    };
    let size = first.image_size_px;
    if let Some(other) = cameras.iter().find(|camera| camera.image_size_px != size) {
        let [[w, h], [width, height]] = [other.image_size_px, size];
        return Err(InputError::file(
            dir,
            format!(
                "the images of `{}` are {w} x {h} px, those of `{}` {width} x {height} px; a \
                 rig's are all of one size",
                other.name, first.name
            ),
        ));
    }
    let middle = cameras
        .iter()
        .position(|camera| camera.name == TRINOCULAR[1]);
    let reference = middle.unwrap_or(0);
    let eyes: Vec<RigCamera> = cameras
        .iter()
        .map(|camera| RigCamera {
            lens: camera.intrinsics.lens,
            covariance: camera.intrinsics.covariance.clone(),
        })
        .collect();
    let placed = rig::calibrate(
        &settings.board,
        &eyes,
        reference,
        instants,
        settings.outlier,
    );
    let own_px = own_rms_px(cameras);
    if let Ok(rig) = &placed
        && rig.rms_px > NONSENSE * own_px
    {
        let reason = format!(
            "the cameras contradict each other: together they are {:.3} px off, each alone at \
             most {own_px:.3} px; images of one name must be of one instant",
            rig.rms_px
        );
        return Err(InputError::file(dir, reason));
    }
    placed.map_err(|refusal| {
        let reason = match &refusal {
            rig::RigRefusal::Apart { camera, instants } => format!(
                "cameras `{}` and `{}` both saw the board in {instants} pairs of images of the \
                 same name, but it takes {}",
                cameras[*camera].name,
                cameras[reference].name,
                rig::LEAST_INSTANTS
            ),
            other => other.to_string(),
        };
        InputError::file(dir, reason)
    })
}
