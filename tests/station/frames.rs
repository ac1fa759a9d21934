//! The station's handling of a frame: its capture time, the gate, and the direction of the motors.

use super::{denial, frame, status, twin, wait};
use trinocular_client::stage::default_stage;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Denial, Mounting, Sums};
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::Stage;

/// Returns true if the positions agree within a step, mm.
fn close(got: [f64; 3], want: [f64; 3]) -> bool {
    got.iter().zip(want).all(|(g, w)| (g - w).abs() <= 0.0126)
}

#[test]
fn untimed_frames_are_refused_by_name() {
    let mut twin = twin();
    wait(&mut twin, 1_000);
    let now = twin.now();
    let ago = |ms: u64| Instant::from_micros(now.micros() - ms * 1000);
    let mut send =
        |capture, reference| twin.command("frame", frame([0.5, 0.0, 0.0], capture, reference));
    let ahead = now.plus_micros(50_000);
    assert_eq!(denial(send(ahead, ago(500))), Denial::CaptureInFuture);
    assert_eq!(denial(send(ago(600), ago(700))), Denial::CaptureTooOld);
    send(ago(100), ago(300)).unwrap();
    assert_eq!(denial(send(ago(100), ago(300))), Denial::CaptureOutOfOrder);
    assert_eq!(denial(send(ago(50), ago(299))), Denial::UnknownReference);
    assert_eq!(denial(send(ago(50), ago(40))), Denial::CaptureOutOfOrder);
    send(ago(40), ago(300)).unwrap();
    let status = status(&mut twin);
    assert_eq!((status.frames_used, status.frames_refused), (2, 5));
    wait(&mut twin, 500);
    assert!(
        close(twin.position_mm(), [0.5, 0.0, 0.0]),
        "{:?}",
        twin.position_mm()
    );
}

#[test]
fn gate_refuses_by_name() {
    use trinocular_core::estimate::Refusal;
    let mut twin = twin();
    wait(&mut twin, 500);
    let now = twin.now();
    let change = |change: fn(&mut FixedCentredSums)| {
        let Command::Frame(mut f) = frame(
            [1.0, 0.0, 0.0],
            Instant::from_micros(now.micros() - 20_000),
            Instant::from_micros(now.micros() - 90_000),
        ) else {
            unreachable!()
        };
        if let Sums::Midpoint(sums) = &mut f.sums {
            change(sums);
        }
        Command::Frame(f)
    };
    let cases = [
        (change(|s| s.points = 7), Refusal::TooFewPoints),
        (change(|s| s.freedom = 0), Refusal::TooFewPoints),
        (change(|s| s.spread = 1), Refusal::Degenerate),
        (change(|s| s.exponent = -30), Refusal::Degenerate),
        (
            change(|s| s.residual_nm = 90_000_000),
            Refusal::TooUncertain,
        ),
        (change(|s| s.mean_nm[0] = 110_000_000), Refusal::TooLarge),
    ];
    for (command, refusal) in cases {
        assert_eq!(
            denial(twin.command("frame", command)),
            Denial::Estimate(refusal)
        );
    }
    wait(&mut twin, 300);
    assert_eq!(twin.steps_from_zero(), [0; 3]);
}

/// The stage moves between capture and frame, the target does not. With any latency the stage must
/// end at the target.
#[test]
fn own_motion_is_not_target_motion() {
    let mut twin = twin();
    wait(&mut twin, 100);
    let reference = twin.now();
    let target = [10.0, -5.0, 2.0];
    let mut pending: Vec<(Instant, [f64; 3])> = Vec::new();
    for _ in 0..40 {
        wait(&mut twin, 20);
        let stage = twin.position_mm();
        pending.push((twin.now(), std::array::from_fn(|i| target[i] - stage[i])));
        if pending.len() > 4 {
            // The frame is four images late: 80 ms.
            let (capture, seen) = pending.remove(0);
            twin.send(frame(seen, capture, reference));
        }
    }
    assert!(
        close(twin.position_mm(), target),
        "{:?}",
        twin.position_mm()
    );
}

#[test]
fn matrix_and_invert_map_axes() {
    let stage = Stage {
        matrix: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        invert: [true, false, true],
        ..default_stage()
    };
    let mut twin = Twin::start(&stage, "twin", Mounting::Fixed).unwrap();
    wait(&mut twin, 100);
    let now = twin.now();
    twin.command(
        "frame",
        frame(
            [3.0, 2.0, 1.0],
            Instant::from_micros(now.micros() - 10_000),
            Instant::from_micros(now.micros() - 50_000),
        ),
    )
    .unwrap();
    wait(&mut twin, 500);
    assert!(
        close(twin.position_mm(), [2.0, -3.0, 1.0]),
        "{:?}",
        twin.position_mm()
    );
}

/// Cameras beside the stage do not move with it, so the stage copies the displacement instead of
/// chasing it for ever.
#[test]
fn fixed_cameras_copy_target() {
    let mut twin = Twin::start(&default_stage(), "twin", Mounting::Fixed).unwrap();
    wait(&mut twin, 100);
    let reference = twin.now();
    for _ in 0..30 {
        wait(&mut twin, 20);
        let now = twin.now();
        twin.command("frame", frame([1.0, 1.0, 0.0], now, reference))
            .unwrap();
    }
    assert!(
        close(twin.position_mm(), [1.0, 1.0, 0.0]),
        "{:?}",
        twin.position_mm()
    );
}
