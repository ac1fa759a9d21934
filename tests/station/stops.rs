//! A stop cancels everything before it, and every command is answered.

use super::{denial, frame, setpoint, status, twin, wait};
use trinocular_client::stage::{configuration, default_stage};
use trinocular_client::twin::Twin;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{
    Command, Denial, LastRun, Mounting, Outcome, Packet, Report, ResetCause,
};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::{Board, Machine, Output};
use trinocular_core::safety::State;
use trinocular_core::steps::WordRate;
use trinocular_core::time::Instant;

fn jog(mm: i32) -> Command {
    Command::Jog {
        distance_um: [1_000 * mm, 0, 0],
    }
}

/// Sends all commands at once, as one write of the host; returns the sequence numbers.
fn burst(twin: &mut Twin, commands: &[Command]) -> Vec<u16> {
    let packets = commands.iter().map(|command| twin.packet(*command));
    let (sequences, bytes): (Vec<u16>, Vec<_>) = packets.unzip();
    twin.write(&bytes.concat());
    sequences
}

/// Commands that came before a stop and still wait are dropped and answered as dropped, wherever
/// the control tick falls. The stop ends the motion of commands done before it.
#[test]
fn commands_before_stop_are_dropped() {
    let before = [
        vec![Command::Reset],
        vec![Command::Reset, jog(20)],
        vec![Command::Reset, Command::Zero, setpoint([20, 0, 0])],
        vec![
            Command::Reset,
            jog(5),
            jog(5),
            Command::Zero,
            Command::Reset,
        ],
    ];
    for commands in before {
        for gap_us in [0, 100, 300, 400, 999, 2_500] {
            let mut twin = twin();
            twin.command("stop", Command::Stop).unwrap();
            wait(&mut twin, 5);
            let mut sent = Vec::new();
            for command in &commands {
                sent.push(twin.send(*command));
                twin.advance(twin.now().plus_micros(gap_us));
            }
            sent.push(twin.send(Command::Stop));
            wait(&mut twin, 100);
            let rest = twin.steps();
            let answers: Vec<_> = sent.iter().map(|n| twin.answer(*n)).collect();
            assert!(answers.iter().all(Option::is_some), "{answers:?}");
            assert_eq!(answers.last(), Some(&Some(Ok(()))));
            if gap_us == 0 {
                let (_, dropped) = answers.split_last().unwrap();
                let all = dropped.iter().all(|a| *a == Some(Err(Denial::Dropped)));
                assert!(all, "{answers:?}");
                assert_eq!(rest, [0; 3], "not one step");
            }
            assert_eq!(status(&mut twin).state, State::Stopped);
            wait(&mut twin, 1_000);
            assert_eq!(twin.steps(), rest, "no step after the stop's ramp");
        }
    }
}

#[test]
fn frames_before_stop_are_refused() {
    let mut twin = twin();
    wait(&mut twin, 500);
    let ago = |ms: u64| Instant::from_micros(twin.now().micros() - 1_000 * ms);
    let commands = [
        frame([0.5, 0.0, 0.0], ago(20), ago(100)),
        frame([0.5, 0.0, 0.0], ago(10), ago(100)),
        Command::Stop,
    ];
    let sent = burst(&mut twin, &commands);
    wait(&mut twin, 50);
    assert_eq!(twin.answer(sent[0]), Some(Err(Denial::Dropped)));
    let status = status(&mut twin);
    assert_eq!((status.frames_used, status.frames_refused), (0, 2));
    assert_eq!((status.state, twin.steps()), (State::Stopped, [0; 3]));
}

#[test]
fn commands_after_stop_keep_order() {
    let mut twin = twin();
    let sent = burst(&mut twin, &[jog(9), Command::Stop, Command::Reset, jog(1)]);
    wait(&mut twin, 500);
    let answers: Vec<_> = sent.iter().map(|n| twin.answer(*n)).collect();
    let dropped = Some(Err(Denial::Dropped));
    assert_eq!(answers, [dropped, Some(Ok(())), Some(Ok(())), Some(Ok(()))]);
    assert_eq!(twin.steps(), [80, 0, 0]);
}

#[test]
fn every_stop_of_a_tick_is_answered() {
    let mut twin = twin();
    twin.command("jog", jog(20)).unwrap();
    wait(&mut twin, 50);
    let sent = burst(&mut twin, &[Command::Stop; 8]);
    wait(&mut twin, 5);
    for stop in sent {
        assert_eq!(twin.answer(stop), Some(Ok(())));
    }
    assert_eq!(status(&mut twin).drops.answers, 0);
}

/// The station counts commands of one tick beyond eight, and answers without room.
#[test]
fn overflow_is_counted_by_name() {
    let mut twin = twin();
    let sent = burst(&mut twin, &[jog(0); 40]);
    wait(&mut twin, 5);
    let answered = sent.iter().filter(|n| twin.answer(**n).is_some()).count();
    let drops = status(&mut twin).drops;
    assert_eq!((answered, drops.overflow, drops.answers), (8, 32, 0));

    let mut commands = Vec::new();
    for _ in 0..12 {
        commands.extend([jog(1), jog(1), Command::Stop]);
    }
    let sent = burst(&mut twin, &commands);
    wait(&mut twin, 5);
    let answered = sent.iter().filter(|n| twin.answer(**n).is_some()).count();
    let drops = status(&mut twin).drops;
    assert_eq!(answered, 24, "16 dropped commands and 8 stops");
    assert_eq!((drops.overflow, drops.answers), (32, 12));
}

/// Noise on an idle line precedes a stop in mid-jog.
#[test]
fn stop_behind_noise_is_understood() {
    for length in 1..=3 {
        for noise in [0x01_u8, 0x55, 0x80, 0xfe, 0xff] {
            let mut twin = twin();
            twin.command("jog", jog(30)).unwrap();
            wait(&mut twin, 50);
            twin.set_pings(false);
            twin.write(&vec![noise; length]);
            let stop = twin.send(Command::Stop);
            wait(&mut twin, 3);
            assert_eq!(twin.answer(stop), Some(Ok(())), "{length} bytes {noise:#x}");
        }
    }
}

#[test]
fn only_pings_are_a_heartbeat() {
    let others = [Command::Hello, Command::Motors { on: true }, Command::Zero];
    for command in others {
        let mut twin = twin();
        twin.command("setpoint", setpoint([50, 0, 0])).unwrap();
        wait(&mut twin, 50);
        twin.set_pings(false);
        for _ in 0..10 {
            twin.send(command);
            wait(&mut twin, 50);
        }
        let status = status(&mut twin);
        assert_eq!(
            status.fault,
            Some(trinocular_core::safety::Fault::Heartbeat)
        );
        assert!(twin.position_mm()[0] < 25.0, "{:?}", twin.position_mm());
    }
}

/// The station's own start is no ping. This test uses a bare station, because the twin's host pings
/// from the start.
#[test]
fn no_motion_before_first_ping() {
    let mut machine = Machine::new(Board {
        name: "bare",
        version: [0; 3],
        word_rate: WordRate::MHZ_1,
        delay_us: 512,
        session: 1,
        reset_cause: ResetCause::PowerOn,
        last_run: LastRun::UNKNOWN,
        camera_pin: None,
    });
    let config = configuration(&default_stage(), Mounting::OnStage).unwrap();
    let commands = [Command::Hello, Command::Config(config), jog(1)];
    for (sequence, command) in (1..).zip(commands) {
        let packet = encode(&Packet { sequence, command }).unwrap();
        machine.receive(Instant::default(), &packet);
    }
    let mut answers = Vec::new();
    let mut reports = Receiver::<Report>::default();
    let mut now = Instant::default();
    while now < Instant::from_micros(50_000) {
        match machine.poll(now, usize::MAX) {
            Output::Send(bytes) => {
                let report = reports.next(&mut &bytes[..]).unwrap().unwrap();
                if let Report::Answer { outcome, .. } = report {
                    answers.push(outcome);
                }
            }
            Output::Segment(_) => {}
            Output::Idle(until) => now = until,
        }
    }
    let denied = Outcome::Denied(Denial::NoHeartbeat);
    assert_eq!(answers, [Outcome::Accepted, denied]);
    assert_eq!(machine.motors(), [0; 3]);
}

/// A motion without a heartbeat would end in a fault at once, so none begins.
#[test]
fn no_motion_without_heartbeat() {
    let mut twin = twin();
    twin.set_pings(false);
    wait(&mut twin, 200);
    let now = twin.now();
    let ago = |ms: u64| Instant::from_micros(now.micros() - 1_000 * ms);
    for command in [
        jog(1),
        setpoint([1, 0, 0]),
        frame([1.0; 3], ago(10), ago(90)),
    ] {
        assert_eq!(denial(twin.command("move", command)), Denial::NoHeartbeat);
    }
    assert_eq!(twin.steps(), [0; 3]);
    assert_eq!(status(&mut twin).fault, None);
}
