//! Time per stage of the flow, for `trinocular bench flow` and `cargo bench`.
//!
//! Two pieces of work are timed:
//!
//! * [`with_fresh_keyframe`]: every frame set is the keyframe of the next one. Per frame set:
//!   filter the new images, choose corners in the old ones, match them in all cameras (two stereo
//!   matches for three cameras), track them into the new images (three temporal matches). This is
//!   the unit in which the program is compared with others; reports call it a frame set.
//! * [`with_kept_keyframe`]: the keyframe stays. Per frame set: filter and track.

use std::time::{Duration, Instant};

use crate::flow::{FilteredFrameSet, Flow, FlowRefusal, Measurement, PipelineStage, StageObserver};
use crate::images::FrameSet;

/// Time spent in each stage since the start.
#[derive(Clone, Copy, Debug)]
pub struct StageTimings {
    last: Instant,
    spent: [Duration; PipelineStage::ALL.len()],
}

impl StageTimings {
    /// Starts the clock.
    pub fn start() -> Self {
        Self {
            last: Instant::now(),
            spent: [Duration::ZERO; PipelineStage::ALL.len()],
        }
    }

    /// Returns the time spent in `stage`.
    pub fn of(&self, stage: PipelineStage) -> Duration {
        self.spent[stage as usize]
    }

    /// Returns the time spent in all stages.
    pub fn total(&self) -> Duration {
        self.spent.iter().sum()
    }
}

impl StageObserver for StageTimings {
    /// Adds the time since the end of the stage before to `stage`.
    fn stage_done(&mut self, stage: PipelineStage) {
        let now = Instant::now();
        self.spent[stage as usize] += now - self.last;
        self.last = now;
    }
}

/// Result of [`with_fresh_keyframe`].
#[derive(Clone, Debug)]
pub struct FreshKeyframe {
    /// Displacement between the two frame sets.
    pub measurement: Measurement,
    /// Time per stage.
    pub timings: StageTimings,
    /// The new frame set: the next call's `before`.
    pub filtered: FilteredFrameSet,
}

/// Makes the frame set `before` the keyframe and measures the frame set `now` against it.
///
/// # Errors
/// [`FlowRefusal`] if one of the two cannot be used.
pub fn with_fresh_keyframe(
    flow: &mut Flow,
    before: FilteredFrameSet,
    now: &FrameSet,
) -> Result<FreshKeyframe, FlowRefusal> {
    let mut timings = StageTimings::start();
    let thread_pool = flow.thread_pool().clone();
    let (measurement, filtered) = thread_pool.run(|| {
        let filtered = flow.filter_observed(now, &mut timings)?;
        flow.set_filtered_keyframe(before, &mut timings)?;
        let measurement = flow.measure_filtered(&filtered, &mut timings)?;
        Ok((measurement, filtered))
    })?;
    // The switch back to this thread is part of the stage.
    timings.stage_done(PipelineStage::Consensus);
    Ok(FreshKeyframe {
        measurement,
        timings,
        filtered,
    })
}

/// Measures the frame set `now` against the keyframe that `flow` has.
///
/// # Errors
/// [`FlowRefusal`] if there is no keyframe or the frame set cannot be used.
pub fn with_kept_keyframe(
    flow: &mut Flow,
    now: &FrameSet,
) -> Result<(Measurement, StageTimings), FlowRefusal> {
    let mut timings = StageTimings::start();
    let measurement = flow.measure_observed(now, &mut timings)?;
    timings.stage_done(PipelineStage::Consensus);
    Ok((measurement, timings))
}
