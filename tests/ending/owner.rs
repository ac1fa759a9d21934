//! Commands while another program has the port.

use super::{Desk, RUNS, alone, ended, moving, stands_stopped};
use std::process::{Child, Stdio};
use trinocular_tests::binary::{interrupt, signal, suspend};
use trinocular_tests::far_end::{FarEnd, station};

/// Starts a jog, and suspends it while the stage moves.
fn suspended_in_motion(desk: &Desk) -> (FarEnd, Child) {
    let end = station();
    let first = desk.start(&end, RUNS[0]);
    moving(&end);
    suspend(&first);
    (end, first)
}

#[test]
fn suspended_port_owner_is_named() {
    let _alone = alone();
    let desk = Desk::new();
    let (end, first) = suspended_in_motion(&desk);
    let (code, err) = ended(desk.start(&end, "stop"));
    assert_eq!(code, Some(3), "{err}");
    let kill = format!("kill -9 {}", first.id());
    for part in [end.path.as_str(), kill.as_str(), "suspended", "button"] {
        assert!(err.contains(part), "`{part}` is not in: {err}");
    }
    // The owner receives the stop's signal when it continues.
    signal(&first, "CONT");
    assert_eq!(ended(first).0, Some(3));
    let (code, err) = ended(desk.start(&end, "stop"));
    assert_eq!(code, Some(0), "{err}");
    end.standing();
}

#[test]
fn stop_after_owner_left_succeeds() {
    let _alone = alone();
    let desk = Desk::new();
    let end = station();
    let mut first = desk.start(&end, RUNS[0]);
    moving(&end);
    first.kill().expect("it runs");
    first.wait().expect("it ended");
    let (code, err) = ended(desk.start(&end, "stop"));
    assert_eq!(code, Some(0), "{err}");
    stands_stopped(&end);
}

#[test]
fn suspended_owner_is_named_to_guests() {
    let _alone = alone();
    let desk = Desk::new();
    let (end, first) = suspended_in_motion(&desk);
    let pid = format!("process {}", first.id());
    for guest in ["status", "jog x=1", "motors on"] {
        let (code, err) = ended(desk.start(&end, guest));
        assert_eq!(code, Some(3), "{guest}: {err}");
        for part in [pid.as_str(), "does not answer", "may be suspended", "fg"] {
            assert!(err.contains(part), "{guest}: `{part}` is not in: {err}");
        }
    }
    // It still has the port.
    signal(&first, "CONT");
    interrupt(&first);
    assert_eq!(ended(first).0, Some(3));
    end.standing();
}

#[test]
fn motion_stopped_by_other_says_where_it_ended() {
    let _alone = alone();
    let desk = Desk::new();
    for (words, parts) in [
        (RUNS[0], &["moved by  ", "now at    "][..]),
        (RUNS[1], &["now at  "]),
    ] {
        let end = station();
        let mut run = desk.command(&end, words);
        let run = run.stdout(Stdio::piped()).spawn().expect("it runs");
        moving(&end);
        let (code, err) = ended(desk.start(&end, "stop"));
        assert_eq!(code, Some(0), "{err}");
        let done = run.wait_with_output().expect("it ends");
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        let (out, err) = (text(done.stdout), text(done.stderr));
        assert_eq!(done.status.code(), Some(3), "{err}");
        assert!(
            err.contains("stopped by `") && err.contains("reset"),
            "{err}"
        );
        let steps = end.standing()[0];
        for part in parts {
            let line = out.lines().find(|line| line.starts_with(part));
            let line = line.unwrap_or_else(|| panic!("`{part}` is not in: {out}"));
            assert!(line.contains(&format!("({steps} 0 0 steps)")), "{line}");
        }
    }
}
