//! `trinocular completions`: completions for a shell.

use std::io::Write;

use crate::commands::failure::Failure;
use clap::{Args, CommandFactory as _};
use clap_complete::Shell;

use super::Arguments;

/// Print completions for a shell
///
/// Completes commands and options after TAB. Redirect the output to the file that the shell loads.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  trinocular completions bash > ~/.local/share/bash-completion/completions/trinocular
  trinocular completions zsh > ~/.zfunc/_trinocular
  trinocular completions fish > ~/.config/fish/completions/trinocular.fish")]
pub struct CompletionsOptions {
    /// Name of the shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Runs the command.
pub fn run(options: &CompletionsOptions, out: &mut impl Write) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(
        options.shell,
        &mut Arguments::command(),
        "trinocular",
        &mut text,
    );
    out.write_all(&text)?;
    Ok(())
}
