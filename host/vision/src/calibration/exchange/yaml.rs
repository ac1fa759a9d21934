//! YAML documents whose values keep their own name and line.
//!
//! OpenCV begins its files with `%YAML:1.0`, which is not a directive of any YAML; without this
//! line they are ordinary YAML with the tag `!!opencv-matrix`. Anchors and aliases, which neither
//! program writes, are refused.
//!
//! Only the values under known names are kept, because files of other programs may hold all corners
//! of all images. Time and memory are proportional to the length of the file.
//!
//! The parser's events are read here rather than by a loader: saphyr's keeps the whole file,
//! expands aliases and nests without a limit; serde-saphyr's errors have a line, but not the name
//! of a value such as `camera_matrix.data[4]`.

use std::borrow::Cow;
use std::collections::HashSet;
use std::ops::RangeInclusive;
use std::path::Path;

use saphyr_parser::{Event, Parser, ScanError, Span};

use trinocular_rig::error::InputError;
use trinocular_rig::printable::printable_up_to;

/// Largest depth of nesting; camera files need less.
const DEEPEST: usize = 16;
/// Largest number of values in a list or a mapping that is kept.
const MOST_VALUES: usize = 1_000;
/// Largest number of characters of a value that a message quotes.
const QUOTED: usize = 60;

/// Names, each with another spelling: OpenCV 2.4's, and those of a printed `camera_info` message.
/// That message's `R` is not here, because OpenCV's files have another `R`.
pub(super) const ALIASES: [(&str, &str); 13] = [
    ("image_width", "image_Width"),
    ("image_height", "image_Height"),
    ("camera_matrix", "Camera_Matrix"),
    ("distortion_coefficients", "Distortion_Coefficients"),
    ("image_width", "width"),
    ("image_height", "height"),
    ("camera_matrix", "K"),
    ("distortion_coefficients", "D"),
    ("projection_matrix", "P"),
    // ROS 2.
    ("camera_matrix", "k"),
    ("distortion_coefficients", "d"),
    ("rectification_matrix", "r"),
    ("projection_matrix", "p"),
];

/// Returns true for a name that is one of the `known`, or another spelling.
pub(super) fn is_known(known: &[&str], name: &str) -> bool {
    known.contains(&name) || ALIASES.iter().any(|(_, other)| *other == name)
}

/// First document of a file.
pub(super) struct Document<'a> {
    file: &'a Path,
    root: Tree<'a>,
}

/// Value of a document that is not YAML.
pub(super) enum Entry<'a> {
    /// Single value.
    Scalar(&'a str),
    /// Matrix, with the line of each element.
    Matrix {
        /// Number of rows.
        rows: &'a str,
        /// Number of columns.
        cols: &'a str,
        /// Elements, row by row.
        data: Vec<(usize, &'a str)>,
    },
    /// List of numbers, with the line of each.
    List(Vec<(usize, &'a str)>),
}

/// Value with its place.
struct Tree<'a> {
    line: usize,
    value: Value<'a>,
}

enum Value<'a> {
    Scalar(Cow<'a, str>),
    List(Vec<Tree<'a>>),
    Map(Vec<(Cow<'a, str>, Tree<'a>)>),
    /// Value whose name is not known.
    Dropped,
}

/// Value with its file, name and place.
#[derive(Clone)]
pub(super) struct Node<'a> {
    file: &'a Path,
    path: String,
    tree: &'a Tree<'a>,
}

/// Line of a value, and its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Line, counted from 1.
    pub line: usize,
    /// Name, such as `projection_matrix`.
    pub field: String,
}

impl<'a> Document<'a> {
    /// Reads the file's first document and keeps the values under `known` names.
    pub fn parse(file: &'a Path, text: &'a str, known: &[&str]) -> Result<Self, InputError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        // The rest of the line is empty or a comment, so lines keep their numbers.
        let text = text.strip_prefix("%YAML:1.0").unwrap_or(text);
        let mut reader = Reader {
            file,
            known,
            parser: Parser::new_from_str(text),
        };
        loop {
            match reader.next()? {
                (Event::StreamStart | Event::DocumentStart(_), _) => {}
                (Event::StreamEnd | Event::DocumentEnd, _) => {
                    return Err(InputError::file(file, "the file is empty"));
                }
                (event, line) => {
                    let root = reader.tree(event, line, &Way::Root)?;
                    return Ok(Self { file, root });
                }
            }
        }
    }

    /// Makes a document of names with values, each with its line.
    pub fn of_entries(file: &'a Path, entries: Vec<(&'a str, usize, Entry<'a>)>) -> Self {
        let scalar = |line: usize, text: &'a str| Tree {
            line,
            value: Value::Scalar(Cow::Borrowed(text)),
        };
        let tree = |line: usize, entry: Entry<'a>| match entry {
            Entry::Scalar(text) => scalar(line, text),
            Entry::Matrix { rows, cols, data } => {
                let data = data.into_iter().map(|(line, text)| scalar(line, text));
                let list = Tree {
                    line,
                    value: Value::List(data.collect()),
                };
                let value = Value::Map(vec![
                    (Cow::Borrowed("rows"), scalar(line, rows)),
                    (Cow::Borrowed("cols"), scalar(line, cols)),
                    (Cow::Borrowed("data"), list),
                ]);
                Tree { line, value }
            }
            Entry::List(data) => {
                let data = data.into_iter().map(|(line, text)| scalar(line, text));
                let value = Value::List(data.collect());
                Tree { line, value }
            }
        };
        let entries = entries.into_iter();
        let entries = entries.map(|(name, line, entry)| (Cow::Borrowed(name), tree(line, entry)));
        let root = Tree {
            line: 1,
            value: Value::Map(entries.collect()),
        };
        Self { file, root }
    }

    /// Returns the root of the document.
    pub fn root(&self) -> Node<'_> {
        Node {
            file: self.file,
            path: String::new(),
            tree: &self.root,
        }
    }
}

impl<'a> Node<'a> {
    /// Returns the place of the value in the file.
    pub fn place(&self) -> Place {
        Place {
            line: self.tree.line,
            field: self.path.clone(),
        }
    }

    /// Creates an error that names this value.
    pub fn fault(&self, reason: impl Into<String>) -> InputError {
        match self.path.as_str() {
            "" => InputError::line(self.file, self.tree.line, reason),
            path => InputError::field(self.file, self.tree.line, path, reason),
        }
    }

    /// Returns the value under `key`, if there is one.
    pub fn optional(&self, key: &str) -> Result<Option<Self>, InputError> {
        let Value::Map(entries) = &self.tree.value else {
            return Err(self.fault("expected names with values"));
        };
        let is_alias = |name: &str| ALIASES.contains(&(key, name));
        let entry = (entries.iter().find(|(name, _)| name == key))
            .or_else(|| entries.iter().find(|(name, _)| is_alias(name)));
        Ok(entry.map(|(name, tree)| self.child(join(&self.path, name), tree)))
    }

    /// Returns the value under `key`; an error if it is missing.
    pub fn required(&self, key: &str) -> Result<Self, InputError> {
        self.optional(key)?.ok_or_else(|| {
            let (path, line) = (join(&self.path, key), self.tree.line);
            InputError::field(self.file, line, path, "missing; it has no default")
        })
    }

    /// Returns true if the value is a list.
    pub fn is_list(&self) -> bool {
        matches!(self.tree.value, Value::List(_))
    }

    /// Returns the elements of a list.
    pub fn elements(&self) -> Result<Vec<Self>, InputError> {
        let Value::List(list) = &self.tree.value else {
            return Err(self.fault("expected a list"));
        };
        let child = |(i, tree)| self.child(format!("{}[{i}]", self.path), tree);
        Ok(list.iter().enumerate().map(child).collect())
    }

    fn child(&self, path: String, tree: &'a Tree<'a>) -> Self {
        Self {
            file: self.file,
            path,
            tree,
        }
    }

    /// Returns a text without line breaks.
    pub fn text(&self) -> Result<&'a str, InputError> {
        match &self.tree.value {
            Value::Scalar(text) => Ok(text),
            _ => Err(self.fault("expected a single value")),
        }
    }

    /// Returns a finite number. OpenCV writes `1.` for 1.
    pub fn number(&self) -> Result<f64, InputError> {
        let text = self.text()?;
        match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(self.fault(format!("`{}` is not a finite number", quoted(text)))),
        }
    }

    /// Returns an integer within `range`.
    pub fn whole(&self, range: RangeInclusive<u32>) -> Result<u32, InputError> {
        let text = self.text()?;
        text.parse()
            .ok()
            .filter(|number| range.contains(number))
            .ok_or_else(|| {
                let (low, high, text) = (range.start(), range.end(), quoted(text));
                self.fault(format!(
                    "`{text}` is not a whole number from {low} to {high}"
                ))
            })
    }
}

/// Formats a value of the file for a message.
pub(super) fn quoted(text: &str) -> String {
    printable_up_to(QUOTED, text)
}

struct Reader<'a, 'k> {
    file: &'a Path,
    known: &'k [&'k str],
    parser: Parser<'a, saphyr_parser::StrInput<'a>>,
}

/// Path of names and numbers from the root to a value.
enum Way<'w> {
    Root,
    Name(&'w Way<'w>, &'w str),
    Number(&'w Way<'w>, usize),
}

impl Way<'_> {
    fn depth(&self) -> usize {
        match self {
            Self::Root => 0,
            Self::Name(above, _) | Self::Number(above, _) => above.depth() + 1,
        }
    }

    /// Returns the value's name, as in messages.
    fn path(&self) -> String {
        match self {
            Self::Root => String::new(),
            Self::Name(above, name) => join(&above.path(), name),
            Self::Number(above, number) => format!("{}[{number}]", above.path()),
        }
    }

    /// Returns true if the value is one of the `known`, or within one.
    fn is_kept(&self, known: &[&str]) -> bool {
        match self {
            Self::Root => true,
            Self::Name(Self::Root, name) => is_known(known, name),
            Self::Name(above, _) | Self::Number(above, _) => above.is_kept(known),
        }
    }
}

impl<'a> Reader<'a, '_> {
    fn next(&mut self) -> Result<(Event<'a>, usize), InputError> {
        let file = self.file;
        let fault = |error: ScanError| {
            let reason = format!("not valid YAML: {}", error.info());
            InputError::line(file, error.marker().line(), reason)
        };
        let place = |(event, span): (Event<'a>, Span)| (event, span.start.line());
        match self.parser.next_event() {
            Some(event) => event.map(place).map_err(fault),
            None => Err(InputError::file(file, "not valid YAML: it ends too early")),
        }
    }

    /// Builds the value that begins with `event`, at the end of `way`.
    fn tree(
        &mut self,
        event: Event<'a>,
        line: usize,
        way: &Way<'_>,
    ) -> Result<Tree<'a>, InputError> {
        let refuse = |reason: &str| Err(InputError::line(self.file, line, reason));
        if way.depth() > DEEPEST {
            return refuse("nested too deeply");
        }
        let is_kept = way.is_kept(self.known);
        let value = match event {
            Event::Scalar(text, ..) => Value::Scalar(text),
            Event::SequenceStart(..) => self.list(way, is_kept)?,
            Event::MappingStart(..) => self.map(way, is_kept)?,
            Event::Alias(_) => return refuse("aliases are not for this file"),
            _ => return refuse("expected a value"),
        };
        let value = if is_kept { value } else { Value::Dropped };
        Ok(Tree { line, value })
    }

    fn list(&mut self, way: &Way<'_>, is_kept: bool) -> Result<Value<'a>, InputError> {
        let mut list = Vec::new();
        for index in 0.. {
            let (event, line) = self.next()?;
            if event == Event::SequenceEnd {
                break;
            }
            let element = self.tree(event, line, &Way::Number(way, index))?;
            if is_kept {
                self.check_count(list.len(), line, way)?;
                list.push(element);
            }
        }
        Ok(Value::List(list))
    }

    fn map(&mut self, way: &Way<'_>, is_kept: bool) -> Result<Value<'a>, InputError> {
        let mut names: HashSet<Cow<'a, str>> = HashSet::new();
        let mut map = Vec::new();
        loop {
            let (event, line) = self.next()?;
            let name = match event {
                Event::MappingEnd => break Ok(Value::Map(map)),
                Event::Scalar(text, ..) => text,
                _ => {
                    let reason = "expected a name before the colon";
                    return Err(InputError::line(self.file, line, reason));
                }
            };
            let own = Way::Name(way, &name);
            if names.contains(&name) {
                return Err(InputError::field(
                    self.file,
                    line,
                    own.path(),
                    "given twice",
                ));
            }
            let (event, value_line) = self.next()?;
            let value = self.tree(event, value_line, &own)?;
            if is_kept && own.is_kept(self.known) {
                self.check_count(map.len(), line, way)?;
                map.push((name.clone(), value));
            }
            names.insert(name);
        }
    }

    fn check_count(&self, count: usize, line: usize, way: &Way<'_>) -> Result<(), InputError> {
        if count < MOST_VALUES {
            return Ok(());
        }
        let reason = format!("more than {MOST_VALUES} values");
        Err(InputError::field(self.file, line, way.path(), reason))
    }
}

fn join(path: &str, key: &str) -> String {
    match path {
        "" => key.to_owned(),
        path => format!("{path}.{key}"),
    }
}
