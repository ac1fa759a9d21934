//! Values of `init`, as options and as answers to its questions.

use std::str::FromStr;

use trinocular_rig::choice::unknown;

/// Error of a value that could not be read; holds the expected form.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {0}")]
pub struct Expected(pub &'static str);

/// Error of a word that is none of the known ones.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", unknown(self.kind, &self.given, self.known))]
pub struct UnknownWord {
    /// Kind of thing that the word names.
    pub kind: &'static str,
    /// The word.
    pub given: String,
    /// The known words.
    pub known: &'static [&'static str],
}

/// Names of cameras, from left to right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names(pub Vec<String>);

/// Columns and rows, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Image(pub [u32; 2]);

/// A positive number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number(pub f64);

/// Positive numbers of X, Y and Z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerAxis(pub [f64; 3]);

/// Least and greatest position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Travel(pub [f64; 2]);

impl FromStr for Names {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Expected> {
        let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
        let is_folder = |name: &String| {
            !name.is_empty() && !name.starts_with('.') && !name.contains(['/', '\\', '\0'])
        };
        match names.len() {
            2..=8 if names.iter().all(is_folder) => Ok(Self(names)),
            _ => Err(Expected(
                "2 to 8 names of folders such as left,middle,right",
            )),
        }
    }
}

impl FromStr for Image {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Expected> {
        let expected = Expected("columns x rows such as 640x480, each 8 to 65535");
        let (columns, rows) = text.split_once(['x', 'X', '×']).ok_or(expected)?;
        let side = |text: &str| match text.trim().parse() {
            Ok(side @ 8..=65_535) => Ok(side),
            _ => Err(expected),
        };
        Ok(Self([side(columns)?, side(rows)?]))
    }
}

/// Parses the numbers between commas, all finite.
fn numbers(text: &str, expected: Expected) -> Result<Vec<f64>, Expected> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|n| n.is_finite());
    text.split(',')
        .map(|part| number(part).ok_or(expected))
        .collect()
}

impl FromStr for Number {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Expected> {
        let expected = Expected("a number greater than 0, with a decimal point");
        match numbers(text, expected)?[..] {
            [number] if number > 0.0 => Ok(Self(number)),
            _ => Err(expected),
        }
    }
}

impl FromStr for PerAxis {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Expected> {
        let expected = Expected("one number greater than 0, or three such as 80,80,400");
        let axes = match numbers(text, expected)?[..] {
            [all] => [all; 3],
            [x, y, z] => [x, y, z],
            _ => return Err(expected),
        };
        match axes.iter().all(|axis| *axis > 0.0) {
            true => Ok(Self(axes)),
            false => Err(expected),
        }
    }
}

impl FromStr for Travel {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Expected> {
        let expected = Expected("least and greatest position such as -60,60");
        match numbers(text, expected)?[..] {
            [low, high] if low < high => Ok(Self([low, high])),
            _ => Err(expected),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_as_documented() {
        assert_eq!("80".parse(), Ok(PerAxis([80.0; 3])));
        assert_eq!("80, 80,400".parse(), Ok(PerAxis([80.0, 80.0, 400.0])));
        assert_eq!("-60,60".parse(), Ok(Travel([-60.0, 60.0])));
        assert_eq!("640x480".parse(), Ok(Image([640, 480])));
        assert_eq!("1.5".parse(), Ok(Number(1.5)));
    }

    #[test]
    fn other_values_are_refused() {
        for text in ["", "0", "-1", "1,2", "inf", "nan", "1;2;3", "80mm"] {
            assert!(text.parse::<PerAxis>().is_err(), "{text}");
        }
        for text in ["60,-60", "5,5", "1", "", "1,2,3"] {
            assert!(text.parse::<Travel>().is_err(), "{text}");
        }
        for text in [
            "640",
            "640x",
            "x480",
            "-1x480",
            "1e3x480",
            "0x0",
            "99999x480",
        ] {
            assert!(text.parse::<Image>().is_err(), "{text}");
        }
        for text in ["one", "a/b,c", "a,", "..,b"] {
            assert!(text.parse::<Names>().is_err(), "{text}");
        }
    }
}
