//! Markdown tables.

use super::page::Page;

/// A row of a table: its cells, without the header.
pub struct Row<'a> {
    /// Line number in the page, from 1.
    pub line: usize,
    /// Trimmed cells.
    pub cells: Vec<&'a str>,
}

/// Returns the rows of all tables of a page without header and rule.
pub fn rows(page: &Page) -> Vec<Row<'_>> {
    let mut rows = Vec::new();
    let mut header = true;
    for (line, text) in page.prose() {
        let Some(inner) = text.strip_prefix('|').and_then(|t| t.strip_suffix('|')) else {
            header = true;
            continue;
        };
        let cells: Vec<&str> = inner.split('|').map(str::trim).collect();
        if cells
            .iter()
            .all(|cell| cell.trim_matches(['-', ':', '|', ' ']).is_empty())
        {
            header = false;
        } else if !header {
            rows.push(Row { line, cells });
        }
    }
    rows
}

/// Returns the text between the first pair of backticks in a cell.
pub fn code(cell: &str) -> Option<&str> {
    cell.split('`').nth(1)
}

/// Returns the numbers in a text, as they are written.
pub fn numbers(text: &str) -> Vec<f64> {
    let kept = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | ',' | 'e');
    text.split(|c: char| !kept(c))
        .filter_map(|word| word.trim_matches([',', '.']).replace(',', "").parse().ok())
        .collect()
}
