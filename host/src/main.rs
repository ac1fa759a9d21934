//! The command line of Trinocular.
//!
//! `main` only turns the outcome into an exit code and one line on standard error; every command is a file
//! under `commands`.

use std::io;
use std::process::ExitCode;

use clap::Parser as _;

mod commands;

fn main() -> ExitCode {
    let arguments = commands::Arguments::parse();
    match commands::run(arguments, &mut io::stdout().lock()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) if failure.is_closed_output() => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {}", failure.chain());
            ExitCode::from(failure.exit_code())
        }
    }
}
