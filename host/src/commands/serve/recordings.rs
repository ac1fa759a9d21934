//! Recordings that the page of `serve` starts, each in a new file of one folder.

use crate::commands::record::{Opened, Origin, Recording};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};
use trinocular::servo::page_recording::{Finish, Recordings};
use trinocular_recording::recorder::Tap;
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
    pub fn new(folder: PathBuf, origin: Origin) -> Self {
        Self {
            folder,
            origin,
            running: None,
        }
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
            let running = running.ok_or("no recording is under way")?;
            let account = running.finish().map_err(|error| error.to_string())?;
            Ok(account.unwrap_or_default())
        })
    }
}

/// Returns the name of a recording that begins at this time, s since 1970:
/// `trinocular-YYYYMMDD-HHMMSS.mcap`, in UTC.
fn file_name(since_1970_s: u64) -> String {
    let (days, second) = (since_1970_s / 86_400, since_1970_s % 86_400);
    let (year, month, day) = date(days);
    let (hour, minute) = (second / 3_600, second / 60 % 60);
    let second = second % 60;
    format!("trinocular-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.mcap")
}

/// Returns year, month and day of the day `days` after 1 January 1970.
fn date(mut days: u64) -> (u64, u64, u64) {
    let is_leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let mut year = 1970;
    while days >= 365 + u64::from(is_leap(year)) {
        days -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let february = 28 + u64::from(is_leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    (year, month, days + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_carry_the_date() {
        assert_eq!(file_name(0), "trinocular-19700101-000000.mcap");
        assert_eq!(file_name(951_782_399), "trinocular-20000228-235959.mcap");
        assert_eq!(file_name(951_782_400), "trinocular-20000229-000000.mcap");
        assert_eq!(file_name(1_798_761_599), "trinocular-20261231-235959.mcap");
        assert_eq!(file_name(4_107_542_400), "trinocular-21000301-000000.mcap");
    }
}
