//! Motors are switched on and off by command, and never while the stage moves.

use super::{denial, frame, setpoint, status, twin, wait};
use trinocular_client::stage::default_stage;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Denial, Mounting};
use trinocular_core::safety::{Inputs, State, Trust};
use trinocular_core::time::Instant;

const OFF: Command = Command::Motors { on: false };
const ON: Command = Command::Motors { on: true };

#[test]
fn motors_turn_on_with_first_config() {
    let mut twin = Twin::power_on(&default_stage(), "twin").unwrap();
    assert!(!status(&mut twin).motors);
    assert_eq!(denial(twin.command("motors", ON)), Denial::Unconfigured);
    let config = trinocular_client::stage::configuration(&default_stage(), Mounting::OnStage);
    let config = Command::Config(config.unwrap());
    twin.command("config", config).unwrap();
    assert!(status(&mut twin).motors);
    // Motors switched off by command stay off through any configuration.
    twin.command("motors", OFF).unwrap();
    twin.command("config", config).unwrap();
    assert!(!status(&mut twin).motors);
}

#[test]
fn stage_rests_while_motors_are_off() {
    let mut twin = twin();
    twin.command("motors", OFF).unwrap();
    let off = status(&mut twin);
    assert!(!off.motors);
    assert_eq!(off.trust, Trust::Degraded, "they can be moved by hand");
    let jog = Command::Jog {
        distance_um: [1_000, 0, 0],
    };
    for command in [jog, setpoint([1, 1, 1]), Command::Zero] {
        assert_eq!(denial(twin.command("move", command)), Denial::MotorsOff);
    }
    assert_eq!(twin.steps(), [0; 3]);
    twin.command("motors", ON).unwrap();
    twin.command("zero", Command::Zero).unwrap();
    twin.command("jog", jog).unwrap();
    wait(&mut twin, 200);
    assert_eq!(twin.steps(), [80, 0, 0]);
}

#[test]
fn motors_are_not_switched_in_motion() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([20, 0, 0])).unwrap();
    wait(&mut twin, 50);
    assert_eq!(denial(twin.command("motors", OFF)), Denial::Moving);
    wait(&mut twin, 1_000);
    assert_eq!(twin.steps(), [1_600, 0, 0]);
}

#[test]
fn motors_stay_off_while_stop_is_pressed() {
    let mut twin = twin();
    twin.set_switches(Inputs {
        emergency_stop: true,
        ..Inputs::default()
    });
    wait(&mut twin, 5);
    twin.command("motors", OFF).unwrap();
    assert_eq!(denial(twin.command("motors", ON)), Denial::CauseRemains);
}

#[test]
fn motors_turn_off_after_rest() {
    let mut stage = default_stage();
    stage.care.motors_off_after_s = 2;
    let mut twin = Twin::start(&stage, "twin", Mounting::OnStage).unwrap();
    wait(&mut twin, 1_500);
    twin.command("setpoint", setpoint([1, 0, 0])).unwrap();
    // The move took 0.13 s at most; the time runs from its end.
    wait(&mut twin, 1_900);
    assert!(status(&mut twin).motors);
    wait(&mut twin, 300);
    let off = status(&mut twin);
    assert_eq!((off.motors, off.trust), (false, Trust::Degraded));
}

#[test]
fn following_without_frames_is_rest() {
    let mut stage = default_stage();
    stage.care.motors_off_after_s = 2;
    let mut twin = Twin::start(&stage, "twin", Mounting::OnStage).unwrap();
    wait(&mut twin, 500);
    let reference = Instant::from_micros(twin.now().micros() - 90_000);
    for _ in 0..60 {
        let capture = Instant::from_micros(twin.now().micros() - 20_000);
        twin.command("frame", frame([0.0; 3], capture, reference))
            .unwrap();
        wait(&mut twin, 50);
    }
    let following = status(&mut twin);
    assert_eq!(
        (following.state, following.motors),
        (State::Following, true)
    );
    wait(&mut twin, 2_500);
    let off = status(&mut twin);
    assert_eq!((off.state, off.motors), (State::Idle, false));
    assert_eq!(off.trust, Trust::Degraded);
}
