//! Options about a target that turns, for commands that follow it.

use super::estimate::Rotation;
use crate::commands::failure::Failure;
use clap::Args;
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::Contradiction;

/// Options about a target that turns.
#[derive(Clone, Copy, Debug, Args)]
pub struct TurningOptions {
    /// Estimate the rotation of the target and follow its pivot, or refuse a target that turns
    /// [default: the rig file's `rotation`, or estimate]
    ///
    /// `estimate` follows tilts of up to 40 degrees and any rotation about z since the first frame
    /// set. The rows then have the rotation vector with its standard deviation, and the pivot; about
    /// the centroid, rows whose points determine no rotation have the displacement alone. It needs
    /// the estimator midpoint. `refuse` takes less time.
    #[arg(long, value_enum)]
    rotation: Option<Rotation>,

    /// Point of the target that is followed: centroid, or its x, y, z mm at the first frame set, in
    /// the axes and from the origin of the rig file [default: the rig file's `pivot`, or centroid]
    #[arg(long, value_name = "centroid|X,Y,Z", allow_hyphen_values = true)]
    pivot: Option<Pivot>,
}

impl TurningOptions {
    /// Returns true if no option is given.
    pub fn is_default(&self) -> bool {
        self.rotation.is_none() && self.pivot.is_none()
    }

    /// Changes the rig file's treatment of a target that turns as the options demand.
    ///
    /// # Errors
    /// [`Failure::Usage`] for a pivot without a rotation.
    pub fn apply(self, rig: &mut RigFile) -> Result<(), Failure> {
        match self.rotation {
            Some(Rotation::Refuse) => rig.pivot = None,
            Some(Rotation::Estimate) => {
                rig.pivot.get_or_insert_default();
            }
            None => {}
        }
        match (self.pivot, &mut rig.pivot) {
            (None, _) => Ok(()),
            (Some(given), Some(pivot)) => {
                *pivot = given;
                Ok(())
            }
            (Some(_), None) => Err(Failure::Usage(Contradiction::PivotAlone.to_string())),
        }
    }
}
