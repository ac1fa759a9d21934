//! The counts as a table for the screen and as JSON.

use super::sweep::Row;
use crate::accuracy_study::tally::Tally;
use crate::report::{Cell, Table};
use serde_json::{Map, Value, json};

fn name(row: &Row) -> String {
    match row.noise_grey {
        None => row.layout.name.to_owned(),
        Some(noise) => format!("  noise {noise}"),
    }
}

fn refused(tally: &Tally) -> String {
    let counts = tally.refused.iter();
    let counts: Vec<String> = counts
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    match counts.is_empty() {
        true => "-".to_owned(),
        false => counts.join(", "),
    }
}

/// Returns the table of the rows; those of a single noise only if `by_noise`.
pub fn table(rows: &[Row], by_noise: bool) -> Table {
    let columns = [
        "layout",
        "with rotation",
        "refused",
        "rms x y z, mm",
        "rms about x y z, deg",
        "error²/sigma² T R",
        "without rotation",
        "refused",
        "gross T R, without",
        "vague",
    ];
    let caption = "Targets that turn by up to 12 degrees".to_owned();
    let shown = rows
        .iter()
        .filter(|row| by_noise || row.noise_grey.is_none());
    shown.fold(Table::new(caption, columns), |table, row| {
        let mean = |tally: &Tally| tally.normalised().iter().sum::<f64>() / 3.0;
        let of = |tally: &Tally| format!("{} of {}", tally.measured, tally.trials());
        let gross = [&row.moved, &row.turned, &row.displaced].map(|tally| tally.gross.to_string());
        table.row([
            Cell::text(name(row)),
            Cell::right(of(&row.moved)),
            Cell::text(refused(&row.moved)),
            Cell::vector(&row.moved.rms_mm(), 4, 7),
            Cell::vector(&row.turned.rms_mm(), 4, 7),
            Cell::vector(&[mean(&row.moved), mean(&row.turned)], 2, 5),
            Cell::right(of(&row.displaced)),
            Cell::text(refused(&row.displaced)),
            Cell::right(gross.join(" ")),
            Cell::right(row.vague.to_string()),
        ])
    })
}

/// Returns a row as one JSON object.
pub fn json(row: &Row) -> Value {
    let counts = |tally: &Tally| -> Map<String, Value> {
        let refused = tally.refused.iter();
        let refused: Map<String, Value> = refused
            .map(|(name, count)| ((*name).to_owned(), json!(count)))
            .collect();
        let some = tally.measured > 0;
        let mut object = Map::new();
        object.insert("measured".into(), json!(tally.measured));
        object.insert("refused".into(), json!(refused));
        object.insert("rms_error".into(), json!(some.then(|| tally.rms_mm())));
        let normalised = some.then(|| tally.normalised());
        object.insert("normalised_error_squared".into(), json!(normalised));
        object.insert("gross".into(), json!(tally.gross));
        object
    };
    json!({
        "layout": row.layout.name,
        "noise_grey": row.noise_grey,
        "displacement_mm": counts(&row.moved),
        "rotation_deg": counts(&row.turned),
        "without_rotation_mm": counts(&row.displaced),
        "vague": row.vague,
    })
}
