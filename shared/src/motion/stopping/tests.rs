use super::*;
use proptest::prelude::*;

/// Follows the braking rule tick by tick, checks it against its definition, and adds up the
/// distance.
fn slow_stop(pace: &Pace, mut u: i64, mut e: i64) -> i64 {
    let mut way = 0;
    for _ in 0..100_000 {
        if u == 0 && e.abs() <= pace.jerk {
            return way;
        }
        let next = pace.brake(u, e);
        assert!((next - e).abs() <= pace.jerk, "jerk at {u} {e}");
        assert!(next.abs() <= pace.acceleration);
        way += 2 * u + next;
        u += next;
        e = next;
    }
    panic!("never stops")
}

fn slow_easing(mut d: i64, jerk: i64) -> i64 {
    let mut sum = 0;
    while d > 0 {
        d -= jerk;
        sum += d.max(0);
    }
    sum
}

/// Returns the configuration for 2,000 cases, or the number in `PROPTEST_CASES`.
fn cases() -> ProptestConfig {
    match std::env::var_os("PROPTEST_CASES") {
        Some(_) => ProptestConfig::default(),
        None => ProptestConfig::with_cases(2_000),
    }
}

prop_compose! {
    fn states()(
        speed in 1..5_000u32, acceleration in 1..300u32, jerk in 1..300u32,
        u in -1.0..1.0f64, e in -1.0..1.0f64,
    ) -> (Pace, i64, i64) {
        let pace = Pace::new(speed, acceleration, jerk);
        // Twice the speed: relative to a moving target.
        (pace, (u * 2.0 * f64::from(speed)) as i64, (e * pace.acceleration as f64).round() as i64)
    }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn stopping_distance_follows_the_rule((pace, u, e) in states()) {
        prop_assert_eq!(pace.stopping_distance(u, e), slow_stop(&pace, u, e));
    }

    #[test]
    fn steepest_can_just_ease_off((pace, u, _) in states()) {
        let u = u.abs();
        let fits = |d: i64| d + slow_easing(d, pace.jerk) <= u;
        let d = pace.steepest(u);
        prop_assert!(fits(d) && !fits(d + 1));
        prop_assert_eq!(pace.easing(d), slow_easing(d, pace.jerk));
        prop_assert_eq!(pace.easing(-d), -slow_easing(d, pace.jerk));
    }

    #[test]
    fn interpolation_agrees_with_halving(
        speed in 1u32..1 << 28, acceleration in 1u32..1 << 28, jerk in 1u32..1 << 26,
        shift in 0..20u32,
        (v, a, spare, margin) in (any::<i32>(), any::<i32>(), 0..1i64 << 40, 0..1i64 << 28),
    ) {
        let pace = Pace::new(speed >> shift, acceleration >> shift, jerk >> shift);
        let u = i64::from(v) % (pace.speed + 1);
        let e = i64::from(a) % (pace.acceleration + 1);
        let stop = pace.stopping_distance(u, e);
        let ahead = stop + (spare >> shift);
        let fastest = u.abs() + (margin >> shift);
        prop_assert_eq!(
            pace.next_acceleration(u, e, ahead, fastest, stop),
            next_by_halving(&pace, u, e, ahead, fastest)
        );
    }

    #[test]
    fn next_acceleration_is_largest_allowed((pace, u, e) in states(), spare in 0..20_000i64) {
        let ahead = pace.stopping_distance(u, e) + spare;
        let fastest = u.abs() + slow_easing(e.abs(), pace.jerk) + spare;
        let allowed = |next: &i64| {
            let end = u + next;
            (*next <= 0 || end + slow_easing(*next, pace.jerk) <= fastest)
                && u + end + slow_stop(&pace, end, *next) <= ahead
        };
        let lowest = (e - pace.jerk).max(-pace.acceleration);
        let highest = (e + pace.jerk).min(pace.acceleration);
        let best = (lowest..=highest).rev().find(allowed);
        let stop = pace.stopping_distance(u, e);
        prop_assert_eq!(Some(pace.next_acceleration(u, e, ahead, fastest, stop)), best);
    }

    #[test]
    fn nothing_overflows(
        speed: u32, acceleration: u32, jerk: u32,
        u in -(1i64 << 29)..1 << 29, e in -1.0..1.0f64, ahead: i64,
    ) {
        let pace = Pace::new(speed, acceleration, jerk);
        let e = (e * pace.acceleration as f64) as i64;
        let stop = pace.stopping_distance(u, e);
        pace.next_acceleration(u, e, ahead, pace.speed, stop);
    }

    /// Exercises the narrow rule up to its end, where overflow would panic.
    #[test]
    fn both_widths_agree(
        speed in 0..1u32 << 24, acceleration in 0u32..1 << 20, jerk in 0u32..1 << 16,
        shifts in (0..16u32, 0..16u32, 0..16u32),
        u in -1.0..1.0f64, e in -1.0..1.0f64,
    ) {
        let pace = Pace::new(speed >> shifts.0, acceleration >> shifts.1, jerk >> shifts.2);
        let u = (u * 2.0 * pace.speed as f64).round() as i64;
        let e = (e * pace.acceleration as f64).round() as i64;
        if let Some((rule, u32, e32)) = pace.narrow(u, e) {
            let (wide, u64, e64) = (pace.wide(), Wide(u), Wide(e));
            let stop = rule.stopping_distance(u32, e32).0;
            prop_assert_eq!(i64::from(stop), wide.stopping_distance(u64, e64).0);
            prop_assert_eq!(i64::from(rule.brake(u32, e32).0), wide.brake(u64, e64).0);
            prop_assert_eq!(i64::from(rule.easing(e32).0), wide.easing(e64).0);
        }
    }
}

/// Applies the definition: the highest acceleration that is allowed, by halving.
fn next_by_halving(pace: &Pace, u: i64, e: i64, ahead: i64, fastest: i64) -> i64 {
    let allowed = |e: i64| {
        let end = u + e;
        let too_fast = e > 0 && end + pace.easing(e) > fastest;
        !too_fast && u + end + pace.stopping_distance(end, e) <= ahead
    };
    let highest = (e + pace.jerk).min(pace.acceleration);
    if allowed(highest) {
        return highest;
    }
    let (mut good, mut bad) = (pace.brake(u, e), highest);
    while bad - good > 1 {
        let middle = good + (bad - good) / 2;
        if allowed(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}

#[test]
fn ordinary_stage_is_narrow() {
    // 80 steps/mm, 100 mm/s, 2 m/s², 50 m/s³ with words at 1 MHz.
    let pace = Pace::new(68_719, 1_374, 34);
    assert!(pace.is_narrow, "{pace:?}");
}
