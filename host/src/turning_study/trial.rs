//! One rendering, measured with and without a rotation.

use super::scene::{LEAST_TARGET, Rendering, Truth};
use crate::accuracy_study::trial::Outcome;
use nalgebra::{Rotation3, Vector3};
use trinocular_core::estimate::midpoint;
use trinocular_core::estimate::pose::Estimate;
use trinocular_core::rig::Rig;
use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings};
use trinocular_vision::sums::Sums;

/// Standard deviation from which a measurement is vague, mm.
pub const VAGUE_MM: f64 = 0.3;

/// Outcomes of one rendering.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Displacement of the pivot, measured with a rotation.
    pub moved: Outcome,
    /// Rotation, in degrees instead of mm.
    pub turned: Outcome,
    /// Displacement as if nothing turned.
    pub displaced: Outcome,
}

/// Measures a rendering in both ways. The truth is the motion of the target; of two objects that
/// may both be the target, that which is nearer to the result.
pub fn run(rig: &Rig, rendering: &Rendering) -> Trial {
    let refused = |refusal: FlowRefusal| Outcome::Refused(refusal.name());
    let flow = Flow::new(rig, FlowSettings::default()).and_then(|mut flow| {
        flow.set_keyframe(&rendering.before)?;
        Ok(flow)
    });
    let mut flow = match flow {
        Ok(flow) => flow,
        Err(refusal) => {
            let outcome = refused(refusal);
            return Trial {
                moved: outcome.clone(),
                turned: outcome.clone(),
                displaced: outcome,
            };
        }
    };
    let [moved, turned] = match flow.measure_pose(&rendering.now) {
        Ok(seen) => {
            let points = seen.correspondences.len();
            let of = |truth: &Truth| {
                let there = seen.pose.displacement_of(truth.pivot_mm);
                [
                    measured(
                        there.displacement_mm,
                        truth.moved_mm,
                        there.sigma_mm(),
                        points,
                    ),
                    rotation(&seen.pose, truth, points),
                ]
            };
            nearest(rendering, of, |[moved, turned]| {
                worst(moved).max(worst(turned))
            })
        }
        Err(refusal) => [refused(refusal.clone()), refused(refusal)],
    };
    let displaced = flow.measure(&rendering.now).and_then(|seen| {
        let sums = Sums::of(rig, &seen).map_err(|_| FlowRefusal::WrongRig)?;
        let solved = midpoint::solve(&sums.centred).map_err(|_| FlowRefusal::WrongRig)?;
        let points = seen.correspondences.len();
        let got = solved.displacement_mm;
        let of = |truth: &Truth| measured(got, truth.moved_mm, solved.sigma_mm(), points);
        Ok(nearest(rendering, of, worst))
    });
    Trial {
        moved,
        turned,
        displaced: displaced.unwrap_or_else(refused),
    }
}

/// Returns the outcome against the object that fits best, among those that may be the target.
fn nearest<T>(rendering: &Rendering, of: impl Fn(&Truth) -> T, worst: impl Fn(&T) -> f64) -> T {
    let mut objects = rendering.objects.iter();
    let first = of(&rendering.objects[0]);
    if rendering.objects.len() == 1 {
        return first;
    }
    let targets = objects.by_ref().filter(|truth| truth.share >= LEAST_TARGET);
    let best = targets.map(of).min_by(|a, b| worst(a).total_cmp(&worst(b)));
    best.unwrap_or(first)
}

/// Returns the largest error of an outcome in its standard deviations.
fn worst(outcome: &Outcome) -> f64 {
    match outcome {
        Outcome::Refused(_) => 0.0,
        Outcome::Measured {
            error_mm, sigma_mm, ..
        } => {
            let errors = error_mm.iter().zip(sigma_mm);
            errors.map(|(e, s)| (e / s).abs()).fold(0.0, f64::max)
        }
    }
}

fn measured(got: [f64; 3], truth: [f64; 3], sigma: [f64; 3], points: usize) -> Outcome {
    Outcome::Measured {
        error_mm: std::array::from_fn(|i| got[i] - truth[i]),
        sigma_mm: sigma,
        points,
        said: true,
    }
}

fn rotation(pose: &Estimate, truth: &Truth, points: usize) -> Outcome {
    let got = Rotation3::new(Vector3::from(pose.rotation_rad()));
    let off = (got * truth.rotation().inverse()).scaled_axis();
    let off_deg = off.map(f64::to_degrees).into();
    measured(off_deg, [0.0; 3], pose.rotation_sigma_deg(), points)
}
