//! Names in a folder: images, other formats, and the rest.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use trinocular_rig::error::InputError;

const EXTENSIONS: [&str; 12] = [
    "png", "jpg", "jpeg", "pgm", "ppm", "pbm", "pnm", "tif", "tiff", "bmp", "dib", "webp",
];

/// Endings of images in formats that are not read.
const UNREAD: [&str; 22] = [
    "gif", "avif", "heic", "heif", "jp2", "j2k", "jxl", "jpe", "jfif", "jxr", "exr", "hdr", "tga",
    "qoi", "pam", "pfm", "dng", "raw", "cr2", "nef", "arw", "apng",
];

/// Largest number of unread images that a message lists.
const LISTED: usize = 10;

/// Image files of one camera's folder, and the images that are not read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listing {
    /// Names of files that are read.
    pub files: BTreeSet<String>,
    /// Names of images in other formats.
    pub unread: BTreeSet<String>,
}

impl Listing {
    /// Formats a message with the images that are not read, and the reason; `None` if all are read.
    pub fn remark(&self) -> Option<String> {
        let listed: Vec<&str> = self
            .unread
            .iter()
            .take(LISTED)
            .map(String::as_str)
            .collect();
        let more = match self.unread.len() - listed.len() {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        (!listed.is_empty()).then(|| {
            let names = listed.join(", ");
            format!(
                "not read: {names}{more}; only PNG, JPEG, PNM, TIFF, BMP and WebP are, so convert \
                 them"
            )
        })
    }

    /// Returns a warning that names the images in the folder `camera` that are not read.
    pub(crate) fn warning(&self, camera: &Path) -> Option<InputError> {
        self.remark().map(|remark| InputError::file(camera, remark))
    }
}

/// Lists the images in one camera's folder.
///
/// # Errors
/// [`InputError`] if the folder cannot be listed, or a name is not UTF-8.
pub fn listing(camera: &Path) -> Result<Listing, InputError> {
    if !camera.is_dir() {
        let reason = "no such folder; every camera of the rig needs one of its name";
        return Err(InputError::file(camera, reason));
    }
    let io = |cause| InputError::io(camera, "list", &cause);
    let mut listing = Listing::default();
    for entry in fs::read_dir(camera).map_err(io)? {
        let entry = entry.map_err(io)?;
        let path = entry.path();
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let has = |known: &[&str]| extension.as_deref().is_some_and(|e| known.contains(&e));
        let names = match (has(&EXTENSIONS), has(&UNREAD)) {
            (true, _) => &mut listing.files,
            (_, true) => &mut listing.unread,
            _ => continue,
        };
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            return Err(InputError::file(&path, "the file name is not UTF-8"));
        };
        if !name.starts_with('.') {
            names.insert(name.to_owned());
        }
    }
    Ok(listing)
}
