//! List of the images to calibrate with, per camera and instant.
//!
//! ```text
//! boards/left/01.png   boards/right/01.png   a folder per camera; equal names, equal instants
//! boards/left01.png    boards/right01.png    or all in one: the camera's name, then a number
//! ```
//!
//! The names' endings (`.png`, `.jpg`) do not matter. Names in one folder with a date or a time are
//! those of one camera: their last number does not distinguish cameras.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::images::folder;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::TRINOCULAR;

/// Images of one camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Series {
    /// Name of the camera.
    pub name: String,
    /// Images by the name of their instant, in order.
    pub files: Vec<(String, PathBuf)>,
}

/// Images of all cameras.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photographs {
    /// Images of each camera; left, middle and right come first, in this order.
    pub series: Vec<Series>,
    /// Warnings of images in formats that are not read.
    pub warnings: Vec<InputError>,
}

/// Lists the images in `dir`, at least one camera's.
///
/// # Errors
/// [`InputError`] if a folder cannot be listed, or there is no image.
pub fn list(dir: &Path) -> Result<Photographs, InputError> {
    if !dir.is_dir() {
        return Err(InputError::file(dir, "no such folder"));
    }
    let io = |cause| InputError::io(dir, "list", &cause);
    let mut series = Vec::new();
    let mut unread = Vec::new();
    for entry in fs::read_dir(dir).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if path.is_dir() && !name.starts_with('.') {
            let listing = folder::listing(&path)?;
            unread.extend(listing.remark().map(|remark| format!("{name}: {remark}")));
            let files = named(&path, listing.files);
            if !files.is_empty() {
                series.push(Series { name, files });
            }
        }
    }
    if series.is_empty() {
        let listing = folder::listing(dir)?;
        unread.extend(listing.remark());
        series = by_prefix(dir, listing.files);
    }
    if series.is_empty() {
        let reason = "holds no images; expected a folder of PNG, JPEG, PNM, TIFF, BMP or WebP files \
                      for each camera";
        let reason = std::iter::once(reason.to_owned()).chain(unread);
        return Err(InputError::file(dir, reason.collect::<Vec<_>>().join("; ")));
    }
    let warnings = unread.into_iter();
    let warnings = warnings
        .map(|remark| InputError::file(dir, remark))
        .collect();
    for Series { files, .. } in &mut series {
        files.sort_by_cached_key(|(instant, path)| (folder::numbers_padded(instant), path.clone()));
    }
    let rank = |name: &str| {
        TRINOCULAR
            .iter()
            .position(|known| *known == name)
            .unwrap_or(TRINOCULAR.len())
    };
    series.sort_by_cached_key(|s| {
        (
            rank(&s.name),
            folder::numbers_padded(&s.name),
            s.name.clone(),
        )
    });
    Ok(Photographs { series, warnings })
}

fn named(dir: &Path, names: impl IntoIterator<Item = String>) -> Vec<(String, PathBuf)> {
    names
        .into_iter()
        .map(|name| (stem(&name).to_owned(), dir.join(&name)))
        .collect()
}

fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// Returns true if the part of a name before its last number holds a date or a time: two or more
/// numbers, or one of six digits or more.
fn has_time_stamp(camera: &str) -> bool {
    let numbers = camera.split(|c: char| !c.is_ascii_digit());
    let lengths: Vec<usize> = numbers.map(str::len).filter(|length| *length > 0).collect();
    lengths.len() >= 2 || lengths.iter().any(|length| *length >= 6)
}

/// Groups the images of several cameras in one folder. Names that do not all end in numbers, or that
/// hold a time stamp, belong to one camera.
fn by_prefix(dir: &Path, names: impl IntoIterator<Item = String>) -> Vec<Series> {
    let all = named(dir, names);
    let split = |stem: &str| {
        let camera = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        let instant = stem[camera.len()..].to_owned();
        (
            camera.trim_end_matches(['_', '-', ' ', '.']).to_owned(),
            instant,
        )
    };
    let own_name = || {
        let full = fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned());
        full.file_name().map_or("camera".to_owned(), |name| {
            name.to_string_lossy().into_owned()
        })
    };
    let is_numbered = all.iter().all(|(stem, _)| {
        let (camera, instant) = split(stem);
        !camera.is_empty() && !instant.is_empty()
    });
    if !is_numbered
        || all
            .iter()
            .any(|(stem, _)| has_time_stamp(split(stem).0.as_str()))
    {
        return vec![Series {
            name: own_name(),
            files: all,
        }];
    }
    let mut cameras: BTreeMap<String, Vec<(String, PathBuf)>> = BTreeMap::new();
    for (stem, path) in all {
        let (camera, instant) = split(&stem);
        cameras.entry(camera).or_default().push((instant, path));
    }
    cameras
        .into_iter()
        .map(|(name, files)| Series { name, files })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let instants = |s: &Series| s.files.iter().map(|(instant, _)| instant.clone()).collect();
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
