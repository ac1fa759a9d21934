//! Checks of a calibration that has been solved: two cameras that are one, squares in another unit,
//! a rig that breaks a rule of the rig file.

use std::ops::RangeInclusive;
use std::path::Path;

use super::folder::Calibration;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;

/// Largest distance of two cameras that are one camera, in sides of a square.
const SAME_PLACE_SQUARES: f64 = 0.05;
/// Sides of squares of boards that are photographed, mm.
const SQUARES_MM: RangeInclusive<f64> = 0.2..=500.0;

/// Returns the doubt about a square whose side is probably in another unit, as a sentence for the
/// user.
///
/// ```
/// use trinocular_vision::calibration::check::doubt_square;
///
/// assert_eq!(doubt_square(25.0), None);
/// assert!(doubt_square(0.025).is_some_and(|doubt| doubt.contains("in metres?")));
/// ```
pub fn doubt_square(square_mm: f64) -> Option<String> {
    let unit = match square_mm {
        side if side < *SQUARES_MM.start() => "metres",
        side if side > *SQUARES_MM.end() => "micrometres",
        _ => return None,
    };
    Some(format!(
        "squares of {square_mm} mm: is --square in {unit}? It is in mm"
    ))
}

/// Refuses two cameras at one place: their photographs are those of one camera. The limit is in
/// squares, because a wrong unit of their side is another mistake. Errors name `input`.
///
/// # Errors
/// [`InputError`] with the names of the two cameras.
pub fn refuse_same_camera(
    input: &Path,
    result: &Calibration,
    square_mm: f64,
) -> Result<(), InputError> {
    result
        .rig_file()
        .map_or(Ok(()), |rig| distinct(input, &rig, square_mm))
}

fn distinct(input: &Path, file: &RigFile, square_mm: f64) -> Result<(), InputError> {
    let RigFile { names, rig, .. } = file;
    let cameras = || names.iter().zip(&rig.cameras).enumerate();
    let mut pairs = cameras().flat_map(|(k, b)| cameras().take(k).map(move |(_, a)| (a, b)));
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let same = pairs.find(|((_, a), (_, b))| {
        distance(a.offset_mm, b.offset_mm) < SAME_PLACE_SQUARES * square_mm
    });
    match same {
        None => Ok(()),
        Some(((a, _), (b, _))) => Err(InputError::file(
            input,
            format!(
                "`{a}` and `{b}` are at the same place, so their photographs are those of one \
                 camera: give each camera its own"
            ),
        )),
    }
}

/// Makes the rig file, if the rig obeys every rule of one; `None` for a single camera. Errors name
/// `input`.
///
/// # Errors
/// [`InputError`] with the field that breaks a rule.
pub fn obedient(input: &Path, result: &Calibration) -> Result<Option<RigFile>, InputError> {
    let Some(rig) = result.rig_file() else {
        return Ok(None);
    };
    let parsed = RigFile::parse(input, &rig.to_toml());
    parsed.map(Some).map_err(|error| broken(input, error))
}

/// Turns the error of a rule into that of the photographs.
fn broken(input: &Path, error: InputError) -> InputError {
    let field = error.field.unwrap_or_default();
    let advice = match field.ends_with("distortion") {
        true => "; images in which the board reaches into the corners would tell",
        false => "",
    };
    let reason = format!("makes no rig: {field}: {}{advice}", error.reason);
    InputError::file(input, reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_at_one_place_are_named() {
        let input = Path::new("boards");
        let mut rig = RigFile::paper();
        assert_eq!(distinct(input, &rig, 25.0), Ok(()));
        let [x, y] = rig.rig.cameras[0].offset_mm;
        rig.rig.cameras[2].offset_mm = [x + 1.0, y];
        let error = distinct(input, &rig, 25.0).unwrap_err().to_string();
        assert!(error.contains("`left` and `right`"), "{error}");
        assert_eq!(distinct(input, &rig, 15.0), Ok(()));
    }

    #[test]
    fn rule_of_distortion_has_advice() {
        let rig = RigFile::paper().to_toml();
        let rig = rig.replace(
            "name = \"left\"",
            "name = \"left\"\ndistortion = [9, 9, 9, 9, 9]",
        );
        let error = RigFile::parse(Path::new("boards"), &rig).unwrap_err();
        let said = broken(Path::new("boards"), error).to_string();
        assert!(
            said.contains("makes no rig: camera[0].distortion"),
            "{said}"
        );
        assert!(said.contains("into the corners"), "{said}");
    }
}
