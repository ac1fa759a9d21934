//! Runs end with any report of the station, and without one.

use super::{Desk, alone, ended, moving, stands_stopped};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use trinocular_core::frame::message::{Command as StationCommand, Packet, Report};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::safety::State;
use trinocular_tests::far_end::{FarEnd, mute, station_behind};

/// Returns a station that reports endless motion after the first command for which `starts` returns
/// true.
fn restless(mut starts: impl FnMut(&StationCommand) -> bool + Send + 'static) -> FarEnd {
    let is_restless = Arc::new(AtomicBool::new(false));
    let says = Arc::clone(&is_restless);
    station_behind(
        move |packet| {
            says.fetch_or(starts(&packet.command), Ordering::Relaxed);
            false
        },
        move |mut report| {
            if let Report::Status(status) = &mut report
                && is_restless.load(Ordering::Relaxed)
            {
                status.state = State::Moving;
            }
            Some(report)
        },
    )
}

#[test]
fn endless_motion_is_given_up() {
    let _alone = alone();
    let desk = Desk::new();
    let jog = |command: &StationCommand| matches!(command, StationCommand::Jog { .. });
    let end = restless(jog);
    let (code, err) = ended(desk.start(&end, "jog x=1 --rig wide.toml --heartbeat 5000"));
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("still says that the stage moves"), "{err}");
    assert_eq!(end.steps(), [80, 0, 0]);
}

#[test]
fn unknown_rest_is_no_success() {
    let _alone = alone();
    let desk = Desk::new();
    let end = restless(|command| matches!(command, StationCommand::Frame(_)));
    let words = "track --sim --path still --seconds 1 --heartbeat 5000";
    let (code, err) = ended(desk.start(&end, words));
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("see that the stage stands"), "{err}");
}

#[test]
fn stop_precedes_implausible_hello() {
    let _alone = alone();
    let desk = Desk::new();
    let is_strange = Arc::new(AtomicBool::new(false));
    let strange = Arc::clone(&is_strange);
    let end = station_behind(
        |_| false,
        move |mut report| {
            if let Report::Hello(hello) = &mut report
                && strange.load(Ordering::Relaxed)
            {
                hello.delay_us = 100_000_000;
            }
            Some(report)
        },
    );
    let mut first = desk.start(&end, "jog x=50 --rig wide.toml --heartbeat 10000");
    moving(&end);
    first.kill().expect("it runs");
    first.wait().expect("it ended");
    is_strange.store(true, Ordering::Relaxed);
    let (code, err) = ended(desk.start(&end, "stop"));
    assert_eq!(code, Some(3), "{err}");
    for part in ["answered the stop", "hello.delay_us"] {
        assert!(err.contains(part), "`{part}` is not in: {err}");
    }
    end.standing();
    is_strange.store(false, Ordering::Relaxed);
    stands_stopped(&end);
}

#[test]
fn mute_line_gets_stop_after_hello() {
    let desk = Desk::new();
    let end = mute();
    let (code, err) = ended(desk.start(&end, "stop"));
    assert_eq!(code, Some(3), "{err}");
    let (bytes, mut receiver) = (end.received(), Receiver::<Packet>::default());
    let mut bytes = &bytes[..];
    let packets = std::iter::from_fn(|| receiver.next(&mut bytes)).filter_map(Result::ok);
    let commands: Vec<StationCommand> = packets.map(|packet| packet.command).collect();
    assert!(
        matches!(
            commands[..],
            [StationCommand::Hello, StationCommand::Stop, ..]
        ),
        "{commands:?}"
    );
    let stops = commands
        .iter()
        .filter(|c| matches!(c, StationCommand::Stop));
    assert!(stops.count() > 3, "it is repeated: {commands:?}");
}

#[test]
fn board_format_characters_are_hidden() {
    let end = station_behind(
        |_| false,
        |mut report| {
            if let Report::Hello(hello) = &mut report {
                hello.board = "a\u{202e}b\u{200b}c\u{2028}".try_into().expect("short");
            }
            Some(report)
        },
    );
    let desk = Desk::new();
    let done = desk
        .command(&end, "hello")
        .stdout(std::process::Stdio::piped())
        .output();
    let text = String::from_utf8(done.expect("it runs").stdout).expect("UTF-8");
    assert!(text.contains("a?b?c?"), "{text}");
}
