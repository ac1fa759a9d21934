//! Pages that do not keep up.

use super::peer::Peer;
use super::{PATIENCE, Site};
use std::time::Instant;

/// The page reads nothing. The loop goes on, other pages get everything, and the page is dropped.
#[test]
fn page_that_reads_nothing_is_dropped() {
    let site = Site::new();
    let mut good = Peer::open(site.address());
    good.state(|_| true);
    let mut slow = Peer::open(site.address());
    slow.state(|_| true);
    assert_eq!(site.hub.clients(), 2);
    let end = Instant::now() + PATIENCE;
    let mut turns = 0u64;
    while site.hub.clients() == 2 {
        assert!(Instant::now() < end, "it is not dropped");
        // Long notes fill the system's buffers in a few seconds.
        site.hub.note("x".repeat(100_000));
        turns += 1;
        site.turn(turns, 50);
        good.state(|state| state["turns"] == turns);
    }
    drop(slow);
    site.turn(turns + 1, 50);
    good.state(|state| state["turns"] == turns + 1);
}

/// A page that does not say that it has drawn an image set gets no further one.
#[test]
fn images_wait_until_the_last_were_drawn() {
    let site = Site::new();
    let mut page = Peer::open(site.address());
    page.state(|_| true);
    let mut sets = 0;
    let mut number = 0;
    for turn in 1..=50 {
        site.turn(turn, 50);
        loop {
            match page.socket.read().expect("the server goes on") {
                tungstenite::Message::Binary(_) => sets += 1,
                tungstenite::Message::Text(text) => {
                    let state: serde_json::Value = serde_json::from_str(&text).expect("JSON");
                    if state["turns"] == turn {
                        break;
                    }
                }
                _ => {}
            }
        }
    }
    // The encoder may be slower than all the turns.
    while sets == 0 {
        sets += u32::from(page.socket.read().expect("it goes on").is_binary());
    }
    assert_eq!(sets, 1);
    let end = Instant::now() + PATIENCE;
    page.say(&serde_json::json!({ "drawn": 1 }));
    while number < 2 && Instant::now() < end {
        site.turn(100 + number, 50);
        number = page.images().0["number"].as_u64().expect("a number");
    }
    assert!(number >= 2);
}

/// A page tells by it that the program hangs.
#[test]
fn sign_of_life_comes_without_turns() {
    let site = Site::new();
    let mut page = Peer::open(site.address());
    for _ in 0..3 {
        page.wait(|message| (message["type"] == "alive").then_some(()));
    }
}
