//! Ranges of options.

use crate::commands::failure::Failure;
use trinocular_rig::rig_file::capture::DELAY_MS;

/// Refuses a value of the option `--name` outside `low..=high`, and a value that is not a number.
pub fn check(name: &str, value: f64, low: f64, high: f64) -> Result<(), Failure> {
    match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(Failure::Usage(format!(
            "--{name} is {value}, must be {low} to {high}"
        ))),
    }
}

/// Refuses a value of the option `--name` that no camera's time stamps are late by.
pub fn check_delay(name: &str, delay_ms: f64) -> Result<(), Failure> {
    check(name, delay_ms, *DELAY_MS.start(), *DELAY_MS.end())
}
