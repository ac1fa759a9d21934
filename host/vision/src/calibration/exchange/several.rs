//! Files that hold several cameras: Kalibr's camchain, and the pair of files that OpenCV's sample
//! `stereo_calib` writes.
//!
//! ```text
//! cam0: { intrinsics: [fu, fv, pu, pv], distortion_coeffs: [k1, k2, p1, p2], resolution: [..] }
//! cam1: { T_cn_cnm1: 4 x 4, from the axes of cam0 to those of cam1, m, ... }
//!
//! intrinsics.yml: M1 D1 M2 D2
//! extrinsics.yml: R T, from the first camera's axes to the second's
//! ```

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::yaml::{Document, Node, quoted};
use super::{
    CameraFile, MM_PER_M, Places, check_distance, content, distortion, lens_of, matrix_elements,
    not_invertible, numbers, opencv_motion, plausible, rotation_of, text_of, xml,
};
use trinocular_rig::error::InputError;

/// Names of the cameras in a camchain.
const CHAIN: [&str; 8] = [
    "cam0", "cam1", "cam2", "cam3", "cam4", "cam5", "cam6", "cam7",
];
/// Names of the values of `stereo_calib`.
const STEREO: [&str; 8] = [
    "M1",
    "D1",
    "M2",
    "D2",
    "R",
    "T",
    "image_width",
    "image_height",
];
/// Names that the two cameras of `stereo_calib` get.
const PAIR: [&str; 2] = ["left", "right"];

/// Camera with its name and the file that it is in.
pub type NamedCamera = (String, PathBuf, CameraFile);

/// Cameras of files that hold several.
#[derive(Clone, Debug, PartialEq)]
pub struct Several {
    /// The cameras, in order.
    pub cameras: Vec<NamedCamera>,
    /// True if the files do not hold the size of the images.
    pub lacks_size: bool,
}

/// Reads the cameras if the files are a camchain, or the pair of `stereo_calib`; `None` if they are
/// files of single cameras. `image_size_px` is the size of the images, which the pair's files do
/// not hold.
///
/// # Errors
/// [`InputError`] if a file cannot be read, or its values make no cameras.
pub fn several(
    paths: &[PathBuf],
    image_size_px: Option<[u32; 2]>,
) -> Result<Option<Several>, InputError> {
    let (first, second) = match paths {
        [first] => (first, None),
        [first, second] => (first, Some(second)),
        _ => return Ok(None),
    };
    let texts = [Some(first), second]
        .into_iter()
        .flatten()
        .map(|path| text_of(path, &content(path)?).map(|text| (path.as_path(), text)));
    let texts: Vec<(&Path, String)> = texts.collect::<Result<_, _>>()?;
    let has = |text: &str, name: &str| {
        text.lines().map(str::trim_start).any(|line| {
            let rest = line.trim_start_matches(['"', '<']).strip_prefix(name);
            rest.is_some_and(|rest| rest.trim_start().starts_with([':', '"', ' ', '>']))
        })
    };
    match texts.as_slice() {
        [(path, text)] if has(text, "cam0") => chain(path, text).map(Some),
        texts
            if texts.iter().any(|(_, text)| {
                has(text, "M1") && has(text, "D1") && !has(text, "camera_matrix")
            }) =>
        {
            pair(texts, image_size_px).map(Some)
        }
        _ => Ok(None),
    }
}

fn chain(path: &Path, text: &str) -> Result<Several, InputError> {
    let document = Document::parse(path, text, &CHAIN)?;
    let root = document.root();
    let mut cameras: Vec<NamedCamera> = Vec::new();
    let mut motion = Isometry3::identity();
    for name in CHAIN {
        let Some(camera) = root.optional(name)? else {
            break;
        };
        let model = camera.required("camera_model")?;
        if model.text()? != "pinhole" {
            let reason = format!(
                "the model is `{}`; only pinhole cameras can be read: calibrate with \
                 --models pinhole-radtan",
                quoted(model.text()?)
            );
            return Err(model.fault(reason));
        }
        let model = camera.required("distortion_model")?;
        if !["radtan", "none"].contains(&model.text()?) {
            let reason = format!(
                "the model is `{}`; only radtan (k1 k2 p1 p2) can be read: calibrate with \
                 --models pinhole-radtan",
                quoted(model.text()?)
            );
            return Err(model.fault(reason));
        }
        let size = camera.required("resolution")?.elements()?;
        let [width, height] = size.as_slice() else {
            return Err(camera.fault("resolution must be the image's width and height"));
        };
        let image_size_px = [width.whole(8..=65_535)?, height.whole(8..=65_535)?];
        let matrix = camera.required("intrinsics")?;
        let [fx, fy, cx, cy] = numbers(&matrix)?;
        plausible(&matrix, [fx, fy, cx, cy], image_size_px)?;
        let coefficients = camera.required("distortion_coeffs")?;
        let eight = distortion(&coefficients)?;
        let turn = match cameras.is_empty() {
            true => None,
            false => Some(camera.required("T_cn_cnm1")?),
        };
        if let Some(turn) = &turn {
            motion = step(turn)? * motion;
        }
        let place = turn.as_ref().map(Node::place);
        let (lens, rational) = lens_of([fx, fy, cx, cy], eight);
        let file = CameraFile {
            image_size_px,
            lens,
            rational,
            motion: Some(motion),
            places: Places {
                matrix: matrix.place(),
                distortion: coefficients.place(),
                turn: place.clone(),
                shift: place,
            },
        };
        not_invertible(&file, &coefficients)?;
        cameras.push((name.to_owned(), path.to_owned(), file));
    }
    Ok(Several {
        cameras,
        lacks_size: false,
    })
}

/// Returns the motion from one camera's axes to the next one's, mm.
fn step(field: &Node<'_>) -> Result<Isometry3<f64>, InputError> {
    let rows: Vec<[f64; 4]> = field
        .elements()?
        .iter()
        .map(numbers)
        .collect::<Result<_, _>>()?;
    let [a, b, c, last] = rows.as_slice() else {
        return Err(field.fault("must have 4 rows of 4 numbers"));
    };
    if *last != [0.0, 0.0, 0.0, 1.0] {
        return Err(field.fault("the last row must be 0 0 0 1"));
    }
    let turn = Matrix3::from_fn(|row, column| [a, b, c][row][column]);
    let place_mm = Vector3::new(a[3], b[3], c[3]) * MM_PER_M;
    check_distance(field, &place_mm)?;
    Ok(Isometry3::from_parts(
        place_mm.into(),
        rotation_of(field, turn)?,
    ))
}

fn pair(texts: &[(&Path, String)], image_size_px: Option<[u32; 2]>) -> Result<Several, InputError> {
    let documents: Vec<Document<'_>> = texts
        .iter()
        .map(|(path, text)| match xml::is_xml(text) {
            true => xml::parse(path, text, &STEREO),
            false => Document::parse(path, text, &STEREO),
        })
        .collect::<Result<_, _>>()?;
    let roots: Vec<Node<'_>> = documents.iter().map(Document::root).collect();
    let path = texts.first().map_or(Path::new(""), |(path, _)| path);
    let with = |name: &str| -> Result<Option<(usize, Node<'_>)>, InputError> {
        for (index, root) in roots.iter().enumerate() {
            if let Some(value) = root.optional(name)? {
                return Ok(Some((index, value)));
            }
        }
        Ok(None)
    };
    let value = |name: &str| {
        with(name)?.ok_or_else(|| {
            let reason = match name {
                "R" | "T" => format!(
                    "the intrinsics of OpenCV's stereo_calib, without its extrinsics ({name}): \
                     give both files, intrinsics.yml and extrinsics.yml"
                ),
                _ => format!("files of OpenCV's stereo_calib, but without {name}"),
            };
            InputError::file(path, reason)
        })
    };
    let sides = (with("image_width")?, with("image_height")?);
    let lacks_size = sides.0.is_none() || sides.1.is_none();
    let size = match (image_size_px, sides.0, sides.1) {
        (Some(size), ..) => size,
        (None, Some((_, width)), Some((_, height))) => {
            [width.whole(8..=65_535)?, height.whole(8..=65_535)?]
        }
        _ => {
            let reason = "files of OpenCV's stereo_calib, which do not hold the size of the \
                          images: give it as --image-size 640x480";
            return Err(InputError::file(path, reason));
        }
    };
    let motion = opencv_motion(&value("R")?.1, &value("T")?.1)?;
    let mut cameras: Vec<NamedCamera> = Vec::new();
    let motions = [Isometry3::identity(), motion];
    for ((number, name), motion) in (1..).zip(PAIR).zip(motions) {
        let (index, matrix) = value(&format!("M{number}"))?;
        let four = matrix_elements(&matrix, size)?;
        let (_, coefficients) = value(&format!("D{number}"))?;
        let (lens, rational) = lens_of(four, distortion(&coefficients)?);
        let file = CameraFile {
            image_size_px: size,
            lens,
            rational,
            motion: Some(motion),
            places: Places {
                matrix: matrix.place(),
                distortion: coefficients.place(),
                turn: None,
                shift: None,
            },
        };
        not_invertible(&file, &coefficients)?;
        cameras.push((name.to_owned(), texts[index].0.to_owned(), file));
    }
    Ok(Several {
        cameras,
        lacks_size,
    })
}
