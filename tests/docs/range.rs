//! Ranges of numbers as the references state them, and values that try them.

use trinocular_tests::binary::Outcome;

/// A range such as `above 0 to 1e6` or `0 to 65`.
#[derive(Clone, Copy)]
pub struct Range {
    least: f64,
    greatest: f64,
    /// True if the least value itself is excluded.
    above: bool,
}

impl Range {
    /// Reads a cell; `None` if it states no range of numbers.
    pub fn read(cell: &str) -> Option<Self> {
        let (least, greatest) = cell.split_once(" to ")?;
        let above = least.strip_prefix("above ");
        Some(Self {
            least: above.unwrap_or(least).parse().ok()?,
            greatest: greatest.split(',').next()?.parse().ok()?,
            above: above.is_some(),
        })
    }

    /// Returns values at both ends and beyond them, each with true if it is within the range.
    pub fn probes(self) -> [(f64, bool); 4] {
        let Self {
            least,
            greatest,
            above,
        } = self;
        let [low, below] = match above {
            true => [greatest / 2.0, least],
            false => [least, least - 1.0],
        };
        let beyond = (greatest * 1.01 + 1.0).floor();
        [
            (greatest, true),
            (low, true),
            (beyond, false),
            (below, false),
        ]
    }
}

/// Returns an example with every number replaced by `value`.
pub fn filled(example: &str, value: f64) -> String {
    let count = example.matches(',').count() + 1;
    match example.starts_with('[') {
        true => format!("[{}]", vec![value.to_string(); count].join(", ")),
        false => value.to_string(),
    }
}

/// Returns true if the program refused the value of this field because of its size.
pub fn out_of_range(outcome: &Outcome, field: &str) -> bool {
    let size = ["out of range", "must be greater", "must not be negative"];
    let text = &outcome.stderr;
    text.contains(field) && size.iter().any(|reason| text.contains(reason))
}
