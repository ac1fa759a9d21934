//! The rotation of a target, if its points determine one.

use super::PoseMeasurement;
use crate::flow::{FilteredFrameSet, Flow, FlowRefusal, Measurement};
use trinocular_core::estimate::pose::Estimate;

/// Largest standard deviation of a rotation that is not significant, degrees.
const MOST_SIGMA_DEG: f64 = 0.5;
/// 99.9 % quantile of χ² with three degrees of freedom: the limit of a significant rotation.
pub(crate) const SIGNIFICANT: f64 = 16.3;

/// Returns true if noise imitates the rotation in less than one of 1,000 cases.
pub(crate) fn is_significant(pose: &Estimate) -> bool {
    // Without noise any rotation is.
    pose.rotation_chi_squared()
        .is_none_or(|chi| chi > SIGNIFICANT)
}

/// Returns true if the rotation is known to 0.5 degrees, or significant.
pub(crate) fn is_determined(pose: &Estimate) -> bool {
    let sigma = pose.rotation_sigma_deg();
    sigma.iter().all(|sigma| *sigma <= MOST_SIGMA_DEG) || is_significant(pose)
}

/// Measurement of a target that may turn.
#[derive(Clone, Debug)]
pub enum Offered {
    /// Displacement and rotation: the points determine the rotation, or the displacement alone was
    /// refused.
    Pose(Box<PoseMeasurement>),
    /// The displacement alone: the points determine no rotation, and none is certain that exceeds
    /// [`FlowSettings::max_rotation_deg`](crate::flow::FlowSettings::max_rotation_deg).
    Displacement(Box<Measurement>),
}

impl Flow {
    /// Measures displacement and rotation, or the displacement alone if the points do not determine
    /// a rotation: a small target, or few points.
    ///
    /// # Errors
    /// The [`FlowRefusal`] of the pose if neither can be measured; the keyframe stays.
    pub fn measure_filtered_offered(
        &mut self,
        now: &FilteredFrameSet,
    ) -> Result<Offered, FlowRefusal> {
        if let Some(reduced) = &mut self.reduced {
            let seen = reduced.measure_filtered_offered(&reduced.halved(now));
            return seen.map(Offered::enlarged);
        }
        let mut alone = self.displacement_if_still(now);
        let pose = self.pose_of(now, alone.as_ref());
        let mut alone = || (alone.take()).unwrap_or_else(|| self.measure_filtered(now, &mut ()));
        let refusal = match pose {
            Ok(seen) if is_determined(&seen.pose) => return Ok(Offered::Pose(Box::new(seen))),
            Ok(seen) => {
                return Ok(match alone() {
                    Ok(alone) => Offered::Displacement(Box::new(alone)),
                    Err(_) => Offered::Pose(Box::new(seen)),
                });
            }
            Err(refusal) => refusal,
        };
        match refusal {
            FlowRefusal::FewTracks { .. } | FlowRefusal::NoAgreement { .. } => {
                let alone = alone().map_err(|_| refusal)?;
                Ok(Offered::Displacement(Box::new(alone)))
            }
            refusal => Err(refusal),
        }
    }
}
