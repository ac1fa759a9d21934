//! Warnings of probable mistakes: on standard error at once, and in the next object of `--json`.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};

/// Warnings that no object of `--json` holds yet. A process runs one command.
static RAISED: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Largest number of warnings that wait for an object.
const MOST: usize = 1_000;

/// Prints a warning on standard error, and keeps it for the next object of `--json`.
pub fn raise(warning: impl Into<String>) {
    let warning = warning.into();
    notice!("warning: {warning}");
    let mut raised = RAISED.lock().unwrap_or_else(PoisonError::into_inner);
    if raised.len() < MOST {
        raised.push(warning);
    }
}

/// Returns the warnings since the last call.
pub fn take() -> Vec<String> {
    std::mem::take(&mut *RAISED.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Warns of wrong units and exchanged names in a rig.
pub fn rig(path: &Path, rig: &RigFile) {
    for doubt in rig.doubts() {
        raise(format!("{}: {doubt}", path.display()));
    }
}

/// Warns of settings with which a station does not supervise its stage.
pub fn stage(path: &Path, stage: &Stage) {
    if let Some(doubt) = stage.doubt() {
        raise(format!("{}: {doubt}", path.display()));
    }
}

/// Warns of mistakes in a rig and in the stage of its file.
pub fn rig_and_stage(path: &Path, file: &RigFile) {
    rig(path, file);
    if let Some(section) = &file.stage {
        stage(path, section);
    }
}

/// Warns of images that are not read.
pub fn unread(warnings: &[InputError]) {
    for warning in warnings {
        raise(warning.to_string());
    }
}
