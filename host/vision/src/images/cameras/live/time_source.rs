//! Capture times of images: their time stamps, or the triggers of a station.

use super::{CameraEvent, Tally};
use crate::images::cameras::triggers::{Count, Place, Triggers};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Source of the capture times of one camera's images.
pub enum TimeSource {
    /// Time stamps, counted from `zero`.
    Stamps {
        /// Zero of the capture times.
        zero: Instant,
    },
    /// Triggers of a station.
    Triggers {
        triggers: Arc<Triggers>,
        count: Count,
        /// Number of images so far, usable or not, without those that were lost.
        events: u64,
    },
}

/// Capture time of one image, or the reason why it is not used.
#[derive(Clone, Copy, Debug)]
pub enum Placed {
    /// Capture time by its stamp, µs; `None` for an image from before the start.
    Stamp(Option<u64>),
    /// Place among the triggers.
    Trigger(Place),
}

impl TimeSource {
    /// Notes an event of the camera.
    pub fn note(&mut self, event: &CameraEvent) {
        if let Self::Triggers { events, .. } = self {
            *events += u64::from(!matches!(event, CameraEvent::Nothing));
        }
    }

    /// Returns the capture time of an image with this time stamp; may wait for the report of its
    /// trigger. The camera has lost `lost` images so far.
    pub fn place(&mut self, at: Instant, lost: u64) -> Placed {
        match self {
            Self::Stamps { zero } => Placed::Stamp(at.checked_duration_since(*zero).map(micros)),
            Self::Triggers {
                triggers,
                count,
                events,
            } => Placed::Trigger(triggers.place(count, at, *events + lost)),
        }
    }
}

impl Placed {
    /// Returns the capture time, µs; `None` for an image that is not used.
    pub fn time_us(self) -> Option<u64> {
        match self {
            Self::Stamp(time_us) => time_us,
            Self::Trigger(Place::Of { instant_us, .. }) => Some(instant_us),
            Self::Trigger(_) => None,
        }
    }

    /// Counts what is wrong with the image, and returns it in words if it is worth a warning.
    pub fn count(self, tally: &mut Tally) -> Option<String> {
        let place = match self {
            Self::Stamp(time_us) => {
                // An image that was taken before the start has no time, and is stale.
                tally.stale += u64::from(time_us.is_none());
                return None;
            }
            Self::Trigger(place) => place,
        };
        match place {
            Place::Of { number, missed, .. } => {
                tally.missed += u64::from(missed);
                missed_images(number, missed)
            }
            Place::Miscounted { number, missed } => {
                tally.missed += u64::from(missed);
                tally.doubtful += 1;
                let doubt = format!(
                    "the image that fits trigger {number} is not used, because it may be of another"
                );
                let missed = missed_images(number, missed).into_iter();
                Some(missed.chain([doubt]).collect::<Vec<_>>().join("; "))
            }
            Place::Doubled { number } => {
                tally.doubled += 1;
                Some(format!("a second image of trigger {number}"))
            }
            Place::Doubtful => {
                tally.doubtful += 1;
                Some("an image whose trigger is not certain".to_owned())
            }
            Place::Before => None,
            Place::Unreported => {
                tally.unreported += 1;
                None
            }
        }
    }
}

/// Returns the words for the images that are missing right before that of a trigger.
fn missed_images(number: u32, missed: u32) -> Option<String> {
    let first = number - missed;
    match missed {
        0 => None,
        1 => Some(format!("no image of trigger {first}")),
        _ => Some(format!("no images of triggers {first} to {}", number - 1)),
    }
}

/// Returns the instant `by_us` after `at`, or before it if that is negative.
pub fn later(at: Instant, by_us: i64) -> Instant {
    let by = Duration::from_micros(by_us.unsigned_abs());
    let moved = match by_us < 0 {
        true => at.checked_sub(by),
        false => at.checked_add(by),
    };
    moved.unwrap_or(at)
}

/// Returns a duration, µs.
pub fn micros(duration: Duration) -> u64 {
    u64::try_from(duration.as_micros()).unwrap_or(u64::MAX)
}
