//! Cost of a recording: 60 frame sets of 3 x 320 x 240 px per second in real time, with a recording
//! and without.
//!
//! `cargo bench -p trinocular --bench recording -- SECONDS` prints the table of `benches/RECORDING.md`.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use trinocular::servo::recording::measurement;
use trinocular::servo::visual_servo::VisualServo;
use trinocular_core::rig::Rig;
use trinocular_recording::message::Measurement;
use trinocular_recording::queue::Pace;
use trinocular_recording::recorder::{ImageForm, Recorder, Settings};
use trinocular_rig::output::{Output, OwnFile, Replace};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::{FrameSet, Scene, SceneSettings, Texture};
use trinocular_vision::sums::Estimator;

const PERIOD: Duration = Duration::from_micros(16_667);

/// Number of rendered frame sets, which are taken in turn.
const SETS: usize = 30;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // `cargo test --benches` does not pass `--bench`; then a moment shows that everything runs.
    let is_bench = arguments.iter().any(|argument| argument == "--bench");
    let given = arguments.iter().find_map(|argument| argument.parse().ok());
    let seconds: f64 = given.unwrap_or(if is_bench { 20.0 } else { 0.3 });
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default());
    let scene = scene.expect("a scene");
    let sets: Vec<FrameSet> = (0..SETS)
        .map(|i| scene.render([0.1 * i as f64, 0.05 * i as f64, 0.0], 0, i as u64))
        .collect();
    println!(
        "| 60 frame sets of 3 x 320 x 240 px per second | turn, median ms | 99 % ms | handed over, \
         median ms | recorder, % of a core | MB/s | dropped |\n|---|---|---|---|---|---|---|"
    );
    for (name, form) in [
        ("no recording", None),
        ("recording, images raw", Some(ImageForm::Raw)),
        ("recording, images as PNG", Some(ImageForm::Png)),
        ("recording, no images", Some(ImageForm::None)),
    ] {
        run(name, form, &rig, &sets, seconds);
    }
}

fn run(name: &str, form: Option<ImageForm>, rig: &Rig, sets: &[FrameSet], seconds: f64) {
    let folder = tempfile::tempdir().expect("a folder");
    let recorder = form.map(|images| {
        let path = folder.path().join("run.mcap");
        let output =
            Output::open(&path, Replace::Own(OwnFile::Recording)).expect("a writable place");
        let file = RigFile::paper();
        let settings = Settings {
            images,
            pace: Pace::Real,
            cameras: file.names.clone(),
            epoch_us: 0,
            rig: file.to_toml(),
            regions: Regions::default(),
            origin: BTreeMap::new(),
        };
        Recorder::start(output, settings).expect("it begins")
    });
    let tap = recorder.as_ref().map(Recorder::tap);
    let mut servo = VisualServo::new(rig, Estimator::Midpoint).expect("a rig");
    servo.set_keyframe(&sets[0]).expect("a keyframe");
    let (mut turns, mut handing) = (Vec::new(), Vec::new());
    let begun = Instant::now();
    let count = (seconds * 60.0) as u32;
    for number in 0..count {
        let due = begun + PERIOD * number;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let set = &sets[number as usize % sets.len()];
        let start = Instant::now();
        let measured = servo.measure(set);
        let between = Instant::now();
        if let Some(tap) = &tap {
            let message = Measurement {
                stamp_us: u64::from(number) * 16_667,
                ..measurement(rig, measured.as_ref())
            };
            tap.frame_set(Some(set), message);
        }
        handing.push(between.elapsed());
        turns.push(start.elapsed());
    }
    let took = begun.elapsed().as_secs_f64();
    let ms = |times: &mut Vec<Duration>, share: f64| {
        times.sort();
        let index = (times.len() as f64 * share) as usize;
        times
            .get(index)
            .map_or(0.0, |time| time.as_secs_f64() * 1e3)
    };
    let account = recorder.map(|recorder| recorder.finish().expect("it is written"));
    let turn = [ms(&mut turns, 0.5), ms(&mut turns, 0.99)];
    print!("| {name} | {:.2} | {:.2} | ", turn[0], turn[1]);
    match account {
        None => println!("- | - | - | - |"),
        Some(account) => {
            let processor = account.processor.unwrap_or_default().as_secs_f64();
            println!(
                "{:.3} | {:.1} | {:.1} | {} |",
                ms(&mut handing, 0.5),
                100.0 * processor / took,
                account.bytes as f64 * 1e-6 / took,
                account.dropped.frame_sets + account.dropped.messages
            );
        }
    }
}
