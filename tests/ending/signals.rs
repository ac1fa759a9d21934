//! Every signal that ends or suspends a program leaves the stage at rest.

use super::{Desk, RUNS, alone, ended, moving, stands_stopped};
use std::fs::File;
use std::process::{Command, Stdio};
use trinocular_client::serial::Serial;
use trinocular_core::safety::{Fault, State};
use trinocular_tests::binary::{signal, suspend, trinocular};
use trinocular_tests::far_end::station;

/// Signals that end a program by default, without those of the other tests, and SIGTSTP (Ctrl-Z).
const SIGNALS: [&str; 15] = [
    "QUIT", "ALRM", "VTALRM", "PROF", "USR1", "USR2", "XCPU", "SYS", "TRAP", "ABRT", "BUS", "TSTP",
    "IO", "STKFLT", "RTMIN+3",
];

#[test]
fn every_ending_signal_stops_stage() {
    let _alone = alone();
    let desk = Desk::new();
    for name in SIGNALS {
        let end = station();
        let run = desk.start(&end, RUNS[0]);
        moving(&end);
        signal(&run, name);
        let (code, err) = ended(run);
        assert_eq!(code, Some(3), "{name}: {err}");
        assert!(err.contains("interrupted"), "{name}: {err}");
        stands_stopped(&end);
    }
}

#[test]
fn file_limit_stops_stage() {
    let _alone = alone();
    let desk = Desk::new();
    let end = station();
    let out = File::create(desk.folder.path().join("run.jsonl")).expect("ours");
    let words = "track --sim --path line --seconds 60 --heartbeat 5000 --json --port";
    let run = Command::new("bash")
        .args(["-c", "ulimit -f 1; exec \"$@\"", "bash"])
        .arg(trinocular().get_program())
        .args(words.split_whitespace())
        .arg(&end.path)
        .current_dir(desk.folder.path())
        .stdout(out)
        .stderr(Stdio::piped())
        .spawn()
        .expect("bash runs");
    let (code, err) = ended(run);
    assert_eq!(code, Some(1), "{err}");
    assert!(err.contains("standard output"), "{err}");
    stands_stopped(&end);
}

/// SIGSTOP cannot be caught, so the heartbeat stops with the program.
#[test]
fn suspended_host_stops_by_heartbeat() {
    let _alone = alone();
    let desk = Desk::new();
    let end = station();
    let run = desk.start(&end, "jog x=50 --rig wide.toml --heartbeat 500");
    moving(&end);
    suspend(&run);
    let stood = end.standing();
    assert!(stood[0] < 4_000, "{stood:?}");
    signal(&run, "CONT");
    let (code, err) = ended(run);
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("fault 0"), "{err}");
    let serial = Serial::connect(&end.path).expect("it answers");
    let status = serial.fresh_status(false).expect("it tells");
    assert_eq!(
        (status.state, status.fault),
        (State::Faulted, Some(Fault::Heartbeat))
    );
    assert_eq!(end.steps(), stood);
}
