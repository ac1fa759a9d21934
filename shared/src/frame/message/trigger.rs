//! Triggers of cameras.

use super::{ConfigField, Setting};
use crate::motion::Bound;
use crate::steps::WordRate;
use crate::time::Instant;
use serde::{Deserialize, Serialize};

/// Settings of the camera pin. The station keeps none of it across a restart.
///
/// ```
/// use trinocular_core::frame::message::Trigger;
/// use trinocular_core::steps::WordRate;
///
/// let trigger = Trigger { rate_hz: 100, pulse_us: 2_000, ..Trigger::OFF };
/// assert!(trigger.check(WordRate::MHZ_1).is_ok());
/// let too_long = Trigger { pulse_us: 9_751, ..trigger };
/// let refused = too_long.check(WordRate::MHZ_1).unwrap_err();
/// assert_eq!(refused.to_string(), "trigger.pulse_us must be at most 9750");
/// assert!(Trigger::OFF.check(WordRate::MHZ_1).is_ok());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Trigger {
    /// Triggers per second, 1 to 1000; 0 for none, whatever the other fields are.
    pub rate_hz: u16,
    /// Length of a pulse, µs: from 10 to 250 less than the period, and less than that by the longest
    /// wait. An odd length is rounded up to
    /// whole slots, 2 µs with words at 1 MHz.
    pub pulse_us: u32,
    /// True if the pin is low during a pulse and high at rest.
    pub active_low: bool,
    /// Time without a step that a trigger waits for, µs, at most [`Trigger::LONGEST_QUIET_US`]: it
    /// comes later by up to a [sixteenth](Trigger::LATEST) of the period, until no motor will step
    /// for this time, and at the end of that wait in any case. Zero for triggers that do not wait.
    pub quiet_us: u32,
}

impl Trigger {
    /// No triggers.
    pub const OFF: Self = Self {
        rate_hz: 0,
        pulse_us: 0,
        active_low: false,
        quiet_us: 0,
    };

    /// Largest share of the period by which a trigger waits: 1 to this.
    pub const LATEST: u32 = 16;

    /// Longest time without a step, µs.
    pub const LONGEST_QUIET_US: u32 = 50_000;

    /// Highest rate of triggers that wait, triggers per second: the wait is a segment of motion,
    /// 250 µs, or longer.
    pub const HIGHEST_WAITING_HZ: u16 = 250;

    /// Highest rate, triggers per second.
    pub const HIGHEST_RATE_HZ: u16 = 1_000;

    /// Shortest pulse, µs.
    pub const SHORTEST_PULSE_US: u32 = 10;

    /// Shortest pause between two pulses, µs.
    pub const SHORTEST_PAUSE_US: u32 = 250;

    /// Returns the longest wait of a trigger, µs.
    pub const fn longest_wait_us(&self) -> u32 {
        match (self.quiet_us, self.rate_hz) {
            (0, _) | (_, 0) => 0,
            (_, rate_hz) => 1_000_000 / rate_hz as u32 / Self::LATEST,
        }
    }

    /// Checks the settings for a board with words at this rate.
    ///
    /// # Errors
    /// [`ConfigField`] with the first setting beyond its bound.
    pub fn check(&self, words: WordRate) -> Result<(), ConfigField> {
        if self.rate_hz == 0 {
            return Ok(());
        }
        let slot_us = 1_000_000_u32.div_ceil(words.slots_per_s());
        let shortest = Self::SHORTEST_PULSE_US.max(slot_us);
        let period_us = 1_000_000 / u32::from(self.rate_hz);
        let longest = period_us
            .saturating_sub(Self::SHORTEST_PAUSE_US)
            .saturating_sub(self.longest_wait_us());
        let highest = match self.quiet_us {
            0 => Self::HIGHEST_RATE_HZ,
            _ => Self::HIGHEST_WAITING_HZ,
        };
        let refused = |setting, bound| ConfigField::Value {
            setting,
            axis: None,
            bound,
        };
        if self.rate_hz > highest {
            let bound = Bound::AtMost(highest.into());
            Err(refused(Setting::TriggerRate, bound))
        } else if self.quiet_us > Self::LONGEST_QUIET_US {
            let bound = Bound::AtMost(Self::LONGEST_QUIET_US.into());
            Err(refused(Setting::TriggerQuiet, bound))
        } else if self.pulse_us < shortest {
            Err(refused(
                Setting::TriggerPulse,
                Bound::AtLeast(shortest.into()),
            ))
        } else if self.pulse_us > longest {
            Err(refused(
                Setting::TriggerPulse,
                Bound::AtMost(longest.into()),
            ))
        } else {
            Ok(())
        }
    }
}

/// Trigger that the cameras got. Sent 0.5 to 1.5 ms after its instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Triggered {
    /// Number of this trigger, from 1, since the command that started them. A gap means that
    /// reports found no room in the queue.
    pub number: u32,
    /// Instant at which the pulse began.
    pub instant: Instant,
    /// Number of triggers that were due and that the cameras did not get, or of which that is
    /// uncertain, since the same command. They have no number.
    pub lost: u32,
}

impl Triggered {
    /// Least time from a trigger to the dispatch of its report, µs.
    pub const REPORTED_AFTER_US: u64 = 500;
}
