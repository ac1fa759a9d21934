//! Bias common to all points at every sub-pixel phase of the motion.
//!
//! Interpolation errors depend on the position of a template between the pixels, and on the
//! distance it has moved between them. The flow takes its templates at evenly spread phases, so
//! that most of the error averages out. The rest is common to all points, and no residual shows it.
//! This module measures it: the displacement of the whole path minus the truth, in camera pixels,
//! with hardly any noise.

use super::trial::Posters;
use trinocular_core::estimate::midpoint;
use trinocular_core::rig::Rig;
use trinocular_rig::random::Random;
use trinocular_vision::flow::{Flow, FlowSettings};
use trinocular_vision::images::{Exposure, Pose, Scene, SceneError, SceneSettings, TextureKind};
use trinocular_vision::sums::Sums;

/// Number of phases tried.
pub const PHASES: usize = 10;
/// Claimed limit of the mean error at any phase, px, beyond three times its own uncertainty.
pub const MOST_PX: f64 = 0.0005;
/// Sensor noise in grey levels: nearly none, but pixels are rounded.
const NOISE_GREY: f64 = 0.3;
/// Keyframes per poster.
const PLACES: usize = 3;
const DEPTH_MM: f64 = 850.0;

/// Result at one phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// Shift to the right, px; the shift downwards is half a pixel less.
    pub shift_px: f64,
    /// Mean error along x and y, px.
    pub bias_px: [f64; 2],
    /// Standard error of the mean error, px.
    pub uncertainty_px: [f64; 2],
    /// Mean scatter of single flow components, px.
    pub scatter_px: f64,
}

impl Phase {
    /// Returns true if the bias is within the claimed limit.
    pub fn is_small(&self) -> bool {
        let within = |i: usize| self.bias_px[i].abs() <= MOST_PX + 3.0 * self.uncertainty_px[i];
        within(0) && within(1)
    }
}

/// Computes the mean over the posters of the seeds `1..=seeds`. Calls `told` with the progress, 0
/// to 1.
///
/// # Errors
/// If the scene cannot be rendered.
pub fn run(seeds: u64, mut told: impl FnMut(f64)) -> Result<Vec<Phase>, SceneError> {
    let rig = Rig::paper();
    let mm_per_px = DEPTH_MM / rig.mean_focal_px();
    let mut errors: Vec<Vec<[f64; 2]>> = vec![Vec::new(); PHASES];
    let mut scatter = [0.0; PHASES];
    for seed in 1..=seeds {
        let settings = SceneSettings {
            depth_mm: DEPTH_MM,
            ..SceneSettings::default()
        };
        let texture = Posters::new(seed).of(TextureKind::Natural, 1.0);
        let mut scene = Scene::new(&rig, &texture, settings)?;
        let mut random = Random::new(seed, 12);
        for _ in 0..PLACES {
            scene.look_at([(); 2].map(|()| random.between(-300.0, 300.0)));
            let mut picture = |shift: [f64; 2]| {
                let pose = Pose::at([shift[0] * mm_per_px, shift[1] * mm_per_px, 0.0]);
                let shot = Exposure::of(pose, NOISE_GREY);
                scene.render_exposures(&vec![shot; rig.cameras.len()], 0, random.next_u64())
            };
            let Ok(mut flow) = Flow::new(&rig, FlowSettings::default()) else {
                continue;
            };
            if flow.set_keyframe(&picture([0.0; 2])).is_err() {
                continue;
            }
            for phase in 0..PHASES {
                let shift = shift(phase);
                let Ok(seen) = flow.measure(&picture(shift)) else {
                    continue;
                };
                let solved = Sums::of(&rig, &seen).and_then(|s| midpoint::solve(&s.centred));
                if let Ok(solved) = solved {
                    let error = |i: usize| solved.displacement_mm[i] / mm_per_px - shift[i];
                    errors[phase].push([error(0), error(1)]);
                    scatter[phase] += solved.sigma_px;
                }
            }
        }
        told(seed as f64 / seeds as f64);
    }
    Ok((0..PHASES)
        .map(|p| phase(p, &errors[p], scatter[p]))
        .collect())
}

fn shift(phase: usize) -> [f64; 2] {
    let x = phase as f64 / PHASES as f64;
    [x, x - 0.5]
}

fn phase(phase: usize, errors: &[[f64; 2]], scatter: f64) -> Phase {
    let count = errors.len() as f64;
    let bias_px = [0, 1].map(|i| errors.iter().map(|e| e[i]).sum::<f64>() / count);
    let uncertainty_px = [0, 1].map(|i| {
        let squares: f64 = errors.iter().map(|e| (e[i] - bias_px[i]).powi(2)).sum();
        (squares / (count * (count - 1.0))).sqrt()
    });
    Phase {
        shift_px: shift(phase)[0],
        bias_px,
        uncertainty_px,
        scatter_px: scatter / count,
    }
}
