//! List of the images to calibrate with, per camera and instant.
//!
//! ```text
//! boards/left/01.png   boards/right/01.png   a folder per camera; equal names, equal instants
//! boards/left01.png    boards/right01.png    or all in one: the camera's name, then a number
//! boards/left.y4m      boards/right.y4m      or a TIFF stack or Y4M video per camera
//! ```
//!
//! The names' endings (`.png`, `.jpg`) do not matter. Names in one folder with a date or a time are
//! those of one camera: their last number does not distinguish cameras.

use std::path::Path;

use crate::images::folder;
use crate::images::series::Series;
use crate::images::series::layout::{self, Found, split_ending};
use crate::images::series::pairing::{self, Rule};
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::TRINOCULAR;

/// Images of all cameras.
#[derive(Clone, Debug)]
pub struct Photographs {
    /// Images of each camera; left, middle and right come first, in this order.
    pub series: Vec<Series>,
    /// Warnings of images in formats that are not read.
    pub warnings: Vec<InputError>,
    /// Rule by which images are of one instant; `None` for equal names, unless the caller gave it.
    pub pairing: Option<String>,
    /// True if the user gave the rule, so that videos may have different rates.
    pub may_differ: bool,
}

/// Lists the images in a folder, or in one stack or video; at least one camera's.
///
/// # Errors
/// [`InputError`] if a folder cannot be listed, or there is no image.
pub fn list(input: &Path) -> Result<Photographs, InputError> {
    list_paired(input, None)
}

/// Does the same as [`list`] with a rule by which images are of one instant.
///
/// # Errors
/// Those of [`list`], and if the rule cannot be applied.
pub fn list_paired(input: &Path, rule: Option<Rule>) -> Result<Photographs, InputError> {
    let Found { mut series, unread } = layout::of_all(input)?;
    let said = |place: &Path, said: &str| match place.strip_prefix(input) {
        Ok(inner) if inner != Path::new("") => format!("{}: {said}", inner.display()),
        _ => said.to_owned(),
    };
    let unread: Vec<String> = unread
        .iter()
        .map(|(place, text)| said(place, text))
        .collect();
    if series.is_empty() {
        let reason = "holds no images; expected a folder of PNG, JPEG, PNM, TIFF, BMP or WebP files \
                      for each camera, or a TIFF stack or Y4M video";
        let reason = std::iter::once(reason.to_owned()).chain(unread);
        return Err(InputError::file(
            input,
            reason.collect::<Vec<_>>().join("; "),
        ));
    }
    let rank = |name: &str| {
        let known = TRINOCULAR.iter().position(|known| *known == name);
        known.unwrap_or(TRINOCULAR.len())
    };
    series.sort_by_cached_key(|one| {
        let padded = folder::numbers_padded(&one.name);
        (rank(&one.name), padded, one.name.clone())
    });
    for stills in series.iter_mut().filter_map(Series::stills_mut) {
        for still in stills.iter_mut() {
            // Endings do not matter. A number in the middle of a name keeps its point.
            if still.name() == still.instant {
                still.instant = split_ending(&still.instant).0.to_owned();
            }
        }
        stills.sort_by_cached_key(|still| {
            (folder::numbers_padded(&still.instant), still.file.clone())
        });
    }
    let pairing = match series.len() {
        1 => None,
        _ => {
            let paired = pairing::pair(&mut series, rule);
            paired
                .map_err(|reason| InputError::file(input, reason))?
                .said
        }
    };
    let warnings = unread.into_iter();
    Ok(Photographs {
        series,
        warnings: warnings.map(|said| InputError::file(input, said)).collect(),
        pairing: pairing.map(|said| format!("images of one instant by {said}")),
        may_differ: rule.is_some(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn files(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    fn listed(names: &[&str]) -> Vec<(String, Vec<String>)> {
        let folder = files(names);
        let Photographs { series, .. } = list(folder.path()).unwrap();
        let instants = |s: &Series| s.stills().iter().map(|s| s.instant.clone()).collect();
        series
            .iter()
            .map(|s| (s.name.clone(), instants(s)))
            .collect()
    }

    #[test]
    fn folder_per_camera_is_listed() {
        let found = listed(&[
            "right/2.png",
            "left/10.png",
            "left/9.jpg",
            "zoo/1.pgm",
            "none/a.txt",
            ".git/1.png",
        ]);
        let expected = [
            ("left", vec!["9", "10"]),
            ("right", vec!["2"]),
            ("zoo", vec!["1"]),
        ];
        let expected =
            expected.map(|(n, i)| (n.to_owned(), i.into_iter().map(String::from).collect()));
        assert_eq!(found, expected);
    }

    #[test]
    fn single_folder_is_grouped() {
        let found = listed(&["right02.jpg", "left01.jpg", "left02.jpg", "intrinsics.yml"]);
        assert_eq!(
            found[0],
            ("left".to_owned(), vec!["01".to_owned(), "02".to_owned()])
        );
        assert_eq!(found[1], ("right".to_owned(), vec!["02".to_owned()]));
        let found = listed(&["cam-1.png", "board.png"]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].1, ["board", "cam-1"]);
    }

    #[test]
    fn names_with_time_stamps_are_one_camera() {
        for names in [
            [
                "Image__2026-01-05__10-29-10.png",
                "Image__2026-01-05__10-30-11.png",
            ],
            ["img_20260105_102910.png", "img_20260106_103011.png"],
            ["frame 10.29.10.png", "frame 10.30.11.png"],
        ] {
            let found = listed(&names);
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(found[0].1.len(), 2, "{found:?}");
        }
        // One short number is part of a camera's name.
        assert_eq!(listed(&["cam0_01.png", "cam1_01.png"]).len(), 2);
    }

    #[test]
    fn empty_folder_is_refused() {
        let folder = files(&["readme.txt"]);
        assert!(
            list(folder.path())
                .unwrap_err()
                .to_string()
                .contains("no images")
        );
        let missing = folder.path().join("missing");
        assert!(
            list(&missing)
                .unwrap_err()
                .to_string()
                .contains("no such folder")
        );
    }
}
