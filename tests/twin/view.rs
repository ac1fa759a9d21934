//! A run from a saved view moves the stage back; reported positions count from the new zero.

use super::{HEARTBEAT, bench};
use serde_json::Value;

/// Returns the numbers of a vector of a row.
fn vector(row: &Value, field: &str) -> Option<[f64; 3]> {
    let numbers = row[field].as_array()?.iter().map(Value::as_f64);
    let numbers: Option<Vec<f64>> = numbers.collect();
    numbers?.try_into().ok()
}

#[test]
fn stage_goes_back_to_a_saved_view() {
    let twin = bench("still");
    let heartbeat = HEARTBEAT.join(" ");
    let words = |seconds: u32, more: &str| {
        format!(
            "track --cameras twin --rig bench.toml --seconds {seconds} --json {heartbeat} {more}"
        )
    };
    twin.run(&words(1, "--record view.mcap")).good_json();
    twin.good("reset");
    twin.good(&format!("jog x=3 y=-2 --rig bench.toml {heartbeat}"));
    // A run that begins makes the present position zero.
    let still = twin.run(&words(1, "")).good_json();
    assert!(!still.is_empty());
    for row in &still {
        let stage_mm = vector(row, "stage_mm").expect("a position");
        assert!(stage_mm.iter().all(|mm| mm.abs() <= 0.02), "{row}");
    }
    twin.good("reset");
    let rows = twin.run(&words(5, "--reference view.mcap")).good_json();
    let first_mm = rows.iter().find_map(|row| vector(row, "displacement_mm"));
    let [x_mm, y_mm, _] = first_mm.expect("a displacement");
    let is_right = (x_mm + 3.0).abs() < 0.05 && (y_mm - 2.0).abs() < 0.05;
    assert!(is_right, "{first_mm:?}");
    let last_mm = rows.last().and_then(|row| vector(row, "stage_mm"));
    for (is_mm, wanted_mm) in last_mm.expect("a position").iter().zip([-3.0, 2.0, 0.0]) {
        assert!((is_mm - wanted_mm).abs() < 0.05, "{is_mm}, not {wanted_mm}");
    }
}
