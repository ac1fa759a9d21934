//! Visual servoing on the twin: a stage carries the cameras after a target.
//!
//! The twin is the board's own code with a simulated stage, on virtual time. For a station on a
//! serial line, take `StationPlace::Port` and the images of real cameras; the loop stays the same.
//!
//! ```sh
//! cargo run --release -p trinocular --example closed_loop
//! ```

use std::error::Error;
use trinocular::servo::station_link::{StationLink, StationPlace};
use trinocular::servo::visual_servo::VisualServo;
use trinocular_client::stage::default_stage;
use trinocular_core::rig::Rig;
use trinocular_vision::images::{Scene, SceneSettings, Texture};
use trinocular_vision::sums::Estimator;

/// Time between two frame sets, and from a frame set to its flow sums at the station, µs.
const PERIOD_US: u64 = 33_333;
const LATENCY_US: u64 = 20_000;

/// Follows a target at 5 mm/s for `frames` frame sets; returns the last following error, mm.
fn follow(frames: u64) -> Result<[f64; 3], Box<dyn Error>> {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
    let mut station = StationLink::start(StationPlace::Twin, &default_stage())?;
    let mut servo = VisualServo::new(&rig, Estimator::Midpoint)?;

    // The view to be kept.
    let start = station.moment(station.now())?;
    servo.set_keyframe(&scene.render([0.0; 3], start.at.micros(), 0))?;
    servo.set_keyframe_time(start.station);

    let mut error_mm = [0.0; 3];
    for frame in 1..=frames {
        // The cameras see the target relative to the stage that carries them.
        let taken = station.moment(start.at.plus_micros(PERIOD_US * frame))?;
        let time_s = taken.at.since(start.at) as f64 * 1e-6;
        let target_mm = [3.0, 4.0, 0.0].map(|mm_s| mm_s * time_s);
        error_mm = std::array::from_fn(|axis| target_mm[axis] - taken.camera_mm[axis]);
        let images = scene.render(error_mm, taken.at.micros(), frame);

        let arrival = taken.at.plus_micros(LATENCY_US);
        let step = servo.step(&mut station, &images, taken.station, Some(arrival))?;
        match step.outcome.refusal() {
            None => println!("{time_s:6.3} s, target - cameras {error_mm:7.3?} mm"),
            Some(refusal) => println!("{time_s:6.3} s, refused: {refusal}"),
        }
    }
    Ok(error_mm)
}

fn main() -> Result<(), Box<dyn Error>> {
    follow(60)?;
    Ok(())
}

#[test]
fn cameras_stay_with_the_target() {
    let error_mm = follow(45).unwrap();
    assert!(error_mm.iter().all(|mm| mm.abs() < 0.2), "{error_mm:?} mm");
}
