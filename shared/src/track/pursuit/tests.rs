use super::*;
use proptest::prelude::*;

fn any_measurement() -> impl Strategy<Value = Measurement> {
    any::<(u64, StepVector, [f32; 3])>().prop_map(|(capture, position, variance)| Measurement {
        capture: Instant::from_micros(capture),
        position,
        variance,
    })
}

const REACH: [KinematicLimits; 3] = [KinematicLimits {
    speed: 8.0,
    acceleration: 0.16,
    jerk: 0.004,
}; 3];

/// Returns a measurement with the same position on all axes, `ms` ms after the start.
fn seen(ms: u64, steps: i64) -> Measurement {
    Measurement {
        capture: Instant::from_micros(ms * 1_000),
        position: [steps << 32; 3],
        variance: [0.1; 3],
    }
}

fn measure(pursuit: &mut Pursuit, measurement: &Measurement) -> Result<(), Outlier> {
    pursuit.measure(measurement.capture, measurement, &REACH, &Settings::DEFAULT)
}

/// Returns a pursuit after one second at a still target.
fn settled() -> Pursuit {
    let mut pursuit = Pursuit::default();
    for k in 1..=60 {
        assert_eq!(measure(&mut pursuit, &seen(16 * k, 0)), Ok(()));
    }
    pursuit
}

impl Pursuit {
    fn filters(&self) -> Option<[Filter; 3]> {
        self.target
            .as_ref()
            .map(|target| target.axes.map(|axis| axis.filter))
    }
}

proptest! {
    /// Feeds any measurements, in any order and at any time.
    #[test]
    fn every_aim_is_finite(
        reach in any::<[[f32; 3]; 3]>(), prediction: bool, coast_ms: u16,
        measurements in prop::collection::vec((any_measurement(), any::<[u64; 2]>()), 0..40),
    ) {
        let settings = Settings { prediction, coast_ms };
        let reach = reach.map(|[speed, acceleration, jerk]| KinematicLimits {
            speed,
            acceleration,
            jerk,
        });
        let mut pursuit = Pursuit::default();
        for (measurement, [now, at]) in measurements {
            let _ = pursuit.measure(Instant::from_micros(now), &measurement, &reach, &settings);
            let at = Instant::from_micros(at);
            let aims = pursuit.aim(at, &reach, &settings);
            pursuit.work(&reach);
            let swings = pursuit.swing(at, measurement.position, &reach, &settings);
            for aim in aims.into_iter().flatten().chain(swings.into_iter().flatten()) {
                prop_assert!(aim.velocity.is_finite());
            }
            pursuit.lose(at, &settings);
        }
    }
}

#[test]
fn second_agreeing_outlier_is_jump() {
    let mut pursuit = settled();
    let before = pursuit.filters();
    // 5 mm.
    assert_eq!(measure(&mut pursuit, &seen(976, 400)), Err(Outlier));
    assert_eq!(pursuit.filters(), before);
    // Neither near the last outlier nor near the prediction.
    assert_eq!(measure(&mut pursuit, &seen(992, -400)), Err(Outlier));
    assert_eq!(pursuit.filters(), before);
    assert_eq!(measure(&mut pursuit, &seen(1_008, -400)), Ok(()));
    let positions = pursuit
        .filters()
        .map(|axes| axes.map(|axis| axis.position()));
    assert_eq!(positions, Some([-400 << 32; 3]));
}

#[test]
fn expected_frame_clears_suspicion() {
    let mut pursuit = settled();
    assert_eq!(measure(&mut pursuit, &seen(976, 400)), Err(Outlier));
    assert_eq!(measure(&mut pursuit, &seen(992, 0)), Ok(()));
    assert_eq!(measure(&mut pursuit, &seen(1_008, 400)), Err(Outlier));
}

#[test]
fn slow_frames_keep_target_in_sight() {
    let mut pursuit = Pursuit::default();
    for k in 1..=20 {
        assert_eq!(measure(&mut pursuit, &seen(200 * k, 0)), Ok(()));
        let before = Instant::from_micros((200 * k + 199) * 1_000);
        // The first interval must be known.
        let expected = if k == 1 {
            Sight::Coasting
        } else {
            Sight::Tracking
        };
        assert_eq!(pursuit.sight(before), expected);
    }
    let late = |ms: u64| Instant::from_micros((4_000 + ms) * 1_000);
    assert_eq!(pursuit.sight(late(500)), Sight::Tracking);
    assert_eq!(pursuit.sight(late(501)), Sight::Coasting);
}

#[test]
fn target_coasts_then_is_lost_once() {
    let mut pursuit = settled();
    let last = Instant::from_micros(960_000);
    let after = |ms: u64| last.plus_micros(ms * 1_000);
    assert_eq!(Pursuit::default().sight(last), Sight::None);
    assert_eq!(pursuit.sight(after(100)), Sight::Tracking);
    assert_eq!(pursuit.sight(after(101)), Sight::Coasting);
    assert!(!pursuit.lose(after(800), &Settings::DEFAULT));
    assert!(pursuit.lose(after(801), &Settings::DEFAULT));
    assert!(!pursuit.lose(after(802), &Settings::DEFAULT));
    assert_eq!(pursuit.sight(after(900)), Sight::Lost);
    assert_eq!(pursuit.age_us(after(900)), 900_000);
    assert_eq!(pursuit.aim(after(900), &REACH, &Settings::DEFAULT), None);
    assert_eq!(measure(&mut pursuit, &seen(9_000, 3)), Ok(()));
    assert_eq!(pursuit.sight(after(8_100)), Sight::Tracking);
}
