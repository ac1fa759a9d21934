//! A table for the terminal and for the page.

use super::markup::{escape, printable_text};
use std::fmt::Write as _;

/// Emphasis of a cell. Colour alone never carries a meaning: the text says it too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Emphasis {
    /// No emphasis.
    #[default]
    None,
    /// Bold, for the main figure.
    Strong,
    /// Value within its bound.
    Good,
    /// Value out of its bound.
    Bad,
    /// Value for comparison.
    Muted,
}

/// One entry of a [`Table`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cell {
    /// Content of the cell.
    pub text: String,
    /// True for right alignment (numbers), false for left (words).
    pub right: bool,
    /// True if long words are broken into lines on the page.
    pub wraps: bool,
    /// Emphasis of the cell on the page.
    pub emphasis: Emphasis,
}

impl Cell {
    /// Creates a cell of words, left-aligned.
    pub fn text(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            ..Self::default()
        }
    }

    /// Creates a cell of a sentence, which is broken into lines on the page.
    pub fn words(text: impl Into<String>) -> Self {
        Self {
            wraps: true,
            ..Self::text(text)
        }
    }

    /// Creates a cell of preformatted text, right-aligned.
    pub fn right(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            right: true,
            ..Self::default()
        }
    }

    /// Creates a cell with a number of `decimals` decimals, right-aligned. A value that is not
    /// finite is shown as "-".
    pub fn number(value: f64, decimals: usize) -> Self {
        Self::right(fixed(value, decimals))
    }

    /// Creates a cell with several numbers, each padded to `width` characters so that they line up
    /// down the column.
    pub fn vector(values: &[f64], decimals: usize, width: usize) -> Self {
        let numbers: Vec<String> = values
            .iter()
            .map(|value| format!("{:>width$}", fixed(*value, decimals)))
            .collect();
        Self::right(numbers.join(" "))
    }

    /// Returns the cell in bold.
    pub fn strong(self) -> Self {
        self.with(Emphasis::Strong)
    }

    /// Returns the cell marked as within its bound.
    pub fn good(self) -> Self {
        self.with(Emphasis::Good)
    }

    /// Returns the cell marked as out of its bound.
    pub fn bad(self) -> Self {
        self.with(Emphasis::Bad)
    }

    /// Returns the cell muted.
    pub fn muted(self) -> Self {
        self.with(Emphasis::Muted)
    }

    fn with(self, emphasis: Emphasis) -> Self {
        Self { emphasis, ..self }
    }
}

/// Formats a number for tables: never "-0.000", never "NaN".
fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|b| b == b'0' || b == b'.') => digits.to_owned(),
        _ => text,
    }
}

/// Rows of cells under named columns. Short rows are filled with empty cells; cells beyond the last
/// column are not shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Caption of the table.
    pub caption: String,
    /// Names of the columns, with units.
    pub columns: Vec<String>,
    /// Cells, row by row.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Creates a table without rows.
    pub fn new<const N: usize>(caption: impl Into<String>, columns: [&str; N]) -> Self {
        Self {
            caption: caption.into(),
            columns: columns.iter().map(|name| (*name).to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn row(mut self, cells: impl IntoIterator<Item = Cell>) -> Self {
        self.rows.push(cells.into_iter().collect());
        self
    }

    /// Returns true if column `j` holds numbers, so that its name is right-aligned: true if any
    /// cell is right-aligned.
    fn right(&self, j: usize) -> bool {
        self.rows
            .iter()
            .any(|row| row.get(j).is_some_and(|cell| cell.right))
    }

    /// Returns the table in aligned columns for a terminal: caption, a blank line, names over a
    /// rule, rows. Ends with a line end; no line ends in spaces.
    pub fn to_text(&self) -> String {
        let plain = |text: &str| printable_text(text).replace(['\n', '\r', '\t'], " ");
        let names: Vec<String> = self.columns.iter().map(|name| plain(name)).collect();
        let rows: Vec<Vec<String>> = self
            .rows
            .iter()
            .map(|row| {
                (0..names.len())
                    .map(|j| row.get(j).map(|cell| plain(&cell.text)).unwrap_or_default())
                    .collect()
            })
            .collect();
        let length = |text: &String| text.chars().count();
        let widths: Vec<usize> = (0..names.len())
            .map(|j| {
                let cells = rows.iter().filter_map(|row| row.get(j)).map(length);
                cells.chain(names.get(j).map(length)).max().unwrap_or(0)
            })
            .collect();
        let line = |cells: &[String], right: &dyn Fn(usize) -> bool| {
            let padded = cells
                .iter()
                .zip(&widths)
                .enumerate()
                .map(|(j, (text, &width))| {
                    if right(j) {
                        format!("{text:>width$}")
                    } else {
                        format!("{text:<width$}")
                    }
                });
            let padded: Vec<String> = padded.collect();
            format!("{}\n", padded.join("  ").trim_end())
        };
        let mut text = String::new();
        if !self.caption.is_empty() {
            let _ = writeln!(text, "{}\n", plain(&self.caption));
        }
        // Names stand over their column; a lone word among numbers keeps its own alignment.
        text.push_str(&line(&names, &|j| self.right(j)));
        let ruled = widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1);
        text.push_str(&"-".repeat(ruled));
        text.push('\n');
        for (cells, row) in rows.iter().zip(&self.rows) {
            text.push_str(&line(cells, &|j| row.get(j).is_some_and(|cell| cell.right)));
        }
        text
    }

    /// Returns the table as HTML.
    pub(super) fn to_html(&self) -> String {
        let mut html = String::from("<div class=\"table\"><table>\n");
        if !self.caption.is_empty() {
            let _ = writeln!(html, "<caption>{}</caption>", escape(&self.caption));
        }
        html.push_str("<thead><tr>");
        for (j, name) in self.columns.iter().enumerate() {
            let class = if self.right(j) { " class=\"n\"" } else { "" };
            let _ = write!(html, "<th scope=\"col\"{class}>{}</th>", escape(name));
        }
        html.push_str("</tr></thead>\n<tbody>\n");
        let empty = Cell::default();
        for row in &self.rows {
            html.push_str("<tr>");
            for j in 0..self.columns.len() {
                let cell = row.get(j).unwrap_or(&empty);
                let _ = write!(html, "<td{}>{}</td>", class(cell), escape(&cell.text));
            }
            html.push_str("</tr>\n");
        }
        html.push_str("</tbody>\n</table></div>\n");
        html
    }
}

fn class(cell: &Cell) -> String {
    let emphasis = match cell.emphasis {
        Emphasis::None => None,
        Emphasis::Strong => Some("strong"),
        Emphasis::Good => Some("good"),
        Emphasis::Bad => Some("bad"),
        Emphasis::Muted => Some("muted"),
    };
    let names: Vec<&str> = cell
        .right
        .then_some("n")
        .into_iter()
        .chain(cell.wraps.then_some("w"))
        .chain(emphasis)
        .collect();
    if names.is_empty() {
        String::new()
    } else {
        format!(" class=\"{}\"", names.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::super::markup::balance;
    use super::*;

    fn sample() -> Table {
        Table::new("Moves", ["axis", "true, mm", "error, mm"])
            .row([
                Cell::text("X"),
                Cell::number(10.0, 1),
                Cell::number(-0.000_04, 3),
            ])
            .row([
                Cell::text("<Z>"),
                Cell::number(-3.25, 1),
                Cell::number(f64::NAN, 3).bad(),
            ])
            .row([Cell::text("short")])
    }

    #[test]
    fn columns_line_up_on_screen() {
        let expected = "Moves\n\n\
                        axis   true, mm  error, mm\n\
                        --------------------------\n\
                        X          10.0      0.000\n\
                        <Z>        -3.2          -\n\
                        short\n";
        assert_eq!(sample().to_text(), expected);
    }

    #[test]
    fn html_is_balanced_and_escaped() {
        let html = sample().to_html();
        assert_eq!(balance::fault(&html), None);
        assert!(html.contains("<td>&lt;Z&gt;</td>"), "{html}");
        assert!(html.contains("<td class=\"n bad\">-</td>"), "{html}");
        assert_eq!(html.matches("<td").count(), 9);
    }

    #[test]
    fn terminal_gets_no_controls() {
        let table = Table::new("a\u{1b}[2J", ["b\nc"]).row([Cell::text("d\te")]);
        let text = table.to_text();
        assert!(
            !text.contains('\u{1b}') && text.contains("b c") && text.contains("d e"),
            "{text}"
        );
    }

    #[test]
    fn empty_table_is_a_table() {
        assert_eq!(Table::default().to_text(), "\n\n");
        assert_eq!(balance::fault(&Table::default().to_html()), None);
    }

    #[test]
    fn vectors_line_up() {
        assert_eq!(Cell::vector(&[1.0, -20.5], 2, 7).text, "   1.00  -20.50");
    }
}
