//! OpenCV's FileStorage as XML: an element per value below `opencv_storage`.
//!
//! Only this form is read: elements with text, or matrices with `rows`, `cols` and `data`. Only the
//! values under known names are kept.

use std::path::Path;

use super::yaml::{Document, Entry, is_known};
use trinocular_rig::error::InputError;

/// Largest number of elements of a matrix that is kept.
const MOST_ELEMENTS: usize = 1_000;

/// Returns true if the text is XML.
pub(super) fn is_xml(text: &str) -> bool {
    let start = text.trim_start_matches('\u{feff}').trim_start();
    start.starts_with("<?xml") || start.starts_with("<opencv_storage")
}

/// Reads the values under `known` names.
///
/// # Errors
/// [`InputError`] if the file is cut off, or none of OpenCV's.
pub(super) fn parse<'a>(
    file: &'a Path,
    text: &'a str,
    known: &[&str],
) -> Result<Document<'a>, InputError> {
    let mut scan = Scan {
        file,
        text,
        at: 0,
        line: 1,
    };
    let root = scan.open()?;
    if root != Some("opencv_storage") {
        return Err(scan.fault("expected <opencv_storage>, the XML of OpenCV's FileStorage"));
    }
    let mut entries: Vec<(&str, usize, Entry<'_>)> = Vec::new();
    while let Some(name) = scan.open()? {
        let line = scan.line;
        let body = scan.body(name)?;
        if !is_known(known, name) {
            continue;
        }
        if entries.iter().any(|(other, ..)| *other == name) {
            return Err(InputError::field(file, line, name, "given twice"));
        }
        entries.push((name, line, entry(file, line, name, body)?));
    }
    Ok(Document::of_entries(file, entries))
}

fn entry<'a>(file: &Path, line: usize, name: &str, body: &'a str) -> Result<Entry<'a>, InputError> {
    if !body.contains('<') {
        return Ok(Entry::Scalar(body.trim().trim_matches('"')));
    }
    // Value of a part of `body`, with what stands before it.
    let part = |key: &str| {
        let start = format!("<{key}>");
        let (before, rest) = body.split_once(&start)?;
        let (value, _) = rest.split_once(&format!("</{key}>"))?;
        Some((before, value))
    };
    let child = |key: &str| part(key).map(|(_, value)| value);
    let (Some(rows), Some(cols), Some((before, data))) =
        (child("rows"), child("cols"), part("data"))
    else {
        let reason = "expected a value, or a matrix with rows, cols and data";
        return Err(InputError::field(file, line, name, reason));
    };
    // `body` begins on `line`.
    let first = line + before.matches('\n').count();
    let numbered = data.split('\n').enumerate();
    let elements = numbered.flat_map(|(down, row)| {
        let elements = row.split_ascii_whitespace();
        elements.map(move |element| (first + down, element))
    });
    let data: Vec<_> = elements.take(MOST_ELEMENTS + 1).collect();
    if data.len() > MOST_ELEMENTS {
        let reason = format!("more than {MOST_ELEMENTS} values");
        return Err(InputError::field(file, line, name, reason));
    }
    Ok(Entry::Matrix {
        rows: rows.trim(),
        cols: cols.trim(),
        data,
    })
}

/// Place in the text.
struct Scan<'a> {
    file: &'a Path,
    text: &'a str,
    at: usize,
    line: usize,
}

impl<'a> Scan<'a> {
    fn fault(&self, reason: &str) -> InputError {
        InputError::line(self.file, self.line, reason)
    }

    /// Goes on by `length` bytes and returns them.
    fn take(&mut self, length: usize) -> &'a str {
        let taken = &self.text[self.at..self.at + length];
        self.at += length;
        self.line += taken.matches('\n').count();
        taken
    }

    /// Goes beyond the next `end` and returns the text before it.
    fn until(&mut self, end: &str) -> Result<&'a str, InputError> {
        let found = self.text[self.at..].find(end);
        let Some(length) = found else {
            return Err(self.fault("not valid XML: it ends too early"));
        };
        let before = self.take(length);
        self.take(end.len());
        Ok(before)
    }

    /// Returns the name of the next element; `None` at the end tag of the element around it.
    fn open(&mut self) -> Result<Option<&'a str>, InputError> {
        loop {
            self.until("<")?;
            let rest = &self.text[self.at..];
            if rest.starts_with("!--") {
                self.until("-->")?;
                continue;
            }
            let tag = self.until(">")?;
            if tag.starts_with(['?', '!']) {
                continue;
            }
            if tag.starts_with('/') {
                return Ok(None);
            }
            let name = tag
                .split([' ', '\t', '\r', '\n'])
                .next()
                .unwrap_or_default();
            if name.is_empty() || tag.ends_with('/') {
                return Err(self.fault("expected an element with a value"));
            }
            return Ok(Some(name));
        }
    }

    /// Returns the text up to the end tag of `name`.
    fn body(&mut self, name: &str) -> Result<&'a str, InputError> {
        self.until(&format!("</{name}>"))
    }
}
