//! The table as CSV.

use super::{COLUMNS, Cells, Row};
use std::fmt::Write as _;

/// Formats rows as CSV: one line of names, then one line per frame set.
pub fn csv<'a>(rows: impl IntoIterator<Item = &'a Row>) -> String {
    let mut text = COLUMNS.map(|(name, _)| name).join(",");
    text.push('\n');
    for row in rows {
        for (index, (_, cells)) in COLUMNS.iter().enumerate() {
            if index > 0 {
                text.push(',');
            }
            let _ = match cells {
                Cells::Whole(cell) => write!(text, "{}", cell(row)),
                Cells::Number(cell) => cell(row).map_or(Ok(()), |cell| write!(text, "{cell}")),
                Cells::Text(cell) => write!(text, "{}", cell(row)),
                Cells::Quoted(cell) => {
                    write!(text, "\"{}\"", cell(row).replace('"', "\"\""))
                }
            };
        }
        text.push('\n');
    }
    text
}
