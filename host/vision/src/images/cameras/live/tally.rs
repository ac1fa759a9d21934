//! Number of images, by their fate.

use crate::images::cameras::matching::Counts;

/// Number of one camera's images, by their fate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Images handed to the matching.
    pub matching: Counts,
    /// Images of unknown time.
    pub stale: u64,
    /// Damaged images.
    pub damaged: u64,
    /// Images of which packets are missing.
    pub incomplete: u64,
    /// Images that the camera's driver lost.
    pub lost: u64,
    /// Triggers of which the camera has no image.
    pub missed: u64,
    /// Second images of a trigger.
    pub doubled: u64,
    /// Images of triggered cameras whose trigger is not certain.
    pub doubtful: u64,
    /// Images of triggered cameras whose trigger the station has not reported.
    pub unreported: u64,
}

impl Tally {
    /// Returns the number of images that came, whole or not, as far as they belong to the run.
    pub fn images(&self) -> u64 {
        self.matching.arrived
            + self.stale
            + self.damaged
            + self.incomplete
            + self.doubled
            + self.doubtful
            + self.unreported
    }

    /// Returns the reasons why images were not used, each with the number of images, without zeros.
    pub fn drops(&self) -> Vec<(&'static str, u64)> {
        let drops = [
            ("damaged", self.damaged),
            ("with missing packets", self.incomplete),
            ("lost by the driver", self.lost),
            ("missed triggers", self.missed),
            ("of unknown time", self.stale),
            ("out of order", self.matching.disordered),
            ("overtaken by newer images", self.matching.overtaken),
            ("second of a trigger", self.doubled),
            ("whose trigger is not certain", self.doubtful),
            ("whose trigger was not reported", self.unreported),
            ("without partners in time", self.matching.unmatched),
        ];
        drops.into_iter().filter(|(_, count)| *count > 0).collect()
    }
}
