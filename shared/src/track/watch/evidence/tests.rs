use super::*;
use crate::time::Instant;

const STEPS: f64 = 4_294_967_296.0;

/// Time at which the stage stops, s, and at which the trial ends.
const STOPS_S: f64 = 0.5;
const ENDS_S: f64 = 0.8;

/// Number of ticks between two frames that the watch uses.
const WORK: u32 = 12;

/// Returns a stage that shakes on all axes and then stops, steps.
fn shakes(s: f64) -> [f64; 3] {
    let s = s.clamp(0.0, STOPS_S);
    [
        120.0 * (31.0 * s).sin(),
        80.0 * (37.0 * s).cos(),
        60.0 * (28.0 * s).sin(),
    ]
}

/// Returns the window of a trial at 60 frames per second. `seen` is the error at a stamp, s.
fn window(seen: impl Fn(f64) -> [f64; 3]) -> Evidence {
    let fine = |steps: [f64; 3]| steps.map(|steps| (steps * STEPS) as i64);
    let (mut window, mut history, mut tick) = (Evidence::default(), History::default(), 0u64);
    for frame in 0..43u64 {
        let at = 100_000 + 16_667 * frame;
        while 1_000 * tick < at + 100_000 {
            let position = fine(shakes(1e-3 * tick as f64));
            history.record(Instant::from_micros(1_000 * tick), position);
            assert_eq!(window.work(&history), None);
            tick += 1;
        }
        let time_s = 1e-6 * at as f64;
        assert!(time_s <= ENDS_S + 0.01);
        window.add(&Sample {
            capture: Instant::from_micros(at),
            stage: fine(shakes(time_s)),
            error: fine(seen(time_s)),
            variance: [0.1; 3],
        });
    }
    assert_eq!(work(&mut window, &history), None);
    window
}

/// Does the work of the ticks until the next frame can come.
fn work(evidence: &mut Evidence, history: &History) -> Option<Answer> {
    let mut answers = (0..WORK).filter_map(|_| evidence.work(history));
    let answer = answers.next();
    assert_eq!(answers.next(), None, "an answer is given once");
    answer
}

/// Returns the answer, which must be there when the next frame can come.
fn answer(mut evidence: Evidence, question: Question, history: &History) -> Option<Cause> {
    evidence.ask(question);
    let answer = work(&mut evidence, history).expect("the work is done");
    answer.cause
}

fn causes(seen: impl Fn(f64) -> [f64; 3]) -> [Option<Cause>; 3] {
    let window = window(seen);
    [Question::Free, Question::Coupled, Question::Lost]
        .map(|question| answer(window, question, &History::default()))
}

#[test]
fn wrong_stamps_are_found() {
    for late_ms in [-70.0, -57.0, -45.0, -35.0, 35.0, 45.0, 52.0, 60.0] {
        let seen = |s: f64| shakes(s - 1e-3 * late_ms).map(|stage| 30.0 * s - stage);
        let stamps = Some(Cause::Stamps);
        assert_eq!(causes(seen), [stamps, stamps, None], "{late_ms} ms");
    }
}

#[test]
fn wrong_mounts_are_found() {
    let mounts: [fn([f64; 3]) -> [f64; 3]; 5] = [
        |[x, y, z]| [-x, y, z],
        |[x, y, z]| [y, x, z],
        |[x, y, z]| [y, z, x],
        |[x, y, z]| [3.0 * x, 3.0 * y, 3.0 * z],
        |[x, y, z]| [0.2 * x - 1.1 * y, 1.1 * x + 0.2 * y, z],
    ];
    for (index, mount) in mounts.into_iter().enumerate() {
        let seen = |s: f64| mount(shakes(s).map(|stage| 30.0 * s - stage));
        assert_eq!(causes(seen), [None, Some(Cause::Mount), None], "{index}");
    }
}

#[test]
fn lost_steps_are_found() {
    let seen = |s: f64| {
        let [x, _, z] = shakes(s);
        [30.0 * s - x, 30.0 * s, -z]
    };
    let [none, coupled, lost] = causes(seen);
    assert_eq!((none, lost), (None, Some(Cause::Steps)));
    assert_ne!(coupled, Some(Cause::Stamps));
}

#[test]
fn healthy_loop_has_no_cause() {
    // A mount that is off by 20 %, stamps that are off by 3 ms, and a target that swings or jumps.
    let scaled = |s: f64| shakes(s).map(|stage| 1.2 * (30.0 * s - stage));
    assert_eq!(causes(scaled), [None; 3]);
    let late = |s: f64| shakes(s - 0.003).map(|stage| 30.0 * s - stage);
    assert_eq!(causes(late), [None; 3]);
    let swings = |s: f64| shakes(s).map(|stage| 100.0 * (15.0 * s).sin() - stage);
    assert_eq!(causes(swings), [None; 3]);
    let jumps = |s: f64| shakes(s).map(|stage| if s < 0.4 { -stage } else { 200.0 - stage });
    assert_eq!(causes(jumps), [None; 3]);
}

/// The station does not know where its stage will be: delays that would need it explain nothing.
#[test]
fn target_with_unknown_positions_has_no_cause() {
    let (mut evidence, unknown) = (Evidence::default(), History::default());
    for frame in 0..43u64 {
        let stage = shakes(0.1 + 1e-6 * (16_667 * frame) as f64);
        evidence.add(&Sample {
            capture: Instant::from_micros(16_667 * frame),
            stage: stage.map(|steps| (steps * STEPS) as i64),
            error: [0; 3],
            variance: [0.1; 3],
        });
        assert_eq!(work(&mut evidence, &unknown), None);
    }
    for question in [Question::Free, Question::Moving] {
        assert_eq!(answer(evidence, question, &unknown), None, "{question:?}");
    }
}

#[test]
fn few_frames_have_no_cause() {
    let unknown = History::default();
    let alone = Evidence::starting(&Sample {
        capture: Instant::from_micros(0),
        stage: [0; 3],
        error: [0; 3],
        variance: [0.1; 3],
    });
    for question in [
        Question::Moving,
        Question::Free,
        Question::Coupled,
        Question::Lost,
    ] {
        assert_eq!(answer(alone, question, &unknown), None);
    }
}

/// Frames that come in a burst are left out; the answer still comes.
#[test]
fn frame_that_comes_too_early_is_left_out() {
    let (mut evidence, unknown) = (Evidence::default(), History::default());
    let sample = |capture: u64| Sample {
        capture: Instant::from_micros(capture),
        stage: [0; 3],
        error: [0; 3],
        variance: [0.1; 3],
    };
    evidence.add(&sample(0));
    evidence.work(&unknown);
    evidence.add(&sample(12_000));
    work(&mut evidence, &unknown);
    assert_eq!(evidence.window.frames(), 1.0);
    evidence.add(&sample(24_000));
    evidence.work(&unknown);
    assert_eq!(evidence.window.frames(), 2.0);
    assert_eq!(answer(evidence, Question::Free, &unknown), None);
}
