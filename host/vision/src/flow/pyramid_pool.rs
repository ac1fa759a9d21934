//! Pool of pyramids for reuse.
//!
//! The system takes longer to hand out fresh memory than the filter takes to fill it, so the
//! pyramids of a frame set that is no longer needed become the buffers of the next one.

use super::FilteredFrameSet;
use crate::matching::pyramid::FramePyramid;

/// Pyramids of at most one frame set.
#[derive(Clone, Debug, Default)]
pub(super) struct PyramidPool(Vec<FramePyramid>);

impl PyramidPool {
    /// Takes all pyramids out of the pool.
    pub(super) fn take(&mut self) -> Vec<FramePyramid> {
        std::mem::take(&mut self.0)
    }

    /// Puts the pyramids of a frame set into the pool, in place of those in it.
    pub(super) fn put(&mut self, filtered: FilteredFrameSet) {
        self.0 = filtered.pyramids;
    }
}
