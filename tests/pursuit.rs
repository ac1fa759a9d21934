//! Frame sets from outside, followed by a station whose stage carries the cameras: `track
//! --cameras` without cameras. The twin is the station, so the tests wait for no real time.

use trinocular::servo::frame_sets::{CaptureClock, FrameSetServo};
use trinocular::servo::station_link::{StationLink, StationPlace};
use trinocular::servo::visual_servo::ServoOutcome;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_core::rig::Rig;
use trinocular_core::safety::Trust;
use trinocular_vision::flow::CameraRefusal;
use trinocular_vision::images::{FrameSet, Image, Scene, SceneSettings, Texture};
use trinocular_vision::sums::Estimator;

const PERIOD_US: u64 = 33_333;

/// Final position of the target, mm.
const TARGET_MM: [f64; 3] = [4.0, -3.0, 1.5];
const WAY_US: u64 = 2_000_000;

/// Largest distance of the cameras from the target at rest, mm: the project's bound for Table 6.
const BOUND_MM: [f64; 3] = [0.02, 0.02, 0.05];

struct Bench {
    scene: Scene,
    servo: FrameSetServo,
}

impl Bench {
    fn new(clock: CaptureClock) -> Self {
        let rig = Rig::paper();
        let stage = default_stage();
        let station = StationLink::start_as(StationPlace::Twin, &stage, Mounting::OnStage);
        let station = station.expect("a station");
        let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default());
        Self {
            scene: scene.expect("a scene"),
            servo: FrameSetServo::new(&rig, Estimator::Midpoint, clock, station).expect("a rig"),
        }
    }

    /// Renders the frame set of a target at `target_mm`.
    fn capture(&self, target_mm: [f64; 3], time_us: u64) -> FrameSet {
        let camera_mm = self.servo.station().position_mm();
        let relative_mm = std::array::from_fn(|i| target_mm[i] - camera_mm[i]);
        self.scene.render(relative_mm, time_us, time_us)
    }
}

#[test]
fn cameras_on_stage_stay_with_target() {
    let mut bench = Bench::new(CaptureClock::Virtual {
        latency_us: 20_000,
        period_us: PERIOD_US,
    });
    let (mut used, mut refused) = (0, Vec::new());
    for number in 0..100 {
        let time_us = number * PERIOD_US;
        let share = time_us.min(WAY_US) as f64 / WAY_US as f64;
        let capture = bench.capture(TARGET_MM.map(|mm| share * mm), time_us);
        let followed = bench.servo.follow(&capture).expect("a station");
        match followed.map(|followed| followed.turn.outcome) {
            None => assert_eq!(number, 0),
            Some(ServoOutcome::Used(_)) => used += 1,
            Some(other) => refused.push(other),
        }
    }
    assert!(used >= 95, "{used} used: {refused:?}");
    let rest_mm = bench.servo.rest().expect("a station");
    let error_mm: [f64; 3] = std::array::from_fn(|i| rest_mm[i] - TARGET_MM[i]);
    println!("{used} used, {error_mm:.4?} mm off at rest");
    for (error_mm, bound_mm) in error_mm.into_iter().zip(BOUND_MM) {
        assert!(error_mm.abs() <= bound_mm, "{rest_mm:?}");
    }
}

/// The target is followed at its speed, so the stage is moving when the images end.
#[test]
fn stop_ends_motion_of_last_frame() {
    const SPEED_MM_S: f64 = 12.0;
    let end = |stop: bool| {
        let mut bench = Bench::new(CaptureClock::Virtual {
            latency_us: 20_000,
            period_us: PERIOD_US,
        });
        let mut last_mm = 0.0;
        for number in 0..40 {
            let time_us = number * PERIOD_US;
            last_mm = SPEED_MM_S * time_us as f64 * 1e-6;
            let capture = bench.capture([last_mm, 0.0, 0.0], time_us);
            bench.servo.follow(&capture).expect("a station");
        }
        let rest_mm = match stop {
            true => bench.servo.stop(),
            false => bench.servo.rest(),
        };
        rest_mm.expect("a station")[0] - last_mm
    };
    let (stopped, ran_on) = (end(true), end(false));
    println!("{stopped:.3} mm beyond the last image's target after a stop, {ran_on:.3} without");
    // The bound is one period, the frame's latency, and the ramp.
    assert!((0.0..=1.0).contains(&stopped), "{stopped}");
    assert!(ran_on > 5.0, "{ran_on}");
}

/// The clock of the images is five seconds ahead. A frame stamped in the future would be refused, like
/// one whose time is really wrong.
#[test]
fn two_real_clocks_are_aligned() {
    const AHEAD_US: i64 = 5_000_000;
    let mut bench = Bench::new(CaptureClock::Real {
        offset_us: -AHEAD_US,
    });
    let mut outcomes = Vec::new();
    for number in 0..12 {
        // A frame takes two milliseconds of the twin's time.
        let now_us = bench.servo.station().now().micros() + AHEAD_US as u64;
        let late_us = if number == 8 { 1_000_000 } else { 0 };
        let mut capture = bench.capture([0.0; 3], now_us);
        capture.time_us += late_us;
        let followed = bench.servo.follow(&capture).expect("a station");
        outcomes.push(followed.map(|followed| followed.turn.outcome));
    }
    assert_eq!(outcomes[0], None);
    // No time has passed since the first.
    let refusal = |outcome: &ServoOutcome| outcome.refusal().unwrap_or_default();
    assert!(
        outcomes[1]
            .as_ref()
            .is_some_and(|outcome| refusal(outcome).contains("not after"))
    );
    for (number, outcome) in outcomes.iter().enumerate().skip(2) {
        match outcome {
            Some(late @ ServoOutcome::Unused(_)) if number == 8 => {
                assert!(refusal(late).contains("future"), "{late:?}");
            }
            Some(ServoOutcome::Used(estimate)) if number != 8 => {
                let [x, y, z] = estimate.displacement_mm;
                assert!(x.abs().max(y.abs()) < 0.02 && z.abs() < 0.05, "{outcome:?}");
            }
            other => panic!("{number}: {other:?}"),
        }
    }
}

/// From the fifth frame set on, one camera's image is missing: the other two follow the target, and
/// every row names the missing camera and states that the position can be trusted.
#[test]
fn lost_camera_is_named() {
    let mut bench = Bench::new(CaptureClock::Virtual {
        latency_us: 20_000,
        period_us: PERIOD_US,
    });
    for number in 0..10 {
        let mut capture = bench.capture([0.0; 3], number * PERIOD_US);
        if number >= 5 {
            capture.images[2] = Image::missing();
        }
        let followed = bench.servo.follow(&capture).expect("a station");
        let Some(followed) = followed else {
            assert_eq!(number, 0);
            continue;
        };
        let turn = followed.turn;
        assert_eq!(turn.trust, Trust::Homed);
        assert!(turn.outcome.is_used(), "{number}: {turn:?}");
        match turn.absent.as_slice() {
            [] => assert!(number < 5, "{number}: nothing said"),
            absent => assert!(
                number >= 5 && absent == [(2, CameraRefusal::Missing)],
                "{absent:?}"
            ),
        }
    }
}
