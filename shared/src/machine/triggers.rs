//! Triggers of cameras: where their pulses lie in the segments, and their reports.
//!
//! Trigger `n` is due `n` periods after the first, and its edge lies in the slot of that instant,
//! so that no rounding adds up. One that waits for a time without steps lies in its slot, or at the
//! start of a later segment if that is quiet, or at the end of its longest wait; its report has the
//! instant of its edge. The segment that is planned and the velocities at its end tell whether the
//! time is quiet: the motors' steps themselves up to the segment's end, and as long as the motion
//! does not change from there on.
//!
//! Triggers move nothing. So they need no permission: they go on while
//! the station is stopped or faulted, and without a host.

use super::{Machine, SEGMENT_US};
use crate::frame::message::{Denial, Trigger, Triggered};
use crate::steps::{AXES, CameraEdges, Position, Segment, WordRate};
use crate::time::Instant;
use heapless::Deque;

/// Time from the start to the first trigger, µs: the pin is at its level at rest by then.
const BEFORE_FIRST_US: u64 = 10_000;

// The step engine has counted a loss by then: it checks its streams once per segment.
const _: () = assert!(Triggered::REPORTED_AFTER_US == 2 * SEGMENT_US);

/// Largest number of triggers that are planned and not reported: those of 4 ms.
const PLANNED: usize = 8;

/// Microseconds per second.
const US_PER_S: u64 = 1_000_000;

/// State of the triggers.
#[derive(Clone, Debug, Default)]
pub(super) struct Triggers {
    /// Settings; `None` while there are no triggers.
    settings: Option<Trigger>,
    /// Instant of the first trigger.
    first: Instant,
    /// Number of triggers that were due before the next one.
    passed: u64,
    /// Instant at which the next trigger is due.
    next: Instant,
    /// Instant at which a trigger was due that waits for a time without steps.
    waiting: Option<Instant>,
    /// Instant at which the present pulse ends.
    end: Option<Instant>,
    /// True until a segment has given the pin its level at rest.
    unsettled: bool,
    edges: CameraEdges,
    /// Instants of the triggers that are planned and not reported.
    planned: Deque<Instant, PLANNED>,
    /// Number of triggers that the cameras got.
    given: u32,
    lost: u32,
    /// [`crate::safety::Inputs::trigger_losses`] at the last control tick.
    losses: u32,
}

impl Triggers {
    pub fn edges(&self) -> CameraEdges {
        self.edges
    }

    pub fn are_on(&self) -> bool {
        self.settings.is_some()
    }

    fn start(&mut self, trigger: &Trigger, first: Instant) {
        *self = Self {
            settings: (trigger.rate_hz > 0).then_some(*trigger),
            first,
            next: first,
            unsettled: true,
            edges: CameraEdges {
                active_low: trigger.active_low,
                ..CameraEdges::default()
            },
            losses: self.losses,
            ..Self::default()
        };
    }

    /// Returns true if the next segment has no edge, whenever it comes.
    fn are_idle(&self) -> bool {
        self.settings.is_none() && self.end.is_none() && !self.unsettled
    }

    /// Plans the edges of the segment whose first word comes at `from`. `is_quiet` returns true if a
    /// number of slots from a slot of the segment on have no step.
    fn plan(&mut self, from: Instant, words: WordRate, is_quiet: impl Fn(u16, u32) -> bool) {
        self.edges.from = from;
        if self.unsettled {
            self.unsettled = false;
            self.edges.end = Some(0);
        }
        let behind = from.plus_micros(SEGMENT_US);
        // A pulse that ended while the shell did not poll ends now.
        if let Some(end) = self.end.filter(|end| *end < behind) {
            self.edges.end = Some(slot(end.since(from), words));
            self.end = None;
        }
        let Some(trigger) = self.settings else { return };
        let longest_us = u64::from(trigger.longest_wait_us());
        self.skip_to(from, trigger);
        if self.waiting.is_none() && self.next < behind {
            self.waiting = Some(self.next);
            self.pass(self.passed.saturating_add(1), trigger);
        }
        let Some(due) = self.waiting else { return };
        let latest = due.plus_micros(longest_us);
        let mut begin = slot(due.since(from), words);
        if longest_us > 0 && !is_quiet(begin, quiet_slots(trigger, words)) {
            if latest >= behind {
                return;
            }
            begin = slot(latest.since(from), words);
        }
        self.waiting = None;
        let instant = from.plus_micros(middle_us(begin, words));
        self.edges.begin = Some(begin);
        let end = instant.plus_micros(trigger.pulse_us.into());
        if end < behind {
            self.edges.end = Some(slot(end.since(from), words));
        } else {
            self.end = Some(end);
        }
        if self.planned.push_back(instant).is_err() {
            self.lose(1);
        }
    }

    /// Counts the triggers due before `from` as lost: the shell did not poll then.
    fn skip_to(&mut self, from: Instant, trigger: Trigger) {
        let longest_us = u64::from(trigger.longest_wait_us());
        let is_too_late = |due: &Instant| due.plus_micros(longest_us) < from;
        if self.waiting.take_if(|due| is_too_late(due)).is_some() {
            self.lose(1);
        }
        if self.next >= from {
            return;
        }
        let rate = u64::from(trigger.rate_hz);
        let due = from.since(self.first).saturating_mul(rate);
        let passed = due.div_ceil(US_PER_S).max(self.passed);
        self.lose(u32::try_from(passed - self.passed).unwrap_or(u32::MAX));
        self.pass(passed, trigger);
    }

    fn pass(&mut self, passed: u64, trigger: Trigger) {
        self.passed = passed;
        let rate = u64::from(trigger.rate_hz.max(1));
        let after = passed.saturating_mul(US_PER_S) / rate;
        self.next = self.first.plus_micros(after);
    }

    fn lose(&mut self, triggers: u32) {
        self.lost = self.lost.saturating_add(triggers);
    }

    /// Takes the next trigger that the cameras have certainly got by `now`.
    fn next_given(&mut self, now: Instant) -> Option<Triggered> {
        let instant = *self.planned.front()?;
        if instant.plus_micros(Triggered::REPORTED_AFTER_US) > now {
            return None;
        }
        self.planned.pop_front();
        self.given = self.given.wrapping_add(1);
        Some(Triggered {
            number: self.given,
            instant,
            lost: self.lost,
        })
    }

    /// Counts the planned triggers as lost if the step engine lost any.
    fn check_losses(&mut self, losses: u32) {
        if losses != core::mem::replace(&mut self.losses, losses) {
            self.lose(self.planned.len() as u32);
            self.planned.clear();
        }
    }
}

/// Returns the slot of a segment in which an edge lies that is due `us` after its first word.
fn slot(us: u64, words: WordRate) -> u16 {
    // Below 250 µs: the product fits into 32 bits.
    let us = us.min(SEGMENT_US - 1) as u32;
    (us * (words.slots_per_s() / 1_000) / 1_000) as u16
}

/// Returns the number of slots without a step that a trigger waits for, with that of its edge.
fn quiet_slots(trigger: Trigger, words: WordRate) -> u32 {
    // At most 50 ms: below 2^37.
    let slots = u64::from(trigger.quiet_us) * u64::from(words.slots_per_s());
    u32::try_from(slots.div_ceil(US_PER_S) + 1).unwrap_or(u32::MAX)
}

/// Returns the time from the first word of a segment to the second word of a slot, µs.
fn middle_us(slot: u16, words: WordRate) -> u64 {
    let word = u32::from(slot) * 2 + 1;
    u64::from(word * 1_000 / (words.hz() / 1_000))
}

impl Machine {
    pub(super) fn start_triggers(&mut self, trigger: &Trigger) -> Result<(), Denial> {
        if self.board.camera_pin.is_none() {
            return Err(Denial::NoCameraPin);
        }
        trigger
            .check(self.board.word_rate)
            .map_err(Denial::Config)?;
        let delay_us = u64::from(self.board.delay_us) + BEFORE_FIRST_US;
        let first = self.now().plus_micros(delay_us);
        self.triggers.start(trigger, first);
        self.outbox.forget_triggers();
        Ok(())
    }

    /// Plans the camera pin's edges in the segment that is due at `due`, the last that was planned.
    pub(super) fn plan_triggers(&mut self, due: Instant, segment: &Segment) {
        self.triggers.edges.begin = None;
        self.triggers.edges.end = None;
        // Most segments have no edge, and cost little.
        if !self.triggers.are_idle() {
            let from = due.plus_micros(self.board.delay_us.into());
            let planner = self.planner.as_ref();
            let is_quiet = |slot: u16, slots: u32| {
                let Some(planner) = planner else { return true };
                let mut at: [Position; AXES] = planner.positions();
                for (at, distance) in at.iter_mut().zip(segment.displacement()) {
                    *at = at.saturating_add(distance.wrapping_neg());
                }
                segment.is_quiet(&at, slot, slots)
            };
            self.triggers.plan(from, self.board.word_rate, is_quiet);
        }
    }

    /// Reports the triggers that the cameras got, and counts those that they did not get.
    pub(super) fn report_triggers(&mut self) {
        // First: what the engine lost since the last tick is no longer on its way to the pins.
        self.triggers.check_losses(self.inputs.trigger_losses);
        let now = self.now();
        while let Some(triggered) = self.triggers.next_given(now) {
            if self.outbox.triggered(triggered).is_err() {
                self.drops.answers = self.drops.answers.saturating_add(1);
            }
        }
    }
}

#[cfg(test)]
mod tests;
