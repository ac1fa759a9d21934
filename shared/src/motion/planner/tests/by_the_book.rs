//! Durations of moves from rest to rest, compared with the textbook formula.

use super::*;

/// Returns the shortest time of a move from rest to rest by the textbook (seven phases, or fewer),
/// seconds.
fn optimal_time(d: f64, v: f64, a: f64, j: f64) -> f64 {
    // Distance to a speed and back to rest, at that speed.
    let ramps = |v: f64| {
        if v * j >= a * a {
            v * (v / a + a / j)
        } else {
            2.0 * v * (v / j).sqrt()
        }
    };
    if d >= ramps(v) {
        return d / v + ramps(v) / v;
    }
    let (mut low, mut high) = (0.0, v);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if ramps(middle) < d {
            low = middle
        } else {
            high = middle
        }
    }
    2.0 * d / low
}

/// The limits are quantised downwards by up to 1/34 (jerk) and 1/689 (acceleration) here.
#[test]
fn moves_take_the_textbook_time() {
    for steps in [1, 2, 10, 100, 639, 641, 5_000, 80_000] {
        let mut planner = planner([CONFIG; AXES], WordRate::MHZ_1);
        let mut judge = Judge::new([CONFIG; AXES], WordRate::MHZ_1);
        planner.set_target(centres([steps, 0, -steps]));
        let ticks = f64::from(run(&mut planner, &mut judge));
        let optimum = 1_000.0 * optimal_time(f64::from(steps), 8_000.0, 80_000.0, 4_000_000.0);
        std::println!("{steps} steps: {ticks} ms, optimum {optimum:.1} ms");
        assert!(
            ticks >= optimum - 1.0,
            "{steps} steps: {ticks} ms, optimum {optimum} ms"
        );
        assert!(
            ticks <= optimum * 1.01 + 1.0,
            "{steps} steps: {ticks} ms, optimum {optimum} ms"
        );
    }
}
