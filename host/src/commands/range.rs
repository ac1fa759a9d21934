//! Ranges of options.

use crate::commands::failure::Failure;

/// Refuses a value of the option `--name` outside `low..=high`, and a value that is not a number.
pub fn check(name: &str, value: f64, low: f64, high: f64) -> Result<(), Failure> {
    match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(Failure::Usage(format!(
            "--{name} is {value}, must be {low} to {high}"
        ))),
    }
}
