use crate::steps::{AXES, PortMap};

/// Edges in one run of words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// Rising edges of each STEP pin.
    pub rises: [u16; AXES],
    /// Edges of each DIR pin, either way.
    pub turns: [u16; AXES],
}

/// Probe of the port's pins, like a logic analyser: it interprets set/reset words and knows nothing
/// of motion.
#[derive(Clone, Debug)]
pub struct Probe {
    step: [u32; AXES],
    dir: [u32; AXES],
    /// Levels of the 16 pins.
    pins: u32,
    /// Steps so far: a rise of STEP with DIR high counts up, with DIR low down.
    steps: [i32; AXES],
}

impl Probe {
    /// Creates a probe of a port whose pins are all low.
    pub fn new(map: PortMap) -> Self {
        let bit = |pin: u8| 1u32 << (pin & 15);
        Self {
            step: map.step.map(bit),
            dir: map.dir.map(bit),
            pins: 0,
            steps: [0; AXES],
        }
    }

    /// Lets the port write `words`, and calls `edge(index, pins before, pins after)` for each word
    /// that changes a pin.
    pub fn feed(&mut self, words: &[u32], mut edge: impl FnMut(usize, u32, u32)) -> Edges {
        let mut edges = Edges::default();
        for (index, &word) in words.iter().enumerate() {
            // A set bit wins over a reset bit, as in the hardware.
            let after = (self.pins & !(word >> 16)) | (word & 0xffff);
            let changed = after ^ self.pins;
            if changed == 0 {
                continue;
            }
            edge(index, self.pins, after);
            self.pins = after;
            let pins = self.step.iter().zip(&self.dir);
            let counts = edges.rises.iter_mut().zip(&mut edges.turns);
            for (((step, dir), (rises, turns)), steps) in pins.zip(counts).zip(&mut self.steps) {
                *turns = turns.saturating_add(u16::from(changed & dir != 0));
                if changed & after & step != 0 {
                    *rises = rises.saturating_add(1);
                    let direction = if after & dir != 0 { 1 } else { -1 };
                    *steps = steps.wrapping_add(direction);
                }
            }
        }
        edges
    }

    /// Returns the steps so far, with DIR high as forwards.
    pub fn steps(&self) -> [i32; AXES] {
        self.steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const MAP: PortMap = PortMap {
        step: [0, 1, 2],
        dir: [3, 4, 5],
        invert: [false; 3],
    };

    #[test]
    fn steps_follow_the_direction_pin() {
        let mut probe = Probe::new(MAP);
        let mut seen = Vec::new();
        // X forwards; X again with Y, Y backwards; DIR of X falls together with a rise, which
        // counts backwards.
        let words = [
            1 << 3,
            1,
            1 << 16,
            0b11,
            0b11 << 16,
            1 << 19 | 1,
            // Set and reset at once: set.
            1 << 16 | 1,
        ];
        let edges = probe.feed(&words, |index, _, after| seen.push((index, after)));
        assert_eq!(edges.rises, [3, 1, 0]);
        assert_eq!(edges.turns, [2, 0, 0]);
        assert_eq!(probe.steps(), [1, -1, 0]);
        assert_eq!(seen.len(), 6);
        assert_eq!(seen.last(), Some(&(5, 1)));
    }
}
