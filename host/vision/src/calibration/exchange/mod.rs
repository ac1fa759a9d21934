//! Camera files of other programs: OpenCV's FileStorage (YAML, JSON, XML) and ROS's `camera_info`
//! YAML, one file per camera; also OpenCV 2.4's spellings, `.gz` files, a printed `camera_info`
//! message (`rostopic echo`), the calibration program's INI file (`ost.ini`, `ost.txt`) and
//! MATLAB's `Calib_Results.m`. [`several`] reads files of several cameras; [`rig_of`] makes the rig
//! of any of them.
//!
//! | | OpenCV | ROS |
//! |---|---|---|
//! | lens | `camera_matrix`, `distortion_coefficients` | the same, `distortion_model` `plumb_bob` |
//! | turned | `R`, from the rig's axes to the camera's | `rectification_matrix`, from the camera's axes to the rig's |
//! | place | `T = -R c`, mm | `projection_matrix`, last column `-f c`, m |
//!
//! Rotation and position are optional in OpenCV's files. Only the keys that the other programs
//! write are read, all others are ignored; a missing or impossible value is refused with file, line
//! and name. Both kinds are read by the same code, according to their content. Known layouts that
//! are not read are named, with the way to one that is.
//!
//! `distortion_model` may also be `rational_polynomial` (k4 k5 k6), or empty if all coefficients
//! are 0.

use std::fmt::Write as _;
use std::io::Read as _;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use trinocular_core::rig::{Camera, Rig};

use super::lens::Lens;
use trinocular_rig::error::InputError;
use trinocular_rig::input::{self, Limit, not_utf8};
use trinocular_rig::rig_file::{NOT_A_LENS, can_undistort, focal_fault};
use yaml::{Document, Node, quoted};

mod assemble;
mod files;
mod foreign;
mod ini;
mod matlab;
mod several;
mod xml;
mod yaml;

pub use assemble::{Assembled, Member, assemble};
pub use files::{NoRig, rig_of};
pub use several::{NamedCamera, Several, several};
pub use yaml::Place;

#[cfg(test)]
mod tests;

/// Number of OpenCV's distortion coefficients that the rig file supports: k1 k2 p1 p2 k3 k4 k5 k6.
const KNOWN: usize = 8;
/// Largest deviation of a matrix from a rotation, for files with four digits.
const NOT_A_ROTATION: f64 = 1e-3;
const MM_PER_M: f64 = 1e3;
/// Largest distance of a camera from its origin, mm. A distance beyond 1 km is a mistake in the
/// unit.
const LIMIT_SHIFT_MM: f64 = 1e6;
/// Largest size of a file, which may hold the corners of all images too.
const LIMIT: Limit = Limit {
    what: "a camera file",
    bytes: 4 << 20,
};
/// Names of the values that are read, beside their other spellings.
const KEYS: [&str; 14] = [
    "binning_x",
    "binning_y",
    "roi",
    "image_width",
    "image_height",
    "camera_name",
    "camera_matrix",
    "distortion_coefficients",
    "distortion_model",
    "fisheye_model",
    "R",
    "T",
    "rectification_matrix",
    "projection_matrix",
];

/// Content of one camera's file.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFile {
    /// Width and height of its images, px.
    pub image_size_px: [u32; 2],
    /// Lens: focal lengths, principal point, distortion.
    pub lens: Lens,
    /// Denominator of the rational model, k4 k5 k6; zero without.
    pub rational: [f64; 3],
    /// Motion from the rig's axes to the camera's, mm, if the file has one.
    pub motion: Option<Isometry3<f64>>,
    /// Places of the values in the file.
    pub places: Places,
}

/// Places of the values in a camera's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Places {
    /// Place of focal lengths and principal point.
    pub matrix: Place,
    /// Place of the lens distortion.
    pub distortion: Place,
    /// Place of the rotation.
    pub turn: Option<Place>,
    /// Place of the position.
    pub shift: Option<Place>,
}

/// Returns the name of the camera of a file: `left` for `left.yml` and for `left.yml.gz`.
pub fn camera_name(file: &Path) -> String {
    let end = file.extension();
    let is_packed = end.is_some_and(|end| end.eq_ignore_ascii_case("gz"));
    let plain = match is_packed {
        true => file.with_extension(""),
        false => file.to_owned(),
    };
    let stem = plain.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

impl CameraFile {
    /// Reads an OpenCV or ROS file.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(path, &content(path)?)
    }

    /// Returns the camera at the rig's origin, without rotation.
    pub fn camera(&self) -> Camera {
        Camera {
            rational: self.rational,
            ..self.lens.camera()
        }
    }

    /// Reads the content of an OpenCV or ROS file; errors name `file`.
    ///
    /// ```
    /// use std::path::Path;
    /// use trinocular_vision::calibration::exchange::CameraFile;
    ///
    /// let text = "%YAML:1.0
    /// image_width: 640
    /// image_height: 480
    /// camera_matrix: { rows: 3, cols: 3, data: [ 530., 0., 320., 0., 531., 240., 0., 0., 1. ] }
    /// distortion_coefficients: { rows: 1, cols: 5, data: [ 0., 0., 0., 0., 0. ] }
    /// ";
    /// let file = CameraFile::parse(Path::new("left.yml"), text.as_bytes())?;
    /// assert_eq!((file.image_size_px, file.lens.camera().focal_px), ([640, 480], [530.0, 531.0]));
    /// assert_eq!(file.places.matrix.line, 4);
    /// # Ok::<(), trinocular_rig::error::InputError>(())
    /// ```
    pub fn parse(file: &Path, bytes: &[u8]) -> Result<Self, InputError> {
        let text = &text_of(file, bytes)?;
        let document = match xml::is_xml(text) {
            true => xml::parse(file, text, &KEYS)?,
            false if ini::is_ini(text) => ini::parse(file, text)?,
            false if matlab::is_matlab(text) => matlab::parse(file, text)?,
            false => {
                foreign::check(file, text)?;
                Document::parse(file, text, &KEYS)?
            }
        };
        let root = document.root();
        let side = |key: &str| root.required(key)?.whole(8..=65_535);
        let image_size_px = [side("image_width")?, side("image_height")?];
        let model = root.optional("distortion_model")?;
        let name = model.as_ref().map_or(Ok("plumb_bob"), Node::text)?;
        if let Some(model) = &model
            && !["", "plumb_bob", "rational_polynomial"].contains(&name)
        {
            let reason = format!(
                "the model is `{}`; only plumb_bob (k1 k2 p1 p2 k3) and rational_polynomial (also \
                 k4 k5 k6) can be read: calibrate with one of them",
                quoted(name)
            );
            return Err(model.fault(reason));
        }
        not_binned(&root)?;
        // OpenCV's own calibration program marks fisheyes; the four coefficients alone look like k1
        // k2 p1 p2.
        if let Some(flag) = root.optional("fisheye_model")?
            && flag.number()? != 0.0
        {
            let reason = "a fisheye's coefficients mean something else: calibrate with the model \
                          k1 k2 p1 p2 k3";
            return Err(flag.fault(reason));
        }
        let matrix = root.required("camera_matrix")?;
        let four = matrix_elements(&matrix, image_size_px)?;
        let coefficients = root.required("distortion_coefficients")?;
        let eight = distortion(&coefficients)?;
        // Drivers of rectified and simulated cameras leave the model empty.
        if let Some(model) = &model
            && name.is_empty()
            && eight != [0.0; KNOWN]
        {
            let reason = "the model is empty, but some coefficients are not 0; name the model \
                          they belong to, such as plumb_bob";
            return Err(model.fault(reason));
        }
        let (lens, rational) = lens_of(four, eight);
        let (turn, shift, motion);
        match (root.optional("projection_matrix")?, root.optional("R")?) {
            (Some(projection), _) => {
                let printed = root.optional("K")?.and(root.optional("R")?);
                let rectification = match printed {
                    Some(rectification) => rectification,
                    None => root.required("rectification_matrix")?,
                };
                motion = Some(ros_motion(&rectification, &projection)?);
                (turn, shift) = (Some(rectification), Some(projection));
            }
            (None, Some(matrix)) => {
                let place = root.required("T")?;
                motion = Some(opencv_motion(&matrix, &place)?);
                (turn, shift) = (Some(matrix), Some(place));
            }
            (None, None) => (turn, shift, motion) = (None, None, None),
        }
        let places = Places {
            matrix: matrix.place(),
            distortion: coefficients.place(),
            turn: turn.map(|turn| turn.place()),
            shift: shift.map(|shift| shift.place()),
        };
        let file = Self {
            image_size_px,
            lens,
            rational,
            motion,
            places,
        };
        not_invertible(&file, &coefficients)?;
        Ok(file)
    }
}

/// Reads a camera file, and unpacks it.
fn content(path: &Path) -> Result<Vec<u8>, InputError> {
    let bytes = input::bytes(path, LIMIT)?;
    match bytes.starts_with(&GZIP) {
        true => unpacked(path, &bytes),
        false => Ok(bytes),
    }
}

fn text_of(file: &Path, bytes: &[u8]) -> Result<String, InputError> {
    let text = std::str::from_utf8(bytes);
    let text =
        text.map_err(|error| not_utf8(file, bytes.get(..error.valid_up_to()).unwrap_or_default()))?;
    Ok(text.to_owned())
}

/// Returns the lens of focal lengths, principal point and coefficients, and its denominator.
fn lens_of([fx, fy, cx, cy]: [f64; 4], coefficients: [f64; KNOWN]) -> (Lens, [f64; 3]) {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = coefficients;
    (Lens([fx, fy, cx, cy, k1, k2, p1, p2, k3]), [k4, k5, k6])
}

/// Refuses a lens that is not invertible in the image.
fn not_invertible(file: &CameraFile, coefficients: &Node<'_>) -> Result<(), InputError> {
    match can_undistort(&file.camera(), file.image_size_px) {
        true => Ok(()),
        false => Err(coefficients.fault(NOT_A_LENS)),
    }
}

/// First bytes of a gzip file, which OpenCV writes under names that end in `.gz`.
const GZIP: [u8; 2] = [0x1f, 0x8b];

fn unpacked(path: &Path, bytes: &[u8]) -> Result<Vec<u8>, InputError> {
    let mut unpacked = Vec::new();
    let mut reader = flate2::read::MultiGzDecoder::new(bytes).take(LIMIT.bytes + 1);
    (reader.read_to_end(&mut unpacked)).map_err(|cause| InputError::io(path, "unpack", &cause))?;
    match unpacked.len() as u64 > LIMIT.bytes {
        true => Err(InputError::file(path, "is longer than 4 MB when unpacked")),
        false => Ok(unpacked),
    }
}

/// Refuses a file whose images are binned or cut: its matrix may be that of the full sensor.
fn not_binned(root: &Node<'_>) -> Result<(), InputError> {
    for key in ["binning_x", "binning_y"] {
        if let Some(binning) = root.optional(key)?
            && binning.whole(0..=64)? > 1
        {
            let reason = "binned images are not supported: the matrix is that of the full sensor. \
                          Divide image size, focal lengths and principal point by the binning, \
                          and leave this line out";
            return Err(binning.fault(reason));
        }
    }
    let Some(roi) = root.optional("roi")? else {
        return Ok(());
    };
    for key in ["x_offset", "y_offset", "width", "height"] {
        if let Some(side) = roi.optional(key)?
            && side.whole(0..=65_535)? > 0
        {
            let reason = "a region of interest is not supported: the matrix is that of the full \
                          image. Subtract the offsets from the principal point, give the region's \
                          size as the image's, and leave `roi` out";
            return Err(side.fault(reason));
        }
    }
    Ok(())
}

/// Returns the elements of a matrix in either spelling: `rows`, `cols` and `data`, which must
/// agree.
fn elements(field: &Node<'_>) -> Result<Vec<f64>, InputError> {
    // A printed message has a plain list.
    if field.is_list() {
        return field.elements()?.iter().map(Node::number).collect();
    }
    // No coefficients at all: a camera without distortion.
    let size = |key: &str| field.required(key)?.whole(0..=1000);
    let expected = size("rows")? as usize * size("cols")? as usize;
    let data = field.required("data")?;
    let elements = data
        .elements()?
        .iter()
        .map(Node::number)
        .collect::<Result<Vec<_>, _>>()?;
    match elements.len() {
        found if found == expected => Ok(elements),
        found => Err(data.fault(format!("{found} numbers, but rows and cols say {expected}"))),
    }
}

fn numbers<const N: usize>(field: &Node<'_>) -> Result<[f64; N], InputError> {
    let elements = elements(field)?;
    let found = elements.len();
    elements
        .try_into()
        .map_err(|_| field.fault(format!("expected {N} numbers, found {found}")))
}

/// Returns focal lengths and principal point, checked by the rules of a rig file.
fn matrix_elements(field: &Node<'_>, image_size_px: [u32; 2]) -> Result<[f64; 4], InputError> {
    let [fx, skew, cx, zero, fy, cy, a, b, one] = numbers(field)?;
    if [skew, zero, a, b] != [0.0; 4] || one != 1.0 {
        return Err(field.fault("must be [fx 0 cx; 0 fy cy; 0 0 1]"));
    }
    plausible(field, [fx, fy, cx, cy], image_size_px)?;
    Ok([fx, fy, cx, cy])
}

/// Refuses impossible focal lengths, and a principal point outside of the image.
fn plausible(
    field: &Node<'_>,
    [fx, fy, cx, cy]: [f64; 4],
    image_size_px: [u32; 2],
) -> Result<(), InputError> {
    if let Some((_, reason)) = focal_fault([fx, fy], image_size_px) {
        return Err(field.fault(format!("focal lengths: {reason}")));
    }
    let [width, height] = image_size_px;
    let is_inside = |at: f64, side: u32| (0.0..f64::from(side)).contains(&at);
    if !(is_inside(cx, width) && is_inside(cy, height)) {
        return Err(field.fault(format!(
            "the principal point {cx}, {cy} is outside the image of {width} x {height} px"
        )));
    }
    Ok(())
}

fn distortion(field: &Node<'_>) -> Result<[f64; KNOWN], InputError> {
    let elements = elements(field)?;
    if elements.iter().skip(KNOWN).any(|k| *k != 0.0) {
        let reason = "more than k1 k2 p1 p2 k3 k4 k5 k6: calibrate without the thin-prism and \
                      tilted models, that is, with 5 or 8 coefficients";
        return Err(field.fault(reason));
    }
    Ok(std::array::from_fn(|i| {
        elements.get(i).copied().unwrap_or(0.0)
    }))
}

fn rotation(field: &Node<'_>) -> Result<UnitQuaternion<f64>, InputError> {
    rotation_of(field, Matrix3::from_row_slice(&numbers::<9>(field)?))
}

fn rotation_of(field: &Node<'_>, matrix: Matrix3<f64>) -> Result<UnitQuaternion<f64>, InputError> {
    let off = (matrix * matrix.transpose() - Matrix3::identity())
        .abs()
        .max();
    if !(off < NOT_A_ROTATION && matrix.determinant() > 0.0) {
        return Err(field.fault("not a rotation"));
    }
    Ok(UnitQuaternion::from_rotation_matrix(
        &Rotation3::from_matrix_unchecked(matrix),
    ))
}

fn opencv_motion(turn: &Node<'_>, shift: &Node<'_>) -> Result<Isometry3<f64>, InputError> {
    let place_mm = Vector3::from(numbers::<3>(shift)?);
    check_distance(shift, &place_mm)?;
    Ok(Isometry3::from_parts(place_mm.into(), rotation(turn)?))
}

fn check_distance(field: &Node<'_>, place_mm: &Vector3<f64>) -> Result<(), InputError> {
    if place_mm.iter().all(|mm| mm.abs() <= LIMIT_SHIFT_MM) {
        return Ok(());
    }
    Err(field.fault("puts the camera more than 1 km away"))
}

fn ros_motion(turn: &Node<'_>, projection: &Node<'_>) -> Result<Isometry3<f64>, InputError> {
    // From the camera's axes to the rig's: the inverse of this program's rotation.
    let turn = rotation(turn)?.inverse();
    let [fx, _, _, x, _, fy, _, y, _, _, _, z] = numbers(projection)?;
    if !(fx > 0.0 && fy > 0.0) {
        return Err(projection.fault("focal lengths must be greater than 0"));
    }
    if z != 0.0 {
        return Err(projection.fault("the last number must be 0: rectified cameras share a plane"));
    }
    let place_mm = Vector3::new(-x / fx, -y / fy, 0.0) * MM_PER_M;
    check_distance(projection, &place_mm)?;
    Ok(Isometry3::from_parts((turn * -place_mm).into(), turn))
}

/// Formats a camera of the rig as OpenCV's FileStorage YAML, which `cv2.FileStorage` reads.
pub fn opencv(camera: &Camera, image_size_px: [u32; 2]) -> String {
    let [width, height] = image_size_px;
    let turn = camera.rotation.rows();
    let [x, y] = camera.offset_mm;
    let shift = turn.map(|row| -(row[0] * x + row[1] * y));
    let mut text = format!("%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n");
    let mut matrix = |name: &str, rows: usize, data: &[f64]| {
        let (cols, data) = (data.len() / rows, list(data));
        let _ = writeln!(
            text,
            "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ \
             {data} ]"
        );
    };
    matrix("camera_matrix", 3, &matrix_of(camera));
    matrix("distortion_coefficients", 1, &camera.coefficients());
    matrix("R", 3, turn.as_flattened());
    matrix("T", 3, &shift);
    text
}

/// Formats a camera of the rig as ROS's `camera_info`, which `camera_info_manager` and `image_proc`
/// read. The rectified cameras of one rig share their focal length, the mean of all, and their
/// principal point, the middle of the image.
pub fn ros(name: &str, camera: &Camera, rig: &Rig) -> String {
    let [width, height] = rig.image_size_px;
    let focal = rig.mean_focal_px();
    let [cx, cy] = rig.image_size_px.map(|side| (f64::from(side) - 1.0) / 2.0);
    // Adding zero turns -0 into 0.
    let [tx, ty] = camera
        .offset_mm
        .map(|offset| -focal * offset / MM_PER_M + 0.0);
    let turn = camera.rotation.rows();
    let back: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| turn[j][i]));
    let projection = [focal, 0.0, cx, tx, 0.0, focal, cy, ty, 0.0, 0.0, 1.0, 0.0];
    // A name in JSON's quotes, which YAML reads: otherwise `007` is a number, `a #b` has a comment.
    let name = serde_json::Value::from(name);
    let mut text = format!("image_width: {width}\nimage_height: {height}\ncamera_name: {name}\n");
    let mut matrix = |name: &str, rows: usize, data: &[f64]| {
        let (cols, data) = (data.len() / rows, list(data));
        let _ = writeln!(
            text,
            "{name}:\n  rows: {rows}\n  cols: {cols}\n  data: [{data}]"
        );
    };
    matrix("camera_matrix", 3, &matrix_of(camera));
    matrix("distortion_coefficients", 1, &camera.coefficients());
    matrix("rectification_matrix", 3, back.as_flattened());
    matrix("projection_matrix", 3, &projection);
    let model = if camera.is_rational() {
        "rational_polynomial"
    } else {
        "plumb_bob"
    };
    let _ = writeln!(text, "distortion_model: {model}");
    text
}

fn matrix_of(camera: &Camera) -> [f64; 9] {
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.principal_px);
    [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
}

/// Formats numbers with all digits and a decimal point. Without the point some readers take `5` for
/// an integer and `1e-5` for a text.
fn list(numbers: &[f64]) -> String {
    let text = |number: &f64| {
        let text = format!("{number:?}");
        match text.split_once('e') {
            Some((digits, power)) if !digits.contains('.') => format!("{digits}.0e{power}"),
            _ => text,
        }
    };
    numbers.iter().map(text).collect::<Vec<_>>().join(", ")
}
