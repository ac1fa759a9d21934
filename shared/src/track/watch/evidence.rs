//! A window that goes on through a trial, and shows the [`cause`](super::cause) in the end.
//!
//! Its sums cost more than a frame's tick has to spare on the board, and the next frame that the
//! watch uses comes twelve ticks later at the earliest. So each tick does one [`Step`] of the work;
//! the answer to a question comes seven ticks after the frame. A frame that comes before the work
//! on the last one is done, in a burst, is left out.

use super::super::history::History;
use super::Sample;
use super::cause::{Cause, Energies, Question};
use super::late::{Late, Sign};
use super::window::{UNIT_MS, Window};

/// Work of a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Step {
    /// Nothing to do.
    #[default]
    Rest,
    /// Takes the frame into the window.
    Window,
    /// Takes the frame in for the delays of one sign.
    Delays(Sign),
    /// Computes the energies.
    Energies,
    /// Looks for the delay that explains most.
    Least(Sign),
    /// Looks for the cause.
    Cause,
}

/// Answer to a question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Answer {
    /// The cause that the window shows, if any.
    pub cause: Option<Cause>,
}

/// A window that goes on through a trial, and the work on it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Evidence {
    window: Window,
    late: Late,
    /// Number of shorter windows that it covers.
    covers: u8,
    step: Step,
    /// Frame at work.
    frame: Option<Sample>,
    question: Option<Question>,
    energies: Option<Energies>,
    /// Energy with the best delay so far, steps².
    least: f32,
}

impl Evidence {
    /// Creates a window that begins with `sample`.
    pub fn starting(sample: &Sample) -> Self {
        let mut evidence = Self::default();
        evidence.add(sample);
        evidence
    }

    /// Takes in a frame, unless the one before is still at work.
    pub fn add(&mut self, sample: &Sample) {
        if self.step == Step::Rest {
            self.frame = Some(*sample);
            self.step = Step::Window;
        }
    }

    /// Asks for the cause after the frame at work. Drops an earlier question.
    pub fn ask(&mut self, question: Question) {
        self.question = Some(question);
        if !matches!(self.step, Step::Window | Step::Delays(_)) {
            self.step = Step::Energies;
        }
    }

    /// Begins anew after every second of the shorter windows.
    pub fn turn(&mut self) {
        self.covers += 1;
        if self.covers > 1 {
            *self = Self::default();
        }
    }

    /// Does the work of a tick. Returns the answer to the question once, when it is there.
    pub fn work(&mut self, history: &History) -> Option<Answer> {
        let frame = self.frame.as_ref()?;
        self.step = match self.step {
            Step::Rest => return None,
            Step::Window => {
                self.window.add(frame);
                Step::Delays(Sign::Early)
            }
            Step::Delays(sign) => {
                let t = self.window.span_ms * (1.0 / UNIT_MS);
                self.late.add(sign, t, frame, history);
                match (sign, self.question) {
                    (Sign::Early, _) => Step::Delays(Sign::Late),
                    (Sign::Late, None) => Step::Rest,
                    (Sign::Late, Some(_)) => Step::Energies,
                }
            }
            Step::Energies => {
                self.least = f32::INFINITY;
                self.energies = Energies::new(&self.window, frame.variance);
                match (&self.energies, self.question) {
                    (Some(energies), Some(question)) if energies.need_delays(question) => {
                        Step::Least(Sign::Early)
                    }
                    _ => Step::Cause,
                }
            }
            Step::Least(sign) => {
                if let Some(basis) = self.window.basis() {
                    let least = self.late.least(sign, &basis);
                    if least < self.least {
                        self.least = least;
                    }
                }
                match sign {
                    Sign::Early => Step::Least(Sign::Late),
                    Sign::Late => Step::Cause,
                }
            }
            Step::Cause => {
                self.step = Step::Rest;
                let question = self.question.take()?;
                let energies = self.energies.as_ref();
                let cause = energies.and_then(|energies| energies.cause(question, self.least));
                return Some(Answer { cause });
            }
        };
        None
    }
}

#[cfg(test)]
mod tests;
