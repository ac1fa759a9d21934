//! Round trips, and the comparison of measurements.

use super::*;

fn measurement() -> Measurement {
    Measurement {
        stamp_us: 1_234_567,
        frame: 7,
        capture_us: 99,
        reference_us: 3,
        outcome: Outcome::Unused,
        reason: "the target moved too far".to_owned(),
        displacement_mm: [1.0, -2.0, 0.1 + 0.2],
        covariance_mm2: [1e-3; 9],
        variance_inflation: 1.5,
        cameras: vec![0, 2],
        pixels: vec![1.0, 2.0, 3.0, 4.0],
        rejects: vec![("Outlier".to_owned(), 3)],
        absent: vec![(1, "is frozen".to_owned())],
        stage_mm: [4.0; 3],
        station_mm: [5.0; 3],
        station_sigma_mm: [6.0; 3],
        latency_us: 20_000,
    }
}

#[test]
fn measurement_survives_a_round_trip() {
    let (message, mut bytes) = (measurement(), Vec::new());
    message.encode(&mut bytes);
    assert_eq!(Measurement::decode(&bytes), Ok(message));
    for end in 0..bytes.len() {
        assert!(Measurement::decode(&bytes[..end]).is_err(), "{end}");
    }
}

#[test]
fn difference_names_the_field() {
    let message = measurement();
    assert_eq!(message.difference(&message.clone()), None);
    let mut other = message.clone();
    other.displacement_mm[2] = 0.3;
    let (field, a, b) = message.difference(&other).expect("they differ");
    assert_eq!(field, "displacement_mm[2]");
    assert_ne!(a, b);
    let mut other = message.clone();
    other.pixels.pop();
    let (field, a, _) = message.difference(&other).expect("they differ");
    assert_eq!((field.as_str(), a.as_str()), ("pixels", "4 numbers"));
    // The station's answer is not the images'.
    let mut other = message.clone();
    other.stage_mm = [0.0; 3];
    assert_eq!(message.difference(&other), None);
}
