//! When a picture was taken, by its driver's stamp.
//!
//! A V4L2 driver stamps each picture, and says by flags what the stamp is worth: on which clock,
//! and which point of the picture. With the kernel's monotonic clock it becomes an [`Instant`],
//! which on Linux is of that clock too but does not tell what it reads: so both are read
//! [once](Clocks), together.
//!
//! A driver whose stamps are of another clock, or cannot be true, is not believed any more. From
//! then on a picture's moment is when the thread that waited for it got it: later by the time the
//! scheduler takes, tens of microseconds on a computer that is not overloaded. A picture that lay
//! ready before anybody waited has no such moment.

use std::fmt;
use std::time::{Duration, Instant};

/// Largest time by which a stamp may be ahead of its picture's arrival: nothing, but for what the
/// reading of two clocks takes.
const AHEAD: Duration = Duration::from_millis(1);

/// Largest age of an image that has just arrived. None takes so long from the camera to its
/// driver.
const OLDEST: Duration = Duration::from_secs(3);

/// Readings of two clocks, of which the quickest counts.
pub const READINGS: usize = 8;

/// The quickest of several readings of two clocks, each told with the time it took. One during
/// which the scheduler took the processor away is a bad pair.
pub fn quickest<O: Ord, T>(reading: impl Fn() -> (O, T)) -> T {
    let others = (1..READINGS).map(|_| reading());
    let quicker = |best: (O, T), other: (O, T)| match other.0 < best.0 {
        true => other,
        false => best,
    };
    others.fold(reading(), quicker).1
}

/// Both clocks at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Clocks {
    instant: Instant,
    monotonic: Duration,
}

impl Clocks {
    /// Reads them; `monotonic` tells the time on the drivers' clock.
    pub fn read(monotonic: impl Fn() -> Duration) -> Self {
        quickest(|| {
            let before = Instant::now();
            let monotonic = monotonic();
            let took = before.elapsed();
            let instant = before + took / 2;
            (took, Self { instant, monotonic })
        })
    }

    /// A moment on the drivers' clock; `None` if it is too far away for an [`Instant`].
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
    /// The start of the exposure. Cameras on USB say so too, but are stamped when the first of
    /// their data come, and that is after the exposure.
    Start,
    /// The end of the picture: it has been read out and is in memory.
    End,
}

/// Time stamp of an image by its driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stamp {
    /// Time on the monotonic clock, at a point of the picture.
    Monotonic(Duration, Point),
    /// None, or one of an unknown clock.
    Unknown,
}

/// Reason why a driver's stamps are not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doubt {
    /// They are not of the monotonic clock.
    OtherClock,
    /// One was later than its picture.
    Ahead,
    /// One was of long before its picture.
    Behind,
}

/// Source of a camera's time stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The driver's stamps, of this point.
    Driver(Point),
    /// The arrival of the pictures.
    Arrival(Doubt),
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let doubt = match self {
            Self::Driver(Point::End) => {
                return f.write_str("pictures have the driver's time, of their end");
            }
            Self::Driver(Point::Start) => {
                return f.write_str("pictures have the driver's time, of their start");
            }
            Self::Arrival(Doubt::OtherClock) => "its driver does not use the monotonic clock",
            Self::Arrival(Doubt::Ahead) => "its driver's lie in the future",
            Self::Arrival(Doubt::Behind) => "its driver's lie seconds back",
        };
        write!(
            f,
            "pictures have the time of their arrival, which is less exact: {doubt}"
        )
    }
}

/// The moments of one camera's pictures.
#[derive(Clone, Debug)]
pub struct Moments {
    clocks: Clocks,
    source: Option<Source>,
}

impl Moments {
    /// Before the first picture.
    pub const fn new(clocks: Clocks) -> Self {
        let source = None;
        Self { clocks, source }
    }

    /// Returns the source of the time stamps; `None` before the first image.
    pub const fn source(&self) -> Option<Source> {
        self.source
    }

    /// The moment of a picture that was handed over at `arrived`. `was_awaited`: it came while
    /// somebody waited for it. `None` if it cannot be known.
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
                // It may have lain there for as long as the program was held up: no time to go by,
                // and no fault of the driver.
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
