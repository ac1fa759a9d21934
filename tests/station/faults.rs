//! Faults are complete, ranked, and named before they can be cleared.

use super::{denial, setpoint, status, twin, wait};
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Denial};
use trinocular_core::safety::{Fault, Faults, Inputs, State, Trust};

const RELEASED: Inputs = Inputs {
    limits: [[false; 2]; 3],
    emergency_stop: false,
    driver_fault: false,
    words_emitted: 0,
    trigger_losses: 0,
};

const PRESSED: Inputs = Inputs {
    emergency_stop: true,
    ..RELEASED
};

const OVERHEATED: Inputs = Inputs {
    driver_fault: true,
    ..RELEASED
};

fn set(faults: &[Fault]) -> Faults {
    faults.iter().copied().collect()
}

/// Returns a station whose host fell silent in mid-move and has returned.
fn silent_host() -> Twin {
    let mut twin = twin();
    twin.command("setpoint", setpoint([10, 0, 0])).unwrap();
    wait(&mut twin, 20);
    twin.set_pings(false);
    wait(&mut twin, 400);
    twin.set_pings(true);
    assert_eq!(status(&mut twin).fault, Some(Fault::Heartbeat));
    twin
}

/// Whichever fault was latched first, the worst one is shown, and its cause must go before a reset.
#[test]
fn worst_fault_is_shown() {
    for (pressed, worse) in [(PRESSED, Fault::EmergencyStop), (OVERHEATED, Fault::Driver)] {
        let mut twin = silent_host();
        twin.set_switches(pressed);
        let shown = status(&mut twin);
        assert_eq!(shown.fault, Some(worse));
        assert_eq!(shown.faults, set(&[Fault::Heartbeat, worse]));
        let at = twin.steps();
        assert_eq!(
            denial(twin.command("reset", Command::Reset)),
            Denial::CauseRemains
        );
        twin.send(Command::Reset);
        twin.send(setpoint([20, 0, 0]));
        wait(&mut twin, 50);
        assert_eq!(twin.steps(), at, "no step while the cause is there");
        twin.set_switches(RELEASED);
        wait(&mut twin, 2);
        // Both faults are still latched.
        assert_eq!(status(&mut twin).faults, set(&[Fault::Heartbeat, worse]));
        twin.command("reset", Command::Reset).unwrap();
        let cleared = status(&mut twin);
        assert_eq!((cleared.fault, cleared.faults), (None, Faults::NONE));
    }
}

/// The cause of one fault is gone and that of the other is not, so the reset is refused.
#[test]
fn reset_needs_every_cause_gone() {
    let mut twin = twin();
    twin.set_switches(PRESSED);
    wait(&mut twin, 5);
    twin.set_switches(Inputs {
        driver_fault: true,
        ..PRESSED
    });
    wait(&mut twin, 5);
    for switches in [OVERHEATED, PRESSED] {
        twin.set_switches(switches);
        wait(&mut twin, 5);
        let denied = denial(twin.command("reset", Command::Reset));
        assert_eq!(denied, Denial::CauseRemains);
    }
    twin.set_switches(RELEASED);
    wait(&mut twin, 5);
    twin.command("reset", Command::Reset).unwrap();
}

/// A limit switch trips at full speed, and a reset that was sent before arrives in the same tick.
#[test]
fn fault_is_named_before_reset() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([30, 0, 0])).unwrap();
    wait(&mut twin, 100);
    twin.advance(twin.now().plus_micros(200));
    twin.set_switches(Inputs {
        limits: [[false, true], [false; 2], [false; 2]],
        ..RELEASED
    });
    let reset = twin.send(Command::Reset);
    let jog = twin.send(Command::Jog {
        distance_um: [-1_000, 0, 0],
    });
    wait(&mut twin, 2);
    assert_eq!(twin.answer(reset), Some(Err(Denial::FaultUnread)));
    assert_eq!(twin.answer(jog), Some(Err(Denial::Faulted)));
    let shown = *twin.status().unwrap();
    assert_eq!(shown.fault, Some(Fault::Limit));
    assert_eq!(
        (shown.state, shown.trust),
        (State::Faulted, Trust::Degraded)
    );
    // Now a status has named the fault.
    twin.command("reset", Command::Reset).unwrap();
    let off = [-1_000, 0, 0];
    twin.command("jog", Command::Jog { distance_um: off })
        .unwrap();
}

/// A contact bounces while the fault is being cleared: the press falls into the tick of the reset.
#[test]
fn press_in_tick_of_reset_counts() {
    for pressed in [PRESSED, OVERHEATED] {
        let mut twin = twin();
        twin.set_switches(pressed);
        wait(&mut twin, 5);
        twin.set_switches(RELEASED);
        wait(&mut twin, 120);
        for bounce in [pressed, RELEASED] {
            twin.set_switches(bounce);
            twin.advance(twin.now().plus_micros(200));
        }
        let reset = twin.send(Command::Reset);
        let moves = twin.send(setpoint([1, 0, 0]));
        wait(&mut twin, 100);
        assert_eq!(twin.answer(reset), Some(Err(Denial::CauseRemains)));
        assert_eq!(twin.answer(moves), Some(Err(Denial::Faulted)));
        assert_eq!(twin.steps(), [0; 3]);
        twin.command("reset", Command::Reset).unwrap();
    }
}

#[test]
fn limit_in_silence_ramp_is_shown() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&mut twin, 300);
    twin.set_pings(false);
    while twin.status().unwrap().fault.is_none() {
        wait(&mut twin, 1);
    }
    twin.set_switches(Inputs {
        limits: [[false, true], [false; 2], [false; 2]],
        ..RELEASED
    });
    wait(&mut twin, 110);
    let shown = twin.status().unwrap();
    assert_eq!(shown.faults, set(&[Fault::Heartbeat, Fault::Limit]));
    assert_eq!(
        (shown.fault, shown.trust),
        (Some(Fault::Limit), Trust::Degraded)
    );
}

#[test]
fn zero_is_refused_with_a_fault() {
    let mut twin = silent_host();
    assert_eq!(denial(twin.command("zero", Command::Zero)), Denial::Faulted);
    twin.set_switches(PRESSED);
    wait(&mut twin, 5);
    assert_eq!(denial(twin.command("zero", Command::Zero)), Denial::Faulted);
    twin.set_switches(RELEASED);
    wait(&mut twin, 5);
    twin.command("reset", Command::Reset).unwrap();
    twin.command("zero", Command::Zero).unwrap();
}
