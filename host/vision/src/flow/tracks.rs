//! Points of the keyframe that were tracked into a frame set, and the numbers of the others.

use super::keyframe::ActiveKeyframe;
use super::{Correspondence, FlowRefusal};
use crate::matching::{Reject, RejectCounts};

/// Tracked points, and the numbers of those that were not.
#[derive(Clone, Debug)]
pub(super) struct Tracks {
    /// Points tracked in all cameras.
    pub(super) points: Vec<Correspondence>,
    /// Number of points left out, by reason; those of the keyframe included.
    pub(super) rejected: RejectCounts,
    /// Number of points matched at the keyframe.
    matched: usize,
    /// Number of matched points that are in view now.
    pub(super) expected: usize,
}

impl Tracks {
    /// Sorts the matched points of the keyframe by success.
    pub(super) fn of(
        keyframe: &ActiveKeyframe<'_>,
        all: impl IntoIterator<Item = Result<Correspondence, Reject>>,
    ) -> Self {
        let matched = keyframe.matches.len();
        let mut tracks = Self {
            points: Vec::with_capacity(matched),
            rejected: keyframe.rejected,
            matched,
            expected: matched,
        };
        for point in all {
            match point {
                Ok(point) => tracks.points.push(point),
                Err(reason) => {
                    tracks.rejected.add(reason);
                    tracks.expected -= usize::from(reason == Reject::OutOfView);
                }
            }
        }
        tracks
    }

    /// Refuses fewer than `least` points.
    pub(super) fn enough(&self, least: usize) -> Result<(), FlowRefusal> {
        let followed = self.points.len();
        if followed >= least {
            return Ok(());
        }
        Err(FlowRefusal::FewTracks {
            followed,
            matched: self.matched,
            least,
        })
    }

    /// Returns the refusal of points of which only `agree` move alike.
    pub(super) fn no_agreement(&self, agree: usize, median_px: f64) -> FlowRefusal {
        FlowRefusal::NoAgreement {
            agree,
            expected: self.expected,
            median_px,
        }
    }
}
