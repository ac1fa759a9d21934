//! Requests that no page makes.

use super::peer::Peer;
use super::{PATIENCE, Site};
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use trinocular_live::server::{CONTROL_PAGES, PAGES};
use tungstenite::Message;

/// Sends bytes; returns all that the server answers until it closes the connection.
fn answer(address: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).expect("the server listens");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    // The server may close before it has read everything.
    let _ = stream.write_all(request);
    let mut text = Vec::new();
    if let Err(error) = stream.read_to_end(&mut text) {
        let is_open = error.kind() == std::io::ErrorKind::WouldBlock;
        assert!(!is_open, "the server keeps the connection");
    }
    String::from_utf8_lossy(&text).into_owned()
}

fn get(address: SocketAddr, path: &str, host: &str) -> String {
    let request = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    answer(address, request.as_bytes())
}

#[test]
fn page_is_served_with_strict_policy() {
    let site = Site::new();
    let address = site.address();
    let page = get(address, "/", "localhost");
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    let policy = page
        .lines()
        .find_map(|line| line.strip_prefix("content-security-policy: "))
        .expect("a policy");
    for part in [
        "default-src 'none'",
        "script-src 'self'",
        "frame-ancestors 'none'",
    ] {
        assert!(policy.contains(part), "{policy}");
    }
    assert!(!policy.contains("unsafe"), "{policy}");
    for path in [
        "/main.js",
        "/style.css",
        "/vendor/uPlot.iife.min.js",
        "/state.json",
    ] {
        let file = get(address, path, "127.0.0.1");
        assert!(file.starts_with("HTTP/1.1 200"), "{path}: {file}");
        assert!(file.contains("x-content-type-options: nosniff"), "{path}");
    }
}

#[test]
fn only_embedded_files_are_served() {
    let site = Site::new();
    for path in [
        "/../Cargo.toml",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2fetc/passwd",
        "//etc/passwd",
        "/vendor/",
        "/vendor/LICENSE-uPlot/..",
        "/main.js%00",
        "http://example.org/",
    ] {
        let answer = get(site.address(), path, "127.0.0.1");
        let is_page = path.starts_with("http") && answer.contains("<title>Trinocular");
        assert!(
            is_page || answer.starts_with("HTTP/1.1 4"),
            "{path}: {answer}"
        );
        assert!(!answer.contains("root:"), "{path}");
    }
    for method in ["POST", "PUT", "DELETE", "OPTIONS"] {
        let request = format!(
            "{method} / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 0\r\n\
             Connection: close\r\n\r\n"
        );
        let answer = answer(site.address(), request.as_bytes());
        assert!(answer.starts_with("HTTP/1.1 405"), "{method}: {answer}");
    }
    let refused = get(site.address(), "/", "evil.example.org");
    assert!(refused.starts_with("HTTP/1.1 403"), "{refused}");
}

#[test]
fn huge_and_slow_requests_are_ended() {
    let site = Site::new();
    let address = site.address();
    let mut page = Peer::open(address);
    let mut huge = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ".to_vec();
    huge.resize(4 << 20, b'x');
    let refused = answer(address, &huge);
    assert!(
        refused.is_empty() || refused.starts_with("HTTP/1.1 4"),
        "{refused}"
    );
    let mut body =
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 4294967296\r\n\r\n".to_vec();
    body.resize(1 << 20, b'x');
    answer(address, &body);
    for nonsense in [
        &b"\x16\x03\x01\x02\x00\x01"[..],
        b"GET\r\n\r\n",
        b"\0\0\0\0\r\n\r\n",
    ] {
        answer(address, nonsense);
    }
    // Half a header: `answer` returns because the server gives up.
    answer(address, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n");
    site.turn(1, 50);
    page.state(|state| state["turns"] == 1);
}

#[test]
fn many_connections_leave_open_pages_alone() {
    let site = Site::new();
    let address = site.address();
    let mut page = Peer::open(address);
    page.state(|_| true);
    let crowd: Vec<TcpStream> = (0..200)
        .filter_map(|_| TcpStream::connect(address).ok())
        .collect();
    site.turn(1, 50);
    page.state(|state| state["turns"] == 1);
    drop(crowd);
    // The server notices that the crowd is gone.
    let end = std::time::Instant::now() + PATIENCE;
    while !get(address, "/", "127.0.0.1").starts_with("HTTP/1.1 200") {
        assert!(
            std::time::Instant::now() < end,
            "the server does not recover"
        );
    }
}

#[test]
fn pages_are_bounded() {
    let site = Site::new();
    let open = |_| {
        let mut page = Peer::open(site.address());
        page.state(|_| true);
        page
    };
    let mut pages: Vec<Peer> = (0..PAGES).map(open).collect();
    let host = site.address().to_string();
    let more = || Peer::open_from(site.address(), &host, None);
    // The operator's page comes in all the same.
    let mut control = more().expect("it may show a key");
    control.exchange(&site.token()).expect("the link is new");
    control.state(|_| true);
    assert_eq!(control.ask(&serde_json::json!({"stop": {}})), None);
    let _waiting: Vec<_> = (1..CONTROL_PAGES)
        .map(|_| more().expect("it may"))
        .collect();
    let refused = more().err();
    assert_eq!(refused.map(|status| status.as_u16()), Some(503));
    site.turn(1, 50);
    for page in &mut pages {
        page.state(|state| state["turns"] == 1);
    }
}

#[test]
fn unknown_action_is_refused() {
    let site = Site::new();
    let mut page = Peer::open(site.address());
    page.exchange(&site.token()).expect("the link is new");
    for unknown in [
        serde_json::json!({"reboot": {}}),
        serde_json::json!({"jog": {"distance_mm": [1, 0, 0]}}),
        serde_json::json!("stop"),
        serde_json::json!(null),
    ] {
        let refusal = page.ask(&unknown).expect("it is refused");
        assert!(refusal.contains("unknown action"), "{unknown}: {refusal}");
    }
    assert_eq!(page.ask(&serde_json::json!({"stop": {}})), None);
}

#[test]
fn garbage_closes_only_its_own_page() {
    let site = Site::new();
    let mut page = Peer::open(site.address());
    let key = page.exchange(&site.token()).expect("the link is new");
    let long = "x".repeat(100_000);
    for garbage in [
        Message::text("{"),
        Message::text("[]"),
        Message::text(r#"{"do":{"reboot":{}}}"#),
        Message::text(r#"{"drawn":-1}"#),
        Message::text(r#"{"drawn":1,"key":"x"}"#),
        Message::text(format!(r#"{{"key":"{long}"}}"#)),
        Message::binary(vec![0; 50]),
    ] {
        let mut other = Peer::open(site.address());
        let text = format!("{garbage:?}");
        let _ = other.socket.send(garbage);
        assert!(other.is_closed(), "{text:.80}");
    }
    // Bytes that are no websocket frame.
    let mut other = Peer::open(site.address());
    other.socket.get_mut().write_all(&[0xff; 64]).unwrap();
    assert!(other.is_closed());
    page.say(&serde_json::json!({ "key": key }));
    assert_eq!(page.ask(&serde_json::json!({"stop": {}})), None);
}
