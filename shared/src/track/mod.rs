//! Tracking: converts displacements to positions of the target in stage coordinates, whatever the
//! stage did meanwhile.
//!
//! The cameras ride on the stage, so a frame gives the position of the target *relative to the
//! stage at the capture*, against the view at the reference instant. With
//! `e(t) = target(t) - stage(t)` in stage axes,
//!
//! ```text
//! e(capture) = e(reference) + displacement        target(capture) = stage(capture) + e(capture)
//! ```
//!
//! `stage(capture)` comes from the [`history`] of emitted positions, so neither latency nor the
//! stage's own motion enters. The first reference that a station receives defines the view to be
//! kept: `e = 0` there. After that, a frame may refer to the same reference again (a keyframe: no
//! drift) or to the capture of a recent frame that was used, whose `e` is known (previous-frame
//! reference, or a new keyframe: the accumulated target is preserved). Any other reference is
//! refused, so that a lost frame can never shift the target unnoticed.
//!
//! The result is the position of the target at the capture, with noise. [`pursuit`] computes from
//! it the present goal of the stage; each of its axes is a Kalman [`filter`], and an [`oscillator`]
//! for targets that accelerate.

pub mod filter;
pub mod history;
pub mod oscillator;
pub mod pursuit;
pub mod watch;

use crate::frame::message::Denial;
use crate::time::Instant;

/// Distances on the three stage axes, 2⁻³² steps. A position is its distance from the zero of
/// the stage, as [`Position::distance_from_zero`](crate::steps::Position::distance_from_zero)
/// returns it.
pub type StepVector = [i64; 3];

/// Number of used frames that stay available as references.
const RECENT: usize = 8;

/// Position of the target relative to the stage at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sighting {
    instant: Instant,
    /// Target minus stage, relative to the first reference.
    error: StepVector,
}

/// References of later frames, pursuit and watch.
#[derive(Clone, Debug, Default)]
pub struct Tracker {
    reference: Option<Sighting>,
    recent: heapless::Deque<Sighting, RECENT>,
    /// Filters of the target and goal of the stage.
    pub pursuit: pursuit::Pursuit,
    /// Detection of a stage that does not follow its steps.
    pub watch: watch::Watch,
}

impl Tracker {
    /// Clears all state; the next reference defines the view to be kept.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Returns the view that a frame refers to, if the tracker can take the frame.
    ///
    /// # Errors
    /// [`Denial::UnknownReference`] or [`Denial::CaptureOutOfOrder`].
    pub fn reference(&self, reference: Instant, capture: Instant) -> Result<Sighting, Denial> {
        let newest = self.recent.back().map(|view| view.instant);
        if capture <= reference || newest.is_some_and(|newest| capture <= newest) {
            return Err(Denial::CaptureOutOfOrder);
        }
        let known = self.reference.iter().chain(self.recent.iter());
        let found = known.into_iter().find(|view| view.instant == reference);
        // By components: copied as a whole it is a memmove, which nothing else in the station's
        // image needs.
        let [x, y, z] = match found {
            Some(view) => view.error,
            None if self.reference.is_none() => [0; 3],
            None => return Err(Denial::UnknownReference),
        };
        Ok(Sighting {
            instant: reference,
            error: [x, y, z],
        })
    }

    /// Records a view that is going to be used, and the view it refers to.
    pub fn keep(&mut self, reference: Sighting, view: Sighting) {
        if self.recent.is_full() {
            self.recent.pop_front();
        }
        // There is room, because the oldest was dropped above.
        let _ = self.recent.push_back(view);
        self.reference = Some(reference);
    }
}

impl Sighting {
    /// Returns the view at a later instant, after the target was displaced.
    pub fn moved(&self, instant: Instant, displacement: StepVector) -> Self {
        Self {
            instant,
            error: add(self.error, displacement),
        }
    }

    /// Returns the position of the target, if the stage was at `stage` at this view's instant. With
    /// cameras beside the stage, any constant serves.
    pub fn target(&self, stage: StepVector) -> StepVector {
        add(stage, self.error)
    }
}

/// Returns the sum on each axis, saturating.
pub fn add(a: StepVector, b: StepVector) -> StepVector {
    let [[ax, ay, az], [bx, by, bz]] = [a, b];
    [
        ax.saturating_add(bx),
        ay.saturating_add(by),
        az.saturating_add(bz),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_micros(ms * 1000)
    }

    impl Tracker {
        /// Takes one displacement as the machine does, and returns the target's position.
        fn update(
            &mut self,
            reference: Instant,
            capture: Instant,
            displacement: StepVector,
            stage: StepVector,
        ) -> Result<StepVector, Denial> {
            let from = self.reference(reference, capture)?;
            let view = from.moved(capture, displacement);
            self.keep(from, view);
            Ok(view.target(stage))
        }
    }

    /// Target and stage move independently; each reference mode must find the target.
    #[test]
    fn reference_modes_agree() {
        let target = |t: i64| [1000 * t, -300 * t, 7 * t * t];
        let stage = |t: i64| [900 * t - 4, 20 * t, -t];
        let error = |t: i64| {
            core::array::from_fn(|i| target(t)[i] - stage(t)[i] - target(0)[i] + stage(0)[i])
        };
        let displacement = |from: i64, to: i64| -> StepVector {
            let (a, b): (StepVector, StepVector) = (error(from), error(to));
            core::array::from_fn(|i| b[i] - a[i])
        };
        let expected = |t: i64| add(stage(t), error(t));
        for mode in 0..3 {
            let mut tracker = Tracker::default();
            let mut keyframe = 0;
            for t in 1..50i64 {
                let reference = match mode {
                    0 => 0,
                    1 => t - 1,
                    _ => {
                        if t % 5 == 0 {
                            keyframe = t - 1;
                        }
                        keyframe
                    }
                };
                let got = tracker.update(
                    at(reference as u64),
                    at(t as u64),
                    displacement(reference, t),
                    stage(t),
                );
                assert_eq!(got, Ok(expected(t)));
            }
        }
    }

    #[test]
    fn bad_instants_change_nothing() {
        let mut tracker = Tracker::default();
        assert!(tracker.update(at(0), at(1), [5; 3], [0; 3]).is_ok());
        assert_eq!(
            tracker.update(at(7), at(8), [9; 3], [0; 3]),
            Err(Denial::UnknownReference)
        );
        assert_eq!(
            tracker.update(at(0), at(1), [9; 3], [0; 3]),
            Err(Denial::CaptureOutOfOrder)
        );
        assert_eq!(
            tracker.update(at(3), at(3), [9; 3], [0; 3]),
            Err(Denial::CaptureOutOfOrder)
        );
        assert_eq!(tracker.update(at(1), at(9), [1; 3], [0; 3]), Ok([6; 3]));
        tracker.reset();
        assert_eq!(tracker.update(at(9), at(10), [1; 3], [2; 3]), Ok([3; 3]));
    }

    #[test]
    fn huge_displacements_saturate() {
        let mut tracker = Tracker::default();
        let far = tracker.update(at(0), at(1), [i64::MAX; 3], [i64::MAX; 3]);
        assert_eq!(far, Ok([i64::MAX; 3]));
    }
}
