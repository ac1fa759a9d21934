//! A station on a port, and a folder in which frame sets appear.

use super::{CalibrateStageOptions, StageBench};
use crate::commands::driven::Driven;
use crate::commands::failure::Failure;
use crate::commands::warnings;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::folder::{DEFAULT_PERIOD_US, Folder};

/// Polling period of the folder.
const LOOK: Duration = Duration::from_millis(100);

/// Station on a serial port, and the folder of its frame sets.
pub struct Real {
    driven: Driven,
    folder: PathBuf,
    names: Vec<String>,
    size_px: [u32; 2],
    patience: Duration,
}

/// Checks the folder. The station is connected by `driven`.
pub fn bench(
    options: &CalibrateStageOptions,
    folder: &Path,
    rig: &RigFile,
    driven: impl FnOnce() -> Result<Driven, Failure>,
) -> Result<Real, Failure> {
    if !folder.is_dir() {
        return Err(InputError::file(folder, "no such folder").into());
    }
    Ok(Real {
        driven: driven()?,
        folder: folder.to_owned(),
        names: rig.names.clone(),
        size_px: rig.rig.image_size_px,
        patience: Duration::from_secs(options.patience.into()),
    })
}

impl Real {
    /// Returns the frame sets in the folder; `None` before the first is complete.
    fn listed(&self) -> Option<Folder> {
        Folder::open(&self.folder, &self.names, self.size_px, DEFAULT_PERIOD_US).ok()
    }

    fn names(&self) -> BTreeSet<String> {
        let listed = self.listed();
        listed.map_or_else(BTreeSet::new, |folder| {
            folder.names().iter().cloned().collect()
        })
    }
}

impl StageBench for Real {
    fn position_mm(&mut self) -> Result<[f64; 3], Failure> {
        self.driven.position_mm()
    }

    fn go(&mut self, position_mm: [f64; 3]) -> Result<[f64; 3], Failure> {
        self.driven.send(position_mm)?;
        self.driven.arrive()
    }

    /// Waits for a frame set that was not there when the stage came to rest.
    fn look(&mut self) -> Result<FrameSet, Failure> {
        let before = self.names();
        let [x, y, z] = self.position_mm()?;
        notice!("at {x:.3} {y:.3} {z:.3} mm: take an image");
        let end = Instant::now() + self.patience;
        loop {
            let line = self.driven.hand.serial().check();
            line.map_err(|error| self.driven.hand.failed(error))?;
            let folder = self.listed();
            let newest = folder.as_ref().and_then(|folder| {
                let names = folder.names().iter().enumerate();
                let is_new = |name: &str| !before.contains(name) && folder.lost(name).is_none();
                let mut new = names.filter(|(_, name)| is_new(name));
                new.next_back().map(|(index, _)| index)
            });
            if let (Some(folder), Some(index)) = (&folder, newest)
                && let Some(capture) = folder.frame_sets().nth(index)
            {
                match capture {
                    Ok(capture) => return Ok(capture),
                    // The file may still be half written.
                    Err(error) if Instant::now() >= end => return Err(error.into()),
                    Err(_) => {}
                }
            }
            if Instant::now() >= end {
                if let Some(folder) = &folder {
                    warnings::unread(folder.warnings());
                }
                let waited = self.patience.as_secs();
                let reason = format!("no frame set came within {waited} s");
                return Err(InputError::file(&self.folder, reason).into());
            }
            std::thread::sleep(LOOK);
        }
    }
}
