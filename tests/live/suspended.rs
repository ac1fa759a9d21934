//! Pages of a program that was suspended: what they asked meanwhile is not done afterwards.

use super::PATIENCE;
use super::served::Served;
use serde_json::json;
use std::time::{Duration, Instant};
use trinocular_tests::binary::{signal, suspend};

#[test]
fn jog_during_suspension_is_not_done() {
    let mut served = Served::start("60");
    let page = &mut served.page;
    // The built-in twin follows from the start.
    assert_eq!(page.ask(&json!({"follow": {"on": false}})), None);
    page.state(|state| state["station"]["state"] == "idle");
    suspend(&served.program);
    page.say(&json!({"do": {"jog": {"distance_um": [3_000, 0, 0]}}, "id": 1_000}));
    std::thread::sleep(Duration::from_millis(2_500));
    signal(&served.program, "CONT");
    let error = page.wait(|message| {
        let is_answer = message["type"] == "done" && message["id"] == 1_000;
        is_answer.then(|| message["error"].as_str().map(str::to_owned))
    });
    let error = error.expect("it is refused");
    assert!(error.contains("was not done"), "{error}");
    let end = Instant::now() + Duration::from_secs(1);
    page.state(|state| {
        assert_eq!(state["station"]["is_moving"], false, "{state}");
        Instant::now() > end
    });
    // What is asked afterwards is done.
    let end = Instant::now() + PATIENCE;
    while page
        .ask(&json!({"jog": {"distance_um": [500, 0, 0]}}))
        .is_some()
    {
        assert!(Instant::now() < end, "jogs stay refused");
    }
}
