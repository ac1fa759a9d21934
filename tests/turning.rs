//! The closed loop with a target that turns while it moves.

use trinocular::servo::path::TargetPath;
use trinocular::servo::simulated::{ServoTiming, SimulatedServo};
use trinocular::servo::station_link::StationPlace;
use trinocular::servo::world::{SimulatedWorld, Swing};
use trinocular_client::stage::{default_stage, setpoint};
use trinocular_core::rig::Rig;
use trinocular_rig::pivot::Pivot;
use trinocular_vision::images::{SceneSettings, Texture};
use trinocular_vision::sums::Estimator;

/// Largest root mean square error of the pivot, mm.
const BOUND_MM: [f64; 3] = [0.03, 0.05, 0.10];
/// Time for catching up, and duration of the run, s.
const CAUGHT_UP_S: f64 = 1.0;
const DURATION_S: f64 = 4.0;

/// A target on the Lissajous figure that swings by 5 degrees at 0.5 Hz: the stage follows the
/// poster's origin, which is the pivot.
#[test]
fn pivot_of_swinging_target_is_followed() {
    let rig = Rig::paper();
    let settings = SceneSettings::default();
    let texture = Texture::natural(4);
    let (place, stage) = (StationPlace::Twin, default_stage());
    let world = SimulatedWorld::new(&rig, &stage, place, &texture, settings, 4);
    let mut world = world.expect("a world");
    let timing = ServoTiming {
        frames_per_s: 60.0,
        latency_us: 12_000,
    };
    let servo = SimulatedServo::start(&mut world, &rig, timing, Estimator::Midpoint);
    let mut servo = servo.expect("a keyframe");
    servo.set_pivot(Some(Pivot::Place([0.0, 0.0, settings.depth_mm])));
    world.set_swing(Swing {
        most_deg: [3.0, -3.0, 2.6],
        per_s: 0.5,
    });
    let (mut squares, mut count, mut largest_deg) = ([0.0; 3], 0.0, 0.0f64);
    while servo.time_s(&world) < DURATION_S {
        let next_mm = TargetPath::Lissajous.at(servo.time_s(&world));
        world.a.send(setpoint(next_mm));
        let step = servo.step(&mut world).expect("a station");
        let outcome = &step.turn.outcome;
        let seen = outcome.estimate();
        let seen = seen.unwrap_or_else(|| panic!("{}: {outcome:?}", step.time_s));
        let turn = seen.turn.expect("a rotation");
        let angle = turn.rotation_deg.iter().map(|deg| deg * deg).sum::<f64>();
        largest_deg = largest_deg.max(angle.sqrt());
        if step.time_s > CAUGHT_UP_S {
            count += 1.0;
            for (i, sum) in squares.iter_mut().enumerate() {
                *sum += (step.camera_mm[i] - step.target_mm[i]).powi(2);
            }
        }
    }
    let rms = squares.map(|sum| (sum / count).sqrt());
    println!("pivot: rms {rms:.4?} mm, largest rotation {largest_deg:.2} degrees");
    assert!((4.8..5.2).contains(&largest_deg), "{largest_deg}");
    assert!((0..3).all(|i| rms[i] <= BOUND_MM[i]), "{rms:?}");
}
