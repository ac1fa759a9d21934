//! A whole bench behind the page: the built-in twin in real time, rendered cameras, a moving
//! target.

use super::peer::Peer;
use super::{PATIENCE, setup};
use serde_json::{Value, json};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Instant;
use trinocular::servo::page_recording::PageRecording;
use trinocular::servo::path::TargetPath;
use trinocular::servo::simulated_bench::SimulatedBench;
use trinocular::servo::station_link::StationPlace;
use trinocular::servo::workbench::Workbench;
use trinocular::servo::world::SimulatedWorld;
use trinocular_client::serial::Serial;
use trinocular_client::twin::TwinOnPort;
use trinocular_client::twin::real_time::Switches;
use trinocular_core::frame::message::Command;
use trinocular_live::access::Access;
use trinocular_live::{Hub, Server};
use trinocular_vision::images::{SceneSettings, Texture};
use trinocular_vision::sums::Estimator;

/// Running bench.
struct Lab {
    twin: TwinOnPort,
    server: Server,
    token: String,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Lab {
    fn start(path: TargetPath) -> Self {
        let setup = setup();
        let twin = TwinOnPort::start(&setup.stage).expect("a pseudo-terminal");
        let hub = Hub::start(setup.clone()).expect("a thread");
        let listener = Server::listen(([127, 0, 0, 1], 0).into(), true).expect("a port");
        let server = Server::start(listener, Arc::clone(&hub)).expect("a thread");
        let place = StationPlace::Port {
            path: twin.path(),
            heartbeat_ms: 10_000,
        };
        let texture = Texture::natural(1);
        let settings = SceneSettings::default();
        let world = SimulatedWorld::new(&setup.rig, &setup.stage, place, &texture, settings, 1);
        let bench = SimulatedBench::new(world.expect("it starts"), path, 30.0);
        let (rig, stage) = (&setup.rig, &setup.stage);
        let midpoint = Estimator::Midpoint;
        let (mut bench, desk) = Workbench::new(
            bench,
            rig,
            stage,
            midpoint,
            Arc::clone(&hub),
            PageRecording::default(),
        );
        let tokens = Arc::new(Mutex::new(Vec::new()));
        let theirs = Arc::clone(&tokens);
        let access = Access::new(move |token| theirs.lock().unwrap().push(token.to_owned()));
        hub.set_controls(Arc::new(desk), Arc::new(access.expect("random bytes")));
        let is_over = Arc::new(AtomicBool::new(false));
        let theirs = Arc::clone(&is_over);
        let thread = std::thread::spawn(move || {
            bench
                .run(|| theirs.load(Ordering::Relaxed))
                .expect("the station stays in reach");
        });
        let token = tokens.lock().unwrap()[0].clone();
        Self {
            twin,
            server,
            token,
            is_over,
            thread: Some(thread),
        }
    }

    /// Opens the page by the control link.
    fn page(&self) -> Peer {
        let mut page = Peer::open(self.server.address());
        page.exchange(&self.token).expect("the link is new");
        page
    }

    /// Waits until the pins have made a step from `before` on.
    fn wait_for_steps(&self, before: [i64; 3]) {
        let end = Instant::now() + PATIENCE;
        while self.twin.steps() == before {
            assert!(Instant::now() < end, "no steps");
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }
}

impl Drop for Lab {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let outcome = thread.join();
            assert!(outcome.is_ok() || std::thread::panicking());
        }
    }
}

fn is_in(state: &str) -> impl Fn(&Value) -> bool + '_ {
    move |message| message["station"]["state"] == state
}

/// Asks until the action is done: the station hears of a switch, or comes to rest, a moment later.
fn done(page: &mut Peer, action: &Value) {
    let end = Instant::now() + PATIENCE;
    while let Some(refusal) = page.ask(action) {
        assert!(Instant::now() < end, "{refusal}");
    }
}

fn jog(distance_um: [i32; 3]) -> Value {
    json!({"jog": {"distance_um": distance_um}})
}

#[test]
fn stop_of_the_page_stops_the_pins() {
    let lab = Lab::start(TargetPath::Lissajous);
    let mut page = lab.page();
    page.state(is_in("idle"));
    assert_eq!(page.ask(&json!({"follow": {"on": true}})), None);
    page.state(is_in("following"));
    lab.wait_for_steps(lab.twin.steps());
    assert_eq!(page.ask(&json!({"stop": {}})), None);
    page.state(is_in("stopped"));
    // The target moves on, and the loop still looks: nothing moves the stage any more.
    let steps = lab.twin.steps();
    let turns = |state: &Value| state["turns"].as_u64().unwrap_or(0);
    let now = turns(&page.state(|state| state["following"] == false));
    page.state(|state| turns(state) > now + 5);
    assert_eq!(lab.twin.steps(), steps);
    // Jog and following are refused until the reset.
    for action in [jog([500, 0, 0]), json!({"follow": {"on": true}})] {
        let refusal = page.ask(&action).expect("it is refused");
        for part in ["stopped", "reset"] {
            assert!(refusal.contains(part), "{refusal}");
        }
    }
    assert_eq!(lab.twin.steps(), steps);
    assert_eq!(page.ask(&json!({"reset": {}})), None);
    page.state(is_in("idle"));
    assert_eq!(page.ask(&json!({"follow": {"on": true}})), None);
    page.state(is_in("following"));
    lab.wait_for_steps(steps);
}

/// The end of following resets the station by itself; a stop before that must win.
#[test]
fn stop_cancels_reset_before_it() {
    let lab = Lab::start(TargetPath::Lissajous);
    let mut page = lab.page();
    for _ in 0..3 {
        page.state(is_in("idle"));
        assert_eq!(page.ask(&json!({"follow": {"on": true}})), None);
        page.state(is_in("following"));
        lab.wait_for_steps(lab.twin.steps());
        page.say(&json!({"do": {"follow": {"on": false}}, "id": 1001}));
        page.say(&json!({"do": {"reset": {}}, "id": 1002}));
        page.say(&json!({"do": {"stop": {}}, "id": 1003}));
        let turns = |state: &Value| state["turns"].as_u64().unwrap_or(0);
        let now = turns(&page.state(is_in("stopped")));
        let later = page.state(|state| turns(state) > now + 5);
        assert_eq!(later["station"]["state"], "stopped");
        assert_eq!(page.ask(&json!({"reset": {}})), None);
    }
}

#[test]
fn bench_follows_again_after_jog_and_zero() {
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    assert_eq!(page.ask(&jog([500, -250, 0])), None);
    let end = Instant::now() + PATIENCE;
    while lab.twin.steps() != [40, -20, 0] {
        assert!(Instant::now() < end, "{:?}", lab.twin.steps());
        page.state(|_| true);
    }
    done(&mut page, &json!({"zero": {}}));
    page.state(|state| {
        state["notes"]
            .to_string()
            .contains("zero: the position became 0 0 0 mm")
    });
    let at_zero = |state: &Value| {
        let samples = state["samples"].as_array();
        let last = samples.and_then(|samples| samples.last());
        last.is_some_and(|row| [10, 11, 12].iter().all(|i| row[*i] == 0.0))
    };
    page.state(at_zero);
    for _ in 0..2 {
        assert_eq!(page.ask(&json!({"follow": {"on": true}})), None);
        page.state(is_in("following"));
        let seen = |state: &Value| state["samples"][0][1].is_number();
        page.state(seen);
        // While it follows, a jog is refused by the loop.
        let refusal = page.ask(&jog([500, 0, 0]));
        assert_eq!(refusal.as_deref(), Some("end following first"));
        page.say(&json!({"do": {"follow": {"on": false}}, "id": 2001}));
        let ended = "following ended, by the live page";
        page.state(|state| state["notes"].to_string().contains(ended));
        page.state(is_in("idle"));
    }
    let text = "lamp\u{202e} off";
    assert_eq!(page.ask(&json!({"mark": {"text": text}})), None);
    page.state(|state| state["notes"].to_string().contains(r"lamp\\u{202e} off"));
}

/// Each of three jogs at once is done or refused by name, and none replaces another.
#[test]
fn jog_in_motion_is_refused_by_name() {
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    for id in [1001, 1002, 1003] {
        page.say(&json!({"do": jog([5_000, 0, 0]), "id": id}));
    }
    let answers = [1001, 1002, 1003].map(|id| {
        page.wait(|message| {
            let is_answer = message["type"] == "done" && message["id"] == id;
            is_answer.then(|| message["error"].as_str().map(str::to_owned))
        })
    });
    assert_eq!(answers[0], None);
    for answer in &answers[1..] {
        let refusal = answer.as_deref().expect("it is refused");
        assert!(refusal.contains("the stage still moves"), "{refusal}");
    }
    let end = Instant::now() + PATIENCE;
    while lab.twin.steps() != [400, 0, 0] {
        assert!(Instant::now() < end, "{:?}", lab.twin.steps());
        page.state(|_| true);
    }
    page.state(is_in("idle"));
    assert_eq!(lab.twin.steps(), [400, 0, 0]);
}

/// Commands of another program, through this one, stand among the page's events.
#[test]
fn deeds_of_other_program_are_noted() {
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    let by = format!("(process {})", std::process::id());
    let mut guest = Serial::connect(lab.twin.path()).expect("the owner lets it in");
    let near = Command::Jog {
        distance_um: [500, 0, 0],
    };
    guest.start_heartbeat().expect("it is answered");
    guest.command("jog", near).expect("it is passed on");
    page.state(has_note(&["jog by 0.5 0 0 mm, by `", &by]));
    lab.wait_for_steps([39, 0, 0]);
    let at_rest = |guest: &Serial| {
        let status = guest.fresh_status(true).expect("a status");
        !status.state.is_moving()
    };
    let end = Instant::now() + PATIENCE;
    while !at_rest(&guest) {
        assert!(Instant::now() < end, "it does not come to rest");
    }
    for (name, command) in [
        ("zero: ", Command::Zero),
        ("motors off, by", Command::Motors { on: false }),
    ] {
        guest.command("it", command).expect("it is passed on");
        page.state(has_note(&[name, &by]));
    }
    drop(guest);
    page.state(|state| state["station"]["motors"] == false);
    // The next guest is let in once the first has left, and so is the page.
    let end = Instant::now() + PATIENCE;
    while page.ask(&json!({"motors_on": {}})).is_some() {
        assert!(Instant::now() < end, "motors on stays refused");
    }
    page.state(|state| state["station"]["motors"] == true);
}

/// A step of the page's stage is 0.0125 mm.
#[test]
fn jog_below_a_step_is_refused_by_name() {
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    let refusal = page.ask(&jog([500, -6, 0])).expect("it is refused");
    for part in ["y=-0.006", "less than half a step", "0.0125 mm"] {
        assert!(refusal.contains(part), "{refusal}");
    }
    assert_eq!(lab.twin.steps(), [0; 3]);
    assert_eq!(page.ask(&jog([0, -7, 0])), None);
    lab.wait_for_steps([0; 3]);
    assert_eq!(lab.twin.steps(), [0, -1, 0]);
}

/// Returns true if a note of the page contains all of `parts`.
fn has_note(parts: &[&str]) -> impl Fn(&Value) -> bool {
    let parts: Vec<String> = parts.iter().map(|part| (*part).to_owned()).collect();
    move |state| {
        let notes = state["notes"].as_array().into_iter().flatten();
        let mut texts = notes.filter_map(|note| note["text"].as_str());
        texts.any(|text| parts.iter().all(|part| text.contains(part)))
    }
}

#[test]
fn shortened_jog_is_named_on_the_page() {
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    assert_eq!(page.ask(&jog([40_000, 1_000, 0])), None);
    let end = Instant::now() + PATIENCE;
    while lab.twin.steps() != [3_200, 80, 0] {
        assert!(Instant::now() < end, "{:?}", lab.twin.steps());
        page.state(|_| true);
    }
    // The page hears a moment later that the stage stands.
    while page.ask(&jog([30_000, 0, 0])).is_some() {
        assert!(Instant::now() < end, "the stage does not come to rest");
    }
    let expected = "x was shortened to 20.0000 mm of 30 mm by the soft limits";
    page.state(has_note(&[expected]));
    while lab.twin.steps() != [4_800, 80, 0] {
        assert!(Instant::now() < end, "{:?}", lab.twin.steps());
        page.state(|_| true);
    }
    while page.ask(&jog([1_000, 0, 0])).is_some() {
        assert!(Instant::now() < end, "the stage does not come to rest");
    }
    // At the limit, nothing is left to go.
    page.state(has_note(&["x was shortened to 0.0000 mm of 1 mm"]));
}

/// A place is absolute: the stage goes there from wherever it stands, or not at all.
#[test]
fn stage_goes_to_places_within_its_travel() {
    let go = |position_um: [i32; 3]| json!({"go": {"position_um": position_um}});
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    for (position_um, steps) in [
        ([1_000, -500, 0], [80, -40, 0]),
        ([1_000, -500, 0], [80, -40, 0]),
        ([250, 0, 125], [20, 0, 10]),
    ] {
        let end = Instant::now() + PATIENCE;
        // The page hears a moment later that the stage stands.
        while page.ask(&go(position_um)).is_some() {
            assert!(Instant::now() < end, "the stage does not come to rest");
        }
        while lab.twin.steps() != steps {
            assert!(Instant::now() < end, "{:?}", lab.twin.steps());
            page.state(|_| true);
        }
    }
    page.state(is_in("idle"));
    let refusal = page.ask(&go([0, 60_001, 0])).expect("it is refused");
    assert!(
        refusal.contains("y = 60.001 mm is outside the soft limits"),
        "{refusal}"
    );
    let refusal = page.ask(&go([0, i32::MIN, 0])).expect("it is refused");
    assert!(refusal.contains("at most 2000 mm"), "{refusal}");
    assert_eq!(lab.twin.steps(), [20, 0, 10]);
    // An emergency stop in motion may lose steps.
    assert_eq!(page.ask(&go([50_000, 0, 0])), None);
    lab.wait_for_steps([20, 0, 10]);
    lab.twin.set_switches(Switches {
        emergency_stop: true,
        ..Switches::default()
    });
    page.state(has_note(&["fault 1"]));
    lab.twin.set_switches(Switches::default());
    done(&mut page, &json!({"reset": {}}));
    page.state(is_in("idle"));
    let steps = lab.twin.steps();
    let refusal = page.ask(&go([0; 3])).expect("it is refused");
    assert!(
        refusal.contains("does not know where the stage is"),
        "{refusal}"
    );
    assert_eq!(lab.twin.steps(), steps);
}

#[test]
fn fault_while_nothing_is_followed_is_noted() {
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    lab.twin.set_switches(Switches {
        emergency_stop: true,
        ..Switches::default()
    });
    page.state(has_note(&[
        "fault 1: the emergency stop was pressed",
        "; to do: ",
    ]));
    lab.twin.set_switches(Switches::default());
    done(&mut page, &json!({"reset": {}}));
    page.state(has_note(&["no fault any more"]));
}

/// A reset that waited for the end of a motion would undo a stop that comes meanwhile.
#[test]
fn reset_in_motion_is_refused_by_name() {
    let lab = Lab::start(TargetPath::Still);
    let mut page = lab.page();
    page.state(is_in("idle"));
    assert_eq!(page.ask(&jog([50_000, 0, 0])), None);
    lab.wait_for_steps([0; 3]);
    let refusal = page.ask(&json!({"reset": {}})).expect("it is refused");
    assert!(refusal.contains("moving"), "{refusal}");
    assert_eq!(page.ask(&json!({"stop": {}})), None);
    page.state(is_in("stopped"));
    assert!(lab.twin.steps()[0] < 4_000);
    assert_eq!(page.ask(&json!({"reset": {}})), None);
    page.state(is_in("idle"));
    // While it follows, too.
    assert_eq!(page.ask(&json!({"follow": {"on": true}})), None);
    page.state(is_in("following"));
    let refusal = page.ask(&json!({"reset": {}}));
    assert_eq!(refusal.as_deref(), Some("end following first"));
}
