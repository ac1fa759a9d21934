//! Programs reach a station through the program that has its port.

use std::io::Write as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use trinocular_client::StationError;
use trinocular_client::owner;
use trinocular_client::serial::{Access, Serial};
use trinocular_client::stage::{configuration, default_stage};
use trinocular_core::frame::message::{Command, Denial, Mounting, Packet};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::safety::State;
use trinocular_rig::rig_file::Stage;
use trinocular_tests::binary::trinocular;
use trinocular_tests::far_end::{FarEnd, station, station_behind};

/// Time limit of every wait. It is long enough for any machine; a test that reaches it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Heartbeat timeout that a busy test machine does not exceed, ms.
const HEARTBEAT_MS: u16 = 3_000;

/// A stage on which a long jog takes ten seconds, so that whatever shall end it comes in time.
fn slow_stage() -> Stage {
    let mut stage = default_stage();
    stage.max_speed_mm_s = [5.0; 3];
    stage
}

fn start(end: &FarEnd) -> Serial {
    let mut config = configuration(&slow_stage(), Mounting::OnStage).expect("it fits");
    config.heartbeat_ms = HEARTBEAT_MS;
    Serial::start_as(&end.path, config).expect("the station starts")
}

/// A jog along X that takes ten seconds.
const FAR: Command = Command::Jog {
    distance_um: [50_000, 0, 0],
};

fn wait(what: &str, mut is_so: impl FnMut() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !is_so() {
        assert!(Instant::now() < end, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn moving(end: &FarEnd) {
    wait("the stage moves", || end.steps()[0] > 40);
}

fn is_busy(outcome: Result<Serial, StationError>) -> bool {
    match outcome {
        Err(StationError::Busy { holder, .. }) => {
            holder.expect("it introduces itself").pid == std::process::id()
        }
        other => panic!("{other:?}"),
    }
}

/// Returns the folder's sockets for a port of this test.
fn sockets(end: &FarEnd) -> Vec<PathBuf> {
    let real = std::fs::canonicalize(&end.path).expect("it leads to a pseudo-terminal");
    let number = real
        .file_name()
        .expect("a name")
        .to_string_lossy()
        .into_owned();
    let entries = std::fs::read_dir(owner::folder().expect("a folder")).expect("it is ours");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    let begins = |path: &PathBuf| {
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        name.starts_with(&format!("{number}-"))
    };
    paths.filter(begins).collect()
}

#[test]
fn stop_through_owner_ends_its_motion() {
    let end = station();
    let mut owner = start(&end);
    owner.command("jog", FAR).expect("it is allowed");
    moving(&end);
    let mut guest = Serial::connect_and_stop(&end.path).expect("the owner lets it in");
    assert_eq!(
        guest.owner().map(|holder| holder.pid),
        Some(std::process::id())
    );
    guest.stop().expect("it is answered");
    assert_eq!(guest.until_rest().expect("it rests"), State::Stopped);
    let stood = end.standing();
    assert!(stood[0] < 4_000, "{stood:?}");
    let by = match owner.check() {
        Err(StationError::StoppedByOther { by }) => by,
        other => panic!("{other:?}"),
    };
    assert!(by.contains(&std::process::id().to_string()), "{by}");
    // Whatever the owner sends now does not reach the station.
    owner.send(Command::Reset);
    owner.send(FAR);
    assert_eq!(end.standing(), stood);
    // Until the owner decides to go on.
    owner.forgive_stop();
    owner
        .command("reset", Command::Reset)
        .expect("it is allowed");
    owner.command("jog", FAR).expect("it is allowed");
    wait("the stage moves again", || end.steps()[0] > stood[0] + 40);
}

#[test]
fn watcher_sees_reports_and_moves_nothing() {
    let end = station();
    let mut owner = start(&end);
    let mut guest = Serial::connect_to_watch(&end.path).expect("the owner lets it in");
    assert_eq!(guest.who(), owner.who());
    guest.send(FAR);
    guest.send(Command::Stop);
    let near = Command::Jog {
        distance_um: [5_000, 0, 0],
    };
    owner.command("jog", near).expect("it is allowed");
    moving(&end);
    wait("the guest sees the motion", || {
        let status = guest.fresh_status(false).expect("a status comes");
        status.state == State::Moving && status.position_steps[0] > 0
    });
    assert!(owner.check().is_ok());
    wait("it arrives", || end.steps() == [400, 0, 0]);
}

#[test]
fn second_program_cannot_drive() {
    let end = station();
    let owner = start(&end);
    assert!(is_busy(Serial::connect(&end.path)));
    drop(owner);
    assert!(
        Serial::connect(&end.path)
            .expect("the port is free")
            .owner()
            .is_none()
    );
}

#[test]
fn idle_owner_lets_one_guest_drive() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    assert!(guest.owner().is_some());
    assert!(is_busy(Serial::connect(&end.path)));
    guest.start_heartbeat().expect("it is answered");
    let short = Command::Jog {
        distance_um: [1_000, 0, 0],
    };
    guest.command("jog", short).expect("it is passed on");
    wait("it arrives", || {
        let status = guest.fresh_status(true).expect("a status comes");
        status.state == State::Idle && end.steps() == [80, 0, 0]
    });
    // Denials are passed on, too.
    guest.command("jog", FAR).expect("it is passed on");
    moving(&end);
    match guest.command("zero", Command::Zero) {
        Err(StationError::Denied { denial, .. }) => assert_eq!(denial, Denial::Moving),
        other => panic!("{other:?}"),
    }
    guest.stop().expect("it is answered");
    assert!(
        owner.check().is_ok(),
        "a driver's own stop is no stop of the owner"
    );
    drop(guest);
    wait("the next guest drives", || {
        Serial::connect(&end.path).is_ok()
    });
}

#[test]
fn owner_takes_its_configuration_back() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    let mut fine = slow_stage();
    fine.steps_per_mm = [160.0; 3];
    let theirs = configuration(&fine, Mounting::OnStage).expect("it fits");
    let command = Command::Config(theirs);
    guest.command("config", command).expect("it is passed on");
    drop(guest);
    owner.restore_configuration().expect("the stage rests");
    let millimetre = Command::Jog {
        distance_um: [1_000, 0, 0],
    };
    owner.command("jog", millimetre).expect("it is allowed");
    wait("it arrives", || end.steps() == [80, 0, 0]);
}

/// The station alone would replace the rest of the first jog.
#[test]
fn jog_of_guest_in_motion_is_refused() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    guest.start_heartbeat().expect("it is answered");
    let jog = |um| Command::Jog {
        distance_um: [um, 0, 0],
    };
    // The second is on its way before the first is answered.
    let [first, second] = [jog(5_000), jog(1_000)].map(|jog| guest.send(jog));
    let answer = |sequence| {
        let end = Instant::now() + PATIENCE;
        let came = guest.wait_until(end, |client| client.answer(sequence));
        came.expect("the line stays").expect("an answer")
    };
    assert_eq!(answer(first), Ok(()));
    assert_eq!(answer(second), Err(Denial::Moving));
    wait("it arrives", || end.steps() == [400, 0, 0]);
    assert_eq!(end.standing(), [400, 0, 0]);
}

#[test]
fn guest_without_motion_leaves_that_of_owner() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    owner.command("jog", FAR).expect("it is allowed");
    moving(&end);
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    guest.start_heartbeat().expect("it is answered");
    let jog = Command::Jog {
        distance_um: [0, 1_000, 0],
    };
    for (name, command) in [("jog", jog), ("zero", Command::Zero)] {
        let refused = guest.command(name, command);
        assert!(
            matches!(refused, Err(StationError::Denied { .. })),
            "{name}: {refused:?}"
        );
    }
    drop(guest);
    let before = end.steps()[0];
    wait("the motion goes on", || end.steps()[0] > before + 100);
    assert_eq!(
        owner.status().map(|status| status.state),
        Some(State::Moving)
    );
}

#[test]
fn guest_that_vanishes_stops_its_motion() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    guest.start_heartbeat().expect("it is answered");
    guest.command("jog", FAR).expect("it is passed on");
    moving(&end);
    guest.abandon();
    let stood = end.standing();
    assert!(stood[0] < 4_000, "{stood:?}");
    let status = owner.status().expect("it tells");
    assert_eq!((status.state, status.fault), (State::Stopped, None));
}

/// The line loses the first stops, and a guest sends commands all the while.
#[test]
fn unanswered_stop_outlives_guest_commands() {
    let to_lose = Arc::new(AtomicU32::new(0));
    let lost = Arc::clone(&to_lose);
    let is_lost = move |packet: &Packet| {
        let loses = |left: u32| left.checked_sub(1);
        let order = Ordering::Relaxed;
        matches!(packet.command, Command::Stop) && lost.fetch_update(order, order, loses).is_ok()
    };
    let end = station_behind(is_lost, Some);
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    guest.start_heartbeat().expect("it is answered");
    guest.command("jog", FAR).expect("it is passed on");
    moving(&end);
    to_lose.store(3, Ordering::Relaxed);
    owner.stopper().stop("a test");
    wait("the station stops", || {
        guest.send(Command::Setpoint {
            position_um: [50_000, 0, 0],
        });
        owner
            .status()
            .is_some_and(|status| status.state == State::Stopped)
    });
    let stood = end.standing();
    assert!(stood[0] < 4_000, "{stood:?}");
    assert_eq!(to_lose.load(Ordering::Relaxed), 0);
}

/// The stop before was answered, and another command came after it.
#[test]
fn second_stop_is_answered_after_zero() {
    let end = station();
    let mut owner = start(&end);
    owner.stop().expect("it is answered");
    owner
        .command("reset", Command::Reset)
        .expect("it is allowed");
    owner.stop().expect("it is answered");
    owner.command("zero", Command::Zero).expect("it is allowed");
    let mut guest = Serial::connect_and_stop(&end.path).expect("the owner lets it in");
    guest.stop().expect("it is answered");
}

#[test]
fn owner_pings_after_guest_has_left() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    guest
        .command("zero", Command::Zero)
        .expect("it is passed on");
    drop(guest);
    wait("the guest has left", || owner.driver().is_none());
    let pings = || {
        let mut packets = Receiver::<Packet>::default();
        let received = end.received();
        let mut bytes = &received[..];
        let mut count = 0;
        while let Some(packet) = packets.next(&mut bytes) {
            let is_ping = |packet: Packet| matches!(packet.command, Command::Ping { .. });
            count += usize::from(packet.is_ok_and(is_ping));
        }
        count
    };
    let before = pings();
    wait("pings come", || pings() > before + 3);
}

/// A guest whose pings stop is one that is suspended or hangs.
#[test]
fn silent_guest_is_stopped() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let mut guest = Serial::connect(&end.path).expect("the owner lets it in");
    guest.start_heartbeat().expect("it is answered");
    guest.command("jog", FAR).expect("it is passed on");
    moving(&end);
    guest.set_pings(false);
    wait("the station stops", || {
        owner
            .status()
            .is_some_and(|status| status.state == State::Stopped)
    });
    assert!(end.standing()[0] < 4_000);
    assert_eq!(owner.status().and_then(|status| status.fault), None);
}

#[test]
fn guest_names_the_owner_that_has_ended() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let guest = Serial::connect(&end.path).expect("the owner lets it in");
    drop(owner);
    wait("the loss is noticed", || guest.check().is_err());
    let text = guest.check().expect_err("it is lost").to_string();
    for part in ["which had the port", "run this again"] {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    assert!(text.contains(&std::process::id().to_string()), "{text}");
}

#[test]
fn owner_takes_no_station_that_a_guest_drives() {
    let end = station();
    let mut owner = start(&end);
    owner.set_access(Access::Open).expect("opening never fails");
    let guest = Serial::connect(&end.path).expect("the owner lets it in");
    match owner.set_access(Access::Busy) {
        Err(StationError::Busy { holder, .. }) => assert_eq!(holder, owner.driver()),
        other => panic!("{other:?}"),
    }
    drop(guest);
    wait("the guest has left", || {
        owner.set_access(Access::Busy).is_ok()
    });
    assert!(is_busy(Serial::connect(&end.path)));
}

#[test]
fn crashed_owner_leaves_no_lock() {
    let end = station();
    let owner = start(&end);
    let [socket] = &sockets(&end)[..] else {
        panic!("one socket")
    };
    drop(owner);
    assert!(sockets(&end).is_empty());
    // A crash leaves a socket that refuses connections.
    drop(UnixListener::bind(socket).expect("a socket"));
    let mut next = start(&end);
    assert!(next.owner().is_none());
    next.command("jog", FAR).expect("it is allowed");
    moving(&end);
    let mut guest = Serial::connect_and_stop(&end.path).expect("the new owner lets it in");
    guest.stop().expect("it is answered");
}

/// A name of a port goes to the next device that comes.
#[test]
fn owner_of_lost_line_receives_no_guests() {
    let end = station();
    let mut owner = start(&end);
    owner.set_reconnect_patience(PATIENCE);
    let socket = sockets(&end).pop().expect("a socket");
    end.unplug();
    wait("the loss is noticed", || owner.check().is_err());
    let mut stranger = UnixStream::connect(&socket).expect("it is there");
    stranger
        .write_all(b"trinocular 1 stop 1 x\n")
        .expect("it is open");
    let mut reply = String::new();
    let read = std::io::Read::read_to_string(&mut stranger, &mut reply);
    assert_eq!((read.is_ok(), reply.as_str()), (true, ""));
}

#[test]
fn strangers_at_the_socket_do_no_harm() {
    let end = station();
    let mut owner = start(&end);
    let socket = sockets(&end).pop().expect("a socket");
    let silent: Vec<_> = (0..40)
        .filter_map(|_| UnixStream::connect(&socket).ok())
        .collect();
    for garbage in [
        &b"\0\0\0\0"[..],
        b"GET / HTTP/1.1\r\n\r\n",
        b"trinocular 9 stop 1 x\n",
        b"trinocular 1 drive x\n",
        &[b'x'; 100_000],
    ] {
        let mut stranger = UnixStream::connect(&socket).expect("it is there");
        // The owner may have closed it.
        let _ = stranger.write_all(garbage);
    }
    owner.command("jog", FAR).expect("it is allowed");
    moving(&end);
    let mut guest = Serial::connect_and_stop(&end.path).expect("the owner lets it in");
    guest.stop().expect("it is answered");
    assert!(end.standing()[0] < 4_000);
    drop(silent);
}

/// Each has the port for a tenth of a second, and lets no other program in at its start and end.
#[test]
fn status_is_shown_while_others_come_and_go() {
    let end = station();
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                for _ in 0..10 {
                    let args = ["status", "--port", &end.path];
                    let output = trinocular().args(args).output().expect("it runs");
                    let error = String::from_utf8_lossy(&output.stderr);
                    assert!(output.status.success(), "{error}");
                }
            });
        }
    });
}

#[test]
fn command_waits_for_one_that_only_reads() {
    let end = station();
    let reader = Serial::connect_to_watch(&end.path).expect("it is free");
    assert!(is_busy(Serial::connect(&end.path)), "it stays too long");
    let guest = Serial::connect_to_watch(&end.path).expect("it is let in");
    assert!(guest.owner().is_some());
    drop(guest);
    // Ten attempts, for a busy machine on which the reader's end takes longer than one lasts.
    let leaving = std::thread::spawn(move || drop(reader));
    let driver = (0..10).find_map(|_| Serial::connect(&end.path).ok());
    leaving.join().expect("it ends");
    assert!(driver.expect("the port becomes free").owner().is_none());
}

/// A stop that another one overtakes has stopped the stage, too.
#[test]
fn several_stops_at_once_are_all_done() {
    let end = station();
    drop(start(&end));
    for _ in 0..3 {
        let stop = || {
            let mut command = trinocular();
            command.args(["stop", "--port", &end.path]);
            command.stdout(Stdio::piped()).stderr(Stdio::piped());
            command.spawn().expect("it starts")
        };
        let stops: Vec<_> = (0..4).map(|_| stop()).collect();
        for stop in stops {
            let done = stop.wait_with_output().expect("it ends");
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            let (said, complained) = (text(&done.stdout), text(&done.stderr));
            assert!(done.status.success(), "{complained}");
            assert!(said.starts_with("stopped at "), "{said} {complained}");
        }
    }
}
