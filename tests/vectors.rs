//! The reference cases of `golden/estimators.json`: every estimator, in floating and in fixed
//! point.

use serde_json::Value;
use trinocular_core::estimate::{closed_form, least_squares, midpoint};
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;
use trinocular_tests::points::{centred, ideal_rig, pairs};

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|i| {
        value[i]
            .as_f64()
            .unwrap_or_else(|| panic!("not {N} numbers: {value}"))
    })
}

struct Case {
    name: String,
    rig: Rig,
    views: Vec<Vec<View>>,
    expected: Value,
}

fn cases() -> Vec<Case> {
    let text = include_str!("golden/estimators.json");
    let file: Value = serde_json::from_str(text).expect("valid JSON");
    let list = |value: &Value| value.as_array().expect("a list").clone();
    list(&file["cases"])
        .iter()
        .map(|case| {
            let focal = case["focal_px"].as_f64().expect("a number");
            let offsets: Vec<[f64; 2]> = list(&case["camera_offsets_mm"])
                .iter()
                .map(numbers)
                .collect();
            let rig = ideal_rig(focal, &offsets);
            let point = |point: &Value| {
                let cameras = rig.cameras.iter().zip(list(point));
                cameras
                    .map(|(camera, seen)| {
                        View::from_pixels(camera, numbers(&seen["t0"]), numbers(&seen["t1"]))
                    })
                    .collect()
            };
            let views = list(&case["points"]).iter().map(point).collect();
            let name = case["name"].as_str().expect("a name").to_owned();
            Case {
                name,
                rig,
                views,
                expected: case["expected"].clone(),
            }
        })
        .collect()
}

fn assert_close(name: &str, what: &str, got: [f64; 3], want: &Value, bound: f64) {
    let want = numbers::<3>(want);
    for axis in 0..3 {
        assert!(
            (got[axis] - want[axis]).abs() <= bound,
            "{name}, {what}: {got:?} instead of {want:?}"
        );
    }
}

fn mm(nm: [i32; 3]) -> [f64; 3] {
    nm.map(|nm| f64::from(nm) * 1e-6)
}

#[test]
fn midpoint_agrees_with_reference() {
    let cases = cases();
    assert_eq!(cases.len(), 9);
    for Case {
        name,
        rig,
        views,
        expected,
    } in cases
    {
        let (sums, expected) = (centred(&rig, &views), &expected["midpoint"]);
        let estimate = midpoint::solve(&sums).unwrap();
        assert_close(
            &name,
            "midpoint",
            estimate.displacement_mm,
            &expected["displacement_mm"],
            1e-6,
        );
        assert_close(
            &name,
            "sigma",
            estimate.sigma_mm(),
            &expected["sigma_mm"],
            1e-6,
        );
        let sigma_px = expected["sigma_px"].as_f64().unwrap();
        assert!(
            (estimate.sigma_px - sigma_px).abs() < 1e-6,
            "{name}: {} px",
            estimate.sigma_px
        );
        assert!((sums.weight_px2() / expected["sums"]["n"].as_f64().unwrap() - 1.0).abs() < 1e-9);
        let words = sums.quantise().unwrap();
        let fixed = midpoint::solve_fixed(&words).unwrap();
        assert_close(
            &name,
            "midpoint in fixed point",
            mm(fixed.displacement_nm),
            &expected["displacement_mm"],
            1e-3,
        );
        assert_close(
            &name,
            "sigma in fixed point",
            fixed.sigma_nm().map(|nm| f64::from(nm) * 1e-6),
            &expected["sigma_mm"],
            1e-3,
        );
    }
}

#[test]
fn paper_estimators_agree_with_reference() {
    let mut compared = 0;
    for Case {
        name,
        rig,
        views,
        expected,
    } in cases()
    {
        if expected["closed_form_mm"].is_null() {
            continue; // more cameras than the paper's
        }
        compared += 1;
        let sums = pairs(&rig, &views);
        assert_close(
            &name,
            "closed form",
            closed_form::solve(&sums).unwrap(),
            &expected["closed_form_mm"],
            1e-6,
        );
        assert_close(
            &name,
            "least squares",
            least_squares::solve(&sums).unwrap(),
            &expected["least_squares_mm"],
            1e-6,
        );
        let fixed = closed_form::solve_fixed(&sums.quantise().unwrap()).unwrap();
        assert_close(
            &name,
            "closed form in fixed point",
            mm(fixed),
            &expected["closed_form_mm"],
            1e-3,
        );
        // The paper's own sums are ours in pixels.
        let focal = rig.mean_focal_px();
        let of = |sum: &str| expected["paper_sums"][sum].as_f64().unwrap();
        for (got, want) in [
            (sums.a1 * focal, of("a1")),
            (sums.a2 * focal * focal, of("a2")),
            (sums.b3 * focal * focal, of("b3")),
            (sums.d1 * focal, of("d1")),
            (sums.d4 * focal, of("d4")),
        ] {
            assert!(
                (got - want).abs() <= 1e-9 * want.abs().max(1.0),
                "{name}: {got} instead of {want}"
            );
        }
    }
    assert_eq!(compared, 8);
}
