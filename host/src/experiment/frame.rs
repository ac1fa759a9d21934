//! From pictures to the numbers that cross the wire.

use crate::flow::{Flow, Measurement};
use crate::images::FrameSet;
use crate::sums::{Estimator, Sums};
use shared::frame::message::Sums as FrameSums;
use shared::rig::Rig;

/// What `flow` measures of a capture, and its sums for one of the station's estimators.
///
/// # Errors
/// Why there are none, in words.
pub fn measure(
    flow: &mut Flow,
    rig: &Rig,
    capture: &FrameSet,
    estimator: Estimator,
) -> Result<(Measurement, FrameSums), String> {
    let measured = flow
        .measure(capture)
        .map_err(|refusal| refusal.to_string())?;
    let sums = Sums::of(rig, &measured).and_then(|sums| sums.frame(estimator));
    let sums = sums.map_err(|refusal| refusal.to_string())?;
    Ok((measured, sums))
}
