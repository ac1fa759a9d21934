//! Warnings of probable mistakes in a rig, for all commands that measure with a rig.

use std::path::Path;

use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;

/// Warns of wrong units and exchanged names, on standard error.
pub fn warn(path: &Path, rig: &RigFile) {
    for doubt in rig.doubts() {
        notice!("warning: {}: {doubt}", path.display());
    }
}
