//! Command line of Trinocular.
//!
//! `main` only converts the result to an exit code and one line on standard error; every command is
//! a file under `commands`.

#![deny(clippy::print_stderr, clippy::print_stdout)]

use std::io::{self, Write};
use std::process::ExitCode;

use clap::{CommandFactory as _, FromArgMatches as _};
use commands::failure::Failure;
use trinocular_rig::notice;

mod commands;

fn main() -> ExitCode {
    match run() {
        Ok(code) => code,
        Err(failure) if failure.is_closed_output() => ExitCode::SUCCESS,
        // The user knows of the signal, and the run has said how it ended.
        Err(failure @ Failure::Interrupted(_)) => ExitCode::from(failure.exit_code()),
        Err(failure) => {
            notice!("error: {}", failure.chain());
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run() -> Result<ExitCode, Failure> {
    let program = commands::numbers::with_negative_numbers(commands::Arguments::command());
    let arguments = program.try_get_matches();
    let arguments = arguments.and_then(|found| commands::Arguments::from_arg_matches(&found));
    let arguments = match arguments {
        Ok(arguments) => arguments,
        Err(error) => return explain(commands::numbers::explained(error)),
    };
    let mut out = io::stdout().lock();
    commands::run(arguments, &mut out)?;
    // The buffered rest may be the part that does not fit the disk.
    out.flush()?;
    Ok(ExitCode::SUCCESS)
}

/// Prints help, version, or the error in the arguments.
fn explain(error: clap::Error) -> Result<ExitCode, Failure> {
    let printed = error.print();
    let words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
    if let Some(hint) = commands::commas::hint(words) {
        notice!("hint: {hint}");
    }
    if error.use_stderr() {
        // If standard error cannot be written, the exit code must suffice.
        return Ok(ExitCode::from(2));
    }
    printed?;
    io::stdout().flush()?;
    Ok(ExitCode::SUCCESS)
}
