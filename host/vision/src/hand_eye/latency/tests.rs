//! Delays from passes whose motion is computed.

use super::*;
use trinocular_rig::random::Random;

/// Noise of the points' mean motion, px.
const NOISE_PX: f64 = 0.005;

/// Motion per mm of the stage's x and y axes, px.
const SCALES: [[f64; 2]; 2] = [[0.62, 0.05], [-0.05, 0.61]];

/// Passes of 10 mm in 0.25 s along x and y, and the images of each at 60 per second.
struct Bench {
    paths: Vec<Path>,
    /// Lag of the stage behind its path, pass by pass, s.
    slips_s: [f64; 8],
    noise_px: f64,
    /// Motion of the target itself, px/s.
    own_px_s: f64,
    scales: [[f64; 2]; 2],
}

impl Bench {
    fn new() -> Self {
        let path = |pass: usize| {
            let mut path = Path::default();
            for ms in 0..800 {
                let time_s = 3.0 * pass as f64 + f64::from(ms) * 1e-3;
                let share = (f64::from(ms) / 250.0).min(1.0);
                let along = 5.0 * (share * std::f64::consts::PI).cos();
                let along = if pass.is_multiple_of(2) {
                    -along
                } else {
                    along
                };
                let mut place_mm = [0.0; 3];
                place_mm[pass / 4] = along;
                path.push(time_s, place_mm);
            }
            path
        };
        Self {
            paths: (0..8).map(path).collect(),
            slips_s: [0.0; 8],
            noise_px: NOISE_PX,
            own_px_s: 0.0,
            scales: SCALES,
        }
    }

    fn passages(&self, delay_s: f64, seed: u64) -> Vec<Passage<'_>> {
        let mut random = Random::seeded(seed);
        let passes = self.paths.iter().enumerate();
        let passage = |(pass, path): (usize, &'_ Path)| {
            let axis = pass / 4;
            let look = |image: u32| {
                let since_s = random.between(0.0, 1e-3) + f64::from(image) / 60.0;
                let stamp_s = 3.0 * pass as f64 + since_s;
                let stage_mm = path.at(stamp_s - delay_s - self.slips_s[pass])[axis];
                let moved_px = self.scales[axis].map(|scale| {
                    scale * stage_mm + self.own_px_s * since_s + self.noise_px * random.gaussian()
                });
                Look { stamp_s, moved_px }
            };
            let looks = (0..40).map(look).collect();
            (axis, looks)
        };
        let seen: Vec<_> = passes.map(passage).collect();
        let with_paths = seen.into_iter().zip(&self.paths);
        with_paths
            .map(|((axis, looks), path)| Passage { axis, path, looks })
            .collect()
    }

    fn refusal(&self, delay_s: f64) -> Refusal {
        let found = latency(&self.passages(delay_s, 1), self.noise_px, 0.0);
        found.expect_err("a refusal")
    }
}

#[test]
fn delay_is_found_within_four_sigma() {
    let bench = Bench::new();
    let (mut squares, mut count) = (0.0, 0.0);
    for delay_ms in [-90.0, -8.0, 0.0, 12.5, 60.0, 280.0] {
        for seed in 0..40 {
            let passages = bench.passages(delay_ms * 1e-3, seed);
            let found = latency(&passages, NOISE_PX, 0.0).expect("a delay");
            let off = (found.delay_ms - delay_ms) / found.sigma_ms;
            assert!(off.abs() < 4.0, "{delay_ms} ms: {found:?}");
            assert!(found.sigma_ms < 0.1, "{found:?}");
            assert_eq!((found.passes, found.left_out), (8, 0), "{found:?}");
            squares += off * off;
            count += 1.0;
        }
    }
    let ratio = f64::sqrt(squares / count);
    println!("error over sigma {ratio:.3}");
    assert!((0.7..=1.1).contains(&ratio), "{ratio}");
}

#[test]
fn uncertain_clock_widens_sigma() {
    let bench = Bench::new();
    let found = |clock_ms| latency(&bench.passages(0.01, 1), NOISE_PX, clock_ms);
    let (sure, unsure) = (found(0.0).expect("a delay"), found(0.6).expect("a delay"));
    assert_eq!(unsure.own_sigma_ms, sure.own_sigma_ms);
    let clock_ms = 0.6 / f64::sqrt(3.0);
    assert!((unsure.sigma_ms - sure.sigma_ms.hypot(clock_ms)).abs() < 1e-12);
    assert!(matches!(found(5.0), Err(Refusal::Vague { .. })));
}

#[test]
fn single_late_pass_is_left_out() {
    let mut bench = Bench::new();
    bench.slips_s[3] = 0.020;
    let found = latency(&bench.passages(0.010, 1), NOISE_PX, 0.0).expect("a delay");
    assert_eq!((found.passes, found.left_out), (7, 1));
    assert!(
        (found.delay_ms - 10.0).abs() < 4.0 * found.sigma_ms,
        "{found:?}"
    );
}

#[test]
fn slipping_clock_is_refused() {
    let mut bench = Bench::new();
    bench.slips_s = [0.0, 0.0, 0.0, 0.004, 0.004, 0.004, 0.008, 0.008];
    let refused = bench.refusal(0.010);
    let Refusal::Unsteady {
        least_ms,
        greatest_ms,
    } = refused
    else {
        panic!("{refused}");
    };
    assert!((least_ms - 10.0).abs() < 0.5, "{refused}");
    assert!((greatest_ms - 18.0).abs() < 0.5, "{refused}");
}

#[test]
fn camera_that_stands_still_is_refused() {
    let mut bench = Bench::new();
    bench.scales = [[0.0; 2]; 2];
    let refused = bench.refusal(0.010);
    assert!(matches!(refused, Refusal::Still { .. }), "{refused}");
}

#[test]
fn target_that_moves_is_refused() {
    let mut bench = Bench::new();
    bench.own_px_s = 6.0;
    let refused = bench.refusal(0.010);
    let is_known = matches!(
        refused,
        Refusal::Otherwise { .. } | Refusal::Unsteady { .. }
    );
    assert!(is_known, "{refused}");
}

#[test]
fn impossible_delay_is_refused() {
    let refused = Bench::new().refusal(0.310);
    assert!(matches!(refused, Refusal::Impossible { .. }), "{refused}");
}

#[test]
fn few_images_are_refused() {
    let bench = Bench::new();
    let mut passages = bench.passages(0.01, 1);
    for passage in &mut passages[..5] {
        passage.looks.truncate(3);
    }
    let refused = latency(&passages, NOISE_PX, 0.0);
    assert_eq!(refused, Err(Refusal::TooFew { passes: 3 }));
}

#[test]
fn exposures_are_compared_with_the_nearest() {
    let at = |late_s: f64, period_s: f64| -> Vec<f64> {
        (0..100).map(|k| late_s + f64::from(k) * period_s).collect()
    };
    let first_s = at(0.0, 0.02);
    let apart = |other_s: &[f64]| apart_ms(&first_s, other_s).expect("pairs");
    assert!(apart(&first_s) < 1e-9);
    assert!((apart(&at(0.003, 0.02)) - 3.0).abs() < 1e-6);
    // A fifth of the partners was lost.
    let kept = first_s.iter().enumerate().filter(|(k, _)| k % 5 != 0);
    let sparse: Vec<f64> = kept.map(|(_, at_s)| *at_s).collect();
    let lost = apart_ms(&sparse, &at(0.003, 0.02)).expect("pairs");
    assert!((lost - 3.0).abs() < 1e-6, "{lost}");
    // Clocks that drift meet at every phase.
    assert!(apart(&at(0.0, 0.0205)) > 8.0);
    assert_eq!(apart_ms(&[], &[1.0]), None);
}
