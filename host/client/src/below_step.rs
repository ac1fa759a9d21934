//! Jogs of less than a step, which move nothing.

use trinocular_rig::rig_file::Stage;

/// Axis of a jog whose distance the station rounds to no step.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "{name}={asked_mm} is less than half a step, so that nothing would move: a step of {name} is \
     {step_mm} mm (steps_per_mm of the rig file)",
    name = ['x', 'y', 'z'][*axis]
)]
pub struct BelowStep {
    /// Index of the axis.
    pub axis: usize,
    /// Distance that was asked, mm.
    pub asked_mm: f64,
    /// Length of a step, mm.
    pub step_mm: f64,
}

/// Checks that each axis of a jog by `distance_um` moves by a step at least, unless its distance is
/// zero.
///
/// # Errors
/// The first axis whose distance is rounded to no step.
///
/// # Example
/// ```
/// use trinocular_client::below_step::check_steps;
/// use trinocular_client::stage::default_stage;
///
/// // 80 steps/mm.
/// let stage = default_stage();
/// assert!(check_steps(&stage, [1_000, 0, -7]).is_ok());
/// let below = check_steps(&stage, [1_000, -6, 0]).unwrap_err();
/// assert_eq!((below.axis, below.step_mm), (1, 0.0125));
/// ```
pub fn check_steps(stage: &Stage, distance_um: [i32; 3]) -> Result<(), BelowStep> {
    for (axis, um) in distance_um.into_iter().enumerate() {
        let (asked_mm, scale) = (f64::from(um) * 1e-3, stage.steps_per_mm[axis]);
        if um != 0 && (asked_mm * scale).abs() < 0.5 {
            let step_mm = 1.0 / scale;
            return Err(BelowStep {
                axis,
                asked_mm,
                step_mm,
            });
        }
    }
    Ok(())
}
