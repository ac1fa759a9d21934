//! Rows of `track`: their objects, columns and words.

use super::others;
use crate::commands::csv_rows::{self, Column};
use serde_json::{Value, json};
use trinocular::servo::visual_servo::{ServoEstimate, ServoOutcome};
use trinocular_rig::rig_file::RigFile;

/// Adds what the station estimated, or the reason why it did not, to a row's object.
pub fn add_outcome(object: &mut Value, outcome: &ServoOutcome) {
    match outcome {
        ServoOutcome::Used(estimate) => {
            object["displacement_mm"] = json!(estimate.displacement_mm);
            object["sigma_mm"] = json!(estimate.sigma_mm);
            object["covariance_mm2"] = json!(estimate.covariance_mm2);
            object["points"] = json!(estimate.points);
            object["rejected"] = json!(estimate.rejected);
            object["latency_ms"] = json!(f64::from(estimate.latency_us) * 1e-3);
            if let Some(turn) = &estimate.turn {
                object["rotation_deg"] = json!(turn.rotation_deg);
                object["rotation_sigma_deg"] = json!(turn.rotation_sigma_deg);
                object["pivot_mm"] = json!(turn.pivot_mm);
            }
        }
        other => object["refused"] = json!(other.refusal().unwrap_or_default()),
    }
}

/// Adds sentences to a row's warnings.
pub fn add_warnings(object: &mut Value, sentences: Vec<String>) {
    if sentences.is_empty() {
        return;
    }
    let warnings = &mut object["warnings"];
    if warnings.is_null() {
        *warnings = json!([]);
    }
    if let Value::Array(list) = warnings {
        list.extend(sentences.into_iter().map(Value::from));
    }
}

/// Columns of `--csv`; those of other sources stay empty.
const COLUMNS: [&[Column]; 3] = [
    &[("frame", "/frame"), ("time_s", "/time_s")],
    &csv_rows::DISPLACEMENT,
    &[
        ("points", "/points"),
        ("rejected", "/rejected"),
        ("latency_ms", "/latency_ms"),
        ("trust", "/trust"),
        ("stage_x_mm", "/stage_mm/0"),
        ("stage_y_mm", "/stage_mm/1"),
        ("stage_z_mm", "/stage_mm/2"),
        ("camera_x_mm", "/camera_mm/0"),
        ("camera_y_mm", "/camera_mm/1"),
        ("camera_z_mm", "/camera_mm/2"),
        ("target_x_mm", "/target_mm/0"),
        ("target_y_mm", "/target_mm/1"),
        ("target_z_mm", "/target_mm/2"),
        ("drops", "/drops"),
        ("refused", "/refused"),
        ("warnings", "/warnings"),
    ],
];

/// Formats the standard deviation, the rotation if it is more than noise, and the counts of a used
/// row.
pub fn known(estimate: &ServoEstimate) -> String {
    let sigma = estimate.sigma_mm.map_or(String::new(), |sigma| {
        let sigma = sigma.map(|mm| format!("{mm:.4}")).join(" ");
        format!("sigma {sigma} mm, ")
    });
    let ServoEstimate {
        points, rejected, ..
    } = estimate;
    let shown = estimate.turn.filter(|turn| turn.is_significant);
    let turned = shown.map_or(String::new(), |turn| {
        let degrees = turn.rotation_deg.map(|angle| format!("{angle:.3}"));
        format!("turned by {} deg, ", degrees.join(" "))
    });
    format!("{sigma}{turned}{points} points, {rejected} rejected")
}

/// Formats three columns of a row, mm.
pub fn vector([x, y, z]: &[f64; 3]) -> String {
    format!("{x:>8.4} {y:>8.4} {z:>8.4}")
}

/// Returns the columns of --csv; those of the rotation and of several targets come last, and only
/// if there are any.
pub fn columns(rig: &RigFile) -> Vec<&'static [Column]> {
    let turn = rig.estimated_pivot().map(|_| csv_rows::TURN.as_slice());
    let targets = (rig.targets.len() > 1).then_some(others::COLUMNS.as_slice());
    COLUMNS.into_iter().chain(turn).chain(targets).collect()
}
