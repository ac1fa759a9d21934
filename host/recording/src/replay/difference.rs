//! Differences between a recording and its replay.

use std::fmt::Debug;

/// Longest value in a message, characters.
const LONGEST: usize = 200;

/// First difference of one kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Instant of the message on the recording's clock, µs.
    pub at_us: u64,
    /// The message: its kind and number.
    pub message: String,
    /// The field within the message.
    pub field: String,
    /// Value in the recording.
    pub recorded: String,
    /// Value in the replay.
    pub replayed: String,
}

/// Comparison of all messages of one kind.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Comparison {
    /// Number of messages that are the same.
    pub same: u64,
    /// Number of messages that differ. After the first difference of a station it is at least 1,
    /// because all later ones follow from it.
    pub different: u64,
    /// First difference.
    pub first: Option<Difference>,
}

impl Comparison {
    /// Counts a message that is the same or differs.
    pub fn count(&mut self, difference: Option<Difference>) {
        match difference {
            None => self.same += 1,
            Some(difference) => {
                self.different += 1;
                self.first.get_or_insert(difference);
            }
        }
    }
}

fn shortened(text: &str) -> String {
    text.trim()
        .trim_end_matches(',')
        .chars()
        .take(LONGEST)
        .collect()
}

/// Returns the first field in which two values differ, with both, by their debug format: its lines
/// name the fields, and their indent the nesting.
pub fn first_field(a: &impl Debug, b: &impl Debug) -> Option<(String, String, String)> {
    let (a, b) = (format!("{a:#?}"), format!("{b:#?}"));
    let (mut a, mut b) = (a.lines(), b.lines());
    // Names by nesting.
    let mut path: Vec<&str> = Vec::new();
    loop {
        let (left, right) = (a.next(), b.next());
        let line = left.or(right)?;
        let depth = (line.len() - line.trim_start().len()) / 4;
        path.truncate(depth);
        let name = line.trim_start().split([':', ' ', '(']).next();
        path.resize(depth, "");
        path.push(name.unwrap_or_default());
        if left != right {
            let names: Vec<&str> = path
                .iter()
                .copied()
                .filter(|name| !name.is_empty())
                .collect();
            let value = |line: Option<&str>| line.map_or("nothing".to_owned(), shortened);
            return Some((names.join("."), value(left), value(right)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    #[allow(dead_code)] // read by its debug format
    struct Outer {
        name: u8,
        inner: Option<Inner>,
    }

    #[derive(Debug)]
    #[allow(dead_code)] // read by its debug format
    struct Inner {
        x: i32,
        y: i32,
    }

    #[test]
    fn nested_field_is_named() {
        let outer = |y| Outer {
            name: 1,
            inner: Some(Inner { x: 2, y }),
        };
        assert_eq!(first_field(&outer(1), &outer(1)), None);
        let (field, a, b) = first_field(&outer(1), &outer(2)).expect("they differ");
        assert_eq!(field, "Outer.inner.Inner.y");
        assert_eq!((a.as_str(), b.as_str()), ("y: 1", "y: 2"));
        let none = Outer {
            name: 1,
            inner: None,
        };
        let (field, ..) = first_field(&outer(1), &none).expect("they differ");
        assert_eq!(field, "Outer.inner");
    }
}
