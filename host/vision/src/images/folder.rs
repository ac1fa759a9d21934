//! Frame sets as files: a folder, TIFF stack or video per camera ([`series`](super::series)). In
//! folders, equal file names are images of the same instant.
//!
//! ```text
//! captures/left/000000.png    captures/middle/000000.png    captures/right/000000.png
//! captures/left/000001.png    captures/middle/000001.png    captures/right/000001.png
//! ```
//!
//! PNG, JPEG, PNM, TIFF, BMP and WebP files are read. Values of 16-bit files are scaled by the bits
//! that the frame sets use, all images of a frame set alike. Images in other formats are named
//! once and skipped; hidden files and all others are skipped. A name of an image that is not a file
//! (a pipe, a folder, a dangling link) is an unreadable image. Colour is converted to grey by its
//! luminance. Frame sets come in the order of their names, in which numbers count as numbers:
//! `view9.png` comes before `view10.png`.
//!
//! A camera may lack some files, for instance after it failed while the others went on; its images
//! are then [`Image::missing`]. [`Folder::complete`] requires all files.

use std::collections::{BTreeSet, HashMap};
use std::fs;
use std::path::Path;

use image::{ExtendedColorType, ImageFormat};

use super::decode::{Picture, bits_in_use, scale};
use super::exposure::{ExposureFault, MOST_SATURATED};
use super::series::layout::{self, Found};
use super::series::pairing::{self, Pairing, Rule};
use super::series::{Images, Series, Still};
use super::{FrameSet, Image};
use trinocular_rig::error::InputError;

mod listing;
pub mod watch;

pub use listing::{Listing, listing};

/// Default time between frame sets, µs: 30 per second.
pub const DEFAULT_PERIOD_US: u64 = 33_333;

/// Listed frame sets. *Invariant:* at least one frame set had an image of every camera at the time of
/// the listing, unless they come through pipes.
#[derive(Clone, Debug)]
pub struct Folder {
    /// Images of each camera, in the rig's order.
    cameras: Vec<Series>,
    /// Index of each camera's image by the name of its instant.
    places: Vec<HashMap<String, usize>>,
    frames: Vec<String>,
    pairing: Pairing,
    /// True if the user gave the rule, so that videos may have different rates.
    may_differ: bool,
    size_px: [u32; 2],
    period_us: u64,
    /// Images that are not read, per folder, and the depth of the first frame set.
    warnings: Vec<InputError>,
    /// Bits in use in the first whole frame set.
    depth_bits: u32,
}

impl Folder {
    /// Lists the frame sets in `dir`: the images of the cameras `names`, in the rig's order, in any
    /// of the forms of [`series`](super::series).
    ///
    /// Only the first whole frame set is opened, for the bits in use. `image_size_px`
    /// (width, height) is the size that every image must have, `period_us` the time between frame
    /// sets.
    ///
    /// # Errors
    /// [`InputError`] if a camera has no images, or no frame set has an image of every camera: then
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
        Self::open_paired(dir, names, image_size_px, period_us, None)
    }

    /// Does the same as [`Folder::open`] with a rule by which images are of one instant.
    ///
    /// # Errors
    /// Those of [`Folder::open`], and if the rule cannot be applied.
    pub fn open_paired(
        dir: &Path,
        names: &[String],
        image_size_px: [u32; 2],
        period_us: u64,
        rule: Option<Rule>,
    ) -> Result<Self, InputError> {
        let Found { series, unread } = layout::of_cameras(dir, names)?;
        let mut folder = Self {
            places: Vec::new(),
            frames: Vec::new(),
            cameras: series,
            pairing: Pairing::default(),
            may_differ: rule.is_some(),
            size_px: image_size_px,
            period_us,
            warnings: unread
                .iter()
                .map(|(place, said)| InputError::file(place, said))
                .collect(),
            depth_bits: 8,
        };
        let has_pipe = folder.has_pipe();
        if !has_pipe
            && folder
                .cameras
                .iter()
                .all(|camera| camera.stills().is_empty())
        {
            let reason = "holds no images; each camera's folder should have PNG, JPEG, PNM, TIFF, \
                          BMP or WebP files";
            let name = |place: &Path| place.file_name().unwrap_or_default().to_owned();
            let unread = unread.iter();
            let unread = unread.map(|(at, said)| format!("{}: {said}", name(at).to_string_lossy()));
            let reason = std::iter::once(reason.to_owned()).chain(unread);
            return Err(InputError::file(dir, reason.collect::<Vec<_>>().join("; ")));
        }
        folder.pairing = pairing::pair(&mut folder.cameras, rule)
            .map_err(|reason| InputError::file(dir, reason))?;
        folder.list_frames();
        if has_pipe {
            return Ok(folder);
        }
        folder.look_at_depth(dir);
        let mut lost = folder.frames.iter().map(|frame| folder.lost(frame));
        let mut error = match lost.next() {
            None | Some(None) => return Ok(folder),
            Some(Some(_)) if lost.any(|lost| lost.is_none()) => return Ok(folder),
            Some(Some(first)) => first,
        };
        if let Some(endings) = folder.endings() {
            error.reason = format!("{}; {endings}", error.reason);
        }
        if rule.is_none() {
            error.reason += "; --pair order or --pair time pairs images of other names";
        }
        Err(error)
    }

    fn has_pipe(&self) -> bool {
        let mut cameras = self.cameras.iter();
        cameras.any(|camera| matches!(camera.images, Images::Pipe(_)))
    }

    /// Sorts the names of all instants, and indexes each camera's images by them.
    fn list_frames(&mut self) {
        let stills = self.cameras.iter().flat_map(Series::stills);
        let mut frames: Vec<String> = stills.map(|still| still.instant.clone()).collect();
        frames.sort_by_cached_key(|name| (numbers_padded(name), name.clone()));
        frames.dedup();
        self.frames = frames;
        let index = |camera: &Series| {
            let stills = camera.stills().iter().enumerate();
            stills
                .map(|(index, still)| (still.instant.clone(), index))
                .collect()
        };
        self.places = self.cameras.iter().map(index).collect();
    }

    /// Returns a camera's image of the frame set, if it has one.
    fn still(&self, camera: usize, frame: &str) -> Option<&Still> {
        let index = *self.places.get(camera)?.get(frame)?;
        self.cameras.get(camera)?.stills().get(index)
    }

    /// Reads the images of a frame set, with a placeholder for each that is missing.
    fn views(&self, frame: &str) -> Result<Vec<Picture>, InputError> {
        let cameras = 0..self.cameras.len();
        let read = |camera| match self.still(camera, frame) {
            Some(still) => still.read(Some(self.size_px)),
            None => Ok(Picture::Eight(Image::missing())),
        };
        cameras.map(read).collect()
    }

    /// Returns the folder if every camera has an image of every frame set.
    ///
    /// # Errors
    /// [`InputError`] with the first file that is missing.
    pub fn complete(self) -> Result<Self, InputError> {
        match self.frames.iter().find_map(|frame| self.lost(frame)) {
            Some(error) => Err(error),
            None => Ok(self),
        }
    }

    /// Finds the bits in use in the first whole frame set, and warns of the scale and of saturation.
    fn look_at_depth(&mut self, dir: &Path) {
        let mut frames = self.frames.iter();
        let Some(first) = frames.find(|frame| self.lost(frame).is_none()) else {
            return;
        };
        // An error is reported when the frame set's turn comes.
        let Ok(views) = self.views(first) else {
            return;
        };
        if views.iter().all(|view| matches!(view, Picture::Eight(_))) {
            return;
        }
        self.depth_bits = bits_in_use(&views, 8);
        self.warnings
            .push(InputError::file(dir, scale(self.depth_bits)));
        for (camera, view) in views.iter().enumerate() {
            let share = view.saturated(self.depth_bits);
            if share > MOST_SATURATED {
                let file = self.still(camera, first).map_or(dir, |still| &still.file);
                let fault = ExposureFault::Saturated(share).to_string();
                self.warnings.push(InputError::file(file, fault));
            }
        }
    }

    /// Returns warnings: images in formats that are not read, one per folder; the scale of 16-bit
    /// images, and saturation in the first frame set.
    pub fn warnings(&self) -> &[InputError] {
        &self.warnings
    }

    /// Describes the rule by which images are of one instant; `None` for equal file names, unless
    /// the caller gave that rule.
    pub fn pairing(&self) -> Option<String> {
        let said = self.pairing.said.as_ref()?;
        let count = match self.has_pipe() {
            true => String::new(),
            false => format!("{} ", self.frames.len()),
        };
        Some(format!("{count}frame sets by {said}"))
    }

    /// Returns an error for the first camera without an image of this frame set; `None` if it is
    /// whole. The error names the missing file, or its partner if the missing name is not known.
    pub fn lost(&self, frame: &str) -> Option<InputError> {
        let cameras = || self.cameras.iter().enumerate();
        let mut stills = cameras().filter(|(_, camera)| !matches!(camera.images, Images::Pipe(_)));
        let (_, camera) = stills.find(|(index, _)| self.still(*index, frame).is_none())?;
        let partner = cameras().find_map(|(index, _)| self.still(index, frame));
        let is_named = |still: &Still| still.name() == frame;
        let own_folders =
            cameras().all(|(_, other)| !other.is_numbered() && other.has_own_folder());
        Some(match partner {
            Some(partner) if !(own_folders && is_named(partner)) => {
                let reason = format!(
                    "has no partner: camera `{}` has no image of the same instant",
                    camera.name
                );
                InputError::file(&partner.file, reason)
            }
            _ => InputError::file(
                &camera.place.join(frame),
                "missing, but another camera has a file of this name",
            ),
        })
    }

    /// Describes the endings of the files, if cameras have files of different endings.
    fn endings(&self) -> Option<String> {
        let of_camera = |camera: &Series| {
            let endings = camera.stills().iter();
            let endings = endings.filter_map(|still| still.file.extension());
            let endings: BTreeSet<String> = endings
                .map(|ending| format!(".{}", ending.to_string_lossy()))
                .collect();
            let endings: Vec<String> = endings.into_iter().collect();
            (camera.name.clone(), endings.join(" and "))
        };
        let cameras: Vec<(String, String)> = self.cameras.iter().map(of_camera).collect();
        let (known, first) = cameras.first()?;
        let (name, other) = cameras.iter().find(|(_, endings)| endings != first)?;
        (!first.is_empty() && !other.is_empty()).then(|| {
            format!("the images of `{known}` end in {first}, those of `{name}` in {other}")
        })
    }

    /// Returns the names of the frame sets, in order: their files' names if these are equal. Frame
    /// sets from pipes have none.
    pub fn names(&self) -> &[String] {
        &self.frames
    }

    /// Returns the number of frame sets; `None` if they come through pipes.
    pub fn count(&self) -> Option<usize> {
        (!self.has_pipe()).then_some(self.frames.len())
    }

    /// Returns the time between two frames of the videos, µs, if all cameras' images are videos.
    pub fn video_period_us(&self) -> Option<u64> {
        let rates: Option<Vec<[u32; 2]>> = self.cameras.iter().map(Series::rate).collect();
        let [above, below] = rates?.into_iter().next()?.map(f64::from);
        Some((1e6 * below / above).round() as u64)
    }

    /// Sets the time between frame sets, µs.
    pub fn set_period_us(&mut self, period_us: u64) {
        self.period_us = period_us;
    }

    /// Returns the capture time of a frame set, µs since the first.
    fn time_us(&self, index: usize) -> u64 {
        let stamp = |index| self.pairing.times_us.get(self.frames.get::<usize>(index)?);
        match (stamp(0), stamp(index)) {
            (Some(first), Some(now)) => now.abs_diff(*first),
            _ => self.period_us.saturating_mul(index as u64),
        }
    }

    /// Reads the frame set at `index`, of pipes the next one; `None` at the end. Pipes of different
    /// rates end with an error at their first frames.
    fn next_views(&self, index: usize) -> Option<Result<Vec<Picture>, InputError>> {
        if !self.has_pipe() {
            return self.frames.get(index).map(|frame| self.views(frame));
        }
        let differing = || match self.may_differ {
            true => None,
            false => pairing::differing_rates(&self.cameras),
        };
        if index > 0 && differing().is_some() {
            return None;
        }
        let next = |camera: &Series| match &camera.images {
            Images::Stills(stills) => Some(stills.get(index)?.read(Some(self.size_px))),
            Images::Pipe(pipe) => Some(pipe.next(Some(self.size_px))?),
        };
        // All are taken, so that an error of one camera shifts no other's frames.
        let views: Vec<_> = self.cameras.iter().map(next).collect();
        let views: Option<Vec<_>> = views.into_iter().collect();
        if let Some(reason) = differing() {
            return Some(Err(InputError::file(&self.cameras.first()?.place, reason)));
        }
        Some(views?.into_iter().collect())
    }

    /// Reads the frame sets in order, each at its turn, with placeholders for missing images. A
    /// frame set that cannot be read does not end the iteration.
    pub fn frame_sets(&self) -> impl Iterator<Item = Result<FrameSet, InputError>> + '_ {
        let mut depth_bits = self.depth_bits;
        let mut index = 0;
        std::iter::from_fn(move || {
            let views = self.next_views(index)?;
            let time_us = self.time_us(index);
            index += 1;
            Some(views.map(|views| {
                depth_bits = bits_in_use(&views, depth_bits);
                let images = views.into_iter().map(|view| view.scaled(depth_bits));
                FrameSet {
                    time_us,
                    images: images.collect(),
                }
            }))
        })
    }
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
    Still::file("", path.to_owned()).read(Some(size_px))
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
