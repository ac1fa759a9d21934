//! Foreign text, escaped for a terminal or a log.
//!
//! File names, keys of files and the name that a station gives itself are foreign text. Control
//! characters in them could move the cursor, clear the screen or forge a line of output.
//! [`printable`] writes such characters as escapes (`\u{1b}`) and cuts long text.
//!
//! Use it wherever a message or a table quotes foreign text:
//!
//! ```
//! use std::path::Path;
//! use trinocular_rig::printable::printable;
//!
//! assert_eq!(printable(Path::new("a\nb.png").display()), r"a\nb.png");
//! assert_eq!(printable("\u{1b}[2J"), r"\u{1b}[2J");
//! ```

use std::fmt::{self, Display, Write as _};

/// Longest foreign text that is quoted in full, characters.
pub const LONGEST: usize = 1_000;

/// Returns the text without control characters and at most [`LONGEST`] characters long.
///
/// Control characters, separators of lines and paragraphs and all format characters of Unicode,
/// such as those that change the direction of writing, become escapes as in Rust's string literals.
/// All other characters stay, backslashes too, so that a Windows path reads as usual; hence the
/// result is for people and cannot be converted back. A longer text is cut and ends with `...`.
pub fn printable(text: impl Display) -> String {
    printable_up_to(LONGEST, text)
}

/// Returns the text as [`printable`] does, at most `longest` characters long.
pub fn printable_up_to(longest: usize, text: impl Display) -> String {
    let mut kept = Kept {
        text: String::new(),
        left: longest,
    };
    // An error means that the text was cut, so formatting stops there.
    if write!(kept, "{text}").is_err() {
        kept.text.push_str("...");
    }
    kept.text
}

struct Kept {
    text: String,
    left: usize,
}

impl fmt::Write for Kept {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        for letter in part.chars() {
            self.left = self.left.checked_sub(1).ok_or(fmt::Error)?;
            if is_printable(letter) {
                self.text.push(letter);
            } else {
                self.text.extend(letter.escape_default());
            }
        }
        Ok(())
    }
}

/// Returns true if a character appears as a glyph or a blank, and changes nothing around it.
pub fn is_printable(letter: char) -> bool {
    let is_separator = matches!(letter, '\u{2028}' | '\u{2029}');
    !(letter.is_control() || is_separator || is_format(letter))
}

/// Returns true for the characters of Unicode's general category Cf (format), version 16, and the
/// code points that stand among them and are reserved.
fn is_format(letter: char) -> bool {
    matches!(
        letter,
        '\u{ad}'
            | '\u{600}'..='\u{605}'
            | '\u{61c}'
            | '\u{6dd}'
            | '\u{70f}'
            | '\u{890}'..='\u{891}'
            | '\u{8e2}'
            | '\u{180e}'
            | '\u{200b}'..='\u{200f}'
            | '\u{202a}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}'
            | '\u{feff}'
            | '\u{fff0}'..='\u{fffb}'
            | '\u{110bd}'
            | '\u{110cd}'
            | '\u{13430}'..='\u{1343f}'
            | '\u{1bca0}'..='\u{1bca3}'
            | '\u{1d173}'..='\u{1d17a}'
            | '\u{e0000}'..='\u{e0fff}'
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped() {
        for (foreign, shown) in [
            ("rig.toml", "rig.toml"),
            (r"C:\rigs\two words.toml", r"C:\rigs\two words.toml"),
            ("größe µ 目", "größe µ 目"),
            ("a\tb\r\nc\0", r"a\tb\r\nc\u{0}"),
            ("\u{1b}]0;title\u{7}", r"\u{1b}]0;title\u{7}"),
            ("\u{7f}\u{9b}2J", r"\u{7f}\u{9b}2J"),
            ("gnp.\u{202e}exe\u{2028}", r"gnp.\u{202e}exe\u{2028}"),
            (
                "\u{200b}\u{2029}\u{feff}\u{ad}",
                r"\u{200b}\u{2029}\u{feff}\u{ad}",
            ),
            ("\u{2069}\u{e0041}\u{fff9}", r"\u{2069}\u{e0041}\u{fff9}"),
        ] {
            assert_eq!(printable(foreign), shown);
        }
    }

    #[test]
    fn long_text_is_marked_as_cut() {
        let exact = "x".repeat(LONGEST);
        assert_eq!(printable(&exact), exact);
        let long = "x".repeat(100 * LONGEST);
        assert_eq!(printable(long), format!("{exact}..."));
        assert_eq!(printable_up_to(2, "\n\n\n"), r"\n\n...");
    }
}
