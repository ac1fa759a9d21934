//! A value of a TOML file that knows its name and line, so that errors can state both:
//! ``rig.toml:7: field `camera[1].focal_px[0]`: ...``.

use std::ops::Range;
use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::choice;
use crate::error::InputError;

/// Name and text of the file.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// Path of the file.
    pub file: &'a Path,
    /// Text of the file.
    pub text: &'a str,
}

impl Source<'_> {
    /// Returns the line of a byte offset, counted from 1.
    pub fn line(&self, offset: usize) -> usize {
        let before = self.text.as_bytes().get(..offset);
        let before = before.unwrap_or(self.text.as_bytes());
        1 + before.iter().filter(|&&byte| byte == b'\n').count()
    }

    /// Returns the parser's error, with the key of the line at fault.
    pub fn syntax(&self, error: &toml::de::Error) -> InputError {
        if let Some(reason) = other_format(self.text) {
            return InputError::file(self.file, reason);
        }
        let mut reason = format!("not valid TOML: {}", error.message().replace('\n', ", "));
        let Some(span) = error.span() else {
            return InputError::file(self.file, reason);
        };
        // The parser reports an unfinished value at the end of the text, maybe past its line.
        let line = self.line(span.start);
        let text = self.text.lines().nth(line - 1).unwrap_or_default();
        if decimal_commas(text) > 0 {
            reason.push_str(DECIMAL_COMMAS);
        }
        match text.split_once('=') {
            Some((key, _)) if !key.trim().is_empty() => {
                InputError::field(self.file, line, key.trim(), reason)
            }
            _ => InputError::line(self.file, line, reason),
        }
    }
}

/// Names the format of a text that is not TOML, with the way out.
fn other_format(text: &str) -> Option<&'static str> {
    let mut lines = text.lines().map(str::trim_start);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with('#'))?;
    let is_yaml = |line: &str| {
        let key = line.split_once(':').map(|(key, _)| key);
        key.is_some_and(|key| key.chars().all(|c| c.is_alphanumeric() || c == '_'))
    };
    if first.starts_with('{') {
        Some("is JSON, but a rig file is TOML; `trinocular init` writes one")
    } else if first.starts_with("<?xml") {
        Some("is XML, but a rig file is TOML; `trinocular init` writes one")
    } else if first.starts_with("%YAML") || first.starts_with("---") || is_yaml(first) {
        Some(
            "is YAML, but a rig file is TOML; `trinocular convert` makes one from the YAML of \
             OpenCV and ROS",
        )
    } else {
        None
    }
}

/// Hint at numbers with decimal commas.
const DECIMAL_COMMAS: &str = " (decimal commas? write 5.5, not 5,5)";

/// Counts the commas directly between two digits, as in `5,5`.
fn decimal_commas(text: &str) -> usize {
    let value = text.split_once('=').map_or(text, |(_, value)| value);
    let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
    let bytes = value.as_bytes();
    let commas = value.match_indices(',').map(|(at, _)| at);
    commas
        .filter(|&at| is_digit(bytes.get(at.wrapping_sub(1))) && is_digit(bytes.get(at + 1)))
        .count()
}

/// One value: its path from the root of the file, its place, its content.
pub struct Field<'a> {
    source: Source<'a>,
    path: String,
    span: Range<usize>,
    value: &'a DeValue<'a>,
}

impl<'a> Field<'a> {
    /// Returns the whole document.
    pub fn root(source: Source<'a>, value: &'a DeValue<'a>) -> Self {
        Self {
            source,
            path: String::new(),
            span: 0..0,
            value,
        }
    }

    /// Returns an error at this value.
    pub fn fault(&self, reason: impl Into<String>) -> InputError {
        let line = self.source.line(self.span.start);
        if self.path.is_empty() {
            InputError::line(self.source.file, line, reason)
        } else {
            InputError::field(self.source.file, line, &self.path, reason)
        }
    }

    /// Returns an error at this table, of the value that is missing under `key`.
    pub fn fault_under(&self, key: &str, reason: impl Into<String>) -> InputError {
        let line = self.source.line(self.span.start);
        InputError::field(self.source.file, line, self.key_path(key), reason)
    }

    fn wrong_kind(&self, expected: &str) -> InputError {
        self.fault(format!(
            "expected {expected}, found {}",
            self.value.type_str()
        ))
    }

    fn key_path(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    fn table(&self) -> Result<&'a DeTable<'a>, InputError> {
        match self.value {
            DeValue::Table(table) => Ok(table),
            _ => Err(self.wrong_kind("a table")),
        }
    }

    /// Refuses every key that is not in `known`.
    pub fn only(&self, known: &[&str]) -> Result<(), InputError> {
        let unknown = self
            .table()?
            .keys()
            .filter(|key| !known.contains(&key.get_ref().as_ref()))
            // Name the first unknown key of the file, for any order of the parser.
            .min_by_key(|key| key.span().start);
        match unknown {
            None => Ok(()),
            Some(key) => {
                let hint = choice::hint(key.get_ref(), known);
                Err(InputError::field(
                    self.source.file,
                    self.source.line(key.span().start),
                    self.key_path(key.get_ref()),
                    format!("unknown field{hint}; known here: {}", known.join(", ")),
                ))
            }
        }
    }

    /// Returns the error of a word that is none of those `known` for a `kind` of thing.
    pub fn unknown(&self, kind: &str, known: &[&str]) -> InputError {
        match self.text() {
            Ok(given) => self.fault(choice::unknown(kind, given, known)),
            Err(error) => error,
        }
    }

    /// Returns the value under `key`, if it exists.
    pub fn optional(&self, key: &str) -> Result<Option<Field<'a>>, InputError> {
        let entry = self.table()?.get(key);
        Ok(entry.map(|value| self.child(self.key_path(key), value)))
    }

    /// Refuses a table that lacks fields, given as keys and example lines, and names all of them.
    pub fn require(&self, fields: &[(&str, &str)]) -> Result<(), InputError> {
        let table = self.table()?;
        let missing: Vec<_> = fields
            .iter()
            .filter(|(key, _)| table.get(*key).is_none())
            .collect();
        let line = self.source.line(self.span.start);
        match missing[..] {
            [] => Ok(()),
            [(key, example)] => Err(InputError::field(
                self.source.file,
                line,
                self.key_path(key),
                format!("missing; for example `{example}`"),
            )),
            _ => {
                let examples = missing.iter().map(|(_, example)| format!("`{example}`"));
                let examples = examples.collect::<Vec<_>>().join(", ");
                Err(self.fault(format!(
                    "{} fields are missing; for example {examples} (`trinocular init` writes a \
                     whole rig file)",
                    missing.len()
                )))
            }
        }
    }

    /// Returns the value under `key`, or an error.
    pub fn required(&self, key: &str) -> Result<Field<'a>, InputError> {
        self.optional(key)?.ok_or_else(|| {
            let line = self.source.line(self.span.start);
            InputError::field(
                self.source.file,
                line,
                self.key_path(key),
                "missing; it has no default",
            )
        })
    }

    fn child(&self, path: String, value: &'a Spanned<DeValue<'a>>) -> Field<'a> {
        Field {
            source: self.source,
            path,
            span: value.span(),
            value: value.get_ref(),
        }
    }

    /// Returns the elements of an array.
    pub fn elements(&self) -> Result<Vec<Field<'a>>, InputError> {
        let DeValue::Array(array) = self.value else {
            return Err(self.wrong_kind("an array"));
        };
        let numbered = array.iter().enumerate();
        Ok(numbered
            .map(|(i, value)| self.child(format!("{}[{i}]", self.path), value))
            .collect())
    }

    /// Returns the elements of an array that must have exactly `N`.
    pub fn fields<const N: usize>(&self) -> Result<[Field<'a>; N], InputError> {
        self.elements()?
            .try_into()
            .map_err(|elements: Vec<Field<'a>>| {
                let count = elements.len();
                let line = self.source.text.get(self.span.clone()).unwrap_or_default();
                // Each decimal comma makes two elements of one number. Where numbers are not set
                // apart in any other way, all of them must have one.
                let commas = decimal_commas(line);
                let is_plain = commas + 1 == count;
                let is_split = count > N && count - N <= commas && (!is_plain || count == 2 * N);
                let hint = if is_split { DECIMAL_COMMAS } else { "" };
                self.fault(format!("expected {N} elements, found {count}{hint}"))
            })
    }

    /// Returns the elements of an array that must have exactly `N`, each read by `read`.
    pub fn each<const N: usize, T: Copy + Default>(
        &self,
        read: impl Fn(&Field<'a>) -> Result<T, InputError>,
    ) -> Result<[T; N], InputError> {
        let elements: [Field<'a>; N] = self.fields()?;
        let mut values = [T::default(); N];
        for (value, element) in values.iter_mut().zip(&elements) {
            *value = read(element)?;
        }
        Ok(values)
    }

    /// Reads a finite number of at most `limit` in magnitude, whole or not.
    pub fn number(&self, limit: f64) -> Result<f64, InputError> {
        let value: f64 = match self.value {
            DeValue::Float(float) => float.as_str().parse().unwrap_or(f64::NAN),
            // Whole numbers of rig files need at most f64's 53 bits.
            DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
                .map_or(f64::INFINITY, |whole| whole as f64),
            _ => return Err(self.wrong_kind("a number")),
        };
        if !value.is_finite() {
            return Err(self.fault("must be a finite number"));
        }
        if value.abs() > limit {
            return Err(self.fault(format!("{value} is out of range (at most {limit} in size)")));
        }
        Ok(value)
    }

    /// Reads a number greater than 0 and at most `limit`.
    pub fn positive(&self, limit: f64) -> Result<f64, InputError> {
        let value = self.number(limit)?;
        if value > 0.0 {
            Ok(value)
        } else {
            Err(self.fault(format!("{value} must be greater than 0")))
        }
    }

    /// Reads a whole number within `range`; `80.0` is one.
    pub fn whole(&self, range: std::ops::RangeInclusive<u32>) -> Result<u32, InputError> {
        let (text, number) = match self.value {
            DeValue::Integer(integer) => {
                let number = u32::from_str_radix(integer.as_str(), integer.radix());
                (integer.to_string(), number.ok())
            }
            DeValue::Float(float) => {
                let number: Option<f64> = float.as_str().parse().ok();
                let Some(number) = number.filter(|number| number.fract() == 0.0) else {
                    return Err(self.fault(format!("{float} is no whole number")));
                };
                let fits = (0.0..=f64::from(u32::MAX)).contains(&number);
                (float.to_string(), fits.then_some(number as u32))
            }
            _ => return Err(self.wrong_kind("a whole number")),
        };
        number.filter(|whole| range.contains(whole)).ok_or_else(|| {
            let (low, high) = (range.start(), range.end());
            self.fault(format!("{text} is out of range ({low} to {high})"))
        })
    }

    /// Reads a text.
    pub fn text(&self) -> Result<&'a str, InputError> {
        match self.value {
            DeValue::String(text) => Ok(text),
            _ => Err(self.wrong_kind("a text in quotes")),
        }
    }

    /// Reads `true` or `false`.
    pub fn flag(&self) -> Result<bool, InputError> {
        match self.value {
            DeValue::Boolean(flag) => Ok(*flag),
            _ => Err(self.wrong_kind("true or false")),
        }
    }
}
