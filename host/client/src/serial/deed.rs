//! Deeds of guests: commands of other programs that the station has carried out, for those who look
//! at this program.

use std::collections::VecDeque;
use std::fmt::{self, Display, Formatter};
use trinocular_core::frame::message::Command;

/// Largest number of deeds that wait; the oldest are forgotten.
const MOST: usize = 64;

/// Deed of a guest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deed {
    /// Deed in words, such as `jog by 1 0 -0.5 mm`.
    pub what: String,
    /// Program that did it, with its process number.
    pub by: String,
}

impl Display for Deed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}, by {}", self.what, self.by)
    }
}

/// Deeds that have not been taken yet.
#[derive(Debug, Default)]
pub(super) struct Deeds {
    waiting: VecDeque<Deed>,
    /// Latest deed, so that a stream of frames or positions is one.
    last: Option<Deed>,
}

impl Deeds {
    /// Adds a deed. Frames, positions and stops that follow each other are one.
    pub fn add(&mut self, what: String, by: &str) {
        let deed = Deed {
            what,
            by: by.to_owned(),
        };
        let is_stream = [FRAMES, POSITIONS, STOP].contains(&deed.what.as_str());
        if is_stream && self.last.as_ref() == Some(&deed) {
            return;
        }
        self.last = Some(deed.clone());
        if self.waiting.len() == MOST {
            self.waiting.pop_front();
        }
        self.waiting.push_back(deed);
    }

    /// Takes all deeds, the oldest first.
    pub fn take(&mut self) -> Vec<Deed> {
        self.waiting.drain(..).collect()
    }
}

const FRAMES: &str = "flow frames";
const POSITIONS: &str = "positions to go to";

/// Deed of a guest that stops its own motion.
pub(super) const STOP: &str = "stop";

/// Returns a command to the station in words; `None` for one that changes nothing.
///
/// ```
/// use trinocular_client::serial::in_words;
/// use trinocular_core::frame::message::Command;
///
/// let jog = Command::Jog { distance_um: [1_500, 0, -20] };
/// assert_eq!(in_words(&jog).as_deref(), Some("jog by 1.5 0 -0.02 mm"));
/// assert_eq!(in_words(&Command::Hello), None);
/// ```
pub fn in_words(command: &Command) -> Option<String> {
    let words = match command {
        Command::Hello | Command::Ping { .. } => return None,
        Command::Config(_) => "configuration of the stage".to_owned(),
        Command::Frame(_) => FRAMES.to_owned(),
        Command::Setpoint { .. } => POSITIONS.to_owned(),
        Command::Jog { distance_um } => {
            let [x, y, z] = distance_um.map(|um| f64::from(um) * 1e-3);
            format!("jog by {x} {y} {z} mm")
        }
        Command::Zero => "zero: the position became 0 0 0 mm".to_owned(),
        Command::Stop => STOP.to_owned(),
        Command::Reset => "reset".to_owned(),
        Command::Home { axes } => {
            let named = ["x", "y", "z"].into_iter().zip(axes);
            let names: Vec<&str> = named.filter(|(_, is)| **is).map(|(name, _)| name).collect();
            format!("home {}", names.join(" "))
        }
        Command::Motors { on: true } => "motors on".to_owned(),
        Command::Motors { on: false } => "motors off".to_owned(),
        Command::Trigger(trigger) => match trigger.rate_hz {
            0 => "triggers of the cameras off".to_owned(),
            rate_hz => format!("triggers of the cameras at {rate_hz} Hz"),
        },
    };
    Some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stream_of_positions_is_one_deed() {
        let mut deeds = Deeds::default();
        for what in [POSITIONS, POSITIONS, "zero", "zero", POSITIONS] {
            deeds.add(what.to_owned(), "`a` (process 1)");
        }
        deeds.add(POSITIONS.to_owned(), "`b` (process 2)");
        let texts: Vec<String> = deeds.take().iter().map(Deed::to_string).collect();
        let by_a = |what: &str| format!("{what}, by `a` (process 1)");
        let by_b = format!("{POSITIONS}, by `b` (process 2)");
        let expected = [
            by_a(POSITIONS),
            by_a("zero"),
            by_a("zero"),
            by_a(POSITIONS),
            by_b,
        ];
        assert_eq!(texts, expected);
        assert!(deeds.take().is_empty());
    }

    #[test]
    fn oldest_deeds_are_forgotten() {
        let mut deeds = Deeds::default();
        for number in 0..=MOST {
            deeds.add(number.to_string(), "a");
        }
        let deeds = deeds.take();
        assert_eq!((deeds.len(), deeds[0].what.as_str()), (MOST, "1"));
    }
}
