//! `--report`: an HTML page with the results of a command.

use std::path::PathBuf;

use crate::commands::failure::Failure;
use clap::Args;
use trinocular::report::Page;
use trinocular_rig::error::InputError;
use trinocular_rig::output::{Output, OwnFile, Replace};

/// Destination of the page.
#[derive(Debug, Args)]
pub struct ReportOption {
    /// Also write an HTML page with all tables and figures
    ///
    /// It replaces an earlier report of this program, but no other file without --force.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,

    /// Replace existing files even if this program did not write them
    #[arg(long)]
    force: bool,
}

/// File of the page, opened before the work whose results it takes.
pub struct Report(Option<Output>);

impl ReportOption {
    /// Returns true if foreign files may be replaced.
    pub fn is_forced(&self) -> bool {
        self.force
    }

    /// Returns true if a page was requested.
    pub fn is_given(&self) -> bool {
        self.report.is_some()
    }

    /// Opens the file.
    pub fn open(&self) -> Result<Report, InputError> {
        let replace = Replace::Own(OwnFile::Report).or_forced(self.force);
        let open = |path: &PathBuf| Output::open(path, replace);
        self.report.as_ref().map(open).transpose().map(Report)
    }
}

impl Report {
    /// Writes the page, if one was requested.
    pub fn write(self, page: impl FnOnce() -> Page) -> Result<(), Failure> {
        match self.0 {
            Some(output) => Ok(page().write(output)?),
            None => Ok(()),
        }
    }
}
