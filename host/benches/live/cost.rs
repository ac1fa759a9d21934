//! Processor time of hub, encoder and server at 60 updates a second.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_core::rig::Rig;
use trinocular_live::hub::Estimate;
use trinocular_live::{Hub, Server, Setup, Turn};
use trinocular_vision::flow::{Flow, FlowSettings};
use trinocular_vision::images::{Scene, SceneSettings, Texture};
use tungstenite::{Message, connect};

const UPDATES_HZ: u32 = 60;
/// Unit of the times in `/proc`, s.
const TICK_S: f64 = 0.01;

/// Prints the share of one core per thread, by the number of open pages.
pub fn run(seconds: u32) {
    println!("share of one core at {UPDATES_HZ} updates/s, three images of 320x240, {seconds} s\n");
    println!("| pages | loop | images | server | sum | updates | image sets |");
    println!("|---|---|---|---|---|---|---|");
    for pages in [0, 1, 4] {
        measure(seconds, pages);
    }
    println!();
}

fn measure(seconds: u32, pages: usize) {
    let rig = Rig::paper();
    let setup = Setup {
        station: "bench".to_owned(),
        cameras: ["left", "middle", "right"].map(str::to_owned).into(),
        rig: rig.clone(),
        stage: default_stage(),
        mounting: Mounting::OnStage,
        scale: None,
    };
    let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default()).expect("a scene");
    let mut flow = Flow::new(&rig, FlowSettings::default()).expect("a rig");
    flow.set_keyframe(&scene.render([0.0; 3], 0, 1))
        .expect("a keyframe");
    let images = scene.render([3.0, 2.0, 1.0], 0, 2);
    let measurement = flow.measure(&images).expect("a measurement");

    let hub = Hub::start(setup).expect("a thread");
    let listener = Server::listen(([127, 0, 0, 1], 0).into(), false).expect("a port");
    let server = Server::start(listener, Arc::clone(&hub)).expect("a thread");
    let address = server.address();
    let readers: Vec<_> = (0..pages)
        .map(|_| std::thread::spawn(move || read(address)))
        .collect();
    while hub.clients() < pages {
        std::thread::sleep(Duration::from_millis(1));
    }
    let before = threads();
    let (start, mut in_loop) = (Instant::now(), Duration::ZERO);
    let turns = seconds * UPDATES_HZ;
    for turn in 0..turns {
        let due = start + Duration::from_secs(1) * turn / UPDATES_HZ;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let began = Instant::now();
        hub.turn(&Turn {
            taken_us: u64::from(turn) * 1_000_000 / u64::from(UPDATES_HZ),
            images: &images,
            measurement: Some(&measurement),
            estimate: Some(Estimate {
                displacement_mm: [0.1, 0.2, 0.3],
                sigma_mm: Some([0.001; 3]),
                points: measurement.correspondences.len(),
                latency_us: 20_000,
            }),
            refusal: None,
            absent: &[],
            stage_mm: [1.0, 2.0, 3.0],
            status: None,
        });
        in_loop += began.elapsed();
    }
    let span = start.elapsed().as_secs_f64();
    let after = threads();
    let share = |name: &str| {
        let ticks = |of: &BTreeMap<String, u64>| of.get(name).copied().unwrap_or(0);
        100.0 * TICK_S * (ticks(&after) - ticks(&before)) as f64 / span
    };
    let of_loop = 100.0 * in_loop.as_secs_f64() / span;
    let (of_images, of_server) = (share("live images"), share("live page"));
    drop(server);
    let counts: Vec<[u32; 2]> = readers
        .into_iter()
        .map(|reader| reader.join().expect("a page"))
        .collect();
    let mean = |i: usize| {
        let sum: u32 = counts.iter().map(|count| count[i]).sum();
        f64::from(sum) / counts.len().max(1) as f64 / span
    };
    println!(
        "| {pages} | {of_loop:.1} % | {of_images:.1} % | {of_server:.1} % | {:.1} % | {:.0}/s | \
         {:.0}/s |",
        of_loop + of_images + of_server,
        mean(0),
        mean(1)
    );
}

/// Reads as a page does; returns the numbers of states and of image sets.
fn read(address: SocketAddr) -> [u32; 2] {
    let (mut socket, _) = connect(format!("ws://{address}/live")).expect("the server listens");
    let mut counts = [0; 2];
    while let Ok(message) = socket.read() {
        match message {
            Message::Text(_) => counts[0] += 1,
            Message::Binary(_) => {
                counts[1] += 1;
                // Every image so far, whatever was left out in between.
                let drawn = r#"{"drawn":4294967295}"#;
                if socket.send(Message::text(drawn)).is_err() {
                    break;
                }
            }
            _ => {}
        }
    }
    counts
}

/// Returns the processor time of every thread by name, in ticks.
fn threads() -> BTreeMap<String, u64> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir("/proc/self/task").into_iter().flatten() {
        let path = entry.expect("an entry").path().join("stat");
        let Ok(text) = std::fs::read_to_string(path) else {
            continue;
        };
        // PID (NAME) STATE ...: user and system time are the 12th and 13th field behind the name.
        let Some((head, rest)) = text.rsplit_once(')') else {
            continue;
        };
        let name = head.split_once('(').map_or("", |(_, name)| name);
        let fields: Vec<u64> = (rest.split_whitespace().skip(11).take(2))
            .filter_map(|field| field.parse().ok())
            .collect();
        *all.entry(name.to_owned()).or_default() += fields.iter().sum::<u64>();
    }
    all
}
