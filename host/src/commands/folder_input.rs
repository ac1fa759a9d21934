//! Frame sets in files, as all commands that take a folder open them.

use clap::{Args, ValueEnum};
use std::path::Path;

use super::warnings;
use crate::commands::failure::Failure;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::folder::{DEFAULT_PERIOD_US, Folder};
use trinocular_vision::images::series::pairing::Rule;

/// Option for the images of one instant.
#[derive(Clone, Debug, Args)]
pub struct PairOption {
    /// Rule by which images of several cameras are of one instant [default: equal names; order for
    /// stacks and videos; time if no names agree but all hold one]
    ///
    /// `time` takes the nearest: names hold a date and a time (20260105_102910_250) or ns, us, ms
    /// or s since 1970. Equal names may differ in their endings, and in all but their last number.
    /// A line says what was decided unless all names are equal.
    #[arg(long, value_enum, value_name = "RULE")]
    pair: Option<PairBy>,
}

/// Rules of [`PairOption`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PairBy {
    /// Equal names
    Name,
    /// Equal places in the order of the names
    Order,
    /// Nearest times in the names
    Time,
}

impl PairOption {
    /// Returns the rule that the user gave.
    pub fn rule(&self) -> Option<Rule> {
        self.pair.map(|pair| match pair {
            PairBy::Name => Rule::Name,
            PairBy::Order => Rule::Order,
            PairBy::Time => Rule::Time,
        })
    }

    /// Refuses a rule without a folder: `is_there` tells that there is one, `with` names it.
    pub fn goes_with(&self, is_there: bool, with: &str) -> Result<(), Failure> {
        match self.pair.is_some() && !is_there {
            true => Err(Failure::Usage(format!("--pair goes with {with}"))),
            false => Ok(()),
        }
    }

    /// Opens the frame sets in `dir`, 30 per second, and prints how they were paired and scaled.
    pub fn open(&self, dir: &Path, rig: &RigFile) -> Result<Folder, InputError> {
        let size_px = rig.rig.image_size_px;
        let period_us = DEFAULT_PERIOD_US;
        let folder = Folder::open_paired(dir, &rig.names, size_px, period_us, self.rule())?;
        warnings::unread(folder.warnings());
        say(folder.pairing().as_deref());
        Ok(folder)
    }
}

/// Prints the rule by which images were paired.
pub fn say(pairing: Option<&str>) {
    if let Some(pairing) = pairing {
        notice!("{pairing}");
    }
}
