//! A poster in front of a rig, rendered and measured as `estimate` measures it.

use trinocular::paper::moves;
use trinocular_core::rig::Rig;
use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings, Measurement};
use trinocular_vision::images::{FrameSet, Scene, SceneSettings, Texture};
use trinocular_vision::sums::Sums;

/// Largest error of an estimate at the paper's distance, mm: the project's bound for the paper's
/// Table 5.
pub const TOLERANCE_MM: [f64; 3] = moves::BOUND_MM;

/// Returns the true displacements of the paper's Table 5, mm.
pub fn table_5_mm() -> [[f64; 3]; 8] {
    moves::PRINTED.map(|(true_mm, _)| true_mm)
}

/// A displacement measured by the whole path.
#[derive(Clone, Debug)]
pub struct Got {
    pub displacement_mm: [f64; 3],
    pub sigma_mm: [f64; 3],
    pub points: usize,
}

impl Got {
    fn new(rig: &Rig, seen: &Measurement) -> Self {
        let sums = Sums::of(rig, seen).expect("a rig of two or more cameras");
        let estimate = sums.estimates().midpoint.expect("points enough");
        Self {
            displacement_mm: estimate.displacement_mm,
            sigma_mm: estimate.sigma_mm(),
            points: seen.correspondences.len(),
        }
    }

    pub fn error_mm(&self, truth_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| self.displacement_mm[i] - truth_mm[i])
    }

    pub fn is_within(&self, truth_mm: [f64; 3], bound_mm: [f64; 3]) -> bool {
        let error = self.error_mm(truth_mm);
        (0..3).all(|i| error[i].abs() <= bound_mm[i])
    }

    /// Returns true if the error is at most five standard deviations beyond the tolerance.
    pub fn is_honest(&self, truth_mm: [f64; 3]) -> bool {
        let bound = |i: usize| TOLERANCE_MM[i] + 5.0 * self.sigma_mm[i];
        self.is_within(truth_mm, std::array::from_fn(bound))
    }

    #[track_caller]
    pub fn assert_within(&self, truth_mm: [f64; 3], bound_mm: [f64; 3], what: &str) {
        assert!(
            self.is_within(truth_mm, bound_mm),
            "{what}: {:?} mm off {truth_mm:?} with sigma {:?}, {} points",
            self.error_mm(truth_mm),
            self.sigma_mm,
            self.points
        );
    }
}

/// Measures frame sets against one keyframe, like the sequence of a folder.
pub struct Watch {
    rig: Rig,
    flow: Flow,
}

impl Watch {
    pub fn new(rig: &Rig, reference: &FrameSet) -> Result<Self, FlowRefusal> {
        let mut flow = Flow::new(rig, FlowSettings::default())?;
        flow.set_keyframe(reference)?;
        let rig = rig.clone();
        Ok(Self { rig, flow })
    }

    pub fn measure(&mut self, capture: &FrameSet) -> Result<Got, FlowRefusal> {
        let seen = self.flow.measure(capture)?;
        Ok(Got::new(&self.rig, &seen))
    }
}

/// A poster in front of a rig.
pub struct Bench {
    pub rig: Rig,
    pub scene: Scene,
}

impl Bench {
    /// Returns a poster in front of the paper's rig.
    pub fn new(texture: &Texture, settings: SceneSettings) -> Self {
        Self::with_rig(Rig::paper(), texture, settings)
    }

    pub fn with_rig(rig: Rig, texture: &Texture, settings: SceneSettings) -> Self {
        let scene = Scene::new(&rig, texture, settings).expect("a scene that can be rendered");
        Self { rig, scene }
    }

    /// Measures each displacement from rest. `seed` determines the noise, which differs between
    /// frame sets.
    pub fn measure_all(&self, moves_mm: &[[f64; 3]], seed: u64) -> Vec<Result<Got, FlowRefusal>> {
        let seed = seed * 1000;
        let mut watch = match Watch::new(&self.rig, &self.scene.render([0.0; 3], 0, seed)) {
            Ok(watch) => watch,
            Err(refusal) => return moves_mm.iter().map(|_| Err(refusal.clone())).collect(),
        };
        let captures = moves_mm.iter().zip(1..);
        captures
            .map(|(moved, i)| watch.measure(&self.scene.render(*moved, i, seed + i)))
            .collect()
    }
}
