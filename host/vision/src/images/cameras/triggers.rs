//! Matching of images to the triggers that a station reports: by count, with a check by time.
//!
//! An image with the time of another trigger would move the prediction, so an image is used only
//! if its trigger is certain. Three things must agree:
//!
//! - *The instant of the trigger on this computer's clock.* The reports (`reports`) and the answers
//!   to pings bound it for each trigger anew. A clock that stood still, as that of a suspended
//!   computer or of a simulated station, makes no wrong pair: the bounds are those of its new
//!   reading.
//! - *The time from a trigger to the time stamp of its image.* It is learnt (`learning`) from a few
//!   triggers with a silence behind them, of which every camera must have taken all: so images and
//!   triggers are counted off one by one. From then on it may differ by an eighth of a period. With
//!   the bounds above, an image must fit one trigger, and no other.
//! - *The count.* From one image to the next, the camera's count (`count`) must advance as the
//!   triggers do. A camera that left a trigger out does not count it, so the image after such a gap
//!   is not used: it may as well be a late image of an earlier trigger.
//!
//! Triggers may come later than at even intervals, by up to a sixteenth of a period
//! ([`Triggers::with_wait`]): each has bounds of its own, so that this widens none.
//!
//! The capture time is the trigger's instant on the station's own clock; none of the times above
//! goes into it.

mod count;
mod learning;
mod reports;
mod span;

use std::path::PathBuf;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::live::micros;
use count::Shot;
pub use count::{Count, Place};
pub use learning::LEAST;
use reports::Reports;
use trinocular_rig::error::InputError;

/// Longest wait of an image for the report of its trigger.
const PATIENCE: Duration = Duration::from_millis(100);

/// Triggers that a station has reported, for the threads of all cameras.
#[derive(Debug)]
pub struct Triggers {
    zero: Instant,
    /// Time from a trigger to the middle of its exposure, µs.
    middle_us: u64,
    reports: Mutex<Reports>,
    heard: Condvar,
    patience: Duration,
}

impl Triggers {
    /// Creates a list without triggers, of which `rate_hz` come per second. The capture time is
    /// `middle_us` after the trigger.
    pub fn new(rate_hz: u16, middle_us: u64) -> Self {
        Self {
            zero: Instant::now(),
            middle_us,
            reports: Mutex::new(Reports::new(1_000_000 / i64::from(rate_hz.max(1)))),
            heard: Condvar::new(),
            patience: PATIENCE,
        }
    }

    /// Sets the time by which a trigger may come later than at even intervals, µs: less than an
    /// eighth of the period.
    pub fn with_wait(self, wait_us: u32) -> Self {
        self.reports().wait_us = wait_us.into();
        self
    }

    /// Takes a report that came at `heard`.
    pub fn report(&self, number: u32, instant_us: u64, heard: Instant) {
        let heard_us = self.host_us(heard);
        self.reports().add(number, signed(instant_us), heard_us);
        self.heard.notify_all();
    }

    /// Takes the answer to a ping that was sent at `sent` and came to the station at `instant_us`.
    pub fn ping(&self, sent: Instant, instant_us: u64) {
        let sent_us = self.host_us(sent);
        self.reports().pinged(sent_us, signed(instant_us));
    }

    /// Names the cameras, in the order of [`Count::of`].
    pub fn attend(&self, cameras: Vec<PathBuf>) {
        self.reports().attend(cameras);
    }

    /// Returns the number of triggers since the station began to count.
    pub fn given(&self) -> u32 {
        self.reports().newest().map_or(0, |newest| newest.number)
    }

    /// Returns the number of reports that have come so far, of all counts of the station.
    pub fn heard(&self) -> u64 {
        self.reports().heard
    }

    /// Forgets the triggers and images so far: the station begins to count.
    pub fn begin(&self) {
        self.reports().begin();
    }

    /// Learns the time from the triggers since [`Triggers::begin`] to the time stamps of their
    /// images. All images must have come.
    ///
    /// # Errors
    /// [`InputError`] with the first camera that has not one image of each trigger, and why.
    pub fn learn(&self) -> Result<(), InputError> {
        self.reports().learn()
    }

    /// Returns the place of a camera's next image. Waits for the report of its trigger.
    pub fn place(&self, count: &mut Count, at: Instant, seen: u64) -> Place {
        let shot = Shot {
            at_us: self.host_us(at),
            seen,
        };
        let end = Instant::now() + self.patience;
        let mut reports = self.reports();
        loop {
            let newest = reports.newest().map(|given| given.number);
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                count.waited_at = newest;
            }
            // While no report comes at all, as on a lost line, only one image waits.
            let is_last = newest.is_some() && count.waited_at == newest;
            if let Some(mut place) = count.place(&mut reports, shot, is_last) {
                if let Place::Of { instant_us, .. } = &mut place {
                    *instant_us = instant_us.saturating_add(self.middle_us);
                }
                return place;
            }
            let waited = self.heard.wait_timeout(reports, left);
            (reports, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn reports(&self) -> MutexGuard<'_, Reports> {
        self.reports.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns an instant of this computer, µs; negative before the list was created.
    fn host_us(&self, at: Instant) -> i64 {
        match at.checked_duration_since(self.zero) {
            Some(since) => signed(micros(since)),
            None => -signed(micros(self.zero.duration_since(at))),
        }
    }
}

/// Returns a time, µs, so that sums of a few do not overflow.
fn signed(us: u64) -> i64 {
    i64::try_from(us).unwrap_or(i64::MAX / 4)
}

#[cfg(test)]
mod tests;
