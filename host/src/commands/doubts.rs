//! Warnings of probable mistakes in a rig and in folders, for all commands that measure.

use std::path::Path;

use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;

/// Warns of wrong units and exchanged names, on standard error.
pub fn warn(path: &Path, rig: &RigFile) {
    for doubt in rig.doubts() {
        notice!("warning: {}: {doubt}", path.display());
    }
}

/// Prints warnings of images that are not read, on standard error.
pub fn unread(warnings: &[InputError]) {
    for warning in warnings {
        notice!("warning: {warning}");
    }
}
