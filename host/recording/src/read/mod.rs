//! Reading of MCAP files: own recordings, and the files and ROS 2 bags of others.
//!
//! * [`records`]: the records of a file, one after another, in bounded memory;
//! * [`Source`]: a file, or the folder of a bag, read from its beginning as often as needed;
//! * [`survey`]: topics, origin and rig of a source;
//! * [`frames`]: its images as frame sets;
//! * [`image`]: messages with images;
//! * [`calibration`]: `camera_info` as a rig.

pub mod calibration;
mod fields;
pub mod frames;
pub mod image;
pub mod records;
mod stamps;
pub mod survey;
mod topics;

use crate::topic::{END, ORIGIN};
use records::{Damage, Record, Records};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use trinocular_rig::error::InputError;
use trinocular_rig::input;

/// Size of the buffer between a file and its reader, bytes.
const BUFFER: usize = 1 << 20;

/// What is said of a recording that was closed before its run ended.
const UNENDED: &str = "was not ended by its run, as after a full disk: the end of the run is missing, \
                       and what stands before was read";

/// Recording to read: a file, or the files of a bag, in their order.
#[derive(Clone, Debug)]
pub struct Source {
    path: PathBuf,
    files: Vec<PathBuf>,
}

/// Returns true for a path that ends in `.mcap` and for the folder of a ROS 2 bag.
///
/// ```
/// use std::path::Path;
/// use trinocular_recording::read::is_recording;
///
/// assert!(is_recording(Path::new("run.mcap")));
/// assert!(!is_recording(Path::new("points.csv")));
/// ```
pub fn is_recording(path: &Path) -> bool {
    if path.is_dir() {
        return path.join("metadata.yaml").is_file();
    }
    path.extension()
        .is_some_and(|extension| extension == "mcap")
}

impl Source {
    /// Finds the files at `path`.
    ///
    /// # Errors
    /// [`InputError`] if there are none, or a bag is stored in another format.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        if !path.is_dir() {
            // Opened once, so that a missing file or a device is named now.
            input::open(path)?;
            return Ok(Self {
                path: path.to_owned(),
                files: vec![path.to_owned()],
            });
        }
        let unreadable = |cause| InputError::io(path, "list", &cause);
        let entries = std::fs::read_dir(path).map_err(unreadable)?;
        let mut files = Vec::new();
        let mut is_sqlite = false;
        for entry in entries {
            let file = entry.map_err(unreadable)?.path();
            let has = |ending: &str| file.extension().is_some_and(|e| e == ending);
            is_sqlite |= has("db3");
            if has("mcap") {
                files.push(file);
            }
        }
        files.sort_by_cached_key(|file| {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            trinocular_vision::images::folder::numbers_padded(&name)
        });
        match files.is_empty() {
            false => Ok(Self {
                path: path.to_owned(),
                files,
            }),
            true if is_sqlite => Err(InputError::file(
                path,
                "is a bag in SQLite files (.db3), which are not read; convert it: \
                 rosbags-convert --src BAG --dst NEW --dst-storage mcap",
            )),
            true => Err(InputError::file(path, "holds no MCAP file (.mcap)")),
        }
    }

    /// Returns the path that the user gave.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads all records, from the first file's first on.
    pub fn records(&self) -> Contents<'_> {
        Contents {
            source: self,
            next: 0,
            open: None,
            is_unended: false,
            cut: None,
        }
    }
}

/// Records of a source with the number of their file; numbers of channels count per file.
pub struct Contents<'a> {
    source: &'a Source,
    next: usize,
    open: Option<Records<BufReader<File>>>,
    /// True after the beginning of a recording of this program, until its end.
    is_unended: bool,
    cut: Option<InputError>,
}

impl Contents<'_> {
    /// Returns why the end is missing: the place at which a file was cut off, as a recording is by a
    /// crash, or that its run did not end it, as after a full disk. Its records up to there have been
    /// read.
    pub fn cut(&self) -> Option<&InputError> {
        self.cut.as_ref()
    }

    fn file(&self) -> &Path {
        let index = self.next.saturating_sub(1);
        self.source.files.get(index).unwrap_or(&self.source.path)
    }
}

impl Iterator for Contents<'_> {
    type Item = Result<(usize, Record), InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(records) = &mut self.open {
                match records.next() {
                    Some(Ok(record)) => {
                        if let Record::Metadata { name, .. } = &record {
                            self.is_unended = match name.as_str() {
                                ORIGIN => true,
                                END => false,
                                _ => self.is_unended,
                            };
                        }
                        return Some(Ok((self.next - 1, record)));
                    }
                    Some(Err(damage @ Damage::CutOff(_))) => {
                        self.cut = Some(InputError::file(self.file(), damage.to_string()));
                    }
                    Some(Err(damage)) => {
                        let error = InputError::file(self.file(), damage.to_string());
                        self.open = None;
                        self.next = self.source.files.len();
                        return Some(Err(error));
                    }
                    None => {}
                }
            }
            self.open = None;
            let Some(file) = self.source.files.get(self.next) else {
                if std::mem::take(&mut self.is_unended) && self.cut.is_none() {
                    self.cut = Some(InputError::file(&self.source.path, UNENDED));
                }
                return None;
            };
            self.next += 1;
            let opened = input::open(file).and_then(|opened| {
                let buffered = BufReader::with_capacity(BUFFER, opened);
                let records = Records::new(buffered);
                records.map_err(|damage| InputError::file(file, damage.to_string()))
            });
            match opened {
                Ok(records) => self.open = Some(records),
                Err(error) => {
                    self.next = self.source.files.len();
                    return Some(Err(error));
                }
            }
        }
    }
}
