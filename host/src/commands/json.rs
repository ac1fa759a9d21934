//! Output of `--json`: one document per line, with the format's version and rounded numbers.
//!
//! `docs/json.md` has an example of every command's output.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::{Map, Number, Value, json};

use super::warnings;

/// Version of the format. Grows when a key is removed or changes its meaning; new keys may come at
/// any time.
pub const VERSION: u32 = 1;

/// Writes one object as one line, with its `version`, numbers rounded.
///
/// Keys whose name has `sigma` get three significant digits. All other numbers get six decimals
/// (nanometres for mm, microseconds for s), and those whose key states no unit at least three
/// significant digits. A number that is not finite becomes null. Warnings since the last object are
/// added to its `warnings`.
pub fn line(out: &mut impl Write, object: &impl Serialize) -> io::Result<()> {
    let mut value = rounded(serde_json::to_value(object)?);
    if let Value::Object(keys) = &mut value {
        keys.insert("version".to_owned(), VERSION.into());
    }
    writeln!(out, "{value}")
}

/// Returns an object with its numbers rounded as [`line`] does, and the warnings since the last one.
pub fn rounded(mut object: Value) -> Value {
    round(&mut object, Digits::SixDecimals);
    if let Value::Object(keys) = &mut object {
        add_warnings(keys, warnings::take());
    }
    object
}

/// Adds warnings before those that the object has.
fn add_warnings(keys: &mut Map<String, Value>, raised: Vec<String>) {
    if raised.is_empty() {
        return;
    }
    let list = keys.entry("warnings").or_insert_with(|| json!([]));
    if let Value::Array(list) = list {
        list.splice(..0, raised.into_iter().map(Value::from));
    }
}

/// Rounding of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Digits {
    SixDecimals,
    ThreeSignificant,
    /// Six decimals, or three significant digits if they are finer.
    Either,
}

/// Ends of keys with a unit that six decimals suffice for.
const UNITS: [&str; 8] = [
    "_mm", "_px", "_deg", "_ms", "_s", "_mm_s", "_mm_s2", "_percent",
];

impl Digits {
    /// Returns the rounding of the numbers under a key. Keys inside an object without a unit, such
    /// as `median` in `frame_set_ms`, keep the rounding of that object.
    fn of(key: &str, outer: Self) -> Self {
        if ["sigma", "deviation", "covariance"]
            .iter()
            .any(|word| key.contains(word))
        {
            Self::ThreeSignificant
        } else if UNITS.iter().any(|unit| key.ends_with(unit)) {
            Self::SixDecimals
        } else if outer == Self::ThreeSignificant {
            outer
        } else {
            Self::Either
        }
    }

    fn round(self, number: f64) -> f64 {
        let text = match self {
            Self::SixDecimals => format!("{number:.6}"),
            Self::Either if number.abs() >= 1e-3 || number == 0.0 => format!("{number:.6}"),
            Self::ThreeSignificant | Self::Either => format!("{number:.2e}"),
        };
        // Adding zero to what is left after rounding turns -0 into 0.
        text.parse().unwrap_or(number) + 0.0
    }
}

fn round(value: &mut Value, digits: Digits) {
    match value {
        Value::Number(number) if number.is_f64() => {
            let rounded = number.as_f64().map(|number| digits.round(number));
            if let Some(rounded) = rounded.and_then(Number::from_f64) {
                *number = rounded;
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| round(item, digits)),
        Value::Object(keys) => {
            for (key, item) in keys {
                round(item, Digits::of(key, digits));
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Arguments;
    use clap::CommandFactory as _;

    /// Commands whose output is a file or a page of its own kind, and those that run until they are
    /// ended: their results are those of the programs that connect to them.
    const WITHOUT: [&str; 6] = ["completions", "export", "init", "man", "serve", "twin"];

    #[track_caller]
    fn written(object: &Value) -> String {
        let mut out = Vec::new();
        line(&mut out, object).expect("a vector takes all");
        String::from_utf8(out).expect("UTF-8")
    }

    #[test]
    fn numbers_are_rounded_by_their_key() {
        let object = json!({
            "displacement_mm": [-1.9942369999999998, -1e-9], "sigma_mm": [0.000123456],
            "frames": 7, "frame_set_ms": {"median": 1.0 / 3.0}, "true": 8.1234e-14, "ratio": 1.5,
        });
        let expected = "{\"displacement_mm\":[-1.994237,0.0],\
             \"frame_set_ms\":{\"median\":0.333333},\"frames\":7,\"ratio\":1.5,\
             \"sigma_mm\":[0.000123],\"true\":8.12e-14,\"version\":1}\n";
        assert_eq!(written(&object), expected);
    }

    #[test]
    fn number_that_is_not_finite_is_null() {
        let text = written(&json!({ "x_mm": f64::NAN }));
        assert_eq!(text, "{\"version\":1,\"x_mm\":null}\n");
    }

    #[test]
    fn raised_warnings_come_before_own() {
        let with = |object: Value| {
            let Value::Object(mut keys) = object else {
                panic!("it is an object")
            };
            add_warnings(&mut keys, vec!["raised".to_owned()]);
            Value::Object(keys)
        };
        assert_eq!(with(json!({})), json!({"warnings": ["raised"]}));
        let own = json!({"warnings": ["own"]});
        assert_eq!(with(own), json!({"warnings": ["raised", "own"]}));
    }

    fn check(command: &clap::Command, path: &str) {
        let inner: Vec<_> = command.get_subcommands().collect();
        let has = command
            .get_arguments()
            .any(|a| a.get_long() == Some("json"));
        let is_exempt = WITHOUT.contains(&command.get_name());
        // The program itself runs the experiment.
        let runs = inner.is_empty() || path.is_empty();
        assert!(!runs || has != is_exempt, "`{path}`: --json");
        for each in inner.iter().filter(|each| each.get_name() != "help") {
            check(each, &format!("{path} {}", each.get_name()));
        }
    }

    #[test]
    fn every_command_with_results_has_json() {
        check(&Arguments::command(), "");
    }
}
