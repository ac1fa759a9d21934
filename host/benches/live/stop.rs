//! Time from STOP on the page to the last edge at the step pins, while the loop is busy.

use serde_json::{Value, json};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use trinocular::servo::page_recording::PageRecording;
use trinocular::servo::path::TargetPath;
use trinocular::servo::simulated_bench::SimulatedBench;
use trinocular::servo::station_link::StationPlace;
use trinocular::servo::workbench::Workbench;
use trinocular::servo::world::SimulatedWorld;
use trinocular_client::stage::default_stage;
use trinocular_client::twin::TwinOnPort;
use trinocular_core::frame::message::Mounting;
use trinocular_core::rig::Rig;
use trinocular_live::access::Access;
use trinocular_live::{Hub, Server, Setup};
use trinocular_vision::images::{SceneSettings, Texture};
use trinocular_vision::sums::Estimator;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket, connect};

type Socket = WebSocket<MaybeTlsStream<TcpStream>>;

/// Stops the stage `count` times out of a steady motion; prints the distribution.
pub fn run(count: usize) {
    let rig = Rig::paper();
    let stage = default_stage();
    let twin = TwinOnPort::start(&stage).expect("a pseudo-terminal");
    let place = StationPlace::Port {
        path: twin.path(),
        heartbeat_ms: 10_000,
    };
    let texture = Texture::natural(1);
    let settings = SceneSettings::default();
    let world = SimulatedWorld::new(&rig, &stage, place, &texture, settings, 1);
    let bench = SimulatedBench::new(world.expect("it starts"), TargetPath::Circle, 60.0);
    let hub = Hub::start(Setup {
        station: "bench".to_owned(),
        cameras: ["left", "middle", "right"].map(str::to_owned).into(),
        rig: rig.clone(),
        stage: stage.clone(),
        mounting: Mounting::OnStage,
        scale: None,
    });
    let hub = hub.expect("a thread");
    let midpoint = Estimator::Midpoint;
    let (mut bench, desk) = Workbench::new(
        bench,
        &rig,
        &stage,
        midpoint,
        Arc::clone(&hub),
        PageRecording::default(),
    );
    let tokens = Arc::new(Mutex::new(Vec::new()));
    let theirs = Arc::clone(&tokens);
    let access = Access::new(move |token| theirs.lock().unwrap().push(token.to_owned()));
    hub.set_controls(Arc::new(desk), Arc::new(access.expect("random bytes")));
    let listener = Server::listen(([127, 0, 0, 1], 0).into(), true).expect("a port");
    let server = Server::start(listener, hub).expect("a thread");
    let is_over = Arc::new(AtomicBool::new(false));
    let theirs = Arc::clone(&is_over);
    let thread = std::thread::spawn(move || bench.run(|| theirs.load(Ordering::Relaxed)));

    let url = format!("ws://{}/live", server.address());
    let (mut page, _) = connect(url).expect("the server listens");
    let token = tokens.lock().unwrap()[0].clone();
    say(&mut page, &json!({ "token": token }));
    let mut times_ms: Vec<f64> = Vec::new();
    while times_ms.len() < count {
        let seen_ms = until(&mut page, "idle");
        act(&mut page, &json!({"follow": {"on": true}}), seen_ms);
        until(&mut page, "following");
        // Different phases of the loop, once the stage moves steadily.
        let pause = Duration::from_millis(700 + 13 * (times_ms.len() as u64 % 17));
        let end = Instant::now() + pause;
        while Instant::now() < end {
            let _ = read(&mut page);
        }
        let pressed = Instant::now();
        act(&mut page, &json!({"stop": {}}), 0);
        let seen_ms = until(&mut page, "stopped");
        let last_edge = twin.last_edge();
        if last_edge > pressed {
            times_ms.push(last_edge.duration_since(pressed).as_secs_f64() * 1e3);
        }
        act(&mut page, &json!({"reset": {}}), seen_ms);
    }
    is_over.store(true, Ordering::Relaxed);
    let _ = thread.join();
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[(share * (times_ms.len() - 1) as f64).round() as usize];
    println!("from STOP on the page to the last edge at the pins, {count} stops at 7.9 mm/s\n");
    println!("| least | p50 | p90 | p99 | most |");
    println!("|---|---|---|---|---|");
    let row = [0.0, 0.5, 0.9, 0.99, 1.0].map(|share| format!("{:.0} ms", at(share)));
    println!("| {} |", row.join(" | "));
}

fn say(page: &mut Socket, message: &Value) {
    let text = Message::text(message.to_string());
    page.send(text).expect("the server takes it");
}

/// Asks for an action, with the clock of the last message that was seen; a stop needs none.
fn act(page: &mut Socket, action: &Value, seen_ms: u64) {
    say(page, &json!({ "do": action, "id": 1, "seen_ms": seen_ms }));
}

/// Reads a message; image sets count as drawn.
fn read(page: &mut Socket) -> Option<Value> {
    match page.read().expect("the server goes on") {
        Message::Text(text) => serde_json::from_str(&text).ok(),
        Message::Binary(_) => {
            say(page, &json!({ "drawn": u64::from(u32::MAX) }));
            None
        }
        _ => None,
    }
}

/// Waits until the station is in a state; returns the program's clock then, ms.
fn until(page: &mut Socket, state: &str) -> u64 {
    loop {
        if let Some(message) = read(page).filter(|message| message["station"]["state"] == state) {
            return message["clock_ms"].as_u64().expect("every state has it");
        }
    }
}
