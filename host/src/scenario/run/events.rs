//! Events of the scenario: their start, their end, and the ones that last at present.

use super::{Asked, RunningScenario};
use crate::scenario::file::{Event, Happening};
use trinocular_client::stage::HEARTBEAT_MS;
use trinocular_core::frame::message::Command;
use trinocular_core::safety::Inputs;

impl RunningScenario<'_> {
    pub(super) fn begin(&mut self, at_us: u64, index: usize) {
        let Some(Event { what, .. }) = self.scenario.events.get(index).copied() else {
            return;
        };
        match what {
            Happening::Drop { frames }
            | Happening::Late { frames, .. }
            | Happening::Outlier { frames, .. } => self.frames_left[index] = frames,
            Happening::Stop => self.send(Asked::Other("stop"), Command::Stop),
            Happening::Reset => self.send(Asked::Other("reset"), Command::Reset),
            Happening::Zero => self.send(Asked::Zero, Command::Zero),
            Happening::Silence { seconds } => {
                // Send the last ping at the instant of the event.
                self.twin.set_pings(true);
                self.twin.advance(self.twin.now());
                self.twin.set_pings(false);
                if seconds * 1e3 > f64::from(HEARTBEAT_MS) {
                    let at_s = at_us as f64 * 1e-6;
                    self.trace.silences_s.push([at_s, at_s + seconds]);
                }
                self.lasts[index] = true;
            }
            Happening::Occlusion { .. }
            | Happening::Limit { .. }
            | Happening::EmergencyStop { .. }
            | Happening::DriverFault { .. } => {
                self.lasts[index] = true;
                self.twin.set_switches(self.switches());
            }
        }
    }

    pub(super) fn end(&mut self, index: usize) {
        self.lasts[index] = false;
        let what = self.scenario.events.get(index).map(|event| event.what);
        if matches!(what, Some(Happening::Silence { .. })) {
            self.twin.set_pings(!self.is_silent());
        } else {
            self.twin.set_switches(self.switches());
        }
    }

    /// Returns the events that last at present.
    pub(super) fn lasting(&self) -> impl Iterator<Item = Happening> + '_ {
        let events = self.scenario.events.iter().zip(&self.lasts);
        events
            .filter(|(_, lasts)| **lasts)
            .map(|(event, _)| event.what)
    }

    pub(super) fn is_silent(&self) -> bool {
        self.lasting()
            .any(|what| matches!(what, Happening::Silence { .. }))
    }

    fn switches(&self) -> Inputs {
        let mut inputs = Inputs::default();
        for what in self.lasting() {
            match what {
                Happening::Limit { axis, end, .. } => inputs.limits[axis][end] = true,
                Happening::EmergencyStop { .. } => inputs.emergency_stop = true,
                Happening::DriverFault { .. } => inputs.driver_fault = true,
                _ => {}
            }
        }
        inputs
    }

    /// Returns the events that affect this frame set, and decrements their counts of frame sets.
    pub(super) fn take_frame_events(&mut self) -> Vec<Happening> {
        let events = self.scenario.events.iter().zip(&mut self.frames_left);
        events
            .filter(|(_, left)| **left > 0)
            .map(|(event, left)| {
                *left -= 1;
                event.what
            })
            .collect()
    }
}
