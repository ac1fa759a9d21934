//! Measurement from the images of one instant to flow sums.

use crate::flow::{self, Flow, Measurement};
use crate::images::FrameSet;
use crate::sums::Sums;
use shared::estimate;
use shared::rig::Rig;

/// Reason why images give no flow sums.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeasureRefusal {
    /// The images show no displacement from the keyframe.
    #[error(transparent)]
    Flow(#[from] flow::FlowRefusal),
    /// The correspondences give no sums for the estimator.
    #[error(transparent)]
    Sums(#[from] estimate::Refusal),
    /// Something hides all ideal points.
    #[error("no point is seen")]
    NothingSeen,
}

/// Measures `capture` against the keyframe of `flow` and returns the correspondences and their
/// sums.
///
/// # Errors
/// [`MeasureRefusal`], with the stage that refused.
pub fn measure(
    flow: &mut Flow,
    rig: &Rig,
    capture: &FrameSet,
) -> Result<(Measurement, Sums), MeasureRefusal> {
    let measured = flow.measure(capture)?;
    let sums = Sums::of(rig, &measured)?;
    Ok((measured, sums))
}
