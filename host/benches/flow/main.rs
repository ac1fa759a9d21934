//! Speed and accuracy of the flow beside those of optical-flow-lk, imageproc and OpenCV, on images
//! whose true flow is known.
//!
//! `cargo run --release --manifest-path host/benches/flow/Cargo.toml [-- [turning] ROUNDS]`, where
//! `turning` prints the last table alone. OpenCV takes part if `$PYTHON` (or `python3`) has `cv2`.
//! All programs take turns, round by round, so that other load of the machine affects all of them
//! alike. Compare the least times.

mod accuracy;
mod bound;
mod opencv;
mod peers;
mod scene;
mod turning;

use std::time::Instant;

use accuracy::Quality;
use bound::Bound;
use opencv::OpenCv;
use peers::OpticalFlowLk;
use scene::Scene;
use trinocular_vision::flow::{FilteredFrameSet, Flow, FlowSettings, PipelineStage};
use trinocular_vision::images::FrameSet;
use trinocular_vision::stage_timings::{FreshKeyframe, with_fresh_keyframe, with_kept_keyframe};

const CORNERS: usize = 200;
/// Largest root mean square error that this project promises on these scenes, px.
const MOST_RMS_PX: f64 = 0.017;
/// Disparities of the paper's rig at 700 mm.
const PAPER_PX: [f64; 2] = [53.33, -51.81];
const REPETITIONS: usize = 15;
/// Flows of the scenes, px. Accuracy is the mean over all scenes; only the first is timed.
const FLOWS_PX: [[f64; 2]; 5] = [
    [3.37, -2.21],
    [-4.62, 0.87],
    [0.49, 4.15],
    [-1.74, -3.93],
    [4.88, 2.56],
];

fn main() {
    let given = std::env::args()
        .skip(1)
        .find_map(|argument| argument.parse().ok());
    let rounds = given.unwrap_or(7);
    if std::env::args().any(|argument| argument == "turning") {
        return turning::table(rounds);
    }
    let small = |name, disparity_px| Scene {
        name,
        size_px: [320, 240],
        disparity_px,
        flow_px: FLOWS_PX[0],
        noise_grey: 2.0,
        seed: 1,
    };
    for scene in [
        small("the paper's rig at 700 mm", PAPER_PX),
        small("18 and 14 px of disparity", [18.3, -14.2]),
    ] {
        beside_others(&scene, rounds);
    }
    println!(
        "\n| this project, size | disparity px | frame set ms (least) | keyframe ms (least) | {} \
         | points | RMS px, temporal / spatial | wrong |",
        stages()
    );
    println!(
        "|---|---|---|---|{}---|---|---|",
        "---|".repeat(PipelineStage::ALL.len())
    );
    for (size_px, threads, disparity_px) in [
        ([320, 240], 1, [18.3, -14.2]),
        ([320, 240], 1, PAPER_PX),
        ([320, 240], 2, PAPER_PX),
        ([320, 240], 3, PAPER_PX),
        ([640, 480], 1, PAPER_PX.map(|d| 2.0 * d)),
        ([640, 480], 2, PAPER_PX.map(|d| 2.0 * d)),
        ([1280, 960], 1, PAPER_PX.map(|d| 4.0 * d)),
        ([1280, 960], 2, PAPER_PX.map(|d| 4.0 * d)),
    ] {
        let scene = Scene {
            size_px,
            ..small("", disparity_px)
        };
        alone(&scene, threads, rounds);
    }
    turning::table(rounds);
}

fn stages() -> String {
    PipelineStage::ALL.map(PipelineStage::name).join(" | ")
}

/// Times of one program, ms.
#[derive(Default)]
struct Times(Vec<f64>);

impl Times {
    fn add(&mut self, run: impl FnOnce()) {
        let start = Instant::now();
        run();
        self.0.push(start.elapsed().as_secs_f64() * 1e3);
    }

    fn least(&self) -> f64 {
        self.0.iter().copied().fold(f64::INFINITY, f64::min)
    }

    fn median(&self) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
    }
}

/// Tracker of this project with a scene.
struct Ours {
    flow: Flow,
    frame_sets: [FrameSet; 2],
    before: FilteredFrameSet,
}

impl Ours {
    fn new(scene: &Scene, threads: usize) -> Self {
        let settings = FlowSettings {
            max_corners: CORNERS,
            max_points: CORNERS,
            threads,
            ..FlowSettings::default()
        };
        let mut flow = Flow::new(&scene.rig(), settings).expect("three cameras");
        let frame_sets = scene.frame_sets();
        let before = flow.filter(&frame_sets[0]).expect("the rig's images");
        Self {
            flow,
            frame_sets,
            before,
        }
    }

    fn with_fresh_keyframe(&mut self) -> FreshKeyframe {
        let before = self.before.clone();
        with_fresh_keyframe(&mut self.flow, before, &self.frame_sets[1]).expect("a textured scene")
    }

    /// Adds accuracy and count of the points, and returns their places in the middle camera's first
    /// image.
    fn quality(
        &mut self,
        scene: &Scene,
        (points, quality): &mut (usize, Quality),
    ) -> Vec<[f64; 2]> {
        let measurement = self.with_fresh_keyframe().measurement;
        for point in &measurement.correspondences {
            let [middle, _] = point.pixels[1];
            for (k, shift) in [(0, scene.disparity_px[0]), (2, scene.disparity_px[1])] {
                let [at, _] = point.pixels[k];
                let found = [at[0] - middle[0], at[1] - middle[1]];
                quality.spatial.add(found, [shift, 0.0], true);
            }
            for [from, to] in &point.pixels {
                let found = [to[0] - from[0], to[1] - from[1]];
                quality.temporal.add(found, scene.flow_px, true);
            }
        }
        *points += measurement.correspondences.len();
        measurement
            .correspondences
            .iter()
            .map(|p| p.pixels[1][0])
            .collect()
    }
}

fn beside_others(scene: &Scene, rounds: usize) {
    let mut ours = Ours::new(scene, 1);
    let mut lk = OpticalFlowLk::new(&ours.frame_sets, CORNERS);
    let mut opencv = OpenCv::start(scene, &ours.frame_sets, CORNERS);
    let raw: Vec<_> = ours.frame_sets[1].images.iter().map(peers::gray).collect();
    let [
        mut set,
        mut lk_set,
        mut filters,
        mut others_filters,
        mut opencv_set,
    ] = [(); 5].map(|()| Times::default());
    for _ in 0..rounds {
        for _ in 0..REPETITIONS {
            let before = ours.before.clone();
            set.add(|| {
                std::hint::black_box(
                    with_fresh_keyframe(&mut ours.flow, before, &ours.frame_sets[1]).is_ok(),
                );
            });
        }
        for _ in 0..REPETITIONS {
            lk.prepare();
            lk_set.add(|| {
                std::hint::black_box(lk.run());
            });
        }
        for _ in 0..REPETITIONS {
            filters.add(|| {
                std::hint::black_box(peers::our_filters(&ours.frame_sets[1]));
            });
            others_filters.add(|| {
                std::hint::black_box(peers::imageproc_filters(&raw));
            });
        }
        if let Some(times) = opencv.as_mut().and_then(|o| o.times_ms(REPETITIONS)) {
            opencv_set.0.extend(times);
        }
    }
    println!(
        "\n| {}: frame set, one thread | median ms (least) | least / ours | points | RMS px, \
         temporal / spatial | wrong, temporal / spatial |",
        scene.name
    );
    println!("|---|---|---|---|---|---|");
    let base = set.least();
    let row = |name: &str, times: &Times, rest: &str| {
        println!(
            "| {name} | {:.2} ({:.2}) | {:.2} | {rest} |",
            times.median(),
            times.least(),
            times.least() / base
        );
    };
    let mut found = [(0, Quality::default()); 2];
    let mut opencv_found = (0, Quality::default());
    let mut bound = Bound::default();
    for (flow_px, seed) in FLOWS_PX.into_iter().zip(1..) {
        let scene = Scene {
            flow_px,
            seed,
            ..scene.clone()
        };
        let mut ours = Ours::new(&scene, 1);
        let places = ours.quality(&scene, &mut found[0]);
        bound.add(&scene, places.into_iter());
        let mut lk = OpticalFlowLk::new(&ours.frame_sets, CORNERS);
        lk.prepare();
        let places = lk.run();
        OpticalFlowLk::quality(&scene, &places, &mut found[1]);
        if opencv.is_some() {
            let mut opencv = OpenCv::start(&scene, &ours.frame_sets, CORNERS);
            let answer = opencv.as_mut().and_then(OpenCv::quality);
            answer.as_ref().map(|a| opencv::add(a, &mut opencv_found));
        }
    }
    let [(points, quality), _] = found;
    let Quality { temporal, spatial } = quality;
    assert_eq!((temporal.wrong, spatial.wrong), (0, 0), "wrong matches");
    assert!(temporal.rms_px() < MOST_RMS_PX && spatial.rms_px() < MOST_RMS_PX);
    row("this project", &set, &described(points, &quality));
    println!(
        "| least possible error of this project's points | | | {points} | {0:.4} / {0:.4} | |",
        bound.rms_px()
    );
    let [_, (points, quality)] = found;
    row(
        "optical-flow-lk 0.6, window 21, on filtered images",
        &lk_set,
        &described(points, &quality),
    );
    let sum = Times(
        lk_set
            .0
            .iter()
            .zip(&filters.0)
            .map(|(a, b)| a + b)
            .collect(),
    );
    row(
        "the same and this project's filter",
        &sum,
        &described(points, &quality),
    );
    if let Some(opencv) = &mut opencv {
        let name = format!("OpenCV {}, window 21, 4 levels", opencv.version);
        let (points, quality) = opencv_found;
        let rest = described(points, &quality);
        row(&name, &opencv_set, &rest);
    } else {
        println!("| OpenCV: no Python with cv2 found | | | | | |");
    }
    row("only the three filters: this project", &filters, " | |");
    row(
        "only the three filters: imageproc 0.27, sigma 1",
        &others_filters,
        " | |",
    );
}

fn described(points: usize, quality: &Quality) -> String {
    let Quality { temporal, spatial } = quality;
    format!(
        "{points} | {:.4} / {:.4} | {} / {}",
        temporal.rms_px(),
        spatial.rms_px(),
        temporal.wrong,
        spatial.wrong
    )
}

fn alone(scene: &Scene, threads: usize, rounds: usize) {
    let mut ours = Ours::new(scene, threads);
    let [mut set, mut key] = [(); 2].map(|()| Times::default());
    let mut stages = PipelineStage::ALL.map(|_| Times::default());
    for _ in 0..rounds * REPETITIONS {
        let timings = ours.with_fresh_keyframe().timings;
        set.0.push(timings.total().as_secs_f64() * 1e3);
        for (times, stage) in stages.iter_mut().zip(PipelineStage::ALL) {
            times.0.push(timings.of(stage).as_secs_f64() * 1e3);
        }
        let again = with_kept_keyframe(&mut ours.flow, &ours.frame_sets[1]);
        let (_, timings) = again.expect("the keyframe is set");
        key.0.push(timings.total().as_secs_f64() * 1e3);
    }
    let mut found = (0, Quality::default());
    ours.quality(scene, &mut found);
    let (points, quality) = found;
    let ([width, height], [left, right]) = (scene.size_px, scene.disparity_px);
    print!(
        "| {width} x {height}, threads: {threads} | {left:.1} / {right:.1} | {:.2} ({:.2}) | \
         {:.2} ({:.2}) |",
        set.median(),
        set.least(),
        key.median(),
        key.least()
    );
    for times in &stages {
        print!(" {:.2} |", times.least());
    }
    println!(" {} |", described(points, &quality));
}
