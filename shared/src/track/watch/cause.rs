//! Causes of unstable following that leave their mark on the apparent target.
//!
//! Each cause is a hypothesis about the loop with one or two unknowns. The stage's motion before a
//! trial, in its ramp and while it stands, as the hypothesis has it, explains a share of the
//! apparent target's. If it leaves next to nothing, the cause is found: a target that moves by
//! itself would have to imitate the stage with the hypothesis' few unknowns, and to stop with it.
//!
//! * *Mount*: `p = (1 - G M) s`. Hypotheses are a gain on one axis (a wrong sign or scale), a
//!   common gain, a rotation about an axis with any gain, two axes swapped, and a cycle. Each is a
//!   linear combination of one or two matrices, which are orthogonal on the stage's motion, and
//!   explains `Σ b²/m`, with the sums `b` of the products of the matrix with `cov(p, s)`, and `m`
//!   of those of its square with `cov(s, s)`.
//! * *Steps*: `p = s` on one axis, whatever the others do. Its steps do not move the cameras.
//! * *Stamps*: see [`late`](super::late).
//!
//! A healthy mount that is off by 20 % is found in the same way, so the target must also move as
//! much as a loop needs that feeds itself.

use super::super::filter::with_quantisation;
use super::shaking::FEEDS;
use super::window::{Covariances, Window};

/// Least number of frames, and longest mean time between them, ms. With fewer frames a target may
/// turn or rest while the stage does.
const FRAMES: f32 = 11.5;
const LONGEST_MS: f32 = 45.0;

/// Share of the apparent target's energy that a cause leaves at most: a mount, lost steps, and
/// wrong stamps if the trial found the loop coupled, and if it did not.
const MOUNT: f32 = 0.05;
const LOST: f32 = 0.03;
const STAMPS: f32 = 0.1;
const STAMPS_ALONE: f32 = 0.06;

/// Share of the stage's energy in the apparent target above which wrong stamps count. A mount that
/// is turned by 45 degrees makes 0.59 and is stable, and in circles it moves as late stamps do.
const LATE: f32 = 0.65;

/// Share of the stage's energy on an axis above which its steps can be found lost.
const OWN: f32 = 0.25;

/// Largest difference of the gain from 1 on an axis whose steps are lost.
const NONE_SEEN: f32 = 0.1;

/// Cause of unstable following.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cause {
    /// The time stamps are early or late.
    Stamps,
    /// The mount's sign, scale, rotation or order of axes is wrong.
    Mount,
    /// The steps of an axis have no effect.
    Steps,
}

/// Question about a window: what is known of the loop by other means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Question {
    /// The stage moves: is a trial for wrong stamps worth it?
    Moving,
    /// A whole trial did not find the loop coupled.
    Free,
    /// A whole trial found the loop coupled.
    Coupled,
    /// A whole trial found the steps of an axis lost.
    Lost,
}

/// Energies of the motion in a window, steps².
#[derive(Clone, Copy, Debug)]
pub(super) struct Energies {
    covariances: Covariances,
    /// Variances of a measurement.
    noise: [f32; 3],
    /// Energy of the stage.
    stage: f32,
    /// Energy of the apparent target, without noise.
    target: f32,
}

impl Energies {
    /// Returns `None` if there are too few frames, or if the target moves less than the noise.
    /// `variance` is that of a measurement, steps².
    pub fn new(window: &Window, variance: [f32; 3]) -> Option<Self> {
        let frames = window.frames();
        if frames < FRAMES || window.span_ms > LONGEST_MS * frames {
            return None;
        }
        let covariances = window.covariances()?;
        let noise = variance.map(with_quantisation);
        let [[x, ..], [_, y, _], [.., z]] = covariances.stage;
        let ([a, b, c], all) = (noise, covariances.all());
        let energies = Self {
            covariances,
            noise,
            stage: x + y + z,
            target: all - (a + b + c),
        };
        (energies.target > 3.0 * (a + b + c)).then_some(energies)
    }

    /// Returns true if the answer to a question depends on what the delays of the stamps leave.
    pub fn need_delays(&self, question: Question) -> bool {
        question != Question::Lost && self.target > LATE * self.stage
    }

    /// Returns the cause that the window shows. `late` is the energy of the target with the best
    /// delay of the stamps, with noise; infinite if it is not known.
    pub fn cause(&self, question: Question, late: f32) -> Option<Cause> {
        let [a, b, c] = self.noise;
        let late = late - (a + b + c);
        let most = match question {
            Question::Lost => return self.loses_steps().then_some(Cause::Steps),
            Question::Free => STAMPS_ALONE,
            Question::Moving | Question::Coupled => STAMPS,
        };
        if late < most * self.target {
            return Some(Cause::Stamps);
        }
        match question {
            Question::Coupled => self.mount(),
            _ => None,
        }
    }

    /// Returns the cause if a mount explains the target's motion.
    fn mount(&self) -> Option<Cause> {
        if self.target < FEEDS * self.stage {
            return None;
        }
        let [[xx, xy, zx], [_, yy, yz], [_, _, zz]] = self.covariances.stage;
        let [[px, pxy, pxz], [pyx, py, pyz], [pzx, pzy, pz]] = self.covariances.target;
        let (stage, own) = (xx + yy + zz, px + py + pz);
        let (forth, back) = (pxy + pyz + pzx, pxz + pyx + pzy);
        let cycle = 2.0 * (stage - xy - yz - zx);
        let hypotheses = [
            (px, 0.0, xx),
            (py, 0.0, yy),
            (pz, 0.0, zz),
            (own, 0.0, stage),
            (px + py, pxy - pyx, xx + yy),
            (py + pz, pyz - pzy, yy + zz),
            (pz + px, pzx - pxz, zz + xx),
            (px + py - pxy - pyx, 0.0, 2.0 * (xx + yy - xy - xy)),
            (py + pz - pyz - pzy, 0.0, 2.0 * (yy + zz - yz - yz)),
            (pz + px - pzx - pxz, 0.0, 2.0 * (zz + xx - zx - zx)),
            (own - forth, 0.0, cycle),
            (own - back, 0.0, cycle),
        ];
        let (mut most, mut cause) = (0.0, None);
        for (index, (first, second, square)) in hypotheses.into_iter().enumerate() {
            let explained = (first * first + second * second) / square;
            if square > 0.0 && explained > most {
                let steps = index < 3 && is_unseen(first, square);
                most = explained;
                cause = Some(if steps { Cause::Steps } else { Cause::Mount });
            }
        }
        cause.filter(|_| self.target - most < MOUNT * self.target)
    }

    /// Returns true if the steps of an axis are lost.
    fn loses_steps(&self) -> bool {
        let [[xx, ..], [_, yy, _], [.., zz]] = self.covariances.stage;
        let [[px, ..], [_, py, _], [.., pz]] = self.covariances.target;
        let axes = [(xx, px), (yy, py), (zz, pz)];
        let measured = self.covariances.own.into_iter().zip(self.noise);
        axes.into_iter()
            .zip(measured)
            .any(|((stage, both), (own, noise))| {
                let target = own - noise;
                let moves = stage > OWN * self.stage && stage > 9.0 + 9.0 * noise;
                moves && is_unseen(both, stage) && (target - both * both / stage) < LOST * target
            })
    }
}

/// Returns true if the target moves as the stage does: the cameras see nothing of its steps.
fn is_unseen(both: f32, stage: f32) -> bool {
    let off = both - stage;
    off < NONE_SEEN * stage && -off < NONE_SEEN * stage
}
