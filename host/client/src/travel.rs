//! Soft limits of a stage.

use trinocular_rig::rig_file::Stage;

/// Position that is outside the soft limits of an axis.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "{name} = {at_mm} mm is outside the soft limits: travel_mm of the rig file is {} to {} mm",
    .travel_mm[0],
    .travel_mm[1],
    name = ['x', 'y', 'z'][*axis]
)]
pub struct BeyondTravel {
    /// Index of the axis.
    pub axis: usize,
    /// Position that was asked, mm.
    pub at_mm: f64,
    /// Soft limits of the axis, mm.
    pub travel_mm: [f64; 2],
}

/// Checks that a position, mm, lies within the soft limits of every axis.
///
/// # Errors
/// The first axis for which it does not.
///
/// # Example
/// ```
/// use trinocular_client::stage::default_stage;
/// use trinocular_client::travel::check_travel;
///
/// // 60 mm each way.
/// let stage = default_stage();
/// assert!(check_travel(&stage, [60.0, 0.0, -60.0]).is_ok());
/// let beyond = check_travel(&stage, [0.0, -60.1, 0.0]).unwrap_err();
/// assert_eq!(beyond.axis, 1);
/// ```
pub fn check_travel(stage: &Stage, position_mm: [f64; 3]) -> Result<(), BeyondTravel> {
    for (axis, at_mm) in position_mm.into_iter().enumerate() {
        let travel_mm @ [least, greatest] = stage.travel_mm[axis];
        if !(least..=greatest).contains(&at_mm) {
            return Err(BeyondTravel {
                axis,
                at_mm,
                travel_mm,
            });
        }
    }
    Ok(())
}
