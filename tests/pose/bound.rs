//! Monte Carlo: errors over the Cramér-Rao bound, bias, and stated against true errors.

use super::likelihood::{self, Pose};
use super::scene::{FOCAL_PX, LINE, PIVOT_MM, POSTER, RELIEF, Scene};
use nalgebra::{Matrix6, Rotation3, Vector3, Vector6};
use trinocular_core::estimate::pose::{self, Estimate, Noise};
use trinocular_rig::random::Random;

const MOVED_MM: [f64; 3] = [12.0, -8.0, 10.0];
const SLANTED: [f64; 3] = [1.0, 1.0, 1.0];

/// Errors of many trials of one scene.
struct Trials {
    /// Mean square over the bound's variance: displacement x, y, z, rotation x, y, z.
    over_bound: [f64; 6],
    /// Mean error: mm and rad.
    bias: [f64; 6],
    /// Standard deviation of the bias by chance.
    bias_sigma: [f64; 6],
    /// Mean square over the stated variance.
    over_stated: [f64; 6],
    /// Number of trials.
    count: f64,
}

/// Returns the error of the pivot's displacement, mm, and of the rotation, rad.
fn error(scene: &Scene, estimate: &Estimate) -> Vector6<f64> {
    let moved = estimate.displacement_of(PIVOT_MM).displacement_mm;
    let moved = Vector3::from(moved) - Vector3::from(scene.displacement_mm);
    let got = Rotation3::new(estimate.rotation_rad().into());
    let turned = (got * scene.rotation().inverse()).scaled_axis();
    Vector6::new(moved.x, moved.y, moved.z, turned.x, turned.y, turned.z)
}

fn run(
    trials: usize,
    seed: u64,
    scene: impl Fn(&mut Random) -> Scene,
    solve: impl Fn(&Scene, &mut Random) -> Estimate,
    bound: impl Fn(&Scene) -> Matrix6<f64>,
) -> Trials {
    let random = &mut Random::seeded(seed);
    let [mut squares, mut sums, mut bounds, mut stated] = [[0.0; 6]; 4];
    for _ in 0..trials {
        let scene = scene(random);
        let estimate = solve(&scene, random);
        let off = error(&scene, &estimate);
        let least = bound(&scene);
        let moved = estimate.displacement_of(PIVOT_MM).covariance_mm2;
        let turned = estimate.rotation_covariance_rad2();
        for i in 0..6 {
            squares[i] += off[i] * off[i];
            sums[i] += off[i];
            bounds[i] += least[(i, i)];
            let variance = if i < 3 {
                moved[i][i]
            } else {
                turned[i - 3][i - 3]
            };
            stated[i] += off[i] * off[i] / variance;
        }
    }
    let count = trials as f64;
    Trials {
        over_bound: std::array::from_fn(|i| squares[i] / bounds[i]),
        bias: sums.map(|sum| sum / count),
        bias_sigma: squares.map(|square| square.sqrt() / count),
        over_stated: stated.map(|sum| sum / count),
        count,
    }
}

fn bound(scene: &Scene, sigma_px: f64) -> Matrix6<f64> {
    let pivot = Vector3::from(PIVOT_MM);
    let rotation = scene.rotation();
    let [x, y] = scene.geometry.centre_mm();
    let centre = Vector3::new(x, y, 0.0);
    // About the mean camera.
    let translation =
        pivot + Vector3::from(scene.displacement_mm) - centre - rotation * (pivot - centre);
    let pose = Pose::new(rotation, translation, &scene.geometry);
    let unit = likelihood::bound(&scene.geometry, &scene.exact(), &pose, PIVOT_MM);
    unit * (sigma_px / FOCAL_PX).powi(2)
}

/// Asserts the stated bounds, with three standard deviations of chance for the number of trials.
#[track_caller]
fn assert_good(name: &str, trials: &Trials) {
    // Over the three axes together: of displacement, and of rotation.
    let mean = |of: &[f64; 6]| [0, 3].map(|first| of[first..first + 3].iter().sum::<f64>() / 3.0);
    let [ratio, stated] = [
        mean(&trials.over_bound).map(f64::sqrt),
        mean(&trials.over_stated),
    ];
    println!("{name}: over the bound {ratio:.3?}, over the stated variance {stated:.3?}");
    let chance = 3.0 / (6.0 * trials.count).sqrt();
    assert!(
        ratio.iter().all(|ratio| *ratio < 1.06 + chance),
        "{name}: {ratio:?}"
    );
    let honest = 0.8 - 2.0 * chance..1.3 + 2.0 * chance;
    assert!(
        stated.iter().all(|stated| honest.contains(stated)),
        "{name}: {stated:?}"
    );
    for i in 0..6 {
        let limit = if i < 3 { 0.010 } else { 0.020f64.to_radians() };
        let bias = trials.bias[i].abs() - 3.0 * trials.bias_sigma[i];
        assert!(bias < limit, "{name}: bias {bias} of {i}");
    }
}

fn scene(
    shape: [f64; 3],
    count: usize,
    axis: [f64; 3],
    degrees: f64,
) -> impl Fn(&mut Random) -> Scene {
    move |random| Scene::new(&LINE, shape, count, random).moved(MOVED_MM, axis, degrees)
}

/// Rows of shapes, points, noise and angles, each with a mean of `trials`.
fn sweep(trials: usize, counts: &[usize], noises_px: &[f64], angles_deg: &[f64]) {
    let mut seed = 100;
    for (name, shape) in [("poster", POSTER), ("relief", RELIEF)] {
        for &count in counts {
            for &sigma_px in noises_px {
                for &degrees in angles_deg {
                    seed += 1;
                    let name = format!("{name}, {count} points, {sigma_px} px, {degrees} deg");
                    let solve = |scene: &Scene, random: &mut Random| {
                        pose::solve(&scene.geometry, &scene.noisy(sigma_px, random)).unwrap()
                    };
                    let axis = [[0.0, 1.0, 0.0], SLANTED][seed as usize % 2];
                    let made = scene(shape, count, axis, degrees);
                    let found = run(trials, seed, made, solve, |scene| bound(scene, sigma_px));
                    assert_good(&name, &found);
                }
            }
        }
    }
}

#[test]
fn pose_reaches_bound() {
    sweep(150, &[50, 200], &[0.02, 0.1], &[0.0, 5.0, 20.0]);
}

/// A quarter turn, half a turn, and between them.
#[test]
fn pose_reaches_bound_after_90_to_180_degrees() {
    for (seed, degrees) in [(71, 90.0), (72, 135.0), (73, 180.0)] {
        for (name, shape) in [("poster", POSTER), ("relief", RELIEF)] {
            let made = scene(shape, 100, [0.1, 0.2, 1.0], degrees);
            let solve = |scene: &Scene, random: &mut Random| {
                pose::solve(&scene.geometry, &scene.noisy(0.05, random)).unwrap()
            };
            let found = run(150, seed, made, solve, |scene| bound(scene, 0.05));
            assert_good(&format!("{name}, {degrees} deg about z"), &found);
        }
    }
}

/// `POSE_TRIALS=1000`, as in `tests/run --all`, makes the long sweep.
#[test]
#[ignore = "takes a minute; tests/run --all includes it"]
fn pose_reaches_bound_in_more_trials() {
    let trials = std::env::var("POSE_TRIALS").ok();
    sweep(
        trials.map_or(100, |count| count.parse().expect("a number")),
        &[50, 100, 200],
        &[0.02, 0.05, 0.1],
        &[0.0, 1.0, 5.0, 10.0, 20.0],
    );
}

/// Points that are followed from a keyframe: noise that both instants share.
#[test]
fn followed_points_state_their_sigma() {
    for (shape, degrees, stereo_px, following_px) in [
        (POSTER, 10.0, 0.05, 0.05),
        (POSTER, 20.0, 0.1, 0.05),
        (POSTER, 10.0, 0.05, 0.02),
        (RELIEF, 20.0, 0.05, 0.02),
        (POSTER, 0.0, 0.05, 0.02),
    ] {
        let [known, measured, independent] = [0, 1, 2].map(|kind| {
            let solve = |scene: &Scene, random: &mut Random| {
                let seen = scene.observe(|| {
                    let [x, y] = std::array::from_fn(|_| stereo_px * random.gaussian());
                    let mut following = || following_px * random.gaussian();
                    [x, y, x + following(), y + following()]
                });
                let noise = match kind {
                    0 => Noise::followed(stereo_px / FOCAL_PX, following_px / FOCAL_PX),
                    1 => Noise::of(&scene.geometry, &seen),
                    _ => Noise::independent(stereo_px / FOCAL_PX),
                };
                pose::reweighted(&scene.geometry, &seen, &noise).unwrap()
            };
            let made = scene(shape, 100, [0.0, 1.0, 0.0], degrees);
            run(200, 7, made, solve, |scene| bound(scene, stereo_px))
        });
        for (name, trials) in [("known", &known), ("measured", &measured)] {
            let stated = trials.over_stated;
            assert!(
                stated.iter().all(|ratio| (0.7..1.4).contains(ratio)),
                "{name} {stated:?}"
            );
            let bias = trials.bias[4].abs() - 3.0 * trials.bias_sigma[4];
            assert!(bias < 0.01f64.to_radians(), "{name}: {bias}");
        }
        if degrees > 0.0 && shape == POSTER {
            // About y, for which the depths count: worth at least a tenth.
            assert!(
                measured.over_bound[4] < 0.8 * independent.over_bound[4],
                "{degrees}"
            );
        }
    }
}
