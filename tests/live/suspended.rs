//! Pages of a program that was suspended: what they asked meanwhile is not done afterwards.

use super::PATIENCE;
use super::peer::Peer;
use serde_json::json;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};
use trinocular_tests::binary::{signal, trinocular};

/// A program that serves its built-in twin.
struct Served {
    program: Child,
    page: Peer,
}

impl Served {
    fn start() -> Self {
        let mut command = trinocular();
        command.args(["serve", "--control", "--listen", "127.0.0.1:0"]);
        let mut program = command
            .args(["--seconds", "60"])
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("the program runs");
        let mut lines = BufReader::new(program.stderr.take().expect("piped")).lines();
        let link = lines
            .by_ref()
            .filter_map(Result::ok)
            .find_map(|line| {
                let (_, link) = line.split_once("http://")?;
                let (address, token) = link.split_once("/#control=")?;
                Some((address.to_owned(), token.trim().to_owned()))
            })
            .expect("a control link");
        // An unread pipe would block the program.
        std::thread::spawn(move || lines.for_each(drop));
        let mut page = Peer::open(link.0.parse().expect("an address"));
        page.exchange(&link.1).expect("the link is new");
        Self { program, page }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        signal(&self.program, "CONT");
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

#[test]
fn jog_during_suspension_is_not_done() {
    let mut served = Served::start();
    let page = &mut served.page;
    // The built-in twin follows from the start.
    assert_eq!(page.ask(&json!({"follow": {"on": false}})), None);
    page.state(|state| state["station"]["state"] == "idle");
    signal(&served.program, "STOP");
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
