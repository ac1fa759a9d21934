//! Displacement of the cameras themselves, from images of a target at rest.

use super::fit::Sample;
use crate::flow::{Flow, FlowRefusal, FlowSettings};
use crate::images::FrameSet;
use crate::measure::{MeasureRefusal, measure};
use trinocular_core::estimate::midpoint;
use trinocular_core::rig::Rig;

/// Measures frame sets against a keyframe.
#[derive(Debug)]
pub struct Watch {
    rig: Rig,
    flow: Flow,
}

impl Watch {
    /// Takes the keyframe.
    ///
    /// # Errors
    /// If the rig or the images cannot be used.
    pub fn start(rig: &Rig, capture: &FrameSet) -> Result<Self, FlowRefusal> {
        let mut flow = Flow::new(rig, FlowSettings::default())?;
        flow.set_keyframe(capture)?;
        Ok(Self {
            rig: rig.clone(),
            flow,
        })
    }

    /// Measures the displacement in images taken at `position_mm`.
    ///
    /// # Errors
    /// If the images give no displacement, with the reason.
    pub fn look(
        &mut self,
        position_mm: [f64; 3],
        capture: &FrameSet,
    ) -> Result<Sample, MeasureRefusal> {
        let (_, sums) = measure(&mut self.flow, &self.rig, capture)?;
        let estimate = midpoint::solve(&sums.centred)?;
        Ok(Sample {
            position_mm,
            displacement_mm: estimate.displacement_mm,
            sigma_mm: estimate.sigma_mm(),
        })
    }
}
