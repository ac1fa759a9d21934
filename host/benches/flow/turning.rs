//! Price of the rotation: time of a frame set with a kept keyframe, with and without it.

use std::f64::consts::TAU;
use std::hint::black_box;

use trinocular_core::rig::Rig;
use trinocular_vision::flow::{Flow, FlowSettings, Offered};
use trinocular_vision::images::render::{Exposure, Pose, Scene, SceneSettings};
use trinocular_vision::images::{FrameSet, Texture};

use crate::Times;

/// Frame sets of a sequence: one period of the swing.
const FRAME_SETS: usize = 120;
/// Standard deviation of the noise, grey levels.
const NOISE_GREY: f64 = 2.0;

/// Sequence of a target that moves along a figure while it swings about all axes.
struct Sequence {
    name: &'static str,
    is_estimated: bool,
    keyframe: FrameSet,
    frame_sets: Vec<FrameSet>,
}

impl Sequence {
    fn new(name: &'static str, swing_deg: f64, is_estimated: bool) -> Self {
        let scene = Scene::new(
            &Rig::paper(),
            &Texture::natural(3),
            SceneSettings::default(),
        );
        let scene = scene.expect("a scene in range");
        let render = |pose, seed| {
            let exposures = [Exposure::of(pose, NOISE_GREY); 3];
            scene.render_exposures(&exposures, 0, seed)
        };
        let frame_sets = (0..FRAME_SETS).map(|number| {
            let phase = TAU * number as f64 / FRAME_SETS as f64;
            let pose = Pose {
                relative_mm: [
                    6.0 * (2.0 * phase).sin(),
                    4.0 * (3.0 * phase).sin(),
                    5.0 * phase.sin(),
                ],
                turned_deg: [
                    swing_deg * phase.sin(),
                    swing_deg * (2.0 * phase).sin(),
                    swing_deg * (3.0 * phase).sin(),
                ],
            };
            render(pose, 1 + number as u64)
        });
        Self {
            name,
            is_estimated,
            keyframe: render(Pose::default(), 0),
            frame_sets: frame_sets.collect(),
        }
    }

    /// Measures all frame sets; returns the mean number of points.
    fn run(&self, flow: &mut Flow) -> f64 {
        let points = self.frame_sets.iter().map(|frame_set| {
            let filtered = flow.filter(black_box(frame_set)).expect("the rig's images");
            let seen = match self.is_estimated {
                true => flow.measure_filtered_offered(&filtered).map(points),
                false => flow
                    .measure_filtered(&filtered, &mut ())
                    .map(|seen| seen.correspondences.len()),
            };
            seen.expect("a textured scene")
        });
        points.sum::<usize>() as f64 / FRAME_SETS as f64
    }
}

fn points(seen: Offered) -> usize {
    match seen {
        Offered::Pose(seen) => seen.correspondences.len(),
        Offered::Displacement(seen) => seen.correspondences.len(),
    }
}

/// Prints the time of a frame set with a kept keyframe, for targets that do not turn and that do.
pub fn table(rounds: usize) {
    let sequences = [
        ("refused, target does not turn", 0.0, false),
        ("estimated, target does not turn", 0.0, true),
        ("estimated, swing of 5 degrees", 5.0, true),
        ("estimated, swing of 15 degrees", 15.0, true),
    ];
    let sequences = sequences
        .map(|(name, swing_deg, is_estimated)| Sequence::new(name, swing_deg, is_estimated));
    let mut flows: Vec<Flow> = (sequences.iter())
        .map(|sequence| {
            let settings = FlowSettings {
                threads: 1,
                ..FlowSettings::default()
            };
            let mut flow = Flow::new(&Rig::paper(), settings).expect("three cameras");
            flow.set_keyframe(&sequence.keyframe)
                .expect("a textured scene");
            flow
        })
        .collect();
    let mut times: Vec<Times> = sequences.iter().map(|_| Times::default()).collect();
    let mut points = vec![0.0; sequences.len()];
    for _ in 0..rounds {
        for (index, sequence) in sequences.iter().enumerate() {
            times[index].add(|| points[index] = sequence.run(&mut flows[index]));
        }
    }
    println!(
        "\n| rotation: keyframe, 320 x 240, one thread | ms per frame set, median (least) \
         | least / refused | points |"
    );
    println!("|---|---|---|---|");
    let refused = times[0].least();
    for ((sequence, times), points) in sequences.iter().zip(&times).zip(points) {
        let of = |ms: f64| ms / FRAME_SETS as f64;
        println!(
            "| {} | {:.2} ({:.2}) | {:.2} | {points:.0} |",
            sequence.name,
            of(times.median()),
            of(times.least()),
            times.least() / refused,
        );
    }
}
