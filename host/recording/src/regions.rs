//! Regions of interest in a recording, with which its measurements are made again.
//!
//! Rectangles are entries of the origin, `roi.CAMERA`: left, top, width and height, px. Masks are
//! attached PNG files, `mask-CAMERA.png`.

use crate::png::png;
use crate::read::survey::Survey;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trinocular_rig::error::InputError;
use trinocular_vision::flow::region::{Region, Regions};
use trinocular_vision::images::decode::decode;

/// Beginning of the names of entries with rectangles.
const ENTRY: &str = "roi.";

/// Name of the entry with a camera's rectangle.
fn entry(camera: &str) -> String {
    format!("{ENTRY}{camera}")
}

/// Name of the attachment with a camera's mask.
fn attachment(camera: &str) -> String {
    format!("mask-{camera}.png")
}

/// Returns true if an attachment of this name is a mask.
pub(crate) fn is_mask(name: &str) -> bool {
    name.starts_with("mask-") && name.ends_with(".png")
}

/// Returns the entries of the origin.
pub(crate) fn entries(cameras: &[String], regions: &Regions) -> Vec<(String, String)> {
    let regions = cameras.iter().zip(&regions.0);
    let rectangles = regions.filter_map(|(camera, region)| {
        let sides = region.rectangle_px?.map(|side| side.to_string());
        Some((entry(camera), sides.join(",")))
    });
    rectangles.collect()
}

/// Returns the masks as files, by the names of their attachments.
pub(crate) fn masks(cameras: &[String], regions: &Regions) -> io::Result<Vec<(String, Vec<u8>)>> {
    let regions = cameras.iter().zip(&regions.0);
    let masks = regions.filter_map(|(camera, region)| {
        let mask = region.mask.as_ref()?;
        Some(png(mask).map(|file| (attachment(camera), file)))
    });
    masks.collect()
}

/// Returns true if the run of a recording had regions.
pub fn are_in(survey: &Survey) -> bool {
    let entries = survey.origin.iter().flat_map(BTreeMap::keys);
    !survey.masks.is_empty() || entries.into_iter().any(|name| name.starts_with(ENTRY))
}

/// Reads the regions of a recording, if it has any. `size_px` is the size of the cameras' images;
/// errors name `file`.
///
/// # Errors
/// [`InputError`] for a rectangle or a mask that is none.
pub fn read(
    file: &Path,
    (cameras, size_px): (&[String], [u32; 2]),
    survey: &Survey,
) -> Result<Regions, InputError> {
    if !are_in(survey) {
        return Ok(Regions::default());
    }
    let origin = survey.origin.as_ref();
    let region = |camera: &String| {
        let text = origin.and_then(|origin| origin.get(&entry(camera)));
        let rectangle = text.map(|text| {
            let sides = text.split(',').map(|side| side.parse().ok());
            let sides: Option<Vec<u32>> = sides.collect();
            let sides = sides.and_then(|sides| <[u32; 4]>::try_from(sides).ok());
            let none = || InputError::file(file, format!("its {} is no rectangle", entry(camera)));
            sides.ok_or_else(none)
        });
        let mask = survey.masks.get(&attachment(camera)).map(|bytes| {
            let within = PathBuf::from(format!("{}#{}", file.display(), attachment(camera)));
            let unread = |refusal| InputError::file(&within, format!("{refusal}"));
            decode(bytes, Some(size_px)).map_err(unread).map(Arc::new)
        });
        Ok(Region {
            rectangle_px: rectangle.transpose()?,
            mask: mask.transpose()?,
        })
    };
    cameras
        .iter()
        .map(region)
        .collect::<Result<_, _>>()
        .map(Regions)
}
