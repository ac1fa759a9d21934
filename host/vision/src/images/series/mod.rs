//! Images of one camera, in any of the forms that cameras and programs leave.
//!
//! ```text
//! captures/left/0.png   captures/right/0.png     a folder per camera
//! captures/left0.png    captures/right0.png      one folder: the camera's name, then the image's
//! captures/left.tif     captures/right.tif       a TIFF stack per camera: each page is an image
//! captures/left.y4m     captures/right.y4m       a Y4M video per camera, also as a named pipe
//! ```
//!
//! [`layout`] finds the series, [`pairing`] decides which images are of one instant.

use std::fs;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::decode::{LARGEST_FILE, Picture, Refusal, decode_deep};
use pipe::Pipe;
use stack::{Contiguous, Pages};
use trinocular_rig::error::InputError;
use trinocular_rig::input::{self, Limit};
use y4m::Header;

pub mod layout;
mod name_time;
pub mod pairing;
pub mod pipe;
pub(super) mod stack;
mod y4m;

/// Images of one camera.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name of the camera.
    pub name: String,
    /// Folder, stack, video or pipe that the images are in.
    pub place: PathBuf,
    /// The images, in order.
    pub images: Images,
}

/// Images of a [`Series`].
#[derive(Clone, Debug)]
pub enum Images {
    /// Images that can be read at any time.
    Stills(Vec<Still>),
    /// Images that come one after another, their number unknown.
    Pipe(Pipe),
}

/// Image that can be read at any time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Still {
    /// Name of the image's instant: images of several cameras with equal names are of one instant.
    pub instant: String,
    /// File that the image is in.
    pub file: PathBuf,
    part: Part,
}

/// Part of a file that is one image.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Part {
    Whole,
    /// Page of a TIFF stack, numbered from 1.
    Page {
        number: usize,
        directory: u64,
    },
    /// Image of an ImageJ stack with one directory, numbered from 1.
    Slice {
        number: usize,
        stack: Contiguous,
    },
    /// Frame of a Y4M video, numbered from 1.
    Frame {
        number: usize,
        header: Arc<Header>,
        at: u64,
    },
}

impl Still {
    /// Creates the image that is a whole file.
    pub fn file(instant: &str, file: PathBuf) -> Self {
        Self {
            instant: instant.to_owned(),
            file,
            part: Part::Whole,
        }
    }

    /// Returns the name of the image, for the user: its file's, or its number in the file.
    pub fn name(&self) -> String {
        match self.part {
            Part::Whole => {
                let name = self.file.file_name().unwrap_or_default();
                name.to_string_lossy().into_owned()
            }
            Part::Page { number, .. } | Part::Slice { number, .. } => format!("page {number}"),
            Part::Frame { number, .. } => format!("frame {number}"),
        }
    }

    /// Reads the image, which must have `size_px` (width, height) if that is known.
    ///
    /// # Errors
    /// [`InputError`] that names the file, and the number of a page or frame.
    pub fn read(&self, size_px: Option<[u32; 2]>) -> Result<Picture, InputError> {
        let file = &self.file;
        let decoded = match &self.part {
            Part::Whole => decode_deep(&bytes(file)?, size_px),
            Part::Page { directory, .. } => stack::read(file, *directory, size_px)?,
            Part::Slice { number, stack } => sized(Ok(stack.read(file, number - 1)?), size_px),
            Part::Frame { header, at, .. } => {
                let mut reader = input::open(file)?;
                reader
                    .seek(SeekFrom::Start(*at))
                    .map_err(|cause| InputError::io(file, "read", &cause))?;
                sized(header.luma(&mut reader), size_px)
            }
        };
        decoded.map_err(|refusal| {
            let reason = said(&refusal);
            match self.part {
                Part::Whole => InputError::file(file, reason),
                _ => InputError::file(file, format!("{}: {reason}", self.name())),
            }
        })
    }
}

/// Checks the size of a video's frame.
fn sized(frame: Result<Picture, String>, size_px: Option<[u32; 2]>) -> Result<Picture, Refusal> {
    let picture = frame.map_err(Refusal::Malformed)?;
    let given = picture.size_px();
    match size_px {
        Some(wanted) if wanted != given => Err(Refusal::OtherSize { given, wanted }),
        _ => Ok(picture),
    }
}

/// Describes the reason why an image of a rig is refused.
fn said(refusal: &Refusal) -> String {
    match refusal {
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
    }
}

/// Reads the bytes of an image file.
fn bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    input::bytes(
        path,
        Limit {
            what: "an image",
            bytes: LARGEST_FILE,
        },
    )
}

impl Series {
    /// Opens a TIFF stack: each page is an image.
    ///
    /// # Errors
    /// [`InputError`] if the file is no TIFF file.
    pub fn stack(name: &str, path: &Path) -> Result<Self, InputError> {
        let still = |number: usize, part| Still {
            instant: number.to_string(),
            file: path.to_owned(),
            part,
        };
        let stills = match stack::pages(path)? {
            Pages::Directories(pages) => {
                let pages = pages.into_iter().zip(1..);
                pages
                    .map(|(directory, number)| still(number, Part::Page { number, directory }))
                    .collect()
            }
            Pages::Contiguous(stack) => (1..=stack.count)
                .map(|number| still(number, Part::Slice { number, stack }))
                .collect(),
        };
        Ok(Self {
            name: name.to_owned(),
            place: path.to_owned(),
            images: Images::Stills(stills),
        })
    }

    /// Opens a Y4M video: a file, a named pipe, or `-`, which is standard input.
    ///
    /// # Errors
    /// [`InputError`] if the file is no Y4M video. A pipe's errors come with its images.
    pub fn video(name: &str, path: &Path) -> Result<Self, InputError> {
        let series = |images| Self {
            name: name.to_owned(),
            place: path.to_owned(),
            images,
        };
        if !is_regular(path) {
            return Ok(series(Images::Pipe(Pipe::open(path))));
        }
        let mut reader = BufReader::new(input::open(path)?);
        let fault = |reason: String| InputError::file(path, reason);
        let header = Arc::new(Header::read(&mut reader).map_err(fault)?);
        let frames = header.frames(&mut reader).map_err(fault)?;
        let still = |(at, number): (u64, usize)| Still {
            instant: number.to_string(),
            file: path.to_owned(),
            part: Part::Frame {
                number,
                header: Arc::clone(&header),
                at,
            },
        };
        let stills = frames.into_iter().zip(1..).map(still).collect();
        Ok(series(Images::Stills(stills)))
    }

    /// Returns the images that can be read at any time; none of a pipe.
    pub fn stills(&self) -> &[Still] {
        match &self.images {
            Images::Stills(stills) => stills,
            Images::Pipe(_) => &[],
        }
    }

    /// Returns the images that can be read at any time, to change them; `None` for a pipe.
    pub fn stills_mut(&mut self) -> Option<&mut Vec<Still>> {
        match &mut self.images {
            Images::Stills(stills) => Some(stills),
            Images::Pipe(_) => None,
        }
    }

    /// Returns true if the series is a folder of the camera's name.
    pub fn has_own_folder(&self) -> bool {
        self.place
            .file_name()
            .is_some_and(|name| name.to_string_lossy() == self.name)
    }

    /// Returns true if the images are numbered pages or frames of one file or pipe, which have no
    /// names.
    pub fn is_numbered(&self) -> bool {
        match &self.images {
            Images::Stills(stills) => stills.iter().any(|still| still.part != Part::Whole),
            Images::Pipe(_) => true,
        }
    }

    /// Returns the frames per second of a video, as a fraction; that of a pipe once it has begun.
    pub fn rate(&self) -> Option<[u32; 2]> {
        if let Images::Pipe(pipe) = &self.images {
            return pipe.rate();
        }
        match &self.stills().first()?.part {
            Part::Frame { header, .. } => header.rate,
            _ => None,
        }
    }
}

/// Returns true for a regular file; false for a pipe and standard input.
fn is_regular(path: &Path) -> bool {
    path != Path::new(pipe::STANDARD_INPUT) && fs::metadata(path).is_ok_and(|about| about.is_file())
}

#[cfg(test)]
mod tests;
