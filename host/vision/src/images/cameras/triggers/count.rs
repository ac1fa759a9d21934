//! Place of each image among the triggers.

use super::reports::{Given, Reports};

/// Share of a period by which the time from a trigger to the time stamp of its image may differ
/// from that which was learnt: 1 to this.
pub const STEADY: i64 = 8;

/// Largest share of a period between the bounds of a trigger's instant on this computer's clock: 1
/// to this.
pub const SHARP: i64 = 4;

/// Place of an image among the triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Image of a trigger.
    Of {
        /// Number of the trigger.
        number: u32,
        /// Capture time on the station's clock, µs.
        instant_us: u64,
        /// Number of reported triggers right before this one of which the camera has no image.
        missed: u32,
    },
    /// Image that fits this trigger, but the camera's count since its last image does not.
    Miscounted {
        /// Number of the trigger.
        number: u32,
        /// Number of reported triggers right before this one of which the camera has no image.
        missed: u32,
    },
    /// Second image of a trigger.
    Doubled {
        /// Number of the trigger.
        number: u32,
    },
    /// Image that fits no trigger, or more than one.
    Doubtful,
    /// Image that was taken before the first trigger, or while the delay is learnt, or that is the
    /// first of a count.
    Before,
    /// Image whose trigger's report did not come.
    Unreported,
}

/// Image to place.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    /// Time stamp on this computer's clock, µs.
    pub at_us: i64,
    /// Number of images that the camera has counted, with this one and those that were lost.
    pub seen: u64,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    number: u32,
    /// [`Shot::seen`]; `None` if images came since of which the trigger is unknown.
    seen: Option<u64>,
}

/// Count of one camera's images.
#[derive(Clone, Copy, Debug)]
pub struct Count {
    camera: usize,
    /// Start of the triggers to which the count belongs.
    start: u64,
    last: Option<Last>,
    /// Number of the newest trigger when an image last waited for a newer one, and none came.
    pub(super) waited_at: Option<u32>,
}

impl Count {
    /// Creates the count of the camera with this index.
    pub const fn of(camera: usize) -> Self {
        Self {
            camera,
            start: 0,
            last: None,
            waited_at: None,
        }
    }

    /// Returns the place of an image; `None` if a later report may change it, unless this `is_last`
    /// call.
    pub(super) fn place(
        &mut self,
        reports: &mut Reports,
        shot: Shot,
        is_last: bool,
    ) -> Option<Place> {
        let learner = reports.cameras.get_mut(self.camera)?;
        let Some(delay) = learner.delay else {
            learner.stamps_us.push(shot.at_us);
            return Some(Place::Before);
        };
        if self.start != reports.starts {
            self.start = reports.starts;
            self.last = None;
        }
        let period_us = reports.period_us;
        let delays = delay.wider(period_us / STEADY);
        let Some(newest) = reports.newest() else {
            return Some(Place::Before);
        };
        let until = newest.here.map(|here| here.until(shot.at_us));
        // The newest may have come late, and the next one may not.
        let next_us = period_us - reports.wait_us;
        if until.is_some_and(|until| until.to_us - next_us >= delays.from_us) {
            // The next trigger may be nearer, and is not reported yet.
            if is_last {
                self.doubt();
            }
            return is_last.then_some(Place::Unreported);
        }
        let fit = |own: &&Given| {
            let since = own.here.map(|here| here.until(shot.at_us));
            since.is_some_and(|since| since.common(delays).is_some())
        };
        let is_sharp = |own: &Given| {
            own.here
                .is_some_and(|here| here.width_us() * SHARP <= period_us)
        };
        let mut fitting = reports.given.iter().rev().filter(fit);
        let place = match (fitting.next(), fitting.next()) {
            (Some(own), None) if until.is_some() && is_sharp(own) => {
                self.placed(*own, shot, reports)
            }
            (None, _) if self.last.is_none() => Place::Before,
            _ => Place::Doubtful,
        };
        if place == Place::Doubtful {
            self.doubt();
        }
        Some(place)
    }

    /// Notes an image of which the trigger is unknown.
    fn doubt(&mut self) {
        if let Some(last) = &mut self.last {
            last.seen = None;
        }
    }

    /// Returns the place of an image that fits only this trigger.
    fn placed(&mut self, own: Given, shot: Shot, reports: &Reports) -> Place {
        let number = own.number;
        let next = Last {
            number,
            seen: Some(shot.seen),
        };
        let Some(last) = self.last else {
            self.last = Some(next);
            return Place::Before;
        };
        if number < last.number {
            return Place::Doubtful;
        }
        self.last = Some(next);
        if number == last.number {
            // Either may be late, and of an earlier trigger.
            self.doubt();
            return Place::Doubled { number };
        }
        if !own.is_reported {
            // Its instant is a guess.
            self.doubt();
            return Place::Unreported;
        }
        // Of triggers without a report it is unknown whether an image came.
        let between = reports.given.iter().rev();
        let between = between.filter(|one| (last.number + 1..number).contains(&one.number));
        let missed = between.take_while(|one| one.is_reported).count() as u32;
        let counted = last.seen.map(|seen| shot.seen.saturating_sub(seen));
        if counted != Some(u64::from(number - last.number)) {
            return Place::Miscounted { number, missed };
        }
        Place::Of {
            number,
            instant_us: own.instant_us.unsigned_abs(),
            missed,
        }
    }
}
