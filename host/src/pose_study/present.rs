//! The study as a table for the screen and as JSON for programs.

use super::row::Row;
use crate::report::{Cell, Table};
use serde_json::{Value, json};

/// Returns the table of all rows.
pub fn table(rows: &[Row]) -> Table {
    let trials = rows.first().map_or(0, |row| row.trials);
    let caption = format!(
        "Displacement (T) and rotation (R), rms error over the Cramér-Rao bound, {trials} trials"
    );
    let columns = [
        "target",
        "points",
        "noise px",
        "angle deg",
        "bound T µm",
        "bound R mdeg",
        "pose T R",
        "Kabsch T R",
        "error²/sigma² T R",
    ];
    rows.iter()
        .fold(Table::new(caption, columns), |table, row| {
            let bound = |first: usize, factor: f64| {
                let axes = [0, 1, 2].map(|axis| factor * row.bound[first + axis]);
                Cell::vector(&axes, 1, 6)
            };
            table.row([
                Cell::text(row.target.name),
                Cell::right(row.points.to_string()),
                Cell::number(row.noise_px, 2),
                Cell::number(row.angle_deg, 0),
                bound(0, 1e3),
                bound(3, 1e3f64.to_degrees()),
                Cell::vector(&row.pose, 2, 5),
                Cell::vector(&row.kabsch, 2, 5),
                Cell::vector(&row.stated, 2, 5),
            ])
        })
}

/// Returns the ranges of all rows in three lines.
pub fn summary(rows: &[Row]) -> String {
    let range = |of: &dyn Fn(&Row) -> [f64; 2], half: usize| {
        let values = || rows.iter().map(|row| of(row)[half]);
        let least = values().fold(f64::INFINITY, f64::min);
        let most = values().fold(0.0, f64::max);
        format!("{least:.2} to {most:.2}")
    };
    let line = |name: &str, of: &dyn Fn(&Row) -> [f64; 2]| {
        let [moved, turned] = [0, 1].map(|half| range(of, half));
        format!("{name}: displacement {moved}, rotation {turned} times the bound\n")
    };
    let mut text = line("pose", &|row| row.pose) + &line("Kabsch", &|row| row.kabsch);
    let [moved, turned] = [0, 1].map(|half| range(&|row| row.stated, half));
    text += &format!("error²/sigma² of pose: displacement {moved}, rotation {turned}\n");
    text
}

/// Returns a row as one JSON object. Pairs are of displacement and rotation.
pub fn json(row: &Row) -> Value {
    let bound = |first: usize| [0, 1, 2].map(|axis| row.bound[first + axis]);
    json!({
        "target": row.target.name,
        "points": row.points,
        "noise_px": row.noise_px,
        "angle_deg": row.angle_deg,
        "trials": row.trials,
        "bound_mm": bound(0),
        "bound_deg": bound(3).map(f64::to_degrees),
        "pose_over_bound": row.pose,
        "kabsch_over_bound": row.kabsch,
        "normalised_error_squared": row.stated,
    })
}
