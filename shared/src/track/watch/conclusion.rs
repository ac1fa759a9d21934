//! Course and end of a trial: verdict, cause, and what follows from both.

use super::cause::{Cause, Question};
use super::evidence::Answer;
use super::trial::{ENOUGH, Suspicion, Trial, Verdict};
use super::{Advice, Bounds, Case, Sample, Watch, large};
use crate::safety::Fault;

impl Watch {
    /// Continues a trial.
    pub(super) fn try_on(
        &mut self,
        mut trial: Trial,
        frames: [&Sample; 2],
        bounds: &Bounds,
    ) -> Advice {
        if self.verdict.is_some() {
            return Advice::GoOn;
        }
        let (before, large) = (self.shaking.before, large(bounds));
        let verdict = trial.see(frames, &mut self.window, before, large);
        self.trial = Some(trial);
        let [_, sample] = frames;
        self.evidence.add(sample);
        let question = match verdict {
            Verdict::Wait => return Advice::GoOn,
            Verdict::Coupled { lost: true, .. } => Question::Lost,
            Verdict::Coupled { .. } => Question::Coupled,
            Verdict::Free | Verdict::Calm => Question::Free,
        };
        self.verdict = Some(verdict);
        self.evidence.ask(question);
        Advice::GoOn
    }

    /// Takes the answer about the cause: doubtful stamps are a suspicion, and the cause that a
    /// trial shows is more than its verdict.
    pub(super) fn hear(&mut self, answer: Answer) -> Advice {
        let Some(sample) = self.last else {
            return Advice::GoOn;
        };
        if let Some(trial) = self.trial {
            let Some(verdict) = self.verdict.take() else {
                return Advice::GoOn;
            };
            let verdict = answer.cause.map_or(verdict, |cause| Verdict::Coupled {
                points: ENOUGH,
                lost: cause == Cause::Steps,
            });
            return self.conclude(&trial, verdict, &sample);
        }
        let mut advice = Advice::GoOn;
        if answer.cause.is_some() {
            advice = self.stop_for(Suspicion::Shaking, sample.capture);
        }
        if advice == Advice::GoOn {
            self.evidence.turn();
        }
        advice
    }

    /// Ends a trial.
    fn conclude(&mut self, trial: &Trial, verdict: Verdict, sample: &Sample) -> Advice {
        let at = sample.capture;
        self.trial = None;
        self.begin_anew(sample);
        match (verdict, self.case) {
            (Verdict::Coupled { points, lost }, case) => {
                let points = case.map_or(0, |case| case.points).saturating_add(points);
                if points >= ENOUGH {
                    return Advice::Fail(match lost {
                        true => Fault::LostSteps,
                        false => Fault::Unstable,
                    });
                }
                let shook = trial.is_for_shaking();
                self.case = Some(Case {
                    points,
                    at,
                    shook,
                    lost,
                });
                self.free = 0;
                self.quiet_until = at;
            }
            (Verdict::Calm, Some(_)) => self.quiet_until = at.plus_micros(200_000),
            _ => {
                self.case = None;
                self.quiet_until = at.plus_micros(500_000 << self.free);
                self.free = (self.free + 1).min(4);
            }
        }
        Advice::GoOn
    }
}
