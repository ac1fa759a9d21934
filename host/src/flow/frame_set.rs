//! The work that is timed: from one capture to the next, every point chosen anew.
//!
//! A *frame set* is what has to be done when each capture is the reference of the next one:
//!
//! ```text
//! filter and halve the new images (one per camera)
//! choose points in the reference camera's image of the capture before
//! match them in the other cameras of the capture before        (two spatial matches for three cameras)
//! follow them into the new images of all cameras               (three temporal matches)
//! ```
//!
//! and the unit in which this program is compared with others. With a keyframe, the second and
//! third line fall away; what remains is [`keyframe`].

use super::{Filtered, Flow, Measurement, Refusal};
use crate::images::Capture;
use crate::stage_timings::{Laps, Stage};

/// One frame set done.
#[derive(Clone, Debug)]
pub struct FrameSet {
    /// What it found.
    pub measurement: Measurement,
    /// What it took.
    pub laps: Laps,
    /// The new capture: the next frame set's `before`.
    pub filtered: Filtered,
}

/// From the capture `before` to the capture `now`.
///
/// # Errors
/// [`Refusal`], with what was found.
pub fn frame_set(flow: &mut Flow, before: Filtered, now: &Capture) -> Result<FrameSet, Refusal> {
    let mut laps = Laps::start();
    let workers = flow.workers.clone();
    let (measurement, filtered) = workers.run(|| {
        let filtered = flow.filter(now, &mut laps)?;
        flow.refer_to(before, &mut laps)?;
        let measurement = flow.measure_in(&filtered, &mut laps)?;
        Ok((measurement, filtered))
    })?;
    // With the way back to this thread.
    laps.lap(Stage::Consensus);
    Ok(FrameSet {
        measurement,
        laps,
        filtered,
    })
}

/// From the reference, whatever it is, to the capture `now`.
///
/// # Errors
/// [`Refusal`], with what was found.
pub fn keyframe(flow: &Flow, now: &Capture) -> Result<(Measurement, Laps), Refusal> {
    let mut laps = Laps::start();
    let (measurement, filtered) = flow.workers.run(|| {
        let filtered = flow.filter(now, &mut laps)?;
        let measurement = flow.measure_in(&filtered, &mut laps);
        Ok((measurement, filtered))
    })?;
    laps.lap(Stage::Consensus);
    flow.spare.keep(filtered);
    Ok((measurement?, laps))
}
