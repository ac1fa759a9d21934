//! Frame sets as files: one folder per camera, equal file names for images of the same instant.
//!
//! ```text
//! captures/left/000000.png    captures/middle/000000.png    captures/right/000000.png
//! captures/left/000001.png    captures/middle/000001.png    captures/right/000001.png
//! ```
//!
//! PNG, JPEG, PNM, TIFF, BMP and WebP files are read. Values of 16-bit files are scaled by the bits
//! that the frame sets use, all images of a frame set alike. Images in other formats are named
//! once and skipped; hidden files and all others are skipped. A name of an image that is not a file (a pipe, a folder, a
//! dangling link) is an unreadable image. Colour is converted to grey by its luminance. Frame sets
//! come in the order of their names, in which numbers count as numbers: `view9.png` comes before
//! `view10.png`.
//!
//! A camera may lack some files, for instance after it failed while the others went on; its images
//! are then [`Image::missing`]. [`Folder::complete`] requires all files.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageFormat};

use super::decode::{LARGEST_FILE, Picture, Refusal, decode, decode_deep};
use super::{FrameSet, Image};
use trinocular_rig::error::InputError;
use trinocular_rig::input::{self, Limit};

pub mod watch;

/// Default time between frame sets, µs: 30 per second.
pub const DEFAULT_PERIOD_US: u64 = 33_333;

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

/// Listed folder of frame sets. *Invariant:* at least one frame set had a file in every camera's
/// folder at the time of the listing.
#[derive(Clone, Debug)]
pub struct Folder {
    /// Folder of each camera, in the rig's order, with the files in it.
    cameras: Vec<(PathBuf, BTreeSet<String>)>,
    frames: Vec<String>,
    size_px: [u32; 2],
    period_us: u64,
    /// Images that are not read, per folder, and the depth of the first frame set.
    warnings: Vec<InputError>,
    /// Bits in use in the first whole frame set.
    depth_bits: u32,
}

impl Folder {
    /// Lists the frame sets in `dir`, whose subfolders are `names`, one per camera in the rig's
    /// order.
    ///
    /// Only the first whole frame set is opened, for the bits in use. `image_size_px`
    /// (width, height) is the size that every image must
    /// have, `period_us` the time between frame sets.
    ///
    /// # Errors
    /// [`InputError`] if a camera has no folder, or no frame set has a file of every camera: then
    /// the names are wrong rather than files lost.
    ///
    /// # Example
    /// ```
    /// use trinocular_core::rig::Rig;
    /// use trinocular_vision::images::folder::{DEFAULT_PERIOD_US, Folder, save};
    /// use trinocular_vision::images::{Scene, SceneSettings, Texture};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let folder = tempfile::tempdir()?;
    /// # let dir = folder.path();
    /// let rig = Rig::paper();
    /// let names = ["left", "middle", "right"].map(String::from);
    /// let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
    /// save(dir, &names, 0, &scene.render([0.0; 3], 0, 1))?;
    /// save(dir, &names, 1, &scene.render([1.0, 0.0, 0.0], 0, 2))?;
    ///
    /// let folder = Folder::open(dir, &names, rig.image_size_px, DEFAULT_PERIOD_US)?;
    /// assert_eq!(folder.names(), ["000000.png", "000001.png"]);
    /// let second = folder.frame_sets().nth(1).expect("two frame sets")?;
    /// assert_eq!((second.time_us, second.images.len()), (DEFAULT_PERIOD_US, 3));
    /// # Ok(())
    /// # }
    /// ```
    pub fn open(
        dir: &Path,
        names: &[String],
        image_size_px: [u32; 2],
        period_us: u64,
    ) -> Result<Self, InputError> {
        if !dir.is_dir() {
            return Err(InputError::file(dir, "no such folder"));
        }
        let mut unread = Vec::new();
        let listed = |name| {
            let camera = dir.join(name);
            let listing = listing(&camera)?;
            unread.extend(listing.remark().map(|remark| format!("{name}: {remark}")));
            Ok((camera, listing))
        };
        let cameras = names.iter().map(listed).collect::<Result<Vec<_>, _>>()?;
        let warnings = cameras.iter();
        let warnings = warnings.filter_map(|(camera, listing)| listing.warning(camera));
        let warnings = warnings.collect();
        let cameras: Vec<_> = cameras
            .into_iter()
            .map(|(camera, l)| (camera, l.files))
            .collect();
        let mut frames: Vec<String> = cameras.iter().flat_map(|(_, f)| f).cloned().collect();
        frames.sort_by_cached_key(|name| (numbers_padded(name), name.clone()));
        frames.dedup();
        if frames.is_empty() {
            let reason = "holds no images; each camera's folder should have PNG, JPEG, PNM, TIFF, \
                          BMP or WebP files";
            let reason = std::iter::once(reason.to_owned()).chain(unread);
            return Err(InputError::file(dir, reason.collect::<Vec<_>>().join("; ")));
        }
        let mut folder = Self {
            cameras,
            frames,
            size_px: image_size_px,
            period_us,
            warnings,
            depth_bits: 8,
        };
        folder.look_at_depth(dir);
        let lost: Option<Vec<PathBuf>> = folder.frames.iter().map(|f| folder.lost(f)).collect();
        match lost.as_deref() {
            Some([first, ..]) => {
                let mut error = incomplete(first);
                if let Some(endings) = folder.endings() {
                    error.reason = format!("{}; {endings}", error.reason);
                }
                Err(error)
            }
            _ => Ok(folder),
        }
    }

    /// Returns the folder if every camera has a file of every frame set.
    ///
    /// # Errors
    /// [`InputError`] with the first file that is missing.
    pub fn complete(self) -> Result<Self, InputError> {
        match self.frames.iter().find_map(|frame| self.lost(frame)) {
            Some(file) => Err(incomplete(&file)),
            None => Ok(self),
        }
    }

    /// Finds the bits in use in the first whole frame set, and warns of the scale and of saturation.
    fn look_at_depth(&mut self, dir: &Path) {
        let mut frames = self.frames.iter();
        let Some(first) = frames.find(|frame| self.lost(frame).is_none()) else {
            return;
        };
        let views = self.cameras.iter();
        let views = views.map(|(camera, _)| read_deep(&camera.join(first), self.size_px));
        // An error is reported when the frame set's turn comes.
        let Ok(views) = views.collect::<Result<Vec<_>, _>>() else {
            return;
        };
        if views.iter().all(|view| matches!(view, Picture::Eight(_))) {
            return;
        }
        self.depth_bits = bits_in_use(&views, 8);
        self.warnings
            .push(InputError::file(dir, scale(self.depth_bits)));
        for ((camera, _), view) in self.cameras.iter().zip(&views) {
            let share = view.saturated(self.depth_bits);
            if share > MOST_SATURATED {
                let percent = 100.0 * share;
                let reason =
                    format!("{percent:.1} % of the pixels are saturated; shorten the exposure");
                self.warnings
                    .push(InputError::file(&camera.join(first), reason));
            }
        }
    }

    /// Returns warnings: images in formats that are not read, one per folder; the scale of 16-bit
    /// images, and saturation in the first frame set.
    pub fn warnings(&self) -> &[InputError] {
        &self.warnings
    }

    /// Returns the first file of this frame set that is missing.
    pub fn lost(&self, frame: &str) -> Option<PathBuf> {
        let mut cameras = self.cameras.iter();
        let (camera, _) = cameras.find(|(_, files)| !files.contains(frame))?;
        Some(camera.join(frame))
    }

    /// Describes the endings of the files, if cameras have files of different endings.
    fn endings(&self) -> Option<String> {
        let endings_of = |files: &BTreeSet<String>| -> BTreeSet<String> {
            let names = files.iter();
            let endings = names.filter_map(|name| name.rsplit_once('.'));
            endings.map(|(_, ending)| format!(".{ending}")).collect()
        };
        let of_camera = |(camera, files): &(PathBuf, BTreeSet<String>)| {
            let name = camera.file_name().unwrap_or_default().to_string_lossy();
            let endings: Vec<String> = endings_of(files).into_iter().collect();
            (name.into_owned(), endings.join(" and "))
        };
        let cameras: Vec<(String, String)> = self.cameras.iter().map(of_camera).collect();
        let (_, first) = cameras.first()?;
        let (name, other) = cameras.iter().find(|(_, endings)| endings != first)?;
        let (known, _) = cameras.first()?;
        (!first.is_empty() && !other.is_empty()).then(|| {
            format!(
                "the images of `{known}` end in {first}, those of `{name}` in {other}; images of \
                 one instant must have the same file name, its ending included: convert one of \
                 them"
            )
        })
    }

    /// Returns the file names of the frame sets, in order.
    pub fn names(&self) -> &[String] {
        &self.frames
    }

    /// Returns the number of frame sets.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Returns false for any opened folder, because it has at least one frame set.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Reads the frame sets in order, each at its turn, with placeholders for missing images. A
    /// frame set that cannot be read does not end the iteration.
    pub fn frame_sets(&self) -> impl ExactSizeIterator<Item = Result<FrameSet, InputError>> + '_ {
        let mut depth_bits = self.depth_bits;
        self.frames.iter().enumerate().map(move |(index, name)| {
            let views = self
                .cameras
                .iter()
                .map(|(camera, files)| match files.contains(name) {
                    true => read_deep(&camera.join(name), self.size_px),
                    false => Ok(Picture::Eight(Image::missing())),
                })
                .collect::<Result<Vec<_>, _>>()?;
            depth_bits = bits_in_use(&views, depth_bits);
            let time_us = self.period_us.saturating_mul(index as u64);
            let images = views.into_iter().map(|view| view.scaled(depth_bits));
            Ok(FrameSet {
                time_us,
                images: images.collect(),
            })
        })
    }
}

/// Largest share of saturated pixels without a warning.
const MOST_SATURATED: f64 = 0.01;

/// Returns the most bits in use in the images, `so_far` or more.
fn bits_in_use(views: &[Picture], so_far: u32) -> u32 {
    let bits = views.iter().map(Picture::bits_in_use);
    bits.fold(so_far, u32::max)
}

/// Describes the scale of 16-bit images.
fn scale(bits: u32) -> String {
    let divisor = 1 << (bits - 8);
    format!("16-bit images that use {bits} bits; values are divided by {divisor}")
}

fn incomplete(missing: &Path) -> InputError {
    InputError::file(
        missing,
        "missing, but another camera has a file of this name",
    )
}

/// Writes a frame set as number `index` into `dir`, one PNG per camera, and makes folders as
/// needed.
pub fn save(
    dir: &Path,
    names: &[String],
    index: usize,
    capture: &FrameSet,
) -> Result<(), InputError> {
    let (cameras, views) = (names.len(), capture.images.len());
    if cameras != views {
        let reason = format!("cannot save {views} images for {cameras} cameras");
        return Err(InputError::file(dir, reason));
    }
    for (name, view) in names.iter().zip(&capture.images) {
        let camera = dir.join(name);
        fs::create_dir_all(&camera)
            .map_err(|cause| InputError::io(&camera, "make the folder", &cause))?;
        write(&camera.join(format!("{index:06}.png")), view)?;
    }
    Ok(())
}

/// Reads one image file as 8-bit grey, scaled by the bits that it uses. `size_px` (width, height)
/// is the size it must have.
pub fn read(path: &Path, size_px: [u32; 2]) -> Result<Image, InputError> {
    let picture = read_deep(path, size_px)?;
    let bits = picture.bits_in_use();
    Ok(picture.scaled(bits))
}

/// Reads one image file as grey with the depth of the file.
fn read_deep(path: &Path, size_px: [u32; 2]) -> Result<Picture, InputError> {
    decode_deep(&bytes(path)?, Some(size_px)).map_err(|refusal| {
        let reason = match refusal {
            Refusal::OtherSize {
                given: [width, height],
                wanted: [w, h],
            } => {
                let is_turned = width == h && height == w && width != height;
                let hint = if is_turned {
                    ": turn the camera or its images by 90 degrees"
                } else {
                    ""
                };
                format!("{width} x {height} px, but the rig's images are {w} x {h} px{hint}")
            }
            other => other.to_string(),
        };
        InputError::file(path, reason)
    })
}

/// Reads one image file of any size as grey.
pub fn read_any(path: &Path) -> Result<Image, InputError> {
    decode(&bytes(path)?, None).map_err(|refusal| InputError::file(path, refusal.to_string()))
}

fn bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    input::bytes(
        path,
        Limit {
            what: "an image",
            bytes: LARGEST_FILE,
        },
    )
}

/// Writes one image as an 8-bit grey PNG.
pub fn write(path: &Path, image: &Image) -> Result<(), InputError> {
    let size = (u32::try_from(image.width), u32::try_from(image.height));
    let (Ok(width), Ok(height)) = size else {
        return Err(InputError::file(path, "too large for an image"));
    };
    if image.width.checked_mul(image.height) != Some(image.grey.len()) {
        return Err(InputError::file(path, "size and pixels do not agree"));
    }
    let (grey, kind) = (&image.grey, ExtendedColorType::L8);
    image::save_buffer_with_format(path, grey, width, height, kind, ImageFormat::Png)
        .map_err(|cause| InputError::file(path, format!("cannot write the image: {cause}")))
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

/// Returns the name with every number padded with zeros, so that alphabetic order is the order of
/// the numbers.
pub fn numbers_padded(name: &str) -> String {
    let mut key = String::new();
    let mut rest = name;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let (text, tail) = rest.split_at(start);
        let is_text = |c: char| !c.is_ascii_digit();
        let (number, tail) = tail.split_at(tail.find(is_text).unwrap_or(tail.len()));
        key.push_str(&format!("{text}{number:0>20}"));
        rest = tail;
    }
    key + rest
}

#[cfg(test)]
mod tests;
