//! Matching of images to the triggers that a station reports: by count, with a check by time.
//!
//! The first image of a camera belongs to the latest trigger before its time stamp. From then on
//! image and trigger are counted together, and the time between two images must be that between
//! their triggers, within half a period. An image that comes a period or more too late tells that
//! the camera missed triggers, and one that comes half a period or more too soon is an image
//! without a trigger. Both are known at the very image that shows it.
//!
//! Time stamps of images only decide *which* trigger an image belongs to. Its capture time is the
//! trigger's instant on the station's own clock.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest wait of an image for the report of its trigger.
const PATIENCE: Duration = Duration::from_millis(100);

/// Longest time of the quickest report on the line, µs.
const LINE_US: i64 = 2_000;

/// Control tick of a station, µs: it sends a report with the first tick that comes half a tick or
/// more after the trigger.
const TICK_US: i64 = 1_000;

/// Number of triggers that are kept: a second at the highest rate.
const KEPT: usize = 1_000;

/// Share of a new image in the mean delay of a camera's time stamps, 1 to this.
const SMOOTHING: i64 = 8;

/// Trigger that the station has given.
#[derive(Clone, Copy, Debug)]
struct Given {
    number: u32,
    /// Instant on the station's clock, µs.
    instant_us: i64,
    /// False if its report was lost on the line, and the instant is a guess from its neighbours.
    is_reported: bool,
}

/// Place of an image among the triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Image of a trigger.
    Of {
        /// Number of the trigger.
        number: u32,
        /// Instant of the trigger on the station's clock, µs.
        instant_us: u64,
        /// Number of reported triggers right before this one of which the camera has no image.
        missed: u32,
    },
    /// Second image of a trigger.
    Doubled {
        /// Number of the trigger.
        number: u32,
    },
    /// Image that was taken before the first trigger.
    Before,
    /// Image whose trigger's report did not come.
    Unreported,
}

/// Count of one camera's images.
#[derive(Clone, Copy, Debug, Default)]
pub struct Count {
    /// Start of the triggers to which the count belongs.
    start: u64,
    last: Option<Last>,
    /// Number of the newest trigger when an image last waited for a newer one, and none came.
    waited_at: Option<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    number: u32,
    /// Mean of the time stamps less the triggers' instants, µs.
    delay_us: i64,
}

#[derive(Debug, Default)]
struct Reports {
    /// Number of times that the station has begun to count.
    starts: u64,
    given: VecDeque<Given>,
    /// Least time of a report's arrival less that of its dispatch by the station's clock, µs.
    quickest_us: Option<i64>,
}

/// Triggers that a station has reported, for the threads of all cameras.
#[derive(Debug)]
pub struct Triggers {
    zero: Instant,
    period_us: i64,
    reports: Mutex<Reports>,
    heard: Condvar,
}

impl Triggers {
    /// Creates a list without triggers, of which `rate_hz` come per second.
    pub fn new(rate_hz: u16) -> Self {
        Self {
            zero: Instant::now(),
            period_us: 1_000_000 / i64::from(rate_hz.max(1)),
            reports: Mutex::default(),
            heard: Condvar::new(),
        }
    }

    /// Takes a report of the station that came at `heard`.
    pub fn report(&self, number: u32, instant_us: u64, heard: Instant) {
        let instant_us = i64::try_from(instant_us).unwrap_or(i64::MAX);
        let heard_us = self.host_us(heard);
        self.reports().add(number, instant_us, heard_us);
        self.heard.notify_all();
    }

    /// Returns the place of a camera's next image, with the time stamp `at`. Waits for the report
    /// of its trigger.
    pub fn place(&self, count: &mut Count, at: Instant) -> Place {
        let at_us = self.host_us(at);
        let end = Instant::now() + PATIENCE;
        let mut reports = self.reports();
        loop {
            let newest = reports.given.back().map(|given| given.number);
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                count.waited_at = newest;
            }
            // While no report comes at all, as on a lost line, only one image waits.
            let is_last = newest.is_some() && count.waited_at == newest;
            if let Some(place) = reports.place(count, at_us, self.period_us, is_last) {
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
        let us = |time: Duration| i64::try_from(time.as_micros()).unwrap_or(i64::MAX);
        match at.checked_duration_since(self.zero) {
            Some(since) => us(since),
            None => -us(self.zero.duration_since(at)),
        }
    }
}

impl Reports {
    fn add(&mut self, number: u32, instant_us: i64, heard_us: i64) {
        let last = self.given.back().copied();
        if last.is_some_and(|last| number <= last.number) {
            // The station counts anew.
            self.given.clear();
        }
        if self.given.is_empty() {
            self.starts += 1;
            self.quickest_us = None;
        }
        if let Some(last) = self.given.back().copied() {
            // Reports in between were lost on the line: the triggers came at even intervals.
            let gap = i64::from(number - last.number);
            let lost = (gap - KEPT as i64).max(1)..gap;
            self.given.extend(lost.map(|n| Given {
                number: last.number + n as u32,
                instant_us: last.instant_us + (instant_us - last.instant_us) * n / gap,
                is_reported: false,
            }));
        }
        self.given.push_back(Given {
            number,
            instant_us,
            is_reported: true,
        });
        let excess = self.given.len().saturating_sub(KEPT);
        self.given.drain(..excess);
        let sent_us = (instant_us + TICK_US / 2 + TICK_US - 1) / TICK_US * TICK_US;
        let took_us = heard_us.saturating_sub(sent_us);
        self.quickest_us = Some(self.quickest_us.map_or(took_us, |least| least.min(took_us)));
    }

    /// Returns the place of an image; `None` if a later report may change it, unless this `is_last`
    /// call.
    fn place(&self, count: &mut Count, at_us: i64, period_us: i64, is_last: bool) -> Option<Place> {
        if count.start != self.starts {
            *count = Count {
                start: self.starts,
                ..Count::default()
            };
        }
        let (Some(newest), Some(quickest_us)) = (self.given.back(), self.quickest_us) else {
            return Some(Place::Before);
        };
        let Some(last) = count.last else {
            let taken_us = at_us - quickest_us + LINE_US.min(period_us / 2);
            if newest.instant_us <= taken_us && !is_last {
                return None;
            }
            let earlier = self.given.iter().rev();
            let Some(own) = earlier.into_iter().find(|own| own.instant_us <= taken_us) else {
                return Some(Place::Before);
            };
            // The triggers before it count as missed only from the camera's first image on.
            count.last = Some(Last {
                number: own.number,
                delay_us: at_us - own.instant_us,
            });
            return Some(own.place(0));
        };
        let taken_us = at_us - last.delay_us;
        if taken_us > newest.instant_us + period_us / 2 {
            // Its trigger is not reported yet.
            return is_last.then_some(Place::Unreported);
        }
        let from = self.given.iter().filter(|own| own.number >= last.number);
        let own = from.min_by_key(|own| own.instant_us.abs_diff(taken_us))?;
        if own.number == last.number {
            return Some(Place::Doubled { number: own.number });
        }
        count.last = Some(Last {
            number: own.number,
            delay_us: last.delay_us + (at_us - own.instant_us - last.delay_us) / SMOOTHING,
        });
        // Of triggers without a report it is unknown whether an image came.
        let between = self.given.iter().rev();
        let between = between.filter(|one| (last.number + 1..own.number).contains(&one.number));
        let missed = between.take_while(|one| one.is_reported).count();
        Some(own.place(missed as u32))
    }
}

impl Given {
    fn place(self, missed: u32) -> Place {
        match self.is_reported {
            true => Place::Of {
                number: self.number,
                instant_us: self.instant_us.unsigned_abs(),
                missed,
            },
            false => Place::Unreported,
        }
    }
}

#[cfg(test)]
mod tests;
