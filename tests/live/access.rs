//! Who sees and controls a run.

use super::Site;
use super::peer::Peer;
use serde_json::json;
use std::sync::atomic::Ordering;
use trinocular_live::controls::Action;
use tungstenite::http::StatusCode;

#[test]
fn page_shows_turns_and_images() {
    let site = Site::new();
    let mut page = Peer::open(site.address());
    let hello = page.wait(|message| (message["type"] == "hello").then(|| message.clone()));
    assert_eq!(hello["cameras"], json!(["left", "middle", "right"]));
    site.turn(5_000_000, 90);
    site.turn(5_250_000, 90);
    let state = page.state(|state| state["turns"] == 2);
    assert_eq!(state["at_s"], 0.25);
    assert_eq!(state["refusals"], json!({ "lost": 2 }));
    let (header, _) = page.images();
    assert_eq!(header["cameras"][1]["size"], json!([320, 240]));
    assert_eq!(header["cameras"][1]["aids"]["mean"], 90.0);
}

#[test]
fn page_without_key_only_watches() {
    let site = Site::new();
    let mut page = Peer::open(site.address());
    for action in [json!({"stop": {}}), json!({"zero": {}})] {
        let refusal = page.ask(&action).expect("refused");
        assert!(refusal.contains("control link"), "{refusal}");
    }
    assert_eq!(page.exchange("0123456789abcdef0123456789abcdef"), None);
    assert!(page.ask(&json!({"stop": {}})).is_some());
    assert_eq!(site.desk.stops.load(Ordering::SeqCst), 0);
}

#[test]
fn control_link_works_once() {
    let site = Site::new();
    let token = site.token();
    let mut page = Peer::open(site.address());
    let key = page.exchange(&token).expect("the link is new");
    assert_eq!(page.ask(&json!({"stop": {}})), None);
    assert_eq!(site.desk.stops.load(Ordering::SeqCst), 1);

    let mut other = Peer::open(site.address());
    assert_eq!(other.exchange(&token), None, "used");
    assert!(other.ask(&json!({"stop": {}})).is_some());
    // The key of the first page, as after a reload; and the next link.
    other.say(&json!({ "key": key }));
    assert_eq!(other.ask(&json!({"stop": {}})), None);
    assert!(Peer::open(site.address()).exchange(&site.token()).is_some());
    assert_eq!(site.desk.stops.load(Ordering::SeqCst), 2);
}

#[test]
fn only_valid_actions_reach_the_run() {
    let site = Site::new();
    let mut page = Peer::open(site.address());
    page.exchange(&site.token()).expect("the link is new");
    let jog = |um: i64| json!({"jog": {"distance_um": [um, 0, 0]}});
    assert_eq!(page.ask(&jog(1_000)), None);
    assert!(page.ask(&jog(1_000_000_000)).is_some());
    let distance_um = [1_000, 0, 0];
    let requests = site.desk.requests.lock().unwrap().clone();
    assert_eq!(requests, [Action::Jog { distance_um }]);
    site.desk.is_busy.store(true, Ordering::SeqCst);
    assert_eq!(page.ask(&json!({"zero": {}})).as_deref(), Some("busy"));
}

#[test]
fn foreign_origin_and_host_are_refused() {
    let site = Site::new();
    let address = site.address();
    let host = address.to_string();
    let foreign_port = format!("http://127.0.0.1:{}", address.port() ^ 1);
    for origin in [
        "http://example.org",
        "null",
        "https://127.0.0.1",
        &foreign_port,
    ] {
        let refused = Peer::open_from(address, &host, Some(origin)).err();
        assert_eq!(refused, Some(StatusCode::FORBIDDEN), "{origin}");
    }
    // A foreign name that resolves to this computer.
    let name = format!("evil.example.org:{}", address.port());
    let own = format!("http://{name}");
    let refused = Peer::open_from(address, &name, Some(&own)).err();
    assert_eq!(refused, Some(StatusCode::FORBIDDEN));
    // A tunnel (`ssh -L`) has another port at this end.
    let tunnel = Peer::open_from(address, "localhost:9000", Some("http://localhost:9000"));
    assert!(tunnel.is_ok());
}

#[test]
fn open_address_shows_nothing_without_key() {
    let site = Site::on("0.0.0.0:0");
    let mut page = Peer::open(site.address());
    assert_eq!(page.exchange("wrong"), None);
    assert!(page.exchange(&site.token()).is_some());
    page.wait(|message| (message["type"] == "hello").then_some(()));
    // From now on there are images.
    site.turn(1, 50);
    while !page.socket.read().expect("it goes on").is_binary() {}
    // Without a key the server closes the connection and has sent nothing.
    for asked in [
        None,
        Some(json!({ "drawn": 0 })),
        Some(json!({ "do": {"stop": {}}, "id": 1 })),
        Some(json!({ "do": {"unknown": {}}, "id": 1 })),
    ] {
        let mut other = Peer::open(site.address());
        if let Some(asked) = &asked {
            other.say(asked);
        }
        let first = other.socket.read();
        let is_silent = matches!(
            &first,
            Err(tungstenite::Error::Io(error)) if error.kind() == std::io::ErrorKind::WouldBlock
        );
        let is_closed = first.as_ref().map_or(true, tungstenite::Message::is_close);
        assert!(!is_silent && is_closed, "{asked:?}: {first:?}");
    }
    assert_eq!(site.desk.stops.load(Ordering::SeqCst), 0);
}
