//! Recordings that the page of `serve` starts, each in a new file of one folder.

use crate::commands::record::{Opened, Origin, Recording};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};
use trinocular::calendar::Utc;
use trinocular::servo::page_recording::{Finish, Recordings};
use trinocular_recording::recorder::Tap;
use trinocular_rig::error::InputError;
use trinocular_rig::printable::printable;

/// Recordings in a folder, with the same origin.
#[derive(Debug)]
pub struct FolderRecordings {
    folder: PathBuf,
    origin: Origin,
    running: Option<Recording>,
}

impl FolderRecordings {
    /// Makes the recordings of a run. No file is touched before the first one begins.
    ///
    /// # Errors
    /// If there is no such folder.
    pub fn new(folder: PathBuf, origin: Origin) -> Result<Self, InputError> {
        if !folder.is_dir() {
            let reason = "is no folder; create it, or name another for the recordings";
            return Err(InputError::file(&folder, reason));
        }
        Ok(Self {
            folder,
            origin,
            running: None,
        })
    }
}

impl Recordings for FolderRecordings {
    fn begin(&mut self) -> Result<(String, Arc<Tap>), String> {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        let name = file_name(since_1970.map_or(0, |since| since.as_secs()));
        let path = self.folder.join(name);
        let opened = Opened::new(&path).map_err(|error| error.to_string())?;
        let recording = opened.start(&self.origin);
        let recording = recording.map_err(|failure| failure.to_string())?;
        let tap = recording.tap().ok_or("no recording was begun")?;
        self.running = Some(recording);
        Ok((printable(path.display()).to_string(), tap))
    }

    fn end(&mut self) -> Finish {
        let running = self.running.take();
        Box::new(move || {
            let account = running.map_or(Ok(None), Recording::finish)?;
            Ok(account.unwrap_or_default())
        })
    }
}

/// Returns the name of a recording that begins at this time, s since 1970:
/// `trinocular-YYYYMMDD-HHMMSS.mcap`, in UTC.
fn file_name(since_1970_s: u64) -> String {
    let Utc {
        year,
        month,
        day,
        hour,
        minute,
        second,
    } = Utc::of(since_1970_s);
    format!("trinocular-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.mcap")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_name_carries_the_date() {
        assert_eq!(file_name(951_782_400), "trinocular-20000229-000000.mcap");
    }
}
