//! Actions that a page may ask for, and the part of a run that does them.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Longest jog of a page, µm.
pub const LONGEST_JOG_UM: i32 = 50_000;

/// Farthest position of a page, µm from zero.
pub const FARTHEST_UM: i32 = 2_000_000;

/// Longest text of a mark, characters.
pub const LONGEST_MARK: usize = 80;

/// Action that a page asks for.
///
/// ```
/// use trinocular_live::controls::Action;
///
/// let action: Action = serde_json::from_str(r#"{"jog": {"distance_um": [100, 0, 0]}}"#)?;
/// assert!(action.check().is_ok());
/// let far: Action = serde_json::from_str(r#"{"jog": {"distance_um": [900000, 0, 0]}}"#)?;
/// assert!(far.check().is_err());
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Action {
    /// Stops the stage at once; it stays stopped until a reset.
    Stop {},
    /// Clears a stop or a fault whose cause is gone.
    Reset {},
    /// Starts to follow the target (true), or ends it with the stage at rest (false).
    Follow {
        /// True starts.
        on: bool,
    },
    /// Moves the stage by a distance.
    Jog {
        /// Distance per axis, µm.
        distance_um: [i32; 3],
    },
    /// Moves the stage to a position, which must be known.
    Go {
        /// Position per axis, µm from zero.
        position_um: [i32; 3],
    },
    /// Makes the present position zero.
    Zero {},
    /// Finds the home switches.
    Home {},
    /// Switches the motors on.
    MotorsOn {},
    /// Starts or ends a recording.
    Record {
        /// True starts.
        on: bool,
    },
    /// Notes an event, in the page's list and in a recording.
    Mark {
        /// Text of the mark.
        text: String,
    },
}

impl Action {
    /// Checks the numbers and texts, which come from outside.
    ///
    /// # Errors
    /// The reason, in words.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Jog { distance_um } if !are_within(*distance_um, LONGEST_JOG_UM) => {
                let most_mm = LONGEST_JOG_UM / 1000;
                Err(format!("a jog is at most {most_mm} mm per axis"))
            }
            Self::Go { position_um } if !are_within(*position_um, FARTHEST_UM) => {
                let most_mm = FARTHEST_UM / 1000;
                Err(format!("a position is at most {most_mm} mm from zero"))
            }
            Self::Mark { text } if text.chars().count() > LONGEST_MARK => {
                Err(format!("a mark has at most {LONGEST_MARK} characters"))
            }
            _ => Ok(()),
        }
    }
}

fn are_within(values_um: [i32; 3], most_um: i32) -> bool {
    let most_um = most_um.unsigned_abs();
    values_um.iter().all(|um| um.unsigned_abs() <= most_um)
}

/// Actions that a run offers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Offers {
    /// Stop.
    pub stop: bool,
    /// Follow, jog, go, zero, motors on and reset: the run owns the station.
    pub motion: bool,
    /// Home: an axis has a home switch.
    pub home: bool,
    /// Record.
    pub record: bool,
    /// Mark.
    pub mark: bool,
}

/// Part of a run that does what its pages ask for.
pub trait Controls: Send + Sync {
    /// Returns the actions on offer.
    fn offers(&self) -> Offers;

    /// Stops the stage from the thread of the page, whatever the loop is busy with. The outcome goes
    /// to `reply` when the station has answered.
    fn stop(&self, reply: Reply);

    /// Takes in any other action, which has been [checked](Action::check), without waiting for it.
    /// The outcome goes to `reply` when the station has answered.
    fn request(&self, action: Action, reply: Reply);
}

/// Way back to the page that asked for an action. One that is dropped without an outcome answers
/// that the run has ended.
pub struct Reply(Option<Box<SendOutcome>>);

type SendOutcome = dyn FnOnce(Result<(), String>) + Send;

impl Reply {
    /// Makes a reply that calls `send` with the outcome.
    pub fn new(send: impl FnOnce(Result<(), String>) + Send + 'static) -> Self {
        Self(Some(Box::new(send)))
    }

    /// Sends the outcome: done, or the reason why not, in words.
    pub fn send(mut self, outcome: Result<(), String>) {
        if let Some(send) = self.0.take() {
            send(outcome);
        }
    }
}

impl Drop for Reply {
    fn drop(&mut self) {
        if let Some(send) = self.0.take() {
            send(Err("the run has ended".to_owned()));
        }
    }
}

impl fmt::Debug for Reply {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reply").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_read_strictly() {
        let read = |text: &str| serde_json::from_str::<Action>(text).ok();
        assert_eq!(read(r#"{"stop":{}}"#), Some(Action::Stop {}));
        let jog = read(r#"{"jog":{"distance_um":[100,0,-5]}}"#);
        let distance_um = [100, 0, -5];
        assert_eq!(jog, Some(Action::Jog { distance_um }));
        for bad in [
            r#"{"stop":{"now":1}}"#,
            r#"{"jog":{"distance_um":[1,2]}}"#,
            r#"{"jog":{"distance_um":[1e99,0,0]}}"#,
            r#"{"reboot":{}}"#,
        ] {
            assert_eq!(read(bad), None, "{bad}");
        }
    }

    #[test]
    fn dropped_reply_says_that_the_run_ended() {
        let (sender, outcomes) = std::sync::mpsc::channel();
        let reply = || {
            let sender = sender.clone();
            Reply::new(move |outcome| sender.send(outcome).expect("a test listens"))
        };
        reply().send(Ok(()));
        assert_eq!(outcomes.try_iter().collect::<Vec<_>>(), [Ok(())]);
        drop(reply());
        let ended = Err("the run has ended".to_owned());
        assert_eq!(outcomes.try_iter().collect::<Vec<_>>(), [ended]);
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let jog = |um| Action::Jog {
            distance_um: [0, um, 0],
        };
        assert!(jog(LONGEST_JOG_UM).check().is_ok());
        assert!(jog(-LONGEST_JOG_UM - 1).check().is_err());
        assert!(jog(i32::MIN).check().is_err());
        let go = |um| Action::Go {
            position_um: [um, 0, 0],
        };
        assert!(go(FARTHEST_UM).check().is_ok());
        assert!(go(i32::MIN).check().is_err());
        let text = "x".repeat(LONGEST_MARK + 1);
        assert!(Action::Mark { text }.check().is_err());
    }
}
