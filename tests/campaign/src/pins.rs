//! Reads port words as a logic analyser does: levels, edges, pulse widths.

use trinocular_core::steps::{DriverTiming, PortMap};

/// Wiring of the six signals in every life.
pub const WIRING: PortMap = PortMap {
    step: [2, 7, 11],
    dir: [0, 12, 5],
    invert: [false; 3],
};

/// A step: the rising edge of a STEP pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Index of its word within the words fed.
    pub word: usize,
    /// Axis, from 0.
    pub axis: usize,
    /// Level of the axis's DIR pin.
    pub high: bool,
}

/// A time that was shorter than the motor driver requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Short {
    /// Name of the time.
    pub what: &'static str,
    /// Axis, from 0.
    pub axis: usize,
    /// Duration in words.
    pub words: u64,
}

/// Times of the last edges of one axis, words since the start.
#[derive(Clone, Copy, Debug, Default)]
struct Past {
    rise: Option<u64>,
    fall: Option<u64>,
    turn: Option<u64>,
}

/// State of the port's pins.
#[derive(Clone, Debug)]
pub struct Pins {
    hz: u64,
    level: u32,
    words: u64,
    past: [Past; 3],
    /// Rising STEP edges.
    pub rises: u64,
    /// DIR edges.
    pub turns: u64,
}

impl Pins {
    /// Returns pins that are all low, for `hz` words per second.
    pub fn new(hz: u32) -> Self {
        Self {
            hz: hz.into(),
            level: 0,
            words: 0,
            past: [Past::default(); 3],
            rises: 0,
            turns: 0,
        }
    }

    /// Feeds `words` to the port. Steps go to `edges`, times too short for `driver` to `short`.
    pub fn feed(
        &mut self,
        words: &[u32],
        driver: &DriverTiming,
        edges: &mut Vec<Edge>,
        short: &mut Vec<Short>,
    ) {
        let begin = self.words;
        self.words += words.len() as u64;
        for (index, &word) in words.iter().enumerate().filter(|(_, word)| **word != 0) {
            // Set wins over reset, as in the hardware.
            let after = (self.level & !(word >> 16)) | (word & 0xffff);
            let changed = after ^ self.level;
            self.level = after;
            if changed == 0 {
                continue;
            }
            let now = begin + index as u64;
            for axis in 0..3 {
                let (step, dir) = (1 << WIRING.step[axis], 1 << WIRING.dir[axis]);
                let hz = self.hz;
                let mut need = |what, since: Option<u64>, ns: u32| {
                    if let Some(words) = since.map(|since| now - since)
                        && words * 1_000_000_000 < u64::from(ns) * hz
                    {
                        short.push(Short { what, axis, words });
                    }
                };
                let past = &mut self.past[axis];
                if changed & dir != 0 {
                    need("DIR hold", past.rise, driver.dir_hold_ns);
                    past.turn = Some(now);
                    self.turns += 1;
                }
                if changed & step == 0 {
                    continue;
                }
                if after & step != 0 {
                    need("STEP low", past.fall, driver.step_low_ns);
                    need("DIR set-up", past.turn, driver.dir_setup_ns);
                    past.rise = Some(now);
                    self.rises += 1;
                    edges.push(Edge {
                        word: index,
                        axis,
                        high: after & dir != 0,
                    });
                } else {
                    need("STEP high", past.rise, driver.step_high_ns);
                    past.fall = Some(now);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fed(words: &[u32], driver: DriverTiming) -> (Vec<Edge>, Vec<&'static str>) {
        let (mut edges, mut short) = (Vec::new(), Vec::new());
        Pins::new(1_000_000).feed(words, &driver, &mut edges, &mut short);
        (edges, short.iter().map(|short| short.what).collect())
    }

    #[test]
    fn rising_step_counts_with_direction() {
        let [step, dir] = [1 << 2, 1 << 0];
        let words = [dir, 0, step, step << 16, dir << 16, 0, step, step << 16];
        let (edges, short) = fed(&words, DriverTiming::A4988);
        let seen: Vec<_> = edges.iter().map(|edge| (edge.word, edge.high)).collect();
        assert_eq!(seen, [(2, true), (6, false)]);
        assert!(short.is_empty());
    }

    #[test]
    fn every_short_time_is_named() {
        let [step, dir] = [1 << 2, 1 << 0];
        let slow = DriverTiming {
            step_high_ns: 1_900,
            step_low_ns: 1_900,
            dir_setup_ns: 1_900,
            dir_hold_ns: 2_900,
        };
        let words = [dir, step, step << 16, dir << 16 | step];
        let (_, short) = fed(&words, slow);
        let expected = [
            "DIR set-up",
            "STEP high",
            "DIR hold",
            "STEP low",
            "DIR set-up",
        ];
        assert_eq!(short, expected);
    }
}
