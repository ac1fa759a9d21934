use super::super::Pursuit;
use super::super::{Settings, Target};
use super::*;

const REACH: KinematicLimits = KinematicLimits {
    speed: 8.0,
    acceleration: 0.16,
    jerk: 0.004,
};

/// Returns the target after two seconds of frames every `every_ms`, 20 ms late, with the station's
/// ticks between them. The stage is where it should be.
fn followed(place: impl Fn(f64) -> f64, every_ms: u64) -> Target {
    let mut pursuit = Pursuit::default();
    let settings = Settings::DEFAULT;
    let fine_at = |ms: u64| (place(ms as f64) * 4_294_967_296.0) as i64;
    for ms in 0..2_000u64 {
        let now = Instant::from_micros((ms + 20) * 1_000);
        let at = now.plus_micros(512);
        if ms % every_ms == 0 {
            let measurement = Measurement {
                capture: Instant::from_micros(ms * 1_000),
                position: [fine_at(ms); 3],
                variance: [0.1; 3],
            };
            let _ = pursuit.measure(now, &measurement, &[REACH; 3], &settings);
            pursuit.aim(at, &[REACH; 3], &settings);
        } else {
            pursuit.work(&[REACH; 3]);
            let stage = [fine_at(ms + 20); 3];
            pursuit.swing(at, stage, &[REACH; 3], &settings);
        }
    }
    pursuit.target.expect("a target")
}

fn lead(target: &Target) -> [bool; 3] {
    target.axes.map(|axis| axis.swings)
}

fn sine(ms: f64) -> f64 {
    40.0 * libm::sin(ms * core::f64::consts::TAU / 200.0)
}

#[test]
fn oscillator_leads_swing() {
    assert_eq!(lead(&followed(sine, 16)), [true; 3]);
}

#[test]
fn filter_leads_still_and_steady_targets() {
    // Plus or minus a third of a step.
    let noise = |ms: f64| libm::fmod(ms * 7.31, 1.0) * 0.66 - 0.33;
    assert_eq!(lead(&followed(noise, 16)), [false; 3]);
    assert_eq!(lead(&followed(|ms| 3.0 * ms + noise(ms), 16)), [false; 3]);
}

/// The oscillators learn although every tick has a frame.
#[test]
fn frames_in_every_tick_are_thinned_out() {
    assert_eq!(lead(&followed(sine, 1)), [true; 3]);
}

/// The goal is the line on which a stage comes out that has the target's motion a tick later and
/// then reduces its acceleration.
#[test]
fn goal_leads_to_motion_of_target() {
    let mut target = followed(sine, 16);
    let [axis, ..] = &mut target.axes;
    let swing = &mut axis.swing;
    let at = swing.capture.plus_micros(30_000);
    swing.gain = 1.0;
    let aim = swing.aim(at, REACH);
    let motion = swing.next(at);
    // Ramp down in small steps of time.
    let (mut place, mut speed) = (0.0f64, f64::from(motion.velocity));
    let mut acceleration = f64::from(motion.acceleration);
    let (step, sign) = (0.001, acceleration.signum());
    let mut time = 0.0;
    while acceleration * sign > 0.0 {
        acceleration -= sign * f64::from(REACH.jerk) * step;
        speed += acceleration * step;
        place += speed * step;
        time += step;
    }
    assert!(
        (speed - f64::from(aim.velocity)).abs() < 1e-3,
        "{speed} {aim:?}"
    );
    let goal = f64::from(steps(aim.position - motion.position)) + speed * (time + 1.0);
    assert!((place - goal).abs() < 1e-2, "{place} {goal}");
}

/// Beyond the stage's jerk only a share of the swing is made.
#[test]
fn gain_respects_jerk() {
    let mut target = followed(sine, 16);
    let [axis, ..] = &mut target.axes;
    let slow = KinematicLimits {
        jerk: 0.001,
        ..REACH
    };
    axis.swing.gain = 1.0;
    let at = axis.swing.capture.plus_micros(30_000);
    for _ in 0..1_000 {
        axis.swing.steer(at, 0, slow);
    }
    let share = axis.swing.gain;
    // 40 steps at 5 Hz need 0.00124 steps/ms³.
    assert!((0.3..0.8).contains(&share), "{share}");
    axis.swing.steer(
        at,
        0,
        KinematicLimits {
            jerk: 0.01,
            ..REACH
        },
    );
    assert_eq!(axis.swing.gain, 1.0);
}

/// A swing that loses its stiffness between two ticks is no division by zero.
#[test]
fn swing_without_stiffness_has_no_centre() {
    let mut target = followed(sine, 16);
    let [axis, ..] = &mut target.axes;
    let swing = &mut axis.swing;
    swing.gain = 0.5;
    let motion = Motion {
        stiffness: 0.0,
        ..swing.next(swing.capture)
    };
    assert!(motion.acceleration != 0.0);
    let aim = swing.goal(&motion, REACH);
    let off = steps(aim.position.saturating_sub(motion.position));
    assert!(off.abs() < 100.0 && aim.velocity.abs() < 10.0, "{aim:?}");
}
