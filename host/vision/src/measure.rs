//! Measurement from the images of one instant to flow sums.

use crate::flow::{self, Flow, Measurement};
use crate::images::FrameSet;
use crate::sums::Sums;
use trinocular_core::estimate;
use trinocular_core::rig::Rig;

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

/// Measures `capture` against the keyframe of `flow` as [`Flow::measure_target`] does, and returns
/// the correspondences and their sums.
///
/// # Errors
/// [`MeasureRefusal`], with the stage that refused.
///
/// # Example
/// ```
/// use trinocular_core::estimate::midpoint;
/// use trinocular_core::rig::Rig;
/// use trinocular_vision::flow::{Flow, FlowSettings};
/// use trinocular_vision::images::{Scene, SceneSettings, Texture};
/// use trinocular_vision::measure::measure;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let rig = Rig::paper();
/// let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
/// let mut flow = Flow::new(&rig, FlowSettings::default())?;
/// flow.set_keyframe(&scene.render([0.0; 3], 0, 1))?;
///
/// let (measurement, sums) = measure(&mut flow, &rig, &scene.render([4.0, 4.0, 1.0], 0, 2))?;
/// let estimate = midpoint::solve(&sums.centred)?;
/// let error = [4.0, 4.0, 1.0].iter().zip(estimate.displacement_mm).map(|(a, b)| (a - b).abs());
/// assert!(measurement.correspondences.len() > 100 && error.sum::<f64>() < 0.1);
/// # Ok(())
/// # }
/// ```
pub fn measure(
    flow: &mut Flow,
    rig: &Rig,
    capture: &FrameSet,
) -> Result<(Measurement, Sums), MeasureRefusal> {
    let measured = flow.measure_target(capture)?;
    let sums = Sums::of(rig, &measured)?;
    Ok((measured, sums))
}
