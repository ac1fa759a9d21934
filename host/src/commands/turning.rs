//! Options about a target that turns, for commands that follow it.

use super::estimate::Rotation;
use crate::commands::failure::Failure;
use clap::Args;
use trinocular_rig::pivot::{Pivot, PivotChoice};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::Contradiction;

/// Options about a target that turns.
#[derive(Clone, Copy, Debug, Args)]
pub struct TurningOptions {
    /// Estimate the rotation of the target and follow its pivot, or refuse a target that turns
    /// [default: the rig file's `rotation`, or estimate]
    ///
    /// `estimate` follows tilts of up to 40 degrees and any rotation about z since the first frame
    /// set. The rows then have the rotation vector with its standard deviation, and the pivot;
    /// about the centroid, rows whose points determine no rotation have the displacement alone. It
    /// needs the estimator midpoint.
    #[arg(long, value_enum)]
    rotation: Option<Rotation>,

    /// Point of the target that is followed: centroid, spot, or its x, y, z mm at the first frame
    /// set, in the axes and from the origin of the rig file [default: the rig file's `pivot`, or
    /// centroid]
    ///
    /// spot is the point that the ray of the rig file's `[laser]` meets at the first frame set.
    #[arg(long, value_name = "centroid|spot|X,Y,Z", allow_hyphen_values = true)]
    pivot: Option<PivotChoice>,
}

/// Returns the pivot that an option chose, in this rig.
///
/// # Errors
/// [`Failure::Usage`] for the spot of a rig without a laser.
pub(super) fn pivot(chosen: Option<PivotChoice>, rig: &RigFile) -> Result<Option<Pivot>, Failure> {
    let pivot = chosen.map(|chosen| chosen.in_rig(rig.laser)).transpose();
    pivot.map_err(|no_laser| Failure::Usage(format!("--pivot spot: {no_laser}")))
}

impl TurningOptions {
    /// Returns true if neither options nor rig file, with the options applied, ask for a rotation.
    pub fn are_silent(&self, rig: &RigFile) -> bool {
        self.pivot.is_none() && rig.rotation.is_none() && rig.pivot == Pivot::Centroid
    }

    /// Changes the rig file's treatment of a target that turns as the options demand.
    ///
    /// # Errors
    /// [`Failure::Usage`] for a pivot without a rotation.
    pub fn apply(self, rig: &mut RigFile) -> Result<(), Failure> {
        rig.rotation = self.rotation.map(Into::into).or(rig.rotation);
        match pivot(self.pivot, rig)? {
            Some(_) if rig.estimated_pivot().is_none() => {
                Err(Failure::Usage(Contradiction::PivotAlone.to_string()))
            }
            Some(pivot) => {
                rig.pivot = pivot;
                Ok(())
            }
            None => Ok(()),
        }
    }
}
