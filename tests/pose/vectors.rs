//! The reference cases of `golden/pose.json`, made with independent double-precision code.

use super::likelihood;
use serde_json::Value;
use trinocular_core::estimate::pose::{self, Estimate, Noise, Observation};
use trinocular_core::rig::{Camera, Rig};
use trinocular_core::sums::View;
use trinocular_core::sums::centred::Geometry;

/// Largest difference in position, mm.
const WITHIN_MM: f64 = 1e-9;
/// Largest difference in rotation, rad, and in the Cayley vector.
const WITHIN_RAD: f64 = 1e-9;

struct Case {
    name: String,
    geometry: Geometry,
    observations: Vec<Observation>,
    pivot_mm: [f64; 3],
    file: Value,
}

fn list(value: &Value) -> &Vec<Value> {
    value.as_array().expect("a list")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    assert_eq!(list(value).len(), N, "{value}");
    std::array::from_fn(|i| number(&value[i]))
}

fn cases() -> Vec<Case> {
    let text = include_str!("../golden/pose.json");
    let file: Value = serde_json::from_str(text).expect("valid JSON");
    let case = |case: &Value| {
        let camera = |camera: &Value| {
            let [focal, principal] = ["focal_px", "principal_px"].map(|key| numbers(&camera[key]));
            Camera::ideal(focal, principal, numbers(&camera["offset_mm"]))
        };
        let rig = Rig {
            image_size_px: [320, 240],
            cameras: list(&case["cameras"]).iter().map(camera).collect(),
        };
        let geometry = Geometry::new(&rig).expect("a rig of two cameras or more");
        let observe = |point: &Value| {
            let view = |(camera, seen): (&Camera, &Value)| {
                let [x0, y0, x1, y1] = numbers(seen);
                View::from_pixels(camera, [x0, y0], [x1, y1])
            };
            let views: Vec<View> = rig.cameras.iter().zip(list(point)).map(view).collect();
            Observation::new(&geometry, &views).expect("a point in front of the cameras")
        };
        Case {
            name: case["name"].as_str().expect("a name").to_owned(),
            observations: list(&case["points_px"]).iter().map(observe).collect(),
            pivot_mm: numbers(&case["truth"]["pivot_mm"]),
            geometry,
            file: case.clone(),
        }
    };
    list(&file["cases"]).iter().map(case).collect()
}

#[track_caller]
fn assert_close<const N: usize>(name: &str, got: [f64; N], want: &Value, bound: f64) {
    let want: [f64; N] = numbers(want);
    for (got, want) in got.iter().zip(want) {
        assert!(
            (got - want).abs() <= bound,
            "{name}: {got} instead of {want}"
        );
    }
}

#[track_caller]
fn assert_stage(case: &Case, name: &str, got: &Estimate) {
    let (want, name) = (
        &case.file["expected"][name],
        format!("{}: {name}", case.name),
    );
    assert_close(&name, got.s_mm, &want["s_mm"], WITHIN_MM);
    assert_close(&name, got.omega, &want["omega"], WITHIN_RAD);
    assert_close(&name, got.rotation_rad(), &want["rotation_rad"], WITHIN_RAD);
    let moved = got.displacement_of(case.pivot_mm).displacement_mm;
    assert_close(&name, moved, &want["displacement_mm"], WITHIN_MM);
    // The lever to the rig's origin is 850 mm long.
    let translation = got.translation_mm();
    assert_close(&name, translation, &want["translation_mm"], 2.0 * WITHIN_MM);
}

#[test]
fn stages_agree_with_reference() {
    let cases = cases();
    assert_eq!(cases.len(), 20);
    for case in &cases {
        let sigma = number(&case.file["misfit_sigma"]);
        let noise = Noise::of(&case.geometry, &case.observations);
        assert_eq!(noise.common, 0.0, "{}", case.name);
        let measured = noise.start.sqrt();
        assert!(
            (measured - sigma).abs() < 1e-13 + 1e-9 * sigma,
            "{}: {measured}",
            case.name
        );
        let (geometry, observations) = (&case.geometry, &case.observations);
        let plain = pose::plain(geometry, observations).unwrap();
        assert_stage(case, "plain", &plain);
        assert_close(
            &case.name,
            plain.middle_mm,
            &case.file["middle_mm"],
            WITHIN_MM,
        );
        let removed = pose::noise_removed(geometry, observations, &noise).unwrap();
        assert_stage(case, "noise_removed", &removed);
        let whole = pose::solve(geometry, observations).unwrap();
        assert_stage(case, "reweighted", &whole);
    }
}

/// The covariance is `2 σ²` times the inverse of the reference's normal matrix.
#[test]
fn covariance_agrees_with_reference() {
    for case in cases() {
        for (stage, got) in [
            ("plain", pose::plain(&case.geometry, &case.observations)),
            (
                "reweighted",
                pose::solve(&case.geometry, &case.observations),
            ),
        ] {
            let got = got.unwrap();
            let upper: [f64; 21] = numbers(&case.file["expected"][stage]["normal_upper"]);
            let at = |i: usize, j: usize| {
                let (i, j) = (i.min(j), i.max(j));
                upper[i * 6 - i * i.saturating_sub(1) / 2 + j - i]
            };
            for i in 0..6 {
                for j in 0..6 {
                    let product: f64 = (0..6).map(|k| got.covariance[i][k] * at(k, j)).sum();
                    let product = product / (2.0 * got.sigma.powi(2));
                    let want = if i == j { 1.0 } else { 0.0 };
                    // mm against rad: the units of the off-diagonal blocks differ.
                    let unit = (at(j, j) / at(i, i)).sqrt();
                    let name = (&case.name, stage, i, j);
                    assert!(
                        (product - want).abs() < 1e-6 * unit.max(1.0),
                        "{name:?}: {product}"
                    );
                }
            }
        }
    }
}

/// The oracle of the other tests agrees with the reference's, and the closed form is within 0.35 of
/// its sigma from it.
#[test]
fn likelihood_agrees_with_reference() {
    for case in cases() {
        let start = pose::solve(&case.geometry, &case.observations).unwrap();
        let best = likelihood::fit(&case.geometry, &case.observations, &start);
        let want = &case.file["expected"]["maximum_likelihood"];
        let name = &case.name;
        assert_close(
            name,
            best.displacement_of(case.pivot_mm),
            &want["displacement_mm"],
            1e-7,
        );
        assert_close(name, best.rotation_rad(), &want["rotation_rad"], 1e-8);
        if number(&case.file["noise_px"]) == 0.0 {
            continue;
        }
        let sigma = start.displacement_of(case.pivot_mm).sigma_mm();
        let moved = start.displacement_of(case.pivot_mm).displacement_mm;
        for axis in 0..3 {
            let off = (moved[axis] - best.displacement_of(case.pivot_mm)[axis]).abs();
            assert!(off < 0.35 * sigma[axis], "{name}: {off} of {sigma:?}");
        }
    }
}
