//! A YAML document whose values know their own name and line.
//!
//! OpenCV begins its files with `%YAML:1.0`, which is no directive of any YAML; without this line they are ordinary YAML with the
//! tag `!!opencv-matrix`. Anchors and aliases, which neither program writes, are refused.

use std::ops::RangeInclusive;
use std::path::Path;

use saphyr_parser::{Event, Parser, ScanError, Span};

use crate::error::InputError;

/// Deeper nesting than this belongs to no camera.
const DEEPEST: usize = 16;

/// One value with its place.
pub(super) struct Node<'a> {
    file: &'a Path,
    path: String,
    line: usize,
    value: Value<'a>,
}

enum Value<'a> {
    Scalar(String),
    List(Vec<Node<'a>>),
    Map(Vec<(String, Node<'a>)>),
}

impl<'a> Node<'a> {
    /// Reads the file's first document.
    pub fn parse(file: &'a Path, text: &str) -> Result<Self, InputError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        // What is left of the line is empty or a comment, so lines keep their numbers.
        let text = text.strip_prefix("%YAML:1.0").unwrap_or(text);
        let mut reader = Reader {
            file,
            parser: Parser::new_from_str(text),
        };
        loop {
            match reader.next()? {
                (Event::StreamStart | Event::DocumentStart(_), _) => {}
                (Event::StreamEnd | Event::DocumentEnd, _) => {
                    return Err(InputError::file(file, "the file is empty"));
                }
                (event, line) => return reader.node(event, line, String::new(), 0),
            }
        }
    }

    /// Something is wrong with this value.
    pub fn fault(&self, reason: impl Into<String>) -> InputError {
        match self.path.as_str() {
            "" => InputError::line(self.file, self.line, reason),
            path => InputError::field(self.file, self.line, path, reason),
        }
    }

    /// The value under `key`, if there is one.
    pub fn optional(&self, key: &str) -> Result<Option<&Node<'a>>, InputError> {
        match &self.value {
            Value::Map(entries) => Ok(entries
                .iter()
                .find(|(name, _)| name == key)
                .map(|(_, node)| node)),
            _ => Err(self.fault("expected names with values")),
        }
    }

    /// The value under `key`.
    pub fn required(&self, key: &str) -> Result<&Node<'a>, InputError> {
        self.optional(key)?.ok_or_else(|| {
            let path = join(&self.path, key);
            InputError::field(self.file, self.line, path, "missing; it has no default")
        })
    }

    /// The elements of a list.
    pub fn elements(&self) -> Result<&[Node<'a>], InputError> {
        match &self.value {
            Value::List(list) => Ok(list),
            _ => Err(self.fault("expected a list")),
        }
    }

    /// A text without line breaks.
    pub fn text(&self) -> Result<&str, InputError> {
        match &self.value {
            Value::Scalar(text) => Ok(text),
            _ => Err(self.fault("expected a single value")),
        }
    }

    /// A finite number. OpenCV writes `1.` for 1.
    pub fn number(&self) -> Result<f64, InputError> {
        let text = self.text()?;
        match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(self.fault(format!("`{}` is not a finite number", text.escape_debug()))),
        }
    }

    /// A whole number within `range`.
    pub fn whole(&self, range: RangeInclusive<u32>) -> Result<u32, InputError> {
        let text = self.text()?;
        text.parse()
            .ok()
            .filter(|number| range.contains(number))
            .ok_or_else(|| {
                let (low, high) = (range.start(), range.end());
                let text = text.escape_debug();
                self.fault(format!(
                    "`{text}` is not a whole number from {low} to {high}"
                ))
            })
    }
}

struct Reader<'a, 't> {
    file: &'a Path,
    parser: Parser<'t, saphyr_parser::StrInput<'t>>,
}

impl<'a, 't> Reader<'a, 't> {
    fn next(&mut self) -> Result<(Event<'t>, usize), InputError> {
        let file = self.file;
        let fault = |error: ScanError| {
            let reason = format!("not valid YAML: {}", error.info());
            InputError::line(file, error.marker().line(), reason)
        };
        let place = |(event, span): (Event<'t>, Span)| (event, span.start.line());
        match self.parser.next_event() {
            Some(event) => event.map(place).map_err(fault),
            None => Err(InputError::file(file, "not valid YAML: it ends too early")),
        }
    }

    fn node(
        &mut self,
        event: Event<'t>,
        line: usize,
        path: String,
        depth: usize,
    ) -> Result<Node<'a>, InputError> {
        let refuse = |reason: &str| Err(InputError::line(self.file, line, reason));
        if depth > DEEPEST {
            return refuse("nested too deeply");
        }
        let value = match event {
            Event::Scalar(text, ..) => Value::Scalar(text.into_owned()),
            Event::SequenceStart(..) => {
                let mut list = Vec::new();
                loop {
                    let (event, line) = self.next()?;
                    if event == Event::SequenceEnd {
                        break Value::List(list);
                    }
                    let path = format!("{path}[{}]", list.len());
                    list.push(self.node(event, line, path, depth + 1)?);
                }
            }
            Event::MappingStart(..) => {
                let mut map: Vec<(String, Node<'a>)> = Vec::new();
                loop {
                    let (event, line) = self.next()?;
                    let key = match event {
                        Event::MappingEnd => break Value::Map(map),
                        Event::Scalar(text, ..) => text.into_owned(),
                        _ => {
                            let reason = "expected a name before the colon";
                            return Err(InputError::line(self.file, line, reason));
                        }
                    };
                    let path = join(&path, &key);
                    if map.iter().any(|(known, _)| *known == key) {
                        return Err(InputError::field(self.file, line, path, "given twice"));
                    }
                    let (event, line) = self.next()?;
                    map.push((key, self.node(event, line, path, depth + 1)?));
                }
            }
            Event::Alias(_) => return refuse("aliases are not for this file"),
            _ => return refuse("expected a value"),
        };
        Ok(Node {
            file: self.file,
            path,
            line,
            value,
        })
    }
}

fn join(path: &str, key: &str) -> String {
    match path {
        "" => key.to_owned(),
        path => format!("{path}.{key}"),
    }
}
