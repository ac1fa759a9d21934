//! The simulated stage: drivers and motors that port words move, as seen from the pins.
//!
//! The plant shares no arithmetic with the step generator. It models set/reset words and drivers
//! only: a rising STEP edge is one step, in the direction that the DIR pin shows at that moment.
//! Every time is counted in words, so edges always lie on word borders. The shortest times are kept
//! for comparison with a driver's data sheet.

use trinocular_core::steps::{AXES, DriverTiming, PortMap, Requirement, WordRate};

/// Shortest times on any axis, in words; `None` until the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shortest {
    /// STEP high.
    pub step_high: Option<u64>,
    /// STEP low between two pulses.
    pub step_low: Option<u64>,
    /// Time from a change of DIR to the next rise of STEP.
    pub dir_setup: Option<u64>,
    /// Time from a rise of STEP to the next change of DIR.
    pub dir_hold: Option<u64>,
}

/// A time at the pins that was shorter than the driver allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{}: the driver needs {needs_ns} ns, the pins showed {words} words = {shown_ns} ns",
    requirement.name()
)]
pub struct Violation {
    /// Name of the time.
    pub requirement: Requirement,
    /// Shortest time that the driver allows, ns.
    pub needs_ns: u32,
    /// Shortest time at the pins, words.
    pub words: u64,
    /// Shortest time at the pins, ns, rounded down.
    pub shown_ns: u64,
}

/// One driver and its motor.
#[derive(Clone, Copy, Debug)]
struct Driver {
    step_bit: u32,
    dir_bit: u32,
    /// DIR level that counts backwards.
    backward_level: bool,
    steps: i64,
    /// Word numbers of the last edges.
    rose: Option<u64>,
    fell: Option<u64>,
    turned: Option<u64>,
}

/// Counts the steps in a stream of port words and watches their timing.
///
/// ```
/// use trinocular_client::plant::Plant;
/// use trinocular_core::steps::PortMap;
///
/// let map = PortMap { step: [0, 1, 2], dir: [3, 4, 5], invert: [false; 3] };
/// let mut plant = Plant::new(map, [80.0; 3]);
/// // The lower half of a word sets pins, the upper half resets them. DIR up, then two pulses.
/// plant.feed(&[1 << 4, 1 << 1, 1 << 17, 1 << 1, 1 << 17]);
/// assert_eq!(plant.steps(), [0, 2, 0]);
/// assert_eq!(plant.position_mm()[1], 0.025);
/// ```
#[derive(Clone, Debug)]
pub struct Plant {
    drivers: [Driver; AXES],
    steps_per_mm: [f64; AXES],
    /// Level of all 16 pins.
    pins: u32,
    /// Pins that were ever driven without being in the map.
    stray: u32,
    /// Number of the next word.
    now: u64,
    shortest: Shortest,
}

impl Plant {
    /// Makes a plant with all pins low and all axes at zero. `steps_per_mm` must be positive for
    /// valid positions in mm.
    pub fn new(map: PortMap, steps_per_mm: [f64; AXES]) -> Self {
        let driver = |axis: usize| Driver {
            // Pins beyond 15 do not exist: such an axis never moves.
            step_bit: (1 << (map.step[axis] & 31)) & 0xffff,
            dir_bit: (1 << (map.dir[axis] & 31)) & 0xffff,
            backward_level: map.invert[axis],
            steps: 0,
            rose: None,
            fell: None,
            turned: None,
        };
        Self {
            drivers: [driver(0), driver(1), driver(2)],
            steps_per_mm,
            pins: 0,
            stray: 0,
            now: 0,
            shortest: Shortest::default(),
        }
    }

    /// Sets the counted steps of each axis, for a stage that keeps its place over a power cycle.
    pub fn put(&mut self, steps: [i64; AXES]) {
        for (driver, steps) in self.drivers.iter_mut().zip(steps) {
            driver.steps = steps;
        }
    }

    /// Lets the port write `words`, one per word period.
    pub fn feed(&mut self, words: &[u32]) {
        for &word in words {
            if word != 0 {
                self.write(word);
            }
            self.now += 1;
        }
    }

    /// Lets `words` word periods pass without a write.
    pub fn pause(&mut self, words: u64) {
        self.now += words;
    }

    /// Returns the steps of each axis, backward ones subtracted.
    pub fn steps(&self) -> [i64; AXES] {
        self.drivers.map(|driver| driver.steps)
    }

    /// Returns the position of the stage, mm.
    pub fn position_mm(&self) -> [f64; AXES] {
        std::array::from_fn(|axis| self.drivers[axis].steps as f64 / self.steps_per_mm[axis])
    }

    /// Returns the number of words that have passed.
    pub fn words(&self) -> u64 {
        self.now
    }

    /// Returns the shortest times so far.
    pub fn shortest(&self) -> Shortest {
        self.shortest
    }

    /// Returns the levels of the 16 pins, bit by bit.
    pub fn pins(&self) -> u16 {
        self.pins as u16
    }

    /// Returns the pins outside the map that some word drove; zero without a fault.
    pub fn stray_pins(&self) -> u16 {
        self.stray as u16
    }

    /// Returns all times so far that were too short for the driver, with words at this rate.
    pub fn violations(&self, timing: &DriverTiming, rate: WordRate) -> Vec<Violation> {
        let seen = [
            (
                Requirement::StepHigh,
                timing.step_high_ns,
                self.shortest.step_high,
            ),
            (
                Requirement::StepLow,
                timing.step_low_ns,
                self.shortest.step_low,
            ),
            (
                Requirement::DirSetup,
                timing.dir_setup_ns,
                self.shortest.dir_setup,
            ),
            (
                Requirement::DirHold,
                timing.dir_hold_ns,
                self.shortest.dir_hold,
            ),
        ];
        let too_short = |(requirement, needs_ns, words): (Requirement, u32, Option<u64>)| {
            let words = words?;
            let shown_ns = u128::from(words) * 1_000_000_000 / u128::from(rate.hz());
            (shown_ns < u128::from(needs_ns)).then_some(Violation {
                requirement,
                needs_ns,
                words,
                shown_ns: shown_ns as u64,
            })
        };
        seen.into_iter().filter_map(too_short).collect()
    }

    /// Writes to the set/reset register: the low half sets, the high half resets, set wins.
    fn write(&mut self, word: u32) {
        let before = self.pins;
        self.pins = (before & !(word >> 16)) | (word & 0xffff);
        let changed = before ^ self.pins;
        let now = self.now;
        let keep = |slot: &mut Option<u64>, since: Option<u64>| {
            if let Some(since) = since {
                let words = now - since;
                *slot = Some(slot.map_or(words, |least| least.min(words)));
            }
        };
        let mut mapped = 0;
        for driver in &mut self.drivers {
            mapped |= driver.step_bit | driver.dir_bit;
            if changed & (driver.step_bit | driver.dir_bit) == 0 {
                continue;
            }
            // DIR first: a change together with STEP's rise shows as a set-up of zero words.
            if changed & driver.dir_bit != 0 {
                keep(&mut self.shortest.dir_hold, driver.rose);
                driver.turned = Some(now);
            }
            if changed & driver.step_bit != 0 {
                if self.pins & driver.step_bit != 0 {
                    keep(&mut self.shortest.step_low, driver.fell);
                    keep(&mut self.shortest.dir_setup, driver.turned);
                    driver.rose = Some(now);
                    let level = self.pins & driver.dir_bit != 0;
                    driver.steps += if level == driver.backward_level {
                        -1
                    } else {
                        1
                    };
                } else {
                    keep(&mut self.shortest.step_high, driver.rose);
                    driver.fell = Some(now);
                }
            }
        }
        self.stray |= (word | word >> 16) & 0xffff & !mapped;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: PortMap = PortMap {
        step: [0, 1, 2],
        dir: [3, 4, 5],
        invert: [false, false, true],
    };

    fn plant() -> Plant {
        Plant::new(MAP, [100.0, 200.0, 400.0])
    }

    #[test]
    fn rising_edge_steps_in_dir_direction() {
        let mut plant = plant();
        plant.feed(&[1 << 3, 0, 1, 1 << 16, 0, 1, 0, 1 << 16]);
        assert_eq!(plant.steps(), [2, 0, 0]);
        // Setting a pin that is high already is no edge.
        plant.feed(&[1, 1, 1, 1 << 16]);
        assert_eq!(plant.steps(), [3, 0, 0]);
        // DIR low is backwards, on the inverted axis forwards.
        plant.feed(&[1 << 19, 0, 0b111, 0b111 << 16]);
        assert_eq!(plant.steps(), [2, -1, 1]);
        assert_eq!(plant.position_mm(), [0.02, -0.005, 0.0025]);
        assert_eq!((plant.words(), plant.pins()), (16, 0));
    }

    #[test]
    fn shortest_times_are_judged() {
        let mut plant = plant();
        plant.feed(&[1, 0, 1 << 16, 0, 0, 1, 0, 0, 1 << 16]);
        assert_eq!(plant.shortest().step_high, Some(2));
        assert_eq!(plant.shortest().step_low, Some(3));
        assert_eq!(plant.shortest().dir_setup, None);
        plant.feed(&[1 << 3, 1, 1 << 16]);
        let expected = Shortest {
            step_high: Some(1),
            step_low: Some(2),
            dir_setup: Some(1),
            dir_hold: Some(4),
        };
        assert_eq!(plant.shortest(), expected);
        let violations = plant.violations(&DriverTiming::DRV8825, WordRate::MHZ_1);
        assert_eq!(violations.len(), 1);
        assert_eq!(
            violations[0].to_string(),
            "step_high_ns: the driver needs 1900 ns, the pins showed 1 words = 1000 ns"
        );
        assert_eq!(plant.violations(&DriverTiming::A4988, WordRate::MHZ_1), []);
        // DIR together with STEP.
        plant.feed(&[1 << 19 | 1]);
        assert_eq!(plant.shortest().dir_setup, Some(0));
        assert!(
            !plant
                .violations(&DriverTiming::TMC2209, WordRate::MHZ_1)
                .is_empty()
        );
    }

    #[test]
    fn stray_pins_are_noticed() {
        let mut plant = plant();
        plant.feed(&[0b11_1111, 0b11_1111 << 16]);
        assert_eq!(plant.stray_pins(), 0);
        plant.feed(&[1 << 27]);
        assert_eq!(plant.stray_pins(), 1 << 11);
    }
}

#[cfg(test)]
mod agreement;
