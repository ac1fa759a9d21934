//! Edits of a valid text, so that most of it stays valid for a reader.

use arbitrary::Arbitrary;

/// One edit. Places are modulo the length.
#[derive(Arbitrary, Clone, Debug)]
pub enum Edit {
    /// Replaces some bytes by others.
    Bytes {
        /// Place of the first byte.
        at: u16,
        /// Number of bytes removed.
        remove: u8,
        /// Bytes inserted.
        insert: Vec<u8>,
    },
    /// Replaces some bytes by a piece of syntax.
    Token {
        /// Place of the first byte.
        at: u16,
        /// Number of bytes removed.
        remove: u8,
        /// Index into [`TOKENS`].
        token: u8,
    },
    /// Replaces a number.
    Number {
        /// Index of the number in the text.
        which: u16,
        /// New value.
        value: Number,
    },
    /// Removes a line, or copies another one before it.
    Line {
        /// Index of the line.
        line: u16,
        /// Index of the line to copy before it; `None` removes the line.
        copied: Option<u16>,
    },
    /// Truncates the text.
    End(u16),
}

/// Replacement of a number.
#[derive(Arbitrary, Clone, Copy, Debug)]
pub enum Number {
    /// One of [`NUMBERS`].
    Special(u8),
    /// Any floating-point number.
    Any(f64),
    /// Any integer.
    Whole(i64),
}

/// Numbers at the limits of formats and rules, and text that is not a number.
pub const NUMBERS: [&str; 20] = [
    "0",
    "-0.0",
    "-1",
    "1",
    "8",
    "7",
    "65535",
    "65536",
    "4294967296",
    "9223372036854775807",
    "9223372036854775808",
    "1e-320",
    "1e308",
    "-1e308",
    "1e400",
    "nan",
    "inf",
    "-inf",
    "0x10",
    "1_0",
];

/// Syntax of the text formats.
pub const TOKENS: [&str; 24] = [
    "[",
    "]",
    "{",
    "}",
    "[[",
    "]]",
    "\"",
    "'",
    "#",
    ":",
    "- ",
    "? ",
    "&a ",
    "*a",
    "!!",
    ",",
    "=",
    ".",
    "\n",
    "\r\n",
    "\t",
    "\u{feff}",
    "\u{1b}[2J",
    "\u{202e}",
];

/// Applies all edits to the text, in order.
pub fn edited(text: &str, edits: &[Edit]) -> Vec<u8> {
    let mut text = text.as_bytes().to_vec();
    for edit in edits {
        match edit {
            Edit::Bytes { at, remove, insert } => replace(&mut text, *at, *remove, insert),
            Edit::Token { at, remove, token } => {
                let token = TOKENS[usize::from(*token) % TOKENS.len()];
                replace(&mut text, *at, *remove, token.as_bytes());
            }
            Edit::Number { which, value } => number(&mut text, *which, *value),
            Edit::Line { line, copied } => lines(&mut text, *line, *copied),
            Edit::End(at) => text.truncate(usize::from(*at) % (text.len() + 1)),
        }
    }
    text
}

fn replace(text: &mut Vec<u8>, at: u16, remove: u8, insert: &[u8]) {
    let start = usize::from(at) % (text.len() + 1);
    let end = (start + usize::from(remove)).min(text.len());
    text.splice(start..end, insert.iter().copied());
}

fn number(text: &mut Vec<u8>, which: u16, value: Number) {
    let is_part = |byte: u8| byte.is_ascii_digit() || b".-+eE_".contains(&byte);
    let starts: Vec<usize> = (0..text.len())
        .filter(|&at| text[at].is_ascii_digit() && (at == 0 || !is_part(text[at - 1])))
        .collect();
    if starts.is_empty() {
        return;
    }
    let start = starts[usize::from(which) % starts.len()];
    let length = text[start..]
        .iter()
        .take_while(|&&byte| is_part(byte))
        .count();
    let value = match value {
        Number::Special(index) => NUMBERS[usize::from(index) % NUMBERS.len()].to_owned(),
        Number::Any(number) => format!("{number:?}"),
        Number::Whole(number) => number.to_string(),
    };
    text.splice(start..start + length, value.into_bytes());
}

fn lines(text: &mut Vec<u8>, line: u16, copied: Option<u16>) {
    let all: Vec<&[u8]> = text.split_inclusive(|&byte| byte == b'\n').collect();
    if all.is_empty() || all.len() > 10_000 {
        return;
    }
    let line = usize::from(line) % all.len();
    let mut new = all[..line].concat();
    match copied {
        Some(copied) => {
            new.extend_from_slice(all[usize::from(copied) % all.len()]);
            new.extend_from_slice(&all[line..].concat());
        }
        None => new.extend_from_slice(&all[line + 1..].concat()),
    }
    *text = new;
}
