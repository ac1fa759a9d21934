//! The table of results: as text for the screen, as Markdown for the committed file, as JSON for
//! programs.

use super::phase::Phase;
use super::sweep::Row;
use super::tally::Tally;
use serde_json::{Map, Value, json};

const HEADERS: [&str; 8] = [
    "condition",
    "measured",
    "refused",
    "points",
    "RMS error x y z, mm",
    "error²/sigma² x y z",
    "within 3 sigma",
    "gross",
];

/// One line of the table.
struct ConditionRow([String; 8]);

impl ConditionRow {
    fn new(name: &str, tally: &Tally) -> Self {
        let triple =
            |values: [f64; 3], digits: usize| values.map(|v| format!("{v:.digits$}")).join(" ");
        let refused: Vec<String> = (tally.refused.iter())
            .map(|(name, count)| format!("{count} {name}"))
            .collect();
        let dash = |text: String| {
            if tally.measured == 0 {
                "-".into()
            } else {
                text
            }
        };
        Self([
            name.to_owned(),
            format!("{} of {}", tally.measured, tally.trials()),
            if refused.is_empty() {
                "-".into()
            } else {
                refused.join(", ")
            },
            dash(format!("{:.0}", tally.mean_points())),
            dash(triple(tally.rms_mm(), 4)),
            dash(triple(tally.normalised(), 2)),
            dash(format!("{:.1} %", 100.0 * tally.within())),
            dash(tally.gross.to_string()),
        ])
    }
}

/// Returns the rows of a sweep and their sum as text with aligned columns, or as Markdown.
pub fn table(rows: &[Row], total: &Tally, by_noise: bool, markdown: bool) -> String {
    let mut lines = vec![ConditionRow(HEADERS.map(String::from))];
    for row in rows {
        lines.push(ConditionRow::new(row.condition.name, &row.tally));
        if by_noise {
            let noises = row.by_noise.iter();
            lines.extend(
                noises.map(|(noise, tally)| ConditionRow::new(&format!("  noise {noise}"), tally)),
            );
        }
    }
    lines.push(ConditionRow::new("all", total));
    if markdown {
        let row = |line: &ConditionRow| format!("| {} |\n", line.0.join(" | "));
        let mut text = row(&lines[0]);
        text += &format!("|{}\n", "---|".repeat(HEADERS.len()));
        lines[1..].iter().for_each(|line| text += &row(line));
        return text;
    }
    let width = |column: usize| {
        let widths = lines.iter().map(|line| line.0[column].chars().count());
        widths.max().unwrap_or(0)
    };
    let widths: [usize; 8] = std::array::from_fn(width);
    let mut text = String::new();
    for line in &lines {
        let cells = line.0.iter().zip(widths);
        let padded: Vec<String> = cells
            .map(|(cell, width)| format!("{cell:width$}"))
            .collect();
        text += padded.join("  ").trim_end();
        text.push('\n');
    }
    text
}

/// Returns a row as one JSON object.
pub fn json(name: &str, tally: &Tally) -> Value {
    let refused: Map<String, Value> = (tally.refused.iter())
        .map(|(name, count)| ((*name).to_owned(), json!(count)))
        .collect();
    let some = tally.measured > 0;
    json!({
        "condition": name,
        "trials": tally.trials(),
        "measured": tally.measured,
        "refused": refused,
        "mean_points": some.then(|| tally.mean_points()),
        "rms_error_mm": some.then(|| tally.rms_mm()),
        "normalised_error_squared": some.then(|| tally.normalised()),
        "within_3_sigma": some.then(|| tally.within()),
        "gross": tally.gross,
    })
}

/// Returns the bias at every phase, as text or Markdown.
pub fn phases(phases: &[Phase], markdown: bool) -> String {
    let mut text = if markdown {
        "| shift, px | bias x, px | bias y, px | scatter of a point, px |\n|---|---|---|---|\n"
            .to_owned()
    } else {
        format!(
            "{:>9}  {:>20}  {:>20}  {:>22}\n",
            "shift, px", "bias x, px", "bias y, px", "scatter of a point, px"
        )
    };
    for phase in phases {
        let bias = |i: usize| format!("{:+.5} ± {:.5}", phase.bias_px[i], phase.uncertainty_px[i]);
        let (shift, scatter) = (phase.shift_px, phase.scatter_px);
        text += &if markdown {
            format!(
                "| {shift:.1} | {} | {} | {scatter:.4} |\n",
                bias(0),
                bias(1)
            )
        } else {
            format!(
                "{shift:>9.1}  {:>20}  {:>20}  {scatter:>22.4}\n",
                bias(0),
                bias(1)
            )
        };
    }
    text
}

/// Returns a phase as one JSON object.
pub fn phase_json(phase: &Phase) -> Value {
    json!({
        "phase_px": phase.shift_px,
        "bias_px": phase.bias_px,
        "bias_uncertainty_px": phase.uncertainty_px,
        "scatter_px": phase.scatter_px,
    })
}
