use super::*;
use proptest::prelude::*;

const STEP: i64 = 1 << 32;

fn bounds() -> Bounds {
    Bounds {
        unseen: [800 * STEP; 3],
        error: [1_600 * STEP; 3],
        longest_us: 500_000,
    }
}

fn sample(k: u64, stage: i64, error: i64) -> Sample {
    Sample {
        capture: Instant::from_micros(20_000 * k),
        stage: [0, stage * STEP, 0],
        error: [0, error * STEP, 0],
        variance: [0.1; 3],
    }
}

/// Runs a stage that obeys: it goes on at 40 steps a frame and stops within four frames. `seen` is
/// the error at a frame, for a stage at a position. Frames come every 20 ms. Returns the frame and
/// the fault.
fn obeys(frames: u64, seen: impl Fn(i64, i64) -> i64) -> Option<(u64, Fault)> {
    let (mut watch, mut stage, mut speed) = (Watch::default(), 0, 0);
    let unknown = History::default();
    let unseen_only = Bounds {
        error: [0; 3],
        ..bounds()
    };
    for k in 0..frames {
        stage += speed;
        let wanted = if watch.holds() { 0 } else { 40 };
        speed += (wanted - speed).clamp(-10, 10);
        let frame = sample(k, stage, seen(k as i64, stage));
        match watch.see(&frame, true, &unseen_only) {
            Advice::Fail(fault) => return Some((k, fault)),
            Advice::GoOn | Advice::Stop => {}
        }
        for _ in 0..12 {
            if let Advice::Fail(fault) = watch.work(&unknown) {
                return Some((k, fault));
            }
        }
    }
    None
}

#[test]
fn stalled_stage_has_lost_steps() {
    let (frame, fault) = obeys(200, |_, _| 300).expect("a fault");
    assert_eq!(fault, Fault::LostSteps);
    assert!(frame < 80, "{frame}");
}

#[test]
fn wrong_sign_is_unstable_following() {
    let (frame, fault) = obeys(200, |_, stage| 300 + stage).expect("a fault");
    assert_eq!(fault, Fault::Unstable);
    assert!(frame < 80, "{frame}");
}

#[test]
fn target_that_runs_ahead_is_no_fault() {
    // The target goes on while the stage stands.
    assert_eq!(obeys(400, |k, stage| 300 + 45 * k - stage), None);
}

#[test]
fn distant_target_is_following_error() {
    let far = |frames: u64, error: fn(u64) -> i64| {
        let mut watch = Watch::default();
        (0..frames).find(|k| {
            let advice = watch.see(&sample(*k, 0, error(*k)), true, &bounds());
            advice == Advice::Fail(Fault::FollowingError)
        })
    };
    // At rest: 26 frames are the first beyond half a second.
    assert_eq!(far(100, |_| 1_601), Some(26));
    assert_eq!(far(100, |_| 1_599), None);
    // One frame within the bound restarts the time.
    assert_eq!(far(100, |k| if k == 20 { 0 } else { -1_700 }), Some(47));
}

#[test]
fn zero_bounds_disable_watch() {
    let mut watch = Watch::default();
    for k in 0..1_000 {
        let mut far = sample(k, 0, 0);
        (far.stage, far.error) = ([i64::MAX - k as i64; 3], [i64::MIN + k as i64; 3]);
        let advice = watch.see(&far, !k.is_multiple_of(3), &Bounds::default());
        assert_eq!(advice, Advice::GoOn);
    }
}

proptest! {
    /// Feeds any figures, in any order: nothing panics, and a trial ends when the stage stands.
    #[test]
    fn any_frames_are_survived(
        frames in prop::collection::vec(any::<(u64, StepVector, StepVector, [f32; 3], bool)>(), 0..60),
        bounds: [StepVector; 2],
        ticks in 0..12,
    ) {
        let bounds = Bounds { unseen: bounds[0], error: [0; 3], longest_us: 0 };
        let (mut watch, unknown) = (Watch::default(), History::default());
        let mut last = 0;
        for (capture, stage, error, variance, used) in frames {
            last = last.max(capture);
            let sample = Sample { capture: Instant::from_micros(capture), stage, error, variance };
            watch.see(&sample, used, &bounds);
            for _ in 0..ticks {
                watch.work(&unknown);
            }
        }
        for k in 1..40u64 {
            let capture = Instant::from_micros(last.saturating_add(50_000 * k));
            let sample = Sample { capture, stage: [0; 3], error: [0; 3], variance: [0.1; 3] };
            watch.see(&sample, true, &bounds);
            for _ in 0..12 {
                watch.work(&unknown);
            }
        }
        prop_assert!(!watch.holds() || last > u64::MAX / 2);
    }
}
