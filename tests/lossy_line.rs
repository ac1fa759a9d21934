//! The host on a line that loses chosen packets, and with a station that sends impossible numbers.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use trinocular::servo::station_link::{StationLink, StationPlace};
use trinocular_client::StationError;
use trinocular_client::serial::Serial;
use trinocular_client::stage::{configuration_at, default_stage};
use trinocular_core::frame::message::{Command, Hello, Mounting, Packet, Report, Status};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::safety::State;
use trinocular_core::time::Instant as StationInstant;
use trinocular_rig::rig_file::Stage;
use trinocular_tests::far_end::{FarEnd, station, station_behind};

/// Time limit of every wait. It is long enough for any machine; a test that reaches it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Heartbeat timeout, ms: longer than a busy computer delays a test.
const HEARTBEAT_MS: u16 = 5_000;

fn start(end: &FarEnd) -> Serial {
    start_with(end, &default_stage())
}

fn start_with(end: &FarEnd, stage: &Stage) -> Serial {
    let configuration = configuration_at(stage, Mounting::OnStage, HEARTBEAT_MS);
    let started = Serial::start_as(&end.path, configuration.expect("a stage in range"));
    started.expect("the station starts")
}

/// Starts a stage towards x = 50 mm. The motion takes 10 s, longer than a busy computer delays a
/// test.
fn moving(end: &FarEnd) -> Serial {
    let stage = Stage {
        max_speed_mm_s: [5.0; 3],
        ..default_stage()
    };
    let mut serial = start_with(end, &stage);
    let position_um = [50_000, 0, 0];
    serial
        .command("setpoint", Command::Setpoint { position_um })
        .expect("it moves");
    wait(&serial, |status| status.position_steps[0] > 80);
    serial
}

fn wait(serial: &Serial, wanted: impl Fn(&Status) -> bool) -> Status {
    let end = Instant::now() + PATIENCE;
    loop {
        match serial.status() {
            Some(status) if wanted(&status) => return status,
            last => assert!(Instant::now() < end, "{last:?}"),
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn stopped(serial: &Serial) -> Status {
    wait(serial, |status| status.state == State::Stopped)
}

/// Returns a filter that loses the first `count` packets for which `is_meant` returns true.
fn first(count: usize, is_meant: impl Fn(&Command) -> bool) -> impl FnMut(&Packet) -> bool {
    let mut seen = 0;
    move |packet| {
        seen += usize::from(is_meant(&packet.command));
        is_meant(&packet.command) && seen <= count
    }
}

fn is_stop(command: &Command) -> bool {
    matches!(command, Command::Stop)
}

/// Returns the packets that the host has sent.
fn packets(end: &FarEnd) -> Vec<Packet> {
    let (bytes, mut receiver) = (end.received(), Receiver::<Packet>::default());
    let mut bytes = &bytes[..];
    std::iter::from_fn(|| receiver.next(&mut bytes))
        .filter_map(Result::ok)
        .collect()
}

#[test]
fn lost_stop_is_repeated_as_new_packet() {
    // The client sends one stop at the start, before anything moves.
    let mut stops = 0;
    let end = station_behind(
        move |packet| {
            stops += usize::from(is_stop(&packet.command));
            is_stop(&packet.command) && (2..=6).contains(&stops)
        },
        Some,
    );
    let mut serial = moving(&end);
    serial.stop().expect("one gets through");
    let status = stopped(&serial);
    assert!(
        status.position_steps[0] < 4_000 && status.fault.is_none(),
        "{status:?}"
    );
    let sent = packets(&end);
    let stops: Vec<u16> = sent
        .iter()
        .filter(|p| is_stop(&p.command))
        .map(|p| p.sequence)
        .collect();
    assert!(stops.len() >= 7, "{stops:?}");
    assert!(stops.windows(2).all(|pair| pair[0] != pair[1]), "{stops:?}");
}

#[test]
fn first_answer_to_any_stop_counts() {
    // The line loses the first answers to a stop in motion, not the stops.
    let mut answers = 0;
    let mut moves = false;
    let end = station_behind(
        |_| false,
        move |report| {
            if let Report::Status(status) = &report {
                moves |= status.state == State::Moving;
            }
            let is_answer = matches!(report, Report::Answer { .. }) && moves;
            answers += usize::from(is_answer);
            // The first answer is for the motion command.
            (!is_answer || !(2..=4).contains(&answers)).then_some(report)
        },
    );
    let mut serial = moving(&end);
    serial.stop().expect("one answer gets through");
    assert_eq!(stopped(&serial).fault, None);
}

#[test]
fn unanswered_stop_ends_heartbeat() {
    let mut is_moving = false;
    let end = station_behind(
        move |packet| {
            is_moving |= matches!(packet.command, Command::Setpoint { .. });
            is_moving && is_stop(&packet.command)
        },
        Some,
    );
    let mut serial = start(&end);
    let position_um = [50_000, 0, 0];
    serial
        .command("setpoint", Command::Setpoint { position_um })
        .expect("it moves");
    match serial.stop() {
        Err(error @ StationError::Unstopped { sent }) => {
            assert!(sent > 10, "{sent}");
            assert!(error.to_string().contains("heartbeat"), "{error}");
        }
        other => panic!("{other:?}"),
    }
    let pings = |end: &FarEnd| {
        let is_ping = |p: &&Packet| matches!(p.command, Command::Ping { .. });
        packets(end).iter().filter(is_ping).count()
    };
    std::thread::sleep(Duration::from_millis(100));
    let before = pings(&end);
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(pings(&end), before);
}

/// A caller may take any time to look at the reports.
#[test]
fn heartbeat_runs_while_caller_reads() {
    let end = station();
    let serial = start(&end);
    let pings = || {
        let is_ping = |p: &&Packet| matches!(p.command, Command::Ping { .. });
        packets(&end).iter().filter(is_ping).count()
    };
    let client = serial.client();
    let (before, patience) = (pings(), Instant::now() + PATIENCE);
    while pings() < before + 10 {
        assert!(
            Instant::now() < patience,
            "the heartbeat waits for the line"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(client);
}

/// Checks that the station stopped by command, without a fault.
fn assert_stopped(end: &FarEnd) {
    let serial = Serial::connect(&end.path).expect("it answers");
    let status = serial.fresh_status(false).expect("it tells");
    assert_eq!((status.state, status.fault), (State::Stopped, None));
}

#[test]
fn dropped_connection_stops_stage() {
    let end = station_behind(first(0, is_stop), Some);
    drop(moving(&end));
    let stood = end.standing();
    assert!(stood[0] < 4_000, "{stood:?}");
    assert_stopped(&end);
}

#[test]
fn panic_stops_stage() {
    let end = station();
    let panicked = catch_unwind(AssertUnwindSafe(|| {
        let _serial = moving(&end);
        panic!("as a bug does");
    }));
    assert!(panicked.is_err());
    assert!(end.steps()[0] < 4_000, "{:?}", end.steps());
    assert_stopped(&end);
}

#[test]
fn connection_at_rest_ends_without_stop() {
    let end = station();
    let mut serial = start(&end);
    let position_um = [1_000, 0, 0];
    serial
        .command("setpoint", Command::Setpoint { position_um })
        .expect("it moves");
    wait(&serial, |s| {
        s.state == State::Idle && s.position_steps[0] == 80
    });
    drop(serial);
    let serial = Serial::connect(&end.path).expect("it answers");
    assert_eq!(
        serial.fresh_status(false).expect("it tells").state,
        State::Idle
    );
}

#[test]
fn lost_setup_commands_are_repeated() {
    let mut seen = [0; 3];
    let lost = move |packet: &Packet| {
        let kind = match packet.command {
            Command::Config(_) => 0,
            Command::Zero => 1,
            Command::Setpoint { .. } => 2,
            _ => return false,
        };
        seen[kind] += 1;
        seen[kind] <= 2
    };
    let end = station_behind(lost, Some);
    let mut serial = start(&end);
    let position_um = [1_000, 0, 0];
    serial
        .command("setpoint", Command::Setpoint { position_um })
        .expect("it moves");
    wait(&serial, |s| {
        s.state == State::Idle && s.position_steps[0] == 80
    });
}

#[test]
fn lost_reset_is_repeated() {
    let is_reset = |command: &Command| matches!(command, Command::Reset);
    let end = station_behind(first(2, is_reset), Some);
    start(&end);
}

#[test]
fn unanswered_jog_is_not_repeated() {
    let jog = Command::Jog {
        distance_um: [2_000, 0, 0],
    };
    let is_jog = |command: &Command| matches!(command, Command::Jog { .. });
    let explained = |end: &FarEnd| {
        let mut serial = start(end);
        let Err(error) = serial.command("jog", jog) else {
            panic!("no answer came");
        };
        let jogs = packets(end).iter().filter(|p| is_jog(&p.command)).count();
        assert_eq!(jogs, 1);
        error.to_string()
    };
    // The packet is lost.
    let end = station_behind(first(9, is_jog), Some);
    let text = explained(&end);
    assert!(
        text.contains("did not answer jog") && text.contains("where it was before"),
        "{text}"
    );
    assert_eq!(end.steps(), [0; 3]);
    // Its answer is lost.
    let asked = Arc::new(AtomicU32::new(u32::MAX));
    let is_answer = Arc::clone(&asked);
    let end = station_behind(
        move |packet| {
            if is_jog(&packet.command) {
                asked.store(packet.sequence.into(), Ordering::Relaxed);
            }
            false
        },
        move |report| match report {
            Report::Answer { sequence, .. }
                if u32::from(sequence) == is_answer.load(Ordering::Relaxed) =>
            {
                None
            }
            report => Some(report),
        },
    );
    let text = explained(&end);
    assert!(text.contains("it was at 0 0 0 steps before"), "{text}");
    assert_eq!(end.steps(), [160, 0, 0]);
}

/// Follows in closed loop with a station whose reports pass through `alter`.
fn follow(alter: impl FnMut(Report) -> Report + Send + 'static) -> Result<(), StationError> {
    let mut alter = alter;
    let end = station_behind(|_| false, move |report| Some(alter(report)));
    let place = StationPlace::Port {
        path: &end.path,
        heartbeat_ms: 5_000,
    };
    let mut follower = StationLink::start(place, &default_stage())?;
    for _ in 0..20 {
        let moment = follower.moment(follower.now())?;
        follower.advance(moment.at.plus_micros(20_000));
    }
    Ok(())
}

#[test]
fn implausible_number_is_named() {
    follow(|report| report).expect("plausible numbers are taken");
    let hello = |alter: fn(&mut Hello)| {
        follow(move |mut report| {
            if let Report::Hello(hello) = &mut report {
                alter(hello);
            }
            report
        })
    };
    // Alter reports only once the station is in use.
    let later = |alter: fn(&mut Report)| {
        let mut reports = 0;
        follow(move |mut report| {
            reports += 1;
            if reports > 60 {
                alter(&mut report);
            }
            report
        })
    };
    for (outcome, field, value) in [
        (
            hello(|h| h.delay_us = u32::MAX),
            "hello.delay_us",
            "4294967295",
        ),
        (
            hello(|h| h.delay_us = 100_000_000),
            "hello.delay_us",
            "100000000",
        ),
        (hello(|h| h.word_rate_hz = 0), "hello.word_rate_hz", "0"),
        (
            later(|report| {
                if let Report::Status(status) = report {
                    status.time = StationInstant::MAX;
                }
            }),
            "status.time",
            "281474976710655",
        ),
        (
            later(|report| {
                if let Report::Status(status) = report {
                    status.time = status.time.plus_micros(20_000_000);
                }
            }),
            "status.time",
            "",
        ),
        (
            // The error is so small that only the extended clock shows it.
            later(|report| {
                if let Report::Status(status) = report {
                    status.time = status.time.plus_micros(5_000_000);
                }
            }),
            "status.time on this computer's clock",
            "",
        ),
        (
            later(|report| {
                if let Report::Status(status) = report {
                    status.position_steps[1] = i32::MIN;
                }
            }),
            "status.position_steps",
            "-2147483648",
        ),
        (
            later(|report| {
                if let Report::Pong { host_us, .. } = report {
                    *host_us = u64::MAX;
                }
            }),
            "pong.host_us",
            "18446744073709551615",
        ),
        (
            later(|report| {
                if let Report::Pong { sent, .. } = report {
                    *sent = StationInstant::MAX;
                }
            }),
            "pong.sent",
            "281474976710655",
        ),
        (
            later(|report| {
                if let Report::Pong { received, sent, .. } = report {
                    *sent = StationInstant::from_micros(received.micros() - 1);
                }
            }),
            "pong.sent",
            "",
        ),
    ] {
        let error = outcome.expect_err(field);
        assert!(matches!(error, StationError::Implausible(_)), "{error:?}");
        let text = error.to_string();
        assert!(
            text.starts_with(field) && text.contains(&format!(" {value}")),
            "{text}"
        );
    }
}

#[test]
fn implausible_tick_does_not_hang_wait() {
    let end = station_behind(
        |_| false,
        |mut report| {
            if let Report::Answer { tick, .. } = &mut report {
                *tick = tick.wrapping_add(1 << 31);
            }
            Some(report)
        },
    );
    let started = Serial::start(&end.path, &default_stage(), Mounting::OnStage);
    assert!(
        started.is_err(),
        "it waits for a status of that tick, but not for ever"
    );
}
