//! Files of other programs that are not read as the file of one camera, and the way out.

use std::path::Path;

use trinocular_rig::error::InputError;

/// Layout of another program.
struct Layout {
    /// Names that all start a line of such a file, up to the colon or equals sign.
    names: &'static [&'static str],
    /// Description of the layout, and the way out.
    reason: &'static str,
}

/// Layouts of YAML and INI, recognised by the names that start lines. The first that fits counts.
const LAYOUTS: [Layout; 5] = [
    Layout {
        names: &["camera_model", "distortion_coeffs", "intrinsics"],
        reason: "a Kalibr camchain, which holds all cameras: give it alone",
    },
    Layout {
        names: &["M1", "D1"],
        reason: "the intrinsics of OpenCV's stereo_calib, which hold two cameras: give \
                 intrinsics.yml and extrinsics.yml, and no other file",
    },
    Layout {
        names: &["R", "T", "R1", "P1"],
        reason: "the extrinsics of OpenCV's stereo_calib, which have no lenses: give \
                 intrinsics.yml and extrinsics.yml, and no other file",
    },
    Layout {
        names: &["projection_parameters"],
        reason: "a camodocal file (VINS), which is not read: write fx, fy, cx, cy as camera_matrix \
                 and k1 k2 p1 p2 as distortion_coefficients",
    },
    Layout {
        names: &["Camera.fx"],
        reason: "a settings file of ORB-SLAM, which is not read: write Camera.fx, fy, cx, cy as \
                 camera_matrix and Camera.k1, k2, p1, p2, k3 as distortion_coefficients",
    },
];

/// Refuses a file in a known layout that is not read.
///
/// # Errors
/// [`InputError`] with the name of the layout and the way out.
pub(super) fn check(file: &Path, text: &str) -> Result<(), InputError> {
    let refuse = |reason: &str| Err(InputError::file(file, reason));
    let lines = || text.lines().map(str::trim);
    // A file with `camera_matrix` is in a layout that is read.
    let has = |name: &str| lines().any(|line| starts_with_name(line, name));
    if has("camera_matrix") || has("\"camera_matrix\"") {
        return Ok(());
    }
    let mut layouts = LAYOUTS.iter();
    match layouts.find(|layout| layout.names.iter().all(|name| has(name))) {
        Some(layout) => refuse(layout.reason),
        None => Ok(()),
    }
}

/// Returns true if the line gives a value to `name`.
fn starts_with_name(line: &str, name: &str) -> bool {
    let rest = line.strip_prefix(name).map(str::trim_start);
    rest.is_some_and(|rest| rest.starts_with([':', '=']))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_foreign_layouts_are_named() {
        for (text, name) in [
            (
                "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0]\n  intrinsics: [1]\n",
                "Kalibr",
            ),
            (
                "%YAML:1.0\nM1: 1\nD1: 2\n",
                "the intrinsics of OpenCV's stereo",
            ),
            (
                "R: 1\nT: 2\nR1: 3\nR2: 4\nP1: 5\n",
                "the extrinsics of OpenCV's stereo",
            ),
            ("projection_parameters:\n  fx: 1\n", "camodocal"),
            ("Camera.fx: 500\n", "ORB-SLAM"),
        ] {
            let error = check(Path::new("left.yml"), text).unwrap_err().to_string();
            assert!(
                error.contains(name) && (error.contains("not read") || error.contains("give ")),
                "{text}: {error}"
            );
        }
        for text in ["", "camera_matrix: 1\nM1: 1\nD1: 2\n", "[1, 2]", "a: b"] {
            assert!(check(Path::new("left.yml"), text).is_ok(), "{text}");
        }
    }
}
