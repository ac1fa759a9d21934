//! The rig file: cameras and stage as TOML, read strictly.
//!
//! ```toml
//! image_size_px = [320, 240]            # every camera's image: columns, rows
//! rotation = "estimate"                 # of the target, or "refuse"; default "estimate"
//! pivot = [0.0, 0.0, 850.0]             # mm; not with "refuse"; default "centroid"
//!
//! [[camera]]                            # 2 to 8 of them
//! name = "left"                         # also the name of its folder of images
//! focal_px = [533.16, 529.12]           # along x, along y
//! principal_px = [154.43, 123.0]        # from the centre of the top left pixel
//! offset_mm = [-70.0, 0.0]              # right and down of the rig's origin
//! distortion = [0.0, 0.0, 0.0, 0.0, 0.0] # OpenCV's k1 k2 p1 p2 k3, or also k4 k5 k6;
//!                                       # optional, default 0
//! rotation_deg = [0.0, 0.0, 0.0]        # about the rig's x, y, z; optional, default 0
//! device = "genicam:GV01"               # and settings of the camera; optional, see `Capture`
//!
//! [stage]                               # optional; see `Stage`
//!
//! [trigger]                             # optional; see `Trigger`
//!
//! [laser]                               # optional; see `Laser`
//! ```
//!
//! The rotation (axis times angle, OpenCV's rotation vector in degrees) takes directions along the
//! rig's axes to directions along the camera's. Every pixel is rectified by it on input, so cameras
//! need not be exactly parallel.
//!
//! Unknown, missing and impossible fields are refused with file, line and name of the field. Only
//! distortion, rotations, pivot, the trigger's polarity, exposure and wait, and the fields of
//! [`Capture`] and [`Care`] have defaults, because a stage with a guessed rig may run away.
//!
//! *Invariant:* a `RigFile` from [`RigFile::read`] or [`RigFile::parse`] obeys every rule stated on
//! its fields, and cameras named left, middle and right stand in this order.

use std::fmt::Write as _;
use std::path::Path;

use toml::de::{DeTable, DeValue};
use trinocular_core::rig::{Camera, HEIGHT_ERROR_LIMIT, MAX_CAMERAS, Rig, Rotation};

use crate::error::InputError;
use crate::input::{self, Limit};
use crate::output::{Output, Replace};
use crate::pivot::{self as treatment, Pivot};
use field::{Field, Source};

pub mod capture;
mod care;
mod doubt;
pub mod edit;
pub mod field;
mod laser;
mod lens;
mod pivot;
mod stage;
mod target;
pub mod template;
mod trigger;

pub use capture::Capture;
pub use care::{Care, HomeSwitch};
pub use laser::Laser;
pub use lens::{NOT_A_LENS, can_undistort, focal_fault};
pub use stage::{Driver, Stage, along_stage};
pub use target::{MOST_TARGETS, Target};
pub use trigger::Trigger;

/// Names of the paper's three cameras, in the order its estimators need.
pub const TRINOCULAR: [&str; 3] = ["left", "middle", "right"];

/// Size limit of a rig file. A rig file has a few hundred lines; its numbers are read in linear
/// time up to this limit.
pub const LIMIT: Limit = Limit {
    what: "a rig file",
    bytes: 1 << 20,
};
/// Valid sides of an image, px.
const IMAGE_SIDE_PX: std::ops::RangeInclusive<u32> = 8..=65_535;
/// Largest offset of a camera, mm. A rig wider than 100 m is a mistake of the unit.
const LIMIT_OFFSET_MM: f64 = 1e5;
/// Largest rotation of a camera, degrees. Cameras turned farther were not meant to be parallel and
/// have too small a common view.
pub const LIMIT_ROTATION_DEG: f64 = 20.0;
/// Largest component of a rotation that is read, degrees.
const FULL_TURN_DEG: f64 = 360.0;
/// Least distance between two cameras, mm. Closer ones are the same camera twice.
const LEAST_BASELINE_MM: f64 = 0.1;

/// Fields that every camera has, each with an example.
const CAMERA_FIELDS: [(&str, &str); 4] = [
    ("name", "name = \"left\""),
    ("focal_px", "focal_px = [800.0, 800.0]"),
    ("principal_px", "principal_px = [319.5, 239.5]"),
    ("offset_mm", "offset_mm = [-30.0, 0.0]"),
];

/// Fields of a camera that describe its lens and its place.
const LENS_FIELDS: [&str; 6] = [
    "name",
    "focal_px",
    "principal_px",
    "offset_mm",
    "distortion",
    "rotation_deg",
];

/// Required arrangement of the cameras.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shape {
    /// Any arrangement of 2 to 8 cameras in a plane, for the midpoint.
    Plane,
    /// Left, middle, right, nearly in line, for the paper's estimators.
    Line,
}

const PAPERS_ESTIMATORS: &str = "the estimators closed-form and least-squares";

/// A rig with the names of its cameras, as a rig file holds it.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::RigFile;
///
/// let file = RigFile::paper();
/// let again = RigFile::parse(Path::new("rig.toml"), &file.to_toml())?;
/// assert_eq!(again, file);
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RigFile {
    /// Names of the cameras in the rig's order: distinct, and usable as names of folders.
    pub names: Vec<String>,
    /// The cameras, in the file's order; left, middle, right if they have these names.
    pub rig: Rig,
    /// The stage, if the file describes one.
    pub stage: Option<Stage>,
    /// Treatment of a target that turns, if the file states it.
    pub rotation: Option<treatment::Rotation>,
    /// Pivot of a target whose rotation is estimated.
    pub pivot: Pivot,
    /// Devices and their settings in the order of the cameras; empty if no camera has any.
    pub capture: Vec<Capture>,
    /// Triggers of the cameras, if the station gives them.
    pub trigger: Option<Trigger>,
    /// Laser whose spot can be the pivot.
    pub laser: Option<Laser>,
    /// Targets that are measured apart; empty if the whole view is one target.
    pub targets: Vec<Target>,
}

impl RigFile {
    /// Returns the paper's rig (its Table 3 and section 4): left, middle, right; no stage.
    pub fn paper() -> Self {
        Self {
            names: TRINOCULAR.map(String::from).to_vec(),
            rig: Rig::paper(),
            stage: None,
            rotation: None,
            pivot: Pivot::Centroid,
            capture: Vec::new(),
            trigger: None,
            laser: None,
            targets: Vec::new(),
        }
    }

    /// Returns the pivot, unless a target that turns is refused.
    pub fn estimated_pivot(&self) -> Option<Pivot> {
        let is_refused = self.rotation == Some(treatment::Rotation::Refuse);
        (!is_refused).then_some(self.pivot)
    }

    /// Returns true if the cameras are exactly left, middle and right.
    pub fn is_trinocular(&self) -> bool {
        self.names == TRINOCULAR
    }

    /// Reads and checks the rig file at `path`.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::read_as(path, Shape::Plane)
    }

    /// Reads the rig file like [`RigFile::read`] and returns its text as well, which holds the
    /// user's comments.
    pub fn read_with_text(path: &Path) -> Result<(Self, String), InputError> {
        let text = input::text(path, LIMIT)?;
        Ok((Self::parse(path, &text)?, text))
    }

    /// Reads the rig file like [`RigFile::read`] and refuses every rig that the paper's two
    /// estimators do not support: they need exactly the cameras left, middle and right, at heights
    /// as equal as [`Rig::is_in_line`] requires.
    pub fn read_in_line(path: &Path) -> Result<Self, InputError> {
        Self::read_as(path, Shape::Line)
    }

    fn read_as(path: &Path, shape: Shape) -> Result<Self, InputError> {
        Self::parse_as(path, &input::text(path, LIMIT)?, shape)
    }

    /// Checks the text of a rig file; errors name `file`.
    ///
    /// ```
    /// use std::path::Path;
    /// use trinocular_rig::rig_file::RigFile;
    ///
    /// let text = RigFile::paper().to_toml().replace("538.14", "-538.14");
    /// let error = RigFile::parse(Path::new("rig.toml"), &text).unwrap_err();
    /// assert_eq!((error.line, error.field.as_deref()), (Some(11), Some("camera[1].focal_px[0]")));
    /// ```
    pub fn parse(file: &Path, text: &str) -> Result<Self, InputError> {
        Self::parse_as(file, text, Shape::Plane)
    }

    /// Checks the text of a rig file as [`RigFile::read_in_line`] does; errors name `file`.
    pub fn parse_in_line(file: &Path, text: &str) -> Result<Self, InputError> {
        Self::parse_as(file, text, Shape::Line)
    }

    fn parse_as(file: &Path, text: &str, shape: Shape) -> Result<Self, InputError> {
        let source = Source { file, text };
        let table = DeTable::parse(text).map_err(|error| source.syntax(&error))?;
        let value = DeValue::Table(table.into_inner());
        let root = Field::root(source, &value);
        root.only(&[
            "image_size_px",
            "rotation",
            "pivot",
            "camera",
            "stage",
            "trigger",
            "laser",
            "target",
        ])?;
        root.require(&[
            ("image_size_px", "image_size_px = [640, 480]"),
            ("camera", "[[camera]]"),
        ])?;
        let image_size_px = root
            .required("image_size_px")?
            .each(|side| side.whole(IMAGE_SIDE_PX))?;
        let (names, cameras, capture) = cameras(&root.required("camera")?, image_size_px, shape)?;
        let stage = match root.optional("stage")? {
            Some(section) => Some(Stage::read(&section)?),
            None => None,
        };
        let trigger = match root.optional("trigger")? {
            Some(section) => Some(Trigger::read(&section)?),
            None => None,
        };
        let rotation = pivot::rotation(&root)?;
        let laser = match root.optional("laser")? {
            Some(section) => Some(Laser::read(&section)?),
            None => None,
        };
        let targets = match root.optional("target")? {
            Some(list) => target::read(&list, &names, nearest_middle(&cameras), image_size_px)?,
            None => Vec::new(),
        };
        Ok(Self {
            names,
            rig: Rig {
                image_size_px,
                // `cameras` has checked the number of cameras.
                cameras: cameras.into_iter().collect(),
            },
            stage,
            rotation,
            pivot: pivot::read(&root, rotation, laser)?,
            capture,
            trigger,
            laser,
            targets,
        })
    }

    /// Returns the file's text. [`RigFile::parse`] reads the same rig back, bit for bit.
    pub fn to_toml(&self) -> String {
        let mut text = format!("image_size_px = {:?}\n", self.rig.image_size_px);
        pivot::write_toml(self.rotation, self.pivot, &mut text);
        for (index, (name, camera)) in self.names.iter().zip(&self.rig.cameras).enumerate() {
            let name = toml::Value::from(name.as_str());
            let _ = write!(text, "\n[[camera]]\nname = {name}\n");
            let _ = writeln!(text, "focal_px = {:?}", camera.focal_px);
            let _ = writeln!(text, "principal_px = {:?}", camera.principal_px);
            let _ = writeln!(text, "offset_mm = {:?}", camera.offset_mm);
            if camera.coefficients() != [0.0; 5] {
                let _ = writeln!(text, "distortion = {:?}", camera.coefficients());
            }
            if camera.rotation != Rotation::NONE {
                let _ = writeln!(text, "rotation_deg = {:?}", camera.rotation.degrees());
            }
            if let Some(capture) = self.capture.get(index) {
                capture.write_toml(&mut text);
            }
        }
        if let Some(stage) = &self.stage {
            stage.write_toml(&mut text);
        }
        if let Some(trigger) = &self.trigger {
            trigger.write_toml(&mut text);
        }
        if let Some(laser) = &self.laser {
            laser.write_toml(&mut text);
        }
        target::write_toml(&self.targets, &self.names, &mut text);
        text
    }

    /// Writes the file whole or not at all: the old file at `path` stays until the new one is
    /// complete.
    ///
    /// ```
    /// use trinocular_rig::rig_file::RigFile;
    ///
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("rig.toml");
    /// RigFile::paper().write(&path)?;
    /// assert_eq!(RigFile::read(&path)?.names, ["left", "middle", "right"]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn write(&self, path: &Path) -> Result<(), InputError> {
        Output::open_successor(path, Replace::Anything, path)?.write(self.to_toml())
    }
}

/// Returns the index of the camera nearest to the mean of all places.
fn nearest_middle(cameras: &[Camera]) -> usize {
    let count = cameras.len() as f64;
    let mean = [0, 1].map(|i| cameras.iter().map(|c| c.offset_mm[i]).sum::<f64>() / count);
    let distance = |camera: &Camera| {
        let [x, y] = [0, 1].map(|i| camera.offset_mm[i] - mean[i]);
        x.hypot(y)
    };
    let nearest = cameras.iter().enumerate();
    let nearest = nearest.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
    nearest.map_or(0, |(index, _)| index)
}

/// Names, lenses and places, and devices of the cameras.
type Cameras = (Vec<String>, Vec<Camera>, Vec<Capture>);

/// Reads the `[[camera]]` tables: checks each of them, then the rules between them, then sorts
/// them.
fn cameras(list: &Field<'_>, image_size_px: [u32; 2], shape: Shape) -> Result<Cameras, InputError> {
    let tables = list.elements()?;
    if !(2..=MAX_CAMERAS).contains(&tables.len()) {
        let count = tables.len();
        return Err(list.fault(format!(
            "{count} given, but a rig has 2 to {MAX_CAMERAS} cameras"
        )));
    }
    let mut read: Vec<(String, Camera)> = Vec::with_capacity(tables.len());
    let mut capture = Vec::with_capacity(tables.len());
    for table in &tables {
        table.only(&[&LENS_FIELDS[..], &capture::KEYS].concat())?;
        table.require(&CAMERA_FIELDS)?;
        let name = table.required("name")?;
        let given = folder_name(&name)?;
        let camera = camera(table, image_size_px)?;
        for (other, placed) in &read {
            // Some file systems do not distinguish the case of folder names.
            if other.eq_ignore_ascii_case(given) {
                return Err(name.fault(format!("another camera is named `{other}` already")));
            }
            let [dx, dy] = [0, 1].map(|i| camera.offset_mm[i] - placed.offset_mm[i]);
            if dx.hypot(dy) < LEAST_BASELINE_MM {
                return Err(table.required("offset_mm")?.fault(format!(
                    "`{given}` is at the same place as camera `{other}`: cameras are at least \
                     {LEAST_BASELINE_MM} mm apart, and offset_mm is in mm; is it in metres?"
                )));
            }
        }
        read.push((given.to_owned(), camera));
        capture.push(Capture::read(table)?);
    }
    if capture.iter().all(|capture| *capture == Capture::default()) {
        capture.clear();
    }
    let places = TRINOCULAR.map(|wanted| read.iter().position(|(name, _)| name == wanted));
    if let [Some(left), Some(middle), Some(right)] = places {
        for (low, high) in [(left, middle), (middle, right)] {
            let [a, b] = [&read[low], &read[high]];
            if a.1.offset_mm[0] >= b.1.offset_mm[0] {
                return Err(tables[high].required("offset_mm")?.fault(format!(
                    "x offsets must have left < middle < right, but `{}` is at {} and `{}` at {}",
                    a.0, a.1.offset_mm[0], b.0, b.1.offset_mm[0]
                )));
            }
        }
        if read.len() == TRINOCULAR.len() {
            let ordered = [left, middle, right].map(|k| read[k].1);
            let rig = Rig {
                image_size_px,
                cameras: ordered.into_iter().collect(),
            };
            if shape == Shape::Line {
                in_line([&tables[left], &tables[right]], &rig)?;
            }
            let order = [left, middle, right].into_iter();
            let capture = order.filter_map(|k| capture.get(k).cloned()).collect();
            let names = TRINOCULAR.map(String::from).to_vec();
            return Ok((names, ordered.to_vec(), capture));
        }
    }
    if shape == Shape::Line {
        let found: Vec<&str> = read.iter().map(|(name, _)| name.as_str()).collect();
        return Err(list.fault(format!(
            "{PAPERS_ESTIMATORS} need exactly the cameras left, middle, right, but these are {}",
            found.join(", ")
        )));
    }
    let (names, cameras) = read.into_iter().unzip();
    Ok((names, cameras, capture))
}

/// Refuses cameras at different heights, because the paper's pairs share their image rows. `rig`
/// has left, middle, right in this order; `outer` are the tables of the first and the last.
fn in_line(outer: [&Field<'_>; 2], rig: &Rig) -> Result<(), InputError> {
    let error = rig.height_error().unwrap_or(f64::INFINITY);
    if error <= HEIGHT_ERROR_LIMIT {
        return Ok(());
    }
    let [left, middle, right] = [0, 1, 2].map(|k| rig.cameras[k].offset_mm);
    let slope = |outer: [f64; 2]| ((outer[1] - middle[1]) / (outer[0] - middle[0])).abs();
    let (name, table, at) = match slope(left) > slope(right) {
        true => ("left", outer[0], left),
        false => ("right", outer[1], right),
    };
    let [_, y] = table.required("offset_mm")?.fields()?;
    let [error, limit] = [error, HEIGHT_ERROR_LIMIT].map(|share| 100.0 * share);
    Err(y.fault(format!(
        "{PAPERS_ESTIMATORS} need the cameras in line, but `{name}` is at {} and `middle` at {}, \
         which costs Y up to {error:.2} % of a displacement along Z; {limit} % at most are let \
         pass (the estimator midpoint takes any heights)",
        at[1], middle[1]
    )))
}

fn camera(table: &Field<'_>, image_size_px: [u32; 2]) -> Result<Camera, InputError> {
    let principal = table.required("principal_px")?;
    let principal_px: [f64; 2] = principal.each(|axis| axis.number(f64::MAX))?;
    let axes: [Field<'_>; 2] = principal.fields()?;
    for ((axis, at), size) in axes.iter().zip(principal_px).zip(image_size_px) {
        if !(0.0..f64::from(size)).contains(&at) {
            return Err(axis.fault(format!("{at} is outside the image (0 to {size} px)")));
        }
    }
    let distortion = table.optional("distortion")?;
    let focal = table.required("focal_px")?;
    let focal_px = focal.each(|axis| axis.number(f64::MAX))?;
    if let Some((index, reason)) = focal_fault(focal_px, image_size_px) {
        let axes: [Field<'_>; 2] = focal.fields()?;
        return Err(axes[index].fault(reason));
    }
    let (coefficients, rational) = match &distortion {
        Some(field) => lens::coefficients(field)?,
        None => ([0.0; 5], [0.0; 3]),
    };
    let camera = Camera {
        focal_px,
        principal_px,
        offset_mm: table
            .required("offset_mm")?
            .each(|axis| axis.number(LIMIT_OFFSET_MM))?,
        distortion: coefficients,
        rational,
        rotation: match table.optional("rotation_deg")? {
            Some(field) => rotation(&field)?,
            None => Rotation::NONE,
        },
    };
    match distortion {
        Some(field) if !can_undistort(&camera, image_size_px) => Err(field.fault(NOT_A_LENS)),
        _ => Ok(camera),
    }
}

fn rotation(field: &Field<'_>) -> Result<Rotation, InputError> {
    let degrees: [f64; 3] = field.each(|angle| angle.number(FULL_TURN_DEG))?;
    match turned_too_far(degrees) {
        Some(reason) => Err(field.fault(format!("out of range: {reason}"))),
        None => Ok(Rotation::from_degrees(degrees)),
    }
}

/// Returns the reason why no rig has a camera with this rotation (axis times angle, degrees), with
/// the way out; `None` up to [`LIMIT_ROTATION_DEG`].
pub fn turned_too_far(degrees: [f64; 3]) -> Option<String> {
    let angle = degrees.iter().map(|d| d * d).sum::<f64>().sqrt();
    if angle <= LIMIT_ROTATION_DEG {
        return None;
    }
    let [x, y, roll] = degrees;
    let roll = roll.abs();
    // The tilt of a camera that is rolled by much shows as half of it beside the axis.
    if x.hypot(y) > LIMIT_ROTATION_DEG.min(roll) {
        return Some(format!(
            "turned by {angle:.1} degrees, but cameras that see the same may be turned by \
             {LIMIT_ROTATION_DEG} at most: point it where the others look, and calibrate anew"
        ));
    }
    let way_out = match roll {
        160.0..=200.0 => {
            "turn its images by 180 degrees (the camera's own setting, or ffmpeg -vf hflip,vflip)"
        }
        _ => "mount it as the others",
    };
    Some(format!(
        "turned by {angle:.1} degrees, mostly about its optical axis, but its images can be \
         compared with the others' up to {LIMIT_ROTATION_DEG}: {way_out}, and calibrate anew"
    ))
}

/// Reads a camera's name, which is also the name of its folder of images and stands in CSV files.
fn folder_name<'a>(field: &Field<'a>) -> Result<&'a str, InputError> {
    let name = field.text()?;
    if name.trim().is_empty() {
        return Err(field.fault("must not be empty"));
    }
    let unfit = |c: char| c.is_control() || r#"/\:*?"<>|"#.contains(c);
    if name.trim() != name || name == "." || name == ".." || name.contains(unfit) {
        return Err(field.fault(format!("`{}` cannot name a folder", name.escape_debug())));
    }
    Ok(name)
}

#[cfg(test)]
mod tests;
