use super::*;
use crate::stage::default_stage;
use crate::twin::Twin;
use trinocular_core::frame::message::Mounting;
use trinocular_core::safety::State;

const JOG: Command = Command::Jog {
    distance_um: [1_000, 0, 0],
};

/// Makes a status at this tick and in this state; the rest is a real station's.
fn status(tick: u32, state: State) -> Status {
    let twin = Twin::start(&default_stage(), "twin", Mounting::OnStage).expect("it starts");
    let status = *twin.status().expect("it tells");
    Status {
        tick,
        state,
        ..status
    }
}

#[test]
fn later_status_at_rest_ends_motion() {
    let mut motion = Motion::default();
    motion.sent(7, &JOG);
    motion.told(&status(100, State::Idle));
    assert!(motion.may_go_on(), "its answer has not come");
    motion.answered(7, 200, false);
    motion.told(&status(199, State::Idle));
    assert!(motion.may_go_on(), "that was before the answer");
    motion.told(&status(200, State::Moving));
    assert!(motion.may_go_on());
    motion.told(&status(300, State::Stopping));
    assert!(motion.may_go_on());
    motion.told(&status(400, State::Idle));
    assert!(!motion.may_go_on());
}

#[test]
fn answer_to_any_stop_ends_motion() {
    let mut motion = Motion::default();
    motion.sent(7, &JOG);
    for sequence in [8, 10, 12] {
        motion.sent(sequence, &Command::Stop);
    }
    motion.answered(9, 100, false);
    assert!(motion.may_go_on() && motion.stopped_tick().is_none());
    motion.answered(10, 101, false);
    motion.answered(12, 102, false);
    assert!(!motion.may_go_on());
    assert_eq!(motion.stopped_tick(), Some(101));
}

#[test]
fn answered_stop_starts_ramp() {
    let mut motion = Motion::default();
    motion.sent(7, &JOG);
    motion.sent(8, &Command::Stop);
    assert!(!motion.is_on_its_ramp());
    motion.answered(8, 100, false);
    motion.told(&status(99, State::Idle));
    motion.told(&status(101, State::Stopping));
    assert!(motion.is_on_its_ramp());
    motion.sent(9, &Command::Stop);
    motion.answered(9, 102, false);
    motion.told(&status(200, State::Stopped));
    assert!(!motion.is_on_its_ramp());
}

#[test]
fn stop_before_motion_is_ignored() {
    let mut motion = Motion::default();
    motion.sent(7, &Command::Stop);
    motion.sent(8, &JOG);
    motion.answered(7, 100, false);
    assert!(motion.may_go_on() && motion.stopped_tick().is_none());
}

#[test]
fn denied_command_keeps_earlier_motion() {
    let mut motion = Motion::default();
    motion.sent(7, &JOG);
    motion.answered(7, 100, true);
    assert!(!motion.may_go_on(), "nothing moved");
    motion.sent(8, &JOG);
    motion.answered(8, 200, false);
    motion.sent(9, &JOG);
    motion.answered(9, 201, true);
    assert!(motion.may_go_on(), "the first jog goes on");
    motion.told(&status(300, State::Idle));
    assert!(!motion.may_go_on());
}
