//! Capture time of an image, from its driver's time stamp.
//!
//! A V4L2 driver stamps each image, and describes the stamp by flags: its clock, and the point of
//! the exposure or transfer. A stamp of the kernel's monotonic clock is converted to an
//! [`Instant`]. On Linux, `Instant` uses the same clock but does not show its reading, so both
//! clocks are read [once](Clocks), together.
//!
//! The stamps of a driver are no longer used once one is of another clock or cannot be true. From
//! then on the time of an image is when the waiting thread received it, later by the scheduler's
//! latency: tens of microseconds on a computer that is not overloaded. An image that was ready
//! before the thread waited has no known time.

use std::fmt;
use std::time::{Duration, Instant};

/// Largest time by which a stamp may be ahead of its image's arrival, to allow for reading two
/// clocks.
const AHEAD: Duration = Duration::from_millis(1);

/// Largest age of an image that has just arrived. No image takes longer from the camera to its
/// driver.
const OLDEST: Duration = Duration::from_secs(3);

/// Number of readings of two clocks, of which the quickest is used.
const READINGS: usize = 8;

/// Returns the quickest of several readings of two clocks, each given with its duration. A reading
/// during which the scheduler took the processor away is a bad pair.
pub fn quickest<O: Ord, T>(reading: impl Fn() -> (O, T)) -> T {
    let others = (1..READINGS).map(|_| reading());
    let quicker = |best: (O, T), other: (O, T)| match other.0 < best.0 {
        true => other,
        false => best,
    };
    others.fold(reading(), quicker).1
}

/// Returns the lead of one clock over another, µs.
pub fn offset_us(ahead_us: impl Fn() -> u64, of_us: impl Fn() -> u64) -> i64 {
    quickest(|| {
        let (before_us, at_us, after_us) = (of_us(), ahead_us(), of_us());
        let took_us = after_us.saturating_sub(before_us);
        (took_us, at_us as i64 - (before_us + took_us / 2) as i64)
    })
}

/// Readings of both clocks at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Clocks {
    instant: Instant,
    monotonic: Duration,
}

impl Clocks {
    /// Reads both clocks; `monotonic` reads the drivers' clock.
    pub fn read(monotonic: impl Fn() -> Duration) -> Self {
        quickest(|| {
            let before = Instant::now();
            let monotonic = monotonic();
            let took = before.elapsed();
            let instant = before + took / 2;
            (took, Self { instant, monotonic })
        })
    }

    /// Converts a time on the drivers' clock; `None` if it is too far away for an [`Instant`].
    pub fn instant(&self, monotonic: Duration) -> Option<Instant> {
        match monotonic.checked_sub(self.monotonic) {
            Some(later) => self.instant.checked_add(later),
            None => self.instant.checked_sub(self.monotonic - monotonic),
        }
    }
}

/// Point of an exposure or transfer that the driver stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Point {
    /// Start of the exposure. USB cameras report this point too, but are stamped when the first of
    /// their data arrive, which is after the exposure.
    Start,
    /// End of the transfer: the image has been read out and is in memory.
    End,
}

/// Time stamp of an image by its driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stamp {
    /// Time on the monotonic clock, at a point of the exposure or transfer.
    Monotonic(Duration, Point),
    /// No time stamp, or one of an unknown clock.
    Unknown,
}

/// Reason why a driver's stamps are not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doubt {
    /// The stamps are not of the monotonic clock.
    OtherClock,
    /// A stamp was later than its image's arrival.
    Ahead,
    /// A stamp was long before its image's arrival.
    Behind,
    /// The camera stamps no images.
    NoStamps,
}

/// Source of a camera's time stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Driver's stamps of this point.
    Driver(Point),
    /// Camera's stamps, by a clock of its own that is [compared](super::device_clock) with the
    /// computer's.
    Device,
    /// Arrival of the images.
    Arrival(Doubt),
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let doubt = match self {
            Self::Driver(Point::End) => {
                return f.write_str("images have the driver's time, of their end");
            }
            Self::Driver(Point::Start) => {
                return f.write_str("images have the driver's time, of their start");
            }
            Self::Device => return f.write_str("images have the camera's time"),
            Self::Arrival(Doubt::NoStamps) => "the camera stamps no images",
            Self::Arrival(Doubt::OtherClock) => "its driver does not use the monotonic clock",
            Self::Arrival(Doubt::Ahead) => "its driver's lie in the future",
            Self::Arrival(Doubt::Behind) => "its driver's lie seconds back",
        };
        write!(
            f,
            "images have the time of their arrival, which is less exact: {doubt}"
        )
    }
}

/// Capture times of one camera's images.
#[derive(Clone, Debug)]
pub struct Moments {
    clocks: Clocks,
    source: Option<Source>,
}

impl Moments {
    /// Creates the state before the first image.
    pub const fn new(clocks: Clocks) -> Self {
        let source = None;
        Self { clocks, source }
    }

    /// Returns the source of the time stamps; `None` before the first image.
    pub const fn source(&self) -> Option<Source> {
        self.source
    }

    /// Returns the time of an image that was delivered at `arrived`; `None` if it is unknown.
    /// `was_awaited` is true if the thread was waiting when the image came.
    pub fn of(&mut self, stamp: Stamp, arrived: Instant, was_awaited: bool) -> Option<Instant> {
        let by_arrival = was_awaited.then_some(arrived);
        if let Some(Source::Arrival(_)) = self.source {
            return by_arrival;
        }
        let believed = match stamp {
            Stamp::Unknown => Err(Doubt::OtherClock),
            Stamp::Monotonic(time, point) => match self.clocks.instant(time) {
                Some(at) if at > arrived + AHEAD => Err(Doubt::Ahead),
                Some(at) if arrived.saturating_duration_since(at) <= OLDEST => Ok((at, point)),
                // The image may have been ready for as long as the program was delayed: its time is
                // unknown, and the driver is not at fault.
                _ if !was_awaited => return None,
                _ => Err(Doubt::Behind),
            },
        };
        match believed {
            Ok((at, point)) => {
                self.source = Some(Source::Driver(point));
                Some(at)
            }
            Err(doubt) => {
                self.source = Some(Source::Arrival(doubt));
                by_arrival
            }
        }
    }
}

#[cfg(test)]
mod tests;
