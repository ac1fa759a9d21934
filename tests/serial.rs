//! The host's end of a serial line, against stations behind a pseudo-terminal: the station on this
//! computer's clock, other devices, and QEMU.

use std::time::{Duration, Instant};
use trinocular_client::StationError;
use trinocular_client::serial::Serial;
use trinocular_client::stage::{configuration_at, default_stage};
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{
    Command, Denial, Hello, Mounting, Report, ResetCause, Status,
};
use trinocular_core::frame::{PROTOCOL, SCHEMA_HASH};
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_tests::binary::trinocular;
use trinocular_tests::emulator::{Emulator, pins};
use trinocular_tests::far_end::{self, FarEnd, mute, saying, station};

/// Time limit of every wait. It is long enough for any machine; a test that reaches it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

fn start(path: &str) -> Serial {
    Serial::start(path, &default_stage(), Mounting::OnStage).expect("the station starts")
}

fn setpoint(mm: [i32; 3]) -> Command {
    Command::Setpoint {
        position_um: mm.map(|mm| mm * 1000),
    }
}

/// Waits for a status that satisfies `wanted`.
fn wait(serial: &Serial, wanted: impl Fn(&Status) -> bool) -> Status {
    let end = Instant::now() + PATIENCE;
    loop {
        serial.check().expect("the line works");
        match serial.status() {
            Some(status) if wanted(&status) => return status,
            last => assert!(Instant::now() < end, "{last:?}"),
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Does the same with a station that may fall silent because its emulator waits for the processor:
/// its line is resumed.
fn wait_for_emulator(serial: &mut Serial, wanted: impl Fn(&Status) -> bool) -> Status {
    let end = Instant::now() + PATIENCE;
    loop {
        let is_heard = match serial.check() {
            Ok(()) => true,
            Err(StationError::Lost { .. }) => false,
            Err(StationError::Interrupted { .. }) => serial.resume().is_ok(),
            Err(error) => panic!("{error}"),
        };
        match serial.status().filter(|_| is_heard) {
            Some(status) if wanted(&status) => return status,
            last => assert!(Instant::now() < end, "{last:?}"),
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn arrived(serial: &Serial, steps: [i32; 3]) -> Status {
    wait(serial, |status| {
        status.state == State::Idle && status.position_steps == steps
    })
}

/// Runs `hello`; returns exit code, standard output and standard error.
fn hello(path: &str, options: &[&str]) -> (Option<i32>, String, String) {
    let done = trinocular()
        .args(["hello", "--port", path])
        .args(options)
        .output()
        .expect("trinocular runs");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (done.status.code(), text(done.stdout), text(done.stderr))
}

/// Starts a station that states another protocol and schema.
fn stranger() -> FarEnd {
    let hello = Report::Hello(Hello {
        protocol: PROTOCOL + 1,
        schema: SCHEMA_HASH ^ 1,
        version: [9, 8, 7],
        board: "elsewhere".try_into().expect("a short name"),
        word_rate_hz: 1_000_000,
        delay_us: 500,
        session: 3,
        reset_cause: ResetCause::Watchdog,
    });
    saying(encode(&hello).expect("it fits").to_vec())
}

#[test]
fn station_is_configured_and_moved() {
    let end = station();
    let mut serial = start(&end.path);
    assert_eq!(
        serial.who().map(|hello| hello.board.to_string()),
        Some("far end".to_owned())
    );
    serial.command("setpoint", setpoint([4, -4, 1])).unwrap();
    let status = arrived(&serial, [320, -320, 80]);
    assert_eq!(status.trust, Trust::Homed);
    match serial.command("setpoint", Command::Config(far_end::impossible())) {
        Err(StationError::Denied { denial, .. }) => {
            assert!(matches!(denial, Denial::Config(_)), "{denial:?}");
        }
        other => panic!("{other:?}"),
    }
    serial.command("stop", Command::Stop).unwrap();
    wait(&serial, |status| status.state == State::Stopped);
    assert!(serial.offset_us().is_some());
}

/// The heartbeat has its own thread, so it continues while the caller is busy. A station without it
/// stops.
#[test]
fn heartbeat_runs_without_caller() {
    let end = station();
    let mut serial = start(&end.path);
    serial.command("setpoint", setpoint([40, 0, 0])).unwrap();
    std::thread::sleep(Duration::from_millis(1_500));
    arrived(&serial, [3_200, 0, 0]);
    serial.command("setpoint", setpoint([-40, 0, 0])).unwrap();
    serial.set_pings(false);
    let status = wait(&serial, |status| {
        status.fault.is_some() && status.state == State::Faulted
    });
    assert_eq!(status.fault, Some(Fault::Heartbeat));
    assert!(status.position_steps[0] > -3_200);
}

#[test]
fn other_firmware_is_named_and_not_moved() {
    let end = stranger();
    match Serial::start(&end.path, &default_stage(), Mounting::OnStage) {
        Err(StationError::Mismatch(fields)) => {
            let names: Vec<_> = fields.iter().map(|mismatch| mismatch.field).collect();
            assert_eq!(names, ["protocol", "schema"]);
        }
        other => panic!("{other:?}"),
    }
    // The board received hellos with their leading zeros and nothing else.
    let received = end.received();
    assert!(!received.is_empty());
    let longest = received.split(|byte| *byte == 0).map(<[u8]>::len).max();
    assert!(longest < Some(12), "{received:?}");

    let (code, out, err) = hello(&stranger().path, &[]);
    assert_eq!(code, Some(3));
    assert!(out.contains("elsewhere") && out.contains("9.8.7"), "{out}");
    let protocol = format!("protocol is {} there and {PROTOCOL} here", PROTOCOL + 1);
    for field in [&*protocol, "schema is"] {
        assert!(err.contains(field), "{err}");
    }
    let (code, out, _) = hello(&stranger().path, &["--json"]);
    assert_eq!(code, Some(3));
    let line: serde_json::Value = serde_json::from_str(&out).expect("one JSON object");
    assert_eq!(line["mismatches"][0]["field"], "protocol");
    assert_eq!(line["mismatches"][0]["station"], PROTOCOL + 1);
    assert_eq!(line["reset_cause"], "watchdog");
}

#[test]
fn silence_and_noise_are_distinguished() {
    match Serial::connect(&mute().path) {
        Err(StationError::Silent { command, .. }) => assert_eq!(command, "hello"),
        other => panic!("{other:?}"),
    }
    match Serial::connect(&saying(b"login: \0\0login: \0".to_vec()).path) {
        Err(error @ StationError::Garbled(_)) => {
            let text = error.to_string();
            assert!(
                text.contains("packets with") && !text.contains('{'),
                "{text}"
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn line_that_stays_away_is_reported() {
    let end = station();
    let mut serial = start(&end.path);
    serial.set_reconnect_patience(Duration::from_millis(300));
    serial.check().expect("it works");
    end.unplug();
    match serial.command("setpoint", setpoint([1, 1, 1])) {
        Err(error @ StationError::Lost { .. }) => {
            assert!(error.to_string().contains(&end.path), "{error}");
        }
        other => panic!("{other:?}"),
    }
}

/// Waits until the connection is back or another error is reported.
fn back(serial: &Serial) -> StationError {
    let end = Instant::now() + PATIENCE;
    loop {
        match serial.check() {
            Err(StationError::Lost { .. }) | Ok(()) => assert!(Instant::now() < end),
            Err(error) => return error,
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn returning_line_is_used_after_resume() {
    let end = station();
    let mut serial = start(&end.path);
    serial.command("setpoint", setpoint([4, -4, 1])).unwrap();
    arrived(&serial, [320, -320, 80]);
    end.unplug();
    end.plug();
    let error = back(&serial);
    assert!(
        matches!(error, StationError::Interrupted { .. }) && error.to_string().contains(&end.path),
        "{error}"
    );
    // No command passes before the caller resumes, and no command sent meanwhile passes later.
    serial.send(setpoint([9, 9, 9]));
    assert!(serial.command("setpoint", setpoint([9, 9, 9])).is_err());
    serial.resume().expect("nothing was lost");
    serial.command("setpoint", setpoint([5, -4, 1])).unwrap();
    arrived(&serial, [400, -320, 80]);
    assert_eq!(end.steps(), [400, -320, 80]);
}

/// The system gives the name of a closed pseudo-terminal to the next program that asks for one.
#[test]
#[cfg(target_os = "linux")]
fn pseudo_terminal_is_not_opened_again_by_name() {
    use trinocular_client::twin::far_end::{FarEnd as _, Terminal};
    let end = station();
    let name = std::fs::canonicalize(&end.path).expect("a link");
    let name = name.to_str().expect("UTF-8").to_owned();
    let mut serial = start(&name);
    end.unplug();
    let patience = Instant::now() + PATIENCE;
    while serial.check().is_ok() {
        assert!(Instant::now() < patience, "the loss is not noticed");
        std::thread::sleep(Duration::from_millis(1));
    }
    // The lowest free name comes first, unless another program was faster.
    let opened = (0..20).map(|_| Terminal::open().expect("a pseudo-terminal"));
    let mut foreign: Vec<Terminal> = opened.collect();
    let error = serial
        .command("zero", Command::Zero)
        .expect_err("it is lost");
    assert!(matches!(error, StationError::Lost { .. }), "{error}");
    let text = error.to_string();
    for part in [&name, "not opened again"] {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    drop(serial);
    for terminal in &mut foreign {
        let mut bytes = [0; 64];
        assert_eq!(terminal.read(&mut bytes).unwrap_or(0), 0, "{bytes:?}");
    }
}

#[test]
fn motion_does_not_return_with_line() {
    let end = station();
    let mut serial = start(&end.path);
    serial.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&serial, |status| status.position_steps[0] > 80);
    end.unplug();
    let stood = end.standing();
    assert!(stood[0] < 4_000, "{stood:?}");
    end.plug();
    assert!(matches!(back(&serial), StationError::Interrupted { .. }));
    match serial.resume() {
        Err(StationError::Faulted(Fault::Heartbeat)) => {}
        other => panic!("{other:?}"),
    }
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(end.steps(), stood);
    let status = serial.status().expect("it goes on telling");
    assert_eq!(status.trust, Trust::Homed);
    assert_eq!(status.position_steps.map(i64::from), stood);
}

#[test]
fn restarted_station_is_not_moved() {
    let end = station();
    let mut serial = start(&end.path);
    end.unplug();
    end.restart();
    end.plug();
    let error = back(&serial);
    assert!(
        matches!(error, StationError::Restarted { .. }) && error.to_string().contains("power on"),
        "{error}"
    );
    assert!(matches!(
        serial.resume(),
        Err(StationError::Restarted { .. })
    ));
    // The caller may start anew; the new station is at rest at the position of the old one.
    drop(serial);
    let mut serial = start(&end.path);
    serial.command("setpoint", setpoint([1, 0, 0])).unwrap();
    arrived(&serial, [80, 0, 0]);
}

/// A brown-out or the watchdog restarts the board, and the line of a serial adapter stays up.
#[test]
fn restart_without_unplugging_is_noticed() {
    let end = station();
    let mut serial = start(&end.path);
    serial.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&serial, |status| status.position_steps[0] > 80);
    end.restart();
    let error = back(&serial);
    assert!(
        matches!(error, StationError::Restarted { .. }) && error.to_string().contains("power on"),
        "{error}"
    );
    let stood = end.steps();
    assert!(matches!(
        serial.resume(),
        Err(StationError::Restarted { .. })
    ));
    assert_eq!(end.steps(), stood);
}

#[test]
fn abandoned_motion_is_stopped_first() {
    let end = station();
    let mut serial = start(&end.path);
    serial.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&serial, |status| status.position_steps[0] > 80);
    serial.abandon();
    let mut serial = start(&end.path);
    let stood = end.steps();
    assert!(stood[0] < 4_000, "{stood:?}");
    serial.command("setpoint", setpoint([0, 1, 0])).unwrap();
    arrived(&serial, [0, 80, 0]);
    assert_eq!(end.steps(), [stood[0], 80, 0]);
    drop(serial);
    // The station was left moving, so it reports a fault.
    let mut serial = start(&end.path);
    serial.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&serial, |status| status.position_steps[0] > 80);
    serial.abandon();
    end.standing();
    assert_eq!(start(&end.path).cleared(), Some(Fault::Heartbeat));
}

#[test]
fn missing_port_is_bad_input() {
    let (code, _, err) = hello("/dev/no-such-port", &[]);
    assert_eq!(code, Some(1));
    assert!(err.contains("/dev/no-such-port"), "{err}");
}

#[test]
fn ports_are_listed() {
    let done = trinocular()
        .args(["ports", "--json"])
        .output()
        .expect("trinocular runs");
    assert!(done.status.success());
    for line in String::from_utf8(done.stdout).expect("UTF-8").lines() {
        let port: serde_json::Value = serde_json::from_str(line).expect("JSON");
        assert!(
            port["path"].is_string() && port["is_station"].is_boolean(),
            "{line}"
        );
    }
}

#[test]
#[ignore = "needs QEMU and a thumbv7em compiler; tests/run includes it"]
fn emulated_board_makes_exact_steps() {
    let folder = tempfile::tempdir().expect("a folder");
    let trace = folder.path().join("trace");
    let (emulator, path) = Emulator::live(&trace);
    let (code, out, err) = hello(&path, &["--json"]);
    assert_eq!(code, Some(0), "{err}");
    let line: serde_json::Value = serde_json::from_str(&out).expect("one JSON object");
    assert_eq!(line["board"], "qemu-mps2-an386");
    assert_eq!(line["mismatches"], serde_json::json!([]));

    // Longer than the emulator waits for the processor.
    let configuration = configuration_at(&default_stage(), Mounting::OnStage, 10_000);
    let configuration = configuration.expect("it fits");
    let mut serial = Serial::start_observed(&path, configuration, None).expect("it starts");
    for (to_mm, steps) in [([4, -4, 1], [320, -320, 80]), ([0, 10, -3], [0, 800, -240])] {
        serial.command("setpoint", setpoint(to_mm)).unwrap();
        wait_for_emulator(&mut serial, |status| {
            status.state == State::Idle && status.position_steps == steps
        });
    }
    let (_, bound_us) = serial.offset_us().expect("pongs came");
    println!("time sync to {bound_us} us");
    // The trace is written every 100 ms; the packets continue meanwhile.
    let tick = serial.status().expect("a status").tick;
    wait_for_emulator(&mut serial, |status| status.tick > tick + 500);
    drop(serial);
    drop(emulator);
    let (steps, rises) = pins(&trace);
    assert_eq!(steps, [0, 800, -240]);
    assert_eq!(rises, [320 + 320, 320 + 1_120, 80 + 320]);
}
