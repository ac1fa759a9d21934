//! `trinocular man`: manual pages, one per command.

use std::io::Write;
use std::path::PathBuf;

use crate::commands::failure::Failure;
use clap::{Args, Command, CommandFactory as _};
use clap_mangen::Man;
use trinocular_rig::output::{NewFolders, Output, Replace, write_all};

use super::Arguments;

/// Write the manual pages into a folder
///
/// One page for the program and one for each command, in section 1: `man DIR/trinocular.1`. Pages
/// of commands within commands bear all names: `trinocular-bench-flow.1`.
#[derive(Debug, Args)]
pub struct ManOptions {
    /// Folder of the pages; made if it does not exist
    #[arg(value_name = "DIR")]
    folder: PathBuf,

    /// Overwrite pages that exist
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(options: &ManOptions, out: &mut impl Write) -> Result<(), Failure> {
    let mut folders = NewFolders::default();
    folders.make(&options.folder)?;
    let mut program = Arguments::command();
    program.build();
    let mut pages = Vec::new();
    collect(&program, "trinocular", &mut pages);
    let mut files = Vec::new();
    for page in pages {
        let mut text = Vec::new();
        let path = options.folder.join(format!("{}.1", page.get_name()));
        Man::new(page).render(&mut text)?;
        let file = Output::open(&path, Replace::Nothing.or_forced(options.force))?;
        files.push((file, String::from_utf8_lossy(&text).into_owned()));
    }
    let count = files.len();
    write_all(files)?;
    writeln!(out, "{count} pages in {}", options.folder.display())?;
    Ok(())
}

/// Adds the page of a command, and those of the commands within it.
fn collect(command: &Command, name: &str, pages: &mut Vec<Command>) {
    pages.push(command.clone().name(name.to_owned()));
    let inner = command.get_subcommands();
    for each in inner.filter(|each| each.get_name() != "help") {
        collect(each, &format!("{name}-{}", each.get_name()), pages);
    }
}
