//! What `trinocular` can do: one file per command, each with its options and its `run`.

use std::io::Write;

use clap::{Parser, Subcommand};
use host::error::Failure;

mod estimate;

/// Visual servo for three-dimensional motion: parallel cameras watch a target, a stage follows it.
///
/// All lengths are millimetres, all image positions pixels. Axes are those of ordinary images: x right, y down,
/// z away from the cameras. A displacement is the target's, seen from the cameras.
#[derive(Debug, Parser)]
#[command(
    name = "trinocular",
    version,
    max_term_width = 100,
    arg_required_else_help = true,
    after_help = EXIT_CODES
)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "\
Exit codes:
  0  done
  1  the input was bad (the message names file, line and field), or frames were refused
  2  the command line was wrong
  3  the station refused or faulted";

#[derive(Debug, Subcommand)]
enum Command {
    Estimate(estimate::Options),
}

/// Runs the command; results go to `out`, one line at a time.
pub fn run(arguments: Arguments, out: &mut impl Write) -> Result<(), Failure> {
    match arguments.command {
        Command::Estimate(options) => estimate::run(&options, out),
    }
}
