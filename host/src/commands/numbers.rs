//! Errors of options that take numbers, in the words of this program: the parsers of the standard
//! library say "invalid digit found in string", and a negative number is "unexpected".

use std::error::Error as _;
use std::num::{ParseFloatError, ParseIntError};

use clap::error::{ContextKind, Error, ErrorKind};
use clap::{Arg, Command};

/// Returns the command, and those below it, with options that take a negative number as their
/// value, so that it is refused with the range of the option.
pub fn with_negative_numbers(command: Command) -> Command {
    let takes = |arg: &Arg| arg.get_long().is_some() && arg.get_action().takes_values();
    let command = command.mut_args(|arg| match takes(&arg) {
        true => arg.allow_negative_numbers(true),
        false => arg,
    });
    command.mut_subcommands(with_negative_numbers)
}

/// Returns the error with a reason that states the form of the number, if it is one of a number.
pub fn explained(error: Error) -> Error {
    match reason(&error) {
        Some(reason) => Error::raw(
            ErrorKind::ValueValidation,
            format!("{reason}\n\nFor more information, try '--help'.\n"),
        ),
        None => error,
    }
}

fn reason(error: &Error) -> Option<String> {
    if error.kind() != ErrorKind::ValueValidation {
        return None;
    }
    let context = |kind| error.get(kind).map(ToString::to_string);
    let option = context(ContextKind::InvalidArg)?;
    let value = context(ContextKind::InvalidValue)?;
    let cause = error.source()?;
    let expected = if cause.is::<ParseFloatError>() {
        let hint = with_point(&value).map(|number| format!(" with a decimal point: {number}"));
        format!("expected a number{}", hint.unwrap_or_default())
    } else if cause.is::<ParseIntError>() && value.starts_with('-') {
        "expected a whole number, not a negative one".to_owned()
    } else if cause.is::<ParseIntError>() {
        "expected a whole number".to_owned()
    } else {
        let cause = cause.to_string();
        let (low, high) = bounds(&cause)?;
        return Some(format!(
            "invalid value '{value}' for '{option}': must be {low} to {high}"
        ));
    };
    Some(format!(
        "invalid value '{value}' for '{option}': {expected}"
    ))
}

/// Reads the bounds in "7 is not in 1..=5", clap's reason for a whole number out of range.
fn bounds(text: &str) -> Option<(&str, &str)> {
    let (_, range) = text.split_once(" is not in ")?;
    range.split_once("..=")
}

/// Returns a number that was written with a decimal comma with its decimal point. A comma before
/// exactly three digits may separate thousands.
fn with_point(value: &str) -> Option<String> {
    let (whole, decimals) = value.split_once(',')?;
    let number = format!("{whole}.{decimals}");
    (decimals.len() != 3 && number.parse::<f64>().is_ok()).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Arguments;
    use clap::CommandFactory as _;

    fn said(words: &[&str]) -> String {
        let words = ["trinocular"].iter().chain(words);
        let program = with_negative_numbers(Arguments::command());
        let error = program.try_get_matches_from(words);
        explained(error.expect_err("a wrong number")).to_string()
    }

    #[test]
    fn wrong_number_is_named_with_its_form() {
        for (words, reason) in [
            (
                &["track", "--sim", "--seed", "1,5"][..],
                "'1,5' for '--seed <SEED>': expected a whole number\n",
            ),
            (
                &["track", "--sim", "--fps", "1,000"][..],
                "'1,000' for '--fps <HZ>': expected a number\n",
            ),
            (
                &["verify", "r.toml", "--points", "50,abc"][..],
                "'abc' for '--points <N,...>': expected a whole number",
            ),
            (
                &["verify", "r.toml", "--points", "0"],
                "'0' for '--points <N,...>': must be 1 to 65535",
            ),
            (
                &["track", "--sim", "--fps", "60,5"],
                "'60,5' for '--fps <HZ>': expected a number with a decimal point: 60.5",
            ),
            (
                &["verify", "r.toml", "--noise", "much"],
                "'much' for '--noise <PX>': expected a number\n",
            ),
            (
                &["estimate", "run.mcap", "--tolerance", "-1"],
                "'-1' for '--tolerance <MS>': must be 0 to 1000 ms",
            ),
            (
                &["bench", "flow", "run.mcap", "--repeat", "-1"],
                "'-1' for '--repeat <N>': must be 1 to 100000",
            ),
            (
                &["track", "--sim", "--seed", "-1"],
                "'-1' for '--seed <SEED>': expected a whole number, not a negative one",
            ),
        ] {
            let said = said(words);
            assert!(said.contains(reason), "{words:?}: {said}");
        }
    }

    #[test]
    fn other_errors_stay_as_they_are() {
        let said = said(&["verify", "r.toml", "--point", "50"]);
        assert!(said.contains("'--points'"), "{said}");
    }

    /// Gives every option of a command and of those below it `text`, which is none of its values,
    /// and collects the errors.
    fn refusals(command: &Command, text: &str, path: &[&str], found: &mut Vec<String>) {
        for option in command.get_arguments() {
            let count = option.get_num_args().map_or(0, |range| range.min_values());
            let Some(name) = option.get_long().filter(|_| count > 0) else {
                continue;
            };
            let option = format!("--{name}");
            let words = [path, &[option.as_str()], &vec![text; count]].concat();
            let program = with_negative_numbers(Arguments::command());
            if let Err(error) = program.try_get_matches_from(words) {
                found.push(explained(error).to_string());
            }
        }
        for inner in command.get_subcommands() {
            refusals(inner, text, &[path, &[inner.get_name()]].concat(), found);
        }
    }

    #[test]
    fn no_option_has_the_words_of_a_parser() {
        let mut program = Arguments::command();
        program.build();
        let mut found = Vec::new();
        refusals(&program, "1x", &["trinocular"], &mut found);
        let stated = |said: &&String| said.contains("'1x' for") && said.contains("number");
        assert!(found.iter().filter(stated).count() > 30, "{found:?}");
        for said in found {
            for words in [
                "invalid digit",
                "invalid float",
                " is not in ",
                "cannot parse",
            ] {
                assert!(!said.contains(words), "{said}");
            }
        }
    }

    #[test]
    fn no_option_takes_a_number_for_another() {
        let mut program = Arguments::command();
        program.build();
        let mut found = Vec::new();
        refusals(&program, "-1", &["trinocular"], &mut found);
        assert!(found.len() > 30, "{found:?}");
        for said in found {
            assert!(!said.contains("unexpected argument '-1'"), "{said}");
        }
    }
}
