//! Warning of cameras that were moved since the view of `--reference` was saved.

use crate::commands::warnings;
use trinocular::servo::observer::{ServoEvent, ServoObserver};
use trinocular_core::rig::Rig;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::camera_shift::CameraShift;

/// Observer that warns once.
#[derive(Debug)]
pub(super) struct ShiftObserver {
    rig: Rig,
    names: Vec<String>,
    has_warned: bool,
}

impl ShiftObserver {
    pub fn of(rig: &RigFile) -> Self {
        Self {
            rig: rig.rig.clone(),
            names: rig.names.clone(),
            has_warned: false,
        }
    }
}

impl ServoObserver for ShiftObserver {
    fn observe(&mut self, event: &ServoEvent<'_>) {
        let ServoEvent::Step {
            measured: Some(measured),
            ..
        } = event
        else {
            return;
        };
        let Some(seen) = measured.measurement.as_ref().filter(|_| !self.has_warned) else {
            return;
        };
        let shift = CameraShift::find(&self.rig, &seen.cameras, &seen.correspondences);
        if let Some(shift) = shift {
            self.has_warned = true;
            warnings::raise(shift.warning(&self.names));
        }
    }
}
