//! Options of `serve` and of `track --live`.

use std::net::TcpListener;
use trinocular_tests::binary::{Outcome, trinocular};

#[test]
fn port_in_use_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("an address").to_string();
    let serve = Outcome::of(trinocular().args(["serve", "--listen", &address]));
    serve.failed(1, &[&address, "in use", "--listen"]);
    let live = format!("--live={address}");
    let track = Outcome::of(trinocular().args(["track", "--sim", "--seconds", "1", &live]));
    assert_eq!(track.code, Some(1));
    track.complained(&[&address, "in use"]);
}

#[test]
fn open_address_without_control_is_refused() {
    for arguments in [
        &["serve", "--listen", "0.0.0.0:0"][..],
        &["track", "--sim", "--live=0.0.0.0:0"],
    ] {
        let outcome = Outcome::of(trinocular().args(arguments));
        outcome.failed(2, &["0.0.0.0:0", "--control", "ssh -L"]);
    }
}

#[test]
fn served_run_ends_by_itself() {
    let arguments = ["serve", "--listen", "127.0.0.1:0", "--seconds", "1"];
    let outcome = Outcome::of(trinocular().args(arguments));
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(
        outcome.stderr.contains("live page: http://127.0.0.1:"),
        "{}",
        outcome.stderr
    );
    assert!(!outcome.stderr.contains("#control="), "{}", outcome.stderr);
}

#[test]
fn live_track_prints_page_and_rows() {
    let arguments = [
        "track",
        "--sim",
        "--seconds",
        "0.5",
        "--live=127.0.0.1:0",
        "--json",
    ];
    let outcome = Outcome::of(trinocular().args(arguments));
    assert!(!outcome.good_json().is_empty());
    assert!(
        outcome.stderr.contains("live page: http://127.0.0.1:"),
        "{}",
        outcome.stderr
    );
}
