//! Only the commanded axes move, in the commanded direction, within the window and the travel.

use super::{denial, frame, setpoint, status, twin, wait};
use trinocular_client::stage::{configuration, default_stage};
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Denial, Mounting, Side};
use trinocular_core::safety::{Inputs, State, Trust};
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::{HomeSwitch, Stage};

fn jog(mm: [f64; 3]) -> Command {
    Command::Jog {
        distance_um: mm.map(|mm| (1_000.0 * mm) as i32),
    }
}

fn config(stage: &Stage) -> Command {
    Command::Config(configuration(stage, Mounting::OnStage).unwrap())
}

/// Returns a stage with an X travel of 10 to 110 mm that stands outside it after a zero.
fn outside() -> Twin {
    let mut stage = default_stage();
    stage.travel_mm[0] = [10.0, 110.0];
    Twin::start(&stage, "twin", Mounting::OnStage).unwrap()
}

/// Waits for rest; returns the motion of each axis since `before`, steps, and the highest speed of
/// X, mm/s.
fn finish(twin: &mut Twin, before: [i64; 3]) -> ([i64; 3], f64) {
    let mut fastest = 0.0_f64;
    let mut last = twin.position_mm()[0];
    for _ in 0..600 {
        wait(twin, 10);
        let at = twin.position_mm()[0];
        fastest = fastest.max((at - last).abs() / 0.01);
        last = at;
    }
    assert!(!status(twin).state.is_moving());
    let after = twin.steps();
    (std::array::from_fn(|i| after[i] - before[i]), fastest)
}

#[test]
fn jog_from_outside_moves_one_axis() {
    let mut twin = outside();
    let before = twin.steps();
    twin.command("jog", jog([0.0, 1.0, -2.0])).unwrap();
    assert_eq!(finish(&mut twin, before).0, [0, 80, -160]);
}

#[test]
fn jog_from_outside_is_slow() {
    let mut twin = outside();
    let outwards = denial(twin.command("jog", jog([-1.0, 0.0, 0.0])));
    assert_eq!(outwards, Denial::OutsideTravel { axis: 0 });
    let before = twin.steps();
    twin.command("jog", jog([4.0, 0.0, 0.0])).unwrap();
    let (way, fastest) = finish(&mut twin, before);
    assert_eq!(way, [320, 0, 0]);
    assert!(fastest < 5.3, "{fastest} mm/s");
    // The axis is inside again: it moves at full speed and is clamped at the far end.
    twin.command("jog", jog([7.0, 0.0, 0.0])).unwrap();
    finish(&mut twin, before);
    twin.command("jog", jog([500.0, 0.0, 0.0])).unwrap();
    let (way, fastest) = finish(&mut twin, before);
    assert_eq!(way, [8_800, 0, 0]);
    assert!(fastest > 90.0, "{fastest} mm/s");
}

/// A narrower configuration leaves the stage at its position; setpoints lead inwards only.
#[test]
fn narrower_travel_moves_nothing() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&mut twin, 2_000);
    let mut stage = default_stage();
    stage.travel_mm[0] = [-20.0, 20.0];
    twin.command("config", config(&stage)).unwrap();
    let before = twin.steps();
    twin.command("jog", jog([0.0, 0.0, 1.0])).unwrap();
    assert_eq!(finish(&mut twin, before).0, [0, 0, 80]);
    let farther = denial(twin.command("setpoint", setpoint([55, 0, 1])));
    assert_eq!(farther, Denial::OutsideTravel { axis: 0 });
    twin.command("setpoint", setpoint([50, 3, 1])).unwrap();
    assert_eq!(finish(&mut twin, before).0, [0, 240, 80]);
    twin.command("setpoint", setpoint([-30, 3, 1])).unwrap();
    // The axis moves from 50 to -20 mm at the speed for an unknown position.
    wait(&mut twin, 10_000);
    assert_eq!(finish(&mut twin, before).0, [-5_600, 240, 80]);
}

#[test]
fn no_target_is_followed_from_outside() {
    let mut twin = outside();
    wait(&mut twin, 500);
    let ago = |ms: u64| Instant::from_micros(twin.now().micros() - 1_000 * ms);
    let still = frame([0.0; 3], ago(20), ago(100));
    let denied = denial(twin.command("frame", still));
    assert_eq!(denied, Denial::OutsideTravel { axis: 0 });
    assert_eq!(twin.steps(), [0; 3]);
}

/// Homing of a homed stage is stopped in its search, beyond the soft limit.
#[test]
fn stopped_homing_moves_no_axis() {
    let mut stage = default_stage();
    let side = Side::Negative;
    let position_mm = -66.0;
    stage.care.home[0] = Some(HomeSwitch { side, position_mm });
    let mut twin = Twin::start(&stage, "twin", Mounting::OnStage).unwrap();
    twin.command("setpoint", setpoint([-59, 0, 0])).unwrap();
    wait(&mut twin, 2_000);
    let axes = [true, false, false];
    twin.command("home", Command::Home { axes }).unwrap();
    wait(&mut twin, 500);
    twin.command("stop", Command::Stop).unwrap();
    wait(&mut twin, 500);
    twin.command("reset", Command::Reset).unwrap();
    let before = twin.steps();
    assert!(before[0] < -60 * 80, "beyond the soft limit");
    twin.command("jog", jog([0.0, 1.0, 0.0])).unwrap();
    assert_eq!(finish(&mut twin, before).0, [0, 80, 0]);
}

/// During a move, a jog of another axis lets the first one continue to its goal.
#[test]
fn jog_keeps_goals_of_other_axes() {
    let mut twin = twin();
    let before = twin.steps();
    twin.command("jog", jog([20.0, 0.0, 0.0])).unwrap();
    wait(&mut twin, 60);
    twin.command("jog", jog([0.0, 3.0, 0.0])).unwrap();
    assert_eq!(finish(&mut twin, before).0, [1_600, 240, 0]);
}

/// A jog shorter than the braking distance ends at that distance and does not return.
#[test]
fn short_jog_in_move_does_not_return() {
    let mut twin = twin();
    twin.command("jog", jog([50.0, 0.0, 0.0])).unwrap();
    wait(&mut twin, 200);
    twin.command("jog", jog([0.5, 0.0, 0.0])).unwrap();
    let mut last = twin.steps()[0];
    for _ in 0..1_000 {
        wait(&mut twin, 1);
        let at = twin.steps()[0];
        assert!(at >= last, "X turned round");
        last = at;
    }
    assert_eq!(status(&mut twin).state, State::Idle);
}

/// One axis stands on its switch, between two steps. The others can move at any time.
#[test]
fn axis_on_switch_holds_no_other() {
    for moment in 0..60 {
        let mut twin = twin();
        twin.command("jog", jog([5.0, 0.0, 0.0])).unwrap();
        twin.advance(twin.now().plus_micros(20_000 + 337 * moment));
        twin.set_switches(Inputs {
            limits: [[false, true], [false; 2], [false; 2]],
            ..Inputs::default()
        });
        wait(&mut twin, 110);
        twin.command("reset", Command::Reset).unwrap();
        let before = twin.steps();
        for y in [1.0, -1.0] {
            twin.command("jog", jog([0.0, y, 0.0])).unwrap();
            wait(&mut twin, 500);
        }
        assert_eq!(twin.steps(), before);
        let onto = denial(twin.command("jog", jog([1.0, 0.0, 0.0])));
        assert_eq!(onto, Denial::LimitSwitch);
        twin.command("jog", jog([-1.0, 0.0, 0.0])).unwrap();
    }
}

/// A jog does not take up the backlash of an axis that it does not name.
#[test]
fn backlash_of_unnamed_axis_stays() {
    let mut stage = default_stage();
    stage.care.backlash_mm = [0.5, 0.3, 0.0];
    let mut twin = Twin::start(&stage, "twin", Mounting::OnStage).unwrap();
    for x in [2.0, -1.0, 0.1, -0.05] {
        twin.command("jog", jog([x, 0.0, 0.0])).unwrap();
        wait(&mut twin, 37);
        twin.command("stop", Command::Stop).unwrap();
        wait(&mut twin, 500);
        twin.command("reset", Command::Reset).unwrap();
        let before = twin.steps();
        twin.command("jog", jog([0.0, x, 0.0])).unwrap();
        wait(&mut twin, 1_000);
        assert_eq!(twin.steps()[0], before[0], "X after {x}");
    }
}

/// Before a home or zero the stage always stays within 10 mm of its position at power-on.
#[test]
fn window_stays_at_power_on() {
    let narrow = [0, 1, 2, 3];
    for kind in narrow {
        let mut twin = Twin::power_on(&default_stage(), "twin").unwrap();
        let mut stage = default_stage();
        stage.care.home[0] = Some(HomeSwitch {
            side: Side::Positive,
            position_mm: 70.0,
        });
        twin.command("config", config(&stage)).unwrap();
        for round in 0..5 {
            let _ = twin.command("jog", jog([10.0, 0.0, 0.0]));
            wait(&mut twin, 1_950);
            match kind {
                // Force an abrupt stop.
                0 => {
                    let emergency_stop = true;
                    twin.set_switches(Inputs {
                        emergency_stop,
                        ..Inputs::default()
                    });
                    wait(&mut twin, 20);
                    twin.set_switches(Inputs::default());
                    wait(&mut twin, 110);
                    twin.command("reset", Command::Reset).unwrap();
                }
                // Invert another axis.
                1 => {
                    wait(&mut twin, 1_000);
                    stage.invert[1] = !stage.invert[1];
                    twin.command("config", config(&stage)).unwrap();
                }
                // Configure a finer scale, which makes the distance appear shorter.
                2 => {
                    wait(&mut twin, 1_000);
                    stage.steps_per_mm = [80.0 * f64::from(round + 2); 3];
                    twin.command("config", config(&stage)).unwrap();
                }
                // Switch the motors off for a while.
                _ => {
                    wait(&mut twin, 1_000);
                    twin.command("motors", Command::Motors { on: false })
                        .unwrap();
                    twin.command("motors", Command::Motors { on: true })
                        .unwrap();
                }
            }
        }
        assert_eq!(status(&mut twin).trust, Trust::Unknown);
        let farthest = twin.position_mm()[0];
        assert!(farthest <= 10.02, "kind {kind}: {farthest} mm");
    }
}

/// The frames show a target at rest: even at nine million steps the stage stays at rest.
#[test]
fn far_still_target_moves_nothing() {
    let mut stage = default_stage();
    stage.steps_per_mm = [50_000.0; 3];
    stage.max_speed_mm_s = [8.0; 3];
    stage.max_acceleration_mm_s2 = [400.0; 3];
    stage.max_jerk_mm_s3 = [40_000.0; 3];
    stage.travel_mm = [[-200.0, 200.0]; 3];
    let mut twin = Twin::start(&stage, "twin", Mounting::OnStage).unwrap();
    for far in [180, -180] {
        twin.command("setpoint", setpoint([far, 0, 0])).unwrap();
        wait(&mut twin, 50_000);
        let before = twin.steps();
        assert_eq!(before[0], i64::from(far) * 50_000);
        let reference = Instant::from_micros(twin.now().micros() - 30_000);
        for _ in 0..60 {
            let capture = Instant::from_micros(twin.now().micros() - 20_000);
            twin.send(frame([0.0; 3], capture, reference));
            wait(&mut twin, 16);
        }
        wait(&mut twin, 500);
        let way = twin.steps()[0] - before[0];
        assert!(way.abs() < 2, "{way} steps");
    }
}
