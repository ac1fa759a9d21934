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
        turn: Some(Turn {
            rotation_deg: [1.0, -2.0, 3.0],
            rotation_sigma_deg: [0.1; 3],
            pivot_mm: [0.0, 0.0, 850.0],
        }),
    }
}

#[test]
fn measurement_survives_a_round_trip() {
    let (message, mut bytes) = (measurement(), Vec::new());
    message.encode(&mut bytes);
    assert_eq!(Measurement::decode(&bytes), Ok(message));
    let mut earlier = Vec::new();
    let without = Measurement {
        turn: None,
        ..measurement()
    };
    without.encode(&mut earlier);
    assert_eq!(Measurement::decode(&earlier), Ok(without.clone()));
    // Recordings of earlier versions end before the three empty sequences of the rotation.
    let before = earlier.len() - 3 * 4;
    assert_eq!(Measurement::decode(&earlier[..before]), Ok(without));
    for end in (0..bytes.len()).filter(|end| *end != before) {
        assert!(Measurement::decode(&bytes[..end]).is_err(), "{end}");
    }
}

#[test]
fn rotation_is_in_the_pose() {
    let turned = |rotation_deg| {
        let mut bytes = Vec::new();
        let turn = Turn {
            rotation_deg,
            rotation_sigma_deg: [0.1; 3],
            pivot_mm: [0.0; 3],
        };
        let message = Measurement {
            turn: Some(turn),
            ..measurement()
        };
        pose(&mut bytes, &message);
        let mut reader = Reader::new(&bytes).expect("a message");
        read_header(&mut reader).expect("a header");
        let _: [f64; 3] = reader.array().expect("a place");
        let orientation: [f64; 4] = reader.array().expect("a quaternion");
        let covariance: [f64; 36] = reader.array().expect("a covariance");
        assert!((covariance[35] - 0.1f64.to_radians().powi(2)).abs() < 1e-15);
        orientation
    };
    assert_eq!(turned([0.0; 3]), [0.0, 0.0, 0.0, 1.0]);
    let [x, y, z, w] = turned([0.0, 0.0, -90.0]);
    let half = 0.5f64.sqrt();
    assert!(x == 0.0 && y == 0.0 && (z + half).abs() < 1e-12 && (w - half).abs() < 1e-12);
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
