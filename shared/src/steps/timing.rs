use core::fmt;

/// Rate at which words go to the port, Hz.
///
/// *Invariant:* a multiple of 8 kHz between 32 kHz and 16 MHz, so that a quarter of a 1 ms tick is
/// a whole number of slots, from 4 to 2,000.
///
/// ```
/// use trinocular_core::steps::{WordRate, WordRateFault};
///
/// assert_eq!(WordRate::MHZ_1.slots_per_segment(), 125);
/// assert_eq!(WordRate::from_hz(100_001), Err(WordRateFault::Uneven { hz: 100_001 }));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WordRate(u32);

impl WordRate {
    /// Rate of 1 MHz: 125 slots per segment, up to 500,000 steps/s.
    pub const MHZ_1: Self = Self(1_000_000);

    /// Segments per second: four per control tick of 1 ms.
    pub const SEGMENTS_PER_S: u32 = Self::TICKS_PER_S * Self::SEGMENTS_PER_TICK as u32;

    /// Control ticks per second.
    pub const TICKS_PER_S: u32 = 1_000;

    /// Segments per control tick.
    pub const SEGMENTS_PER_TICK: usize = 4;

    /// Creates a rate of `hz` words per second.
    ///
    /// # Errors
    /// [`WordRateFault`] if `hz` is out of range or not a multiple of 8 kHz.
    pub const fn from_hz(hz: u32) -> Result<Self, WordRateFault> {
        if hz < 32_000 || hz > 16_000_000 {
            Err(WordRateFault::Range { hz })
        } else if !hz.is_multiple_of(2 * Self::SEGMENTS_PER_S) {
            Err(WordRateFault::Uneven { hz })
        } else {
            Ok(Self(hz))
        }
    }

    /// Returns the words per second.
    pub const fn hz(self) -> u32 {
        self.0
    }

    /// Returns the slots per second: the highest step rate of an axis, steps/s.
    pub const fn slots_per_s(self) -> u32 {
        self.0 / 2
    }

    /// Returns the slots in a segment of 250 µs: 4 to 2,000.
    pub const fn slots_per_segment(self) -> u16 {
        // At most 16 MHz / 8 kHz.
        (self.0 / (2 * Self::SEGMENTS_PER_S)) as u16
    }

    /// Returns the slots in a control tick of 1 ms: 16 to 8,000.
    pub const fn slots_per_tick(self) -> u32 {
        self.0 / (2 * Self::TICKS_PER_S)
    }
}

/// Reason to refuse a [`WordRate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordRateFault {
    /// The rate is outside 32 kHz..16 MHz.
    Range {
        /// Refused rate, Hz.
        hz: u32,
    },
    /// The rate is not a multiple of 8 kHz: a segment would not be a whole number of slots.
    Uneven {
        /// Refused rate, Hz.
        hz: u32,
    },
}

impl fmt::Display for WordRateFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Range { hz } => write!(f, "word rate {hz} Hz is outside 32000..16000000 Hz"),
            Self::Uneven { hz } => write!(f, "word rate {hz} Hz is not a multiple of 8000 Hz"),
        }
    }
}

impl core::error::Error for WordRateFault {}

/// Minimum times that a stepper driver needs at its STEP and DIR inputs, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DriverTiming {
    /// Minimum time for which STEP stays high.
    pub step_high_ns: u32,
    /// Minimum time for which STEP stays low.
    pub step_low_ns: u32,
    /// Minimum time for which DIR is stable before STEP rises.
    pub dir_setup_ns: u32,
    /// Minimum time for which DIR is stable after STEP rose.
    pub dir_hold_ns: u32,
}

impl DriverTiming {
    /// Allegro A4988 (datasheet A4988-DS, "STEP minimum high/low pulse width" tA, tB; "set-up/hold
    /// time" tC, tD).
    pub const A4988: Self = Self::from_ns(1_000, 1_000, 200, 200);
    /// Texas Instruments DRV8825 (datasheet SLVSA73, "Timing requirements": tWH(STEP), tWL(STEP),
    /// tSU(STEP), tH(STEP)).
    pub const DRV8825: Self = Self::from_ns(1_900, 1_900, 650, 650);
    /// Trinamic TMC2209 (datasheet, "STEP/DIR interface timing": tSH, tSL, tDSU, tDSH at 12 MHz
    /// internal clock).
    pub const TMC2209: Self = Self::from_ns(100, 100, 20, 20);

    const fn from_ns(
        step_high_ns: u32,
        step_low_ns: u32,
        dir_setup_ns: u32,
        dir_hold_ns: u32,
    ) -> Self {
        Self {
            step_high_ns,
            step_low_ns,
            dir_setup_ns,
            dir_hold_ns,
        }
    }

    /// Checks that words at this rate meet the driver's minimum times.
    ///
    /// The generator guarantees one word of STEP high, one word of STEP low, and DIR stable for two
    /// words before and two words after STEP rises. The hold time is checked against one word,
    /// which covers drivers that count it from the falling edge.
    ///
    /// # Errors
    /// [`TimingFault`] with the first requirement that is violated.
    pub const fn check(&self, rate: WordRate) -> Result<(), TimingFault> {
        let checks = [
            (Requirement::StepHigh, self.step_high_ns, 1),
            (Requirement::StepLow, self.step_low_ns, 1),
            (Requirement::DirSetup, self.dir_setup_ns, 2),
            (Requirement::DirHold, self.dir_hold_ns, 1),
        ];
        let mut i = 0;
        while i < checks.len() {
            let (requirement, needs_ns, words) = checks[i];
            // needs_ns <= words / rate, without the division.
            if needs_ns as u64 * rate.hz() as u64 > words * 1_000_000_000 {
                return Err(TimingFault {
                    requirement,
                    needs_ns,
                    gets_ns: (words * 1_000_000_000 / rate.hz() as u64) as u32,
                });
            }
            i += 1;
        }
        Ok(())
    }
}

/// One of the four minimum times of a [`DriverTiming`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Requirement {
    /// Width of the STEP pulse.
    StepHigh,
    /// Pause between STEP pulses.
    StepLow,
    /// Set-up time of DIR before STEP.
    DirSetup,
    /// Hold time of DIR after STEP.
    DirHold,
}

impl Requirement {
    /// Returns the name of the requirement in the configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::StepHigh => "step_high_ns",
            Self::StepLow => "step_low_ns",
            Self::DirSetup => "dir_setup_ns",
            Self::DirHold => "dir_hold_ns",
        }
    }
}

/// Error of a word rate that is too high for the driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimingFault {
    /// Requirement that is violated.
    pub requirement: Requirement,
    /// Minimum time of the driver, ns.
    pub needs_ns: u32,
    /// Time at this word rate, ns.
    pub gets_ns: u32,
}

impl fmt::Display for TimingFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            requirement,
            needs_ns,
            gets_ns,
        } = self;
        write!(
            f,
            "{}: the driver needs {needs_ns} ns, the word rate gives {gets_ns} ns",
            requirement.name()
        )
    }
}

impl core::error::Error for TimingFault {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn word_rate_makes_whole_slots() {
        assert_eq!(WordRate::from_hz(1_000_000), Ok(WordRate::MHZ_1));
        assert_eq!(WordRate::MHZ_1.slots_per_segment(), 125);
        assert_eq!(
            WordRate::from_hz(1_001_000),
            Err(WordRateFault::Uneven { hz: 1_001_000 })
        );
        for hz in [0, 24_000, 16_008_000, u32::MAX] {
            assert_eq!(WordRate::from_hz(hz), Err(WordRateFault::Range { hz }));
        }
    }

    #[test]
    fn drv8825_is_refused_at_1_mhz() {
        let fault = DriverTiming::DRV8825.check(WordRate::MHZ_1);
        let expected = TimingFault {
            requirement: Requirement::StepHigh,
            needs_ns: 1_900,
            gets_ns: 1_000,
        };
        assert_eq!(fault, Err(expected));
        assert_eq!(
            std::format!("{expected}"),
            "step_high_ns: the driver needs 1900 ns, the word rate gives 1000 ns"
        );
        assert_eq!(DriverTiming::A4988.check(WordRate::MHZ_1), Ok(()));
        assert_eq!(DriverTiming::TMC2209.check(WordRate::MHZ_1), Ok(()));
        let slower = WordRate::from_hz(520_000).unwrap();
        assert_eq!(DriverTiming::DRV8825.check(slower), Ok(()));
    }

    #[test]
    fn every_requirement_can_fail() {
        let easy = DriverTiming::from_ns(1, 1, 1, 1);
        let broken = [
            (
                DriverTiming {
                    step_high_ns: 1_001,
                    ..easy
                },
                Requirement::StepHigh,
            ),
            (
                DriverTiming {
                    step_low_ns: 1_001,
                    ..easy
                },
                Requirement::StepLow,
            ),
            (
                DriverTiming {
                    dir_setup_ns: 2_001,
                    ..easy
                },
                Requirement::DirSetup,
            ),
            (
                DriverTiming {
                    dir_hold_ns: u32::MAX,
                    ..easy
                },
                Requirement::DirHold,
            ),
        ];
        for (timing, requirement) in broken {
            assert_eq!(
                timing.check(WordRate::MHZ_1).map_err(|f| f.requirement),
                Err(requirement)
            );
        }
        assert_eq!(
            DriverTiming::from_ns(1_000, 1_000, 2_000, 1_000).check(WordRate::MHZ_1),
            Ok(())
        );
    }
}
