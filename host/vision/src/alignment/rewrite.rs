//! Writes an alignment into the user's own rig file. Everything else in the file stays unchanged,
//! comments included.

use std::path::Path;

use super::Datum;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::edit::{self, edited};

/// Decimals of a principal point, px, and of an angle, degrees: far below the uncertainty.
const DECIMALS: f64 = 1e4;

/// New values of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction<'a> {
    /// Name of the camera.
    pub name: &'a str,
    /// New principal point, px.
    pub principal_px: [f64; 2],
    /// New rotation, degrees; `None` leaves it as it is.
    pub rotation_deg: Option<[f64; 3]>,
}

impl<'a> From<&'a Datum> for Correction<'a> {
    fn from(datum: &'a Datum) -> Self {
        Self {
            name: &datum.name,
            principal_px: datum.principal_px,
            rotation_deg: datum.rotation_deg,
        }
    }
}

/// Replaces the values of some cameras in `text`, a rig file. Errors name `file`.
///
/// # Errors
/// [`InputError`] if the text is not a rig file, or the result would not be one.
pub fn corrected(
    file: &Path,
    text: &str,
    corrections: &[Correction<'_>],
) -> Result<String, InputError> {
    edited(file, text, |document| {
        for correction in corrections {
            let name = correction.name;
            let camera = edit::camera(document, name)
                .ok_or_else(|| InputError::file(file, format!("there is no camera `{name}`")))?;
            let rounded = |number: &f64| edit::rounded(*number, DECIMALS);
            let principal_px = correction.principal_px.iter().map(rounded);
            edit::write(camera, "principal_px", principal_px);
            if let Some(rotation) = &correction.rotation_deg {
                edit::write(camera, "rotation_deg", rotation.iter().map(rounded));
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_rig::rig_file::RigFile;

    const RIG: &str = "\
# our bench, spring
image_size_px = [320, 240]

[[camera]]
name = \"left\"   # the old one
focal_px = [533.16, 529.12]
principal_px = [154.43, 123]  # as calibrated
offset_mm = [-70.0, 0.0]

[[camera]]
offset_mm = [68.0, 0.0]
principal_px = [
    160.48, # x
    117.76,
]
focal_px = [534.55, 530.76]
name = \"right\"
";

    fn rewrite(text: &str, points: &[(&str, [f64; 2])]) -> Result<String, InputError> {
        let corrections: Vec<Correction<'_>> = (points.iter())
            .map(|(name, principal_px)| Correction {
                name,
                principal_px: *principal_px,
                rotation_deg: None,
            })
            .collect();
        corrected(Path::new("rig.toml"), text, &corrections)
    }

    fn turn(text: &str, name: &str, rotation_deg: [f64; 3]) -> Result<String, InputError> {
        let correction = Correction {
            name,
            principal_px: [160.0, 120.0],
            rotation_deg: Some(rotation_deg),
        };
        corrected(Path::new("rig.toml"), text, &[correction])
    }

    #[test]
    fn only_principal_points_change() {
        let new = rewrite(
            RIG,
            &[("right", [158.412_34, 117.331]), ("left", [1.0, 2.5])],
        )
        .unwrap();
        let expected = RIG
            .replace("154.43, 123]", "1.0, 2.5]")
            .replace("160.48,", "158.4123,")
            .replace("117.76,", "117.331,");
        assert_eq!(new, expected);
    }

    #[test]
    fn cameras_in_braces_are_found() {
        let text = "\
image_size_px = [320, 240]
camera = [
    { name = \"a\", focal_px = [500, 500], principal_px = [160, 120], offset_mm = [0, 0] },
    { name = \"b\", focal_px = [500, 500], principal_px = [161, 121], offset_mm = [9, 0] }, # new
]
";
        let new = rewrite(text, &[("b", [159.5, 120.25])]).unwrap();
        assert_eq!(new, text.replace("[161, 121]", "[159.5, 120.25]"));
    }

    #[test]
    fn rotation_is_added_or_replaced() {
        let added = turn(RIG, "left", [0.0, -0.000_01, 0.512_34]).unwrap();
        let expected = RIG.replace("154.43, 123]", "160.0, 120.0]").replace(
            "[-70.0, 0.0]\n",
            "[-70.0, 0.0]\nrotation_deg = [0.0, 0.0, 0.5123]\n",
        );
        assert_eq!(added, expected);
        let replaced = turn(&added, "left", [1.0, 2.0, -3.0]).unwrap();
        assert_eq!(
            replaced,
            expected.replace("[0.0, 0.0, 0.5123]", "[1.0, 2.0, -3.0]")
        );
        // Cameras in an inline list; the result can be read again.
        let text = r#"image_size_px = [320, 240]
camera = [
    { name = "a", focal_px = [500, 500], principal_px = [160, 120], offset_mm = [0, 0] },
    { name = "b", focal_px = [500, 500], principal_px = [160, 120], offset_mm = [9, 0] },
]
"#;
        let turned = turn(text, "b", [0.0, 0.0, 1.5]).unwrap();
        assert!(
            turned.contains("rotation_deg = [0.0, 0.0, 1.5] }"),
            "{turned}"
        );
        let rig = RigFile::parse(Path::new("rig.toml"), &turned).unwrap().rig;
        assert_eq!(rig.cameras[1].rotation.degrees(), [0.0, 0.0, 1.5]);
        assert!(turn(RIG, "left", [0.0, 0.0, 21.0]).is_err());
    }

    #[test]
    fn invalid_rig_file_is_refused() {
        let error = rewrite(RIG, &[("right", [400.0, 117.0])]).unwrap_err();
        assert!(error.to_string().contains("outside the image"), "{error}");
        assert_eq!(error.line, Some(13));
        assert!(rewrite(RIG, &[("middle", [160.0, 120.0])]).is_err());
        assert!(rewrite("[[camera", &[]).is_err());
    }
}
