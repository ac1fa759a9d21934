//! Pin that triggers cameras, in the words that also make the steps.

use super::{PortFault, PortMap};
use crate::time::Instant;

/// Edges of the camera pin within one segment, by slot.
///
/// An edge lies in the *second* word of its slot. That word lowers STEP pins and does nothing else,
/// so that no edge of STEP or DIR depends on the cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CameraEdges {
    /// Instant of the segment's first word.
    pub from: Instant,
    /// Slot in which a pulse begins.
    pub begin: Option<u16>,
    /// Slot in which the pin takes its level at rest.
    pub end: Option<u16>,
    /// True if the pin is low during a pulse and high at rest.
    pub active_low: bool,
}

/// Pin of the step port that triggers cameras.
///
/// ```
/// use trinocular_core::steps::{CameraEdges, CameraPin, PortMap};
///
/// let map = PortMap { step: [0, 1, 2], dir: [3, 4, 5], invert: [false; 3] };
/// let pin = CameraPin::new(8, &map)?;
/// let edges = CameraEdges { begin: Some(0), end: Some(2), ..CameraEdges::default() };
/// let mut words = [0; 6];
/// pin.mark(&edges, &mut words);
/// assert_eq!(words, [0, 1 << 8, 0, 0, 0, 1 << 24]);
/// # Ok::<(), trinocular_core::steps::PortFault>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct CameraPin {
    high: u32,
}

impl CameraPin {
    /// Creates the pin with this number, 0 to 15, beside the pins of `map`.
    ///
    /// # Errors
    /// [`PortFault`] if the port has no such pin, or it carries another signal.
    pub fn new(pin: u8, map: &PortMap) -> Result<Self, PortFault> {
        if pin > 15 {
            return Err(PortFault::NoSuchPin(pin));
        }
        if map.step.contains(&pin) || map.dir.contains(&pin) {
            return Err(PortFault::PinTwice(pin));
        }
        Ok(Self { high: 1 << pin })
    }

    /// Returns the bits of a port word that begin a pulse.
    pub const fn begin(self, active_low: bool) -> u32 {
        self.level(!active_low)
    }

    /// Returns the bits of a port word that give the pin its level at rest.
    pub const fn end(self, active_low: bool) -> u32 {
        self.level(active_low)
    }

    const fn level(self, high: bool) -> u32 {
        if high { self.high } else { self.high << 16 }
    }

    /// Adds the edges to the words of their segment. Ignores edges behind its end.
    pub fn mark(self, edges: &CameraEdges, words: &mut [u32]) {
        let (slots, _) = words.as_chunks_mut::<2>();
        for (slot, bits) in [
            (edges.end, self.end(edges.active_low)),
            (edges.begin, self.begin(edges.active_low)),
        ] {
            if let Some([_, second]) = slot.and_then(|slot| slots.get_mut(usize::from(slot))) {
                *second |= bits;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: PortMap = PortMap {
        step: [0, 2, 6],
        dir: [1, 3, 7],
        invert: [false; 3],
    };

    #[test]
    fn pin_of_another_signal_is_refused() {
        for pin in [0, 2, 6, 1, 3, 7] {
            let refused = CameraPin::new(pin, &MAP).map(|_| ());
            assert_eq!(refused, Err(PortFault::PinTwice(pin)));
        }
        let refused = CameraPin::new(16, &MAP).map(|_| ());
        assert_eq!(refused, Err(PortFault::NoSuchPin(16)));
    }

    #[test]
    fn active_low_pulse_is_low() {
        let pin = CameraPin::new(8, &MAP).unwrap();
        let edges = CameraEdges {
            begin: Some(1),
            end: Some(0),
            active_low: true,
            ..CameraEdges::default()
        };
        let mut words = [1 << 16; 4];
        pin.mark(&edges, &mut words);
        assert_eq!(
            words,
            [1 << 16, 1 << 16 | 1 << 8, 1 << 16, 1 << 16 | 1 << 24]
        );
    }
}
