use super::*;
use proptest::prelude::*;

const CONFIG: AxisConfig = AxisConfig {
    steps_per_m: 80_000,
    max_speed_um_s: 100_000,
    max_acceleration_um_s2: 1_000_000,
    max_jerk_um_s3: 50_000_000,
    travel_um: [-150_001, 150_001],
    invert: false,
};

fn fault(config: AxisConfig) -> LimitFault {
    AxisLimits::new(&config, WordRate::MHZ_1).unwrap_err()
}

/// Returns the configuration with `value` in one field.
fn with(field: Field, value: i64) -> AxisConfig {
    let mut config = CONFIG;
    match field {
        Field::StepsPerM => config.steps_per_m = value as u32,
        Field::MaxSpeed => config.max_speed_um_s = value as u32,
        Field::MaxAcceleration => config.max_acceleration_um_s2 = value as u32,
        Field::MaxJerk => config.max_jerk_um_s3 = value as u32,
        Field::TravelLow => config.travel_um[0] = value as i32,
        Field::TravelHigh => config.travel_um[1] = value as i32,
    }
    config
}

/// The bound that is named is exact: the value itself is accepted, its neighbour is not.
#[test]
fn named_bound_is_the_edge() {
    let wrong = [
        (Field::StepsPerM, 0),
        (Field::MaxSpeed, 0),
        (Field::MaxSpeed, 1),
        (Field::MaxSpeed, 6_250_013),
        (Field::MaxAcceleration, 0),
        (Field::MaxAcceleration, 1_000),
        (Field::MaxJerk, 0),
        (Field::MaxJerk, 1_000_000),
        (Field::TravelHigh, -150_001),
        (Field::TravelHigh, -150_000),
    ];
    for hz in [64_000, 1_000_000, 16_000_000] {
        let rate = WordRate::from_hz(hz).unwrap();
        let check = |config: &AxisConfig| AxisLimits::new(config, rate);
        for (field, value) in wrong {
            // Only the slowest words forbid the speed of `CONFIG` itself.
            let Err(fault) = check(&with(field, value)) else {
                continue;
            };
            if fault.field != field {
                continue;
            }
            let (edge, beyond) = match fault.bound {
                Bound::AtLeast(least) => (least, least - 1),
                Bound::AtMost(most) => (most, most + 1),
            };
            let other = |outcome: Result<AxisLimits, LimitFault>| {
                outcome.map_or_else(|fault| fault.field != field, |_| true)
            };
            assert!(other(check(&with(field, edge))), "{hz} {field:?} {edge}");
            assert!(
                !other(check(&with(field, beyond))),
                "{hz} {field:?} {beyond}"
            );
        }
    }
}

#[test]
fn fault_names_field_and_bound() {
    let text = |config| std::format!("{}", fault(config));
    let cases = [
        (Field::StepsPerM, 0, "steps_per_m must be at least 1"),
        (Field::MaxSpeed, 0, "max_speed_um_s must be at least 2"),
        (
            Field::MaxSpeed,
            6_250_013,
            "max_speed_um_s must be at most 6250000",
        ),
        (
            Field::MaxAcceleration,
            1_000,
            "max_acceleration_um_s2 must be at least 1456",
        ),
        (
            Field::MaxJerk,
            1_000_000,
            "max_jerk_um_s3 must be at least 1455192",
        ),
        (
            Field::TravelHigh,
            -150_001,
            "travel_um[1] must be at least -150000",
        ),
    ];
    for (field, value, wanted) in cases {
        assert_eq!(text(with(field, value)), wanted);
    }
    let far = |travel_um| AxisConfig {
        steps_per_m: 2_000_000,
        max_speed_um_s: 1_000,
        travel_um,
        ..CONFIG
    };
    assert_eq!(
        text(far([0, 300_000_000])),
        "travel_um[1] must be at most 268435456"
    );
    assert_eq!(
        text(far([-300_000_000, 0])),
        "travel_um[0] must be at least -268435456"
    );
    assert!(AxisLimits::new(&far([-268_435_456, 268_435_456]), WordRate::MHZ_1).is_ok());
    assert_eq!(
        text(far([300_000_000, -1])),
        "travel_um[0] must be at most 268435456"
    );
    let at_the_end = AxisConfig {
        steps_per_m: 5,
        max_speed_um_s: 1_000_000,
        max_acceleration_um_s2: u32::MAX,
        max_jerk_um_s3: u32::MAX,
        travel_um: [i32::MAX - 1, i32::MAX],
        invert: false,
    };
    assert_ne!(fault(at_the_end).field, Field::TravelHigh);
    let coarse = AxisConfig {
        steps_per_m: 1,
        ..with(Field::MaxJerk, 1_000_000)
    };
    assert_eq!(fault(coarse).field, Field::MaxSpeed);
    let third = Limits::new(&[CONFIG, CONFIG, with(Field::MaxSpeed, 0)], WordRate::MHZ_1);
    assert_eq!(
        std::format!("{}", third.unwrap_err()),
        "axis 2: max_speed_um_s must be at least 2"
    );
}

#[test]
fn travel_is_rounded_inwards() {
    let limits = AxisLimits::new(&CONFIG, WordRate::MHZ_1).unwrap();
    // 12,000.08 steps in either direction.
    assert_eq!(limits.range(), [-12_000, 12_000]);
}

proptest! {
    // Slow words refuse one configuration in fifty.
    #![proptest_config(ProptestConfig {
        max_global_rejects: u32::MAX,
        ..ProptestConfig::default()
    })]

    #[test]
    fn limits_round_down_by_under_a_quantum(
        steps_per_m in 10_000..1_000_000u32, max_speed_um_s in 100..300_000u32,
        max_acceleration_um_s2 in 100_000..u32::MAX,
        max_jerk_um_s3 in 100_000_000..u32::MAX, slots in 4..=500u32,
    ) {
        let rate = WordRate::from_hz(8_000 * slots).unwrap();
        let config = AxisConfig {
            steps_per_m,
            max_speed_um_s,
            max_acceleration_um_s2,
            max_jerk_um_s3,
            travel_um: [-1_000, 1_000],
            invert: false,
        };
        let limits = AxisLimits::new(&config, rate);
        prop_assume!(limits.is_ok());
        let limits = limits.unwrap();
        // Steps per slot, per slot and tick, per slot and tick and tick, in fine units.
        let fine = |um: u32, ticks: i32| {
            f64::from(steps_per_m) * f64::from(um) * 1e-6 * 4_294_967_296.0
                / f64::from(rate.slots_per_s())
                / 1_000f64.powi(ticks)
        };
        let quantum = 2.0 * f64::from(rate.slots_per_tick());
        let cap = f64::from(limits.speed);
        for (value, exact) in [
            (limits.speed, fine(max_speed_um_s, 0)),
            (limits.acceleration, fine(max_acceleration_um_s2, 1)),
            (limits.jerk, fine(max_jerk_um_s3, 2)),
        ] {
            let (value, exact) = (f64::from(value), exact / quantum);
            let rounding = 1e-9 * exact;
            prop_assert!(value <= exact + rounding);
            prop_assert!(value + 1.0 > exact - rounding || value == cap);
        }
    }
}
