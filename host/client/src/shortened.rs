//! Axes of a jog that soft limits shorten.

use std::fmt::{Display, Formatter};
use trinocular_rig::rig_file::Stage;

/// Axis of a jog that goes less far than was asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shortened {
    /// Index of the axis.
    pub axis: usize,
    /// Distance that it goes, mm.
    pub goes_mm: f64,
    /// Distance that was asked, mm.
    pub asked_mm: f64,
    /// Soft limits of the axis, mm.
    pub travel_mm: [f64; 2],
}

/// Finds the axes of a jog by `distance_um` that `steps` shortens by more than a whole step.
pub fn shortened(stage: &Stage, distance_um: [i32; 3], steps: [i32; 3]) -> Vec<Shortened> {
    let of_axis = |axis: usize| {
        let asked_mm = f64::from(distance_um[axis]) * 1e-3;
        let scale = stage.steps_per_mm[axis];
        let goes_mm = f64::from(steps[axis]) / scale;
        let is_short = ((asked_mm - goes_mm) * scale).abs() > 1.0;
        is_short.then_some(Shortened {
            axis,
            goes_mm,
            asked_mm,
            travel_mm: stage.travel_mm[axis],
        })
    };
    (0..3).filter_map(of_axis).collect()
}

impl Display for Shortened {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        let name = ['x', 'y', 'z'][self.axis];
        let [least, greatest] = self.travel_mm;
        // Adding zero turns -0 into 0.
        let (goes_mm, asked_mm) = (self.goes_mm + 0.0, self.asked_mm);
        write!(
            formatter,
            "{name} was shortened to {goes_mm:.4} mm of {asked_mm} mm by the soft limits: \
             travel_mm of the rig file is {least} to {greatest} mm"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::default_stage;

    #[test]
    fn step_of_rounding_is_not_shortened() {
        let stage = default_stage();
        assert_eq!(stage.steps_per_mm, [80.0, 80.0, 80.0]);
        assert_eq!(shortened(&stage, [1_006, 0, -990], [80, 0, -80]), []);
        let found = shortened(&stage, [1_000, 80_000, 0], [0, 4_800, 0]);
        let texts: Vec<String> = found.iter().map(Shortened::to_string).collect();
        let limits = "by the soft limits: travel_mm of the rig file is -60 to 60 mm";
        assert_eq!(texts.len(), 2);
        assert_eq!(
            texts[0],
            format!("x was shortened to 0.0000 mm of 1 mm {limits}")
        );
        assert_eq!(
            texts[1],
            format!("y was shortened to 60.0000 mm of 80 mm {limits}")
        );
    }
}
