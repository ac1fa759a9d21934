//! Stages of the pipeline, for observers that time them.

/// One stage of a measurement or of a new keyframe, in the order of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PipelineStage {
    /// Gaussian filter and pyramids.
    Filter,
    /// Shi-Tomasi corners.
    Corners,
    /// Stereo matches of the corners, with the templates to track from them.
    Spatial,
    /// Displacement search.
    Search,
    /// Tracking of every point in every camera.
    Temporal,
    /// Consensus, variance inflation and the tests of the result.
    Consensus,
}

impl PipelineStage {
    /// All stages, in order.
    pub const ALL: [Self; 6] = [
        Self::Filter,
        Self::Corners,
        Self::Spatial,
        Self::Search,
        Self::Temporal,
        Self::Consensus,
    ];

    /// Returns the name in lower case, as `bench flow` prints it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Filter => "filter",
            Self::Corners => "corners",
            Self::Spatial => "spatial",
            Self::Search => "search",
            Self::Temporal => "temporal",
            Self::Consensus => "consensus",
        }
    }
}

/// Observer that is called at the end of every stage. The flow itself reads no clock.
///
/// `()` observes nothing; [`StageTimings`](crate::stage_timings::StageTimings) measures time.
pub trait StageObserver: Send {
    /// Notes that `stage` has ended.
    fn stage_done(&mut self, stage: PipelineStage);
}

impl StageObserver for () {
    fn stage_done(&mut self, _: PipelineStage) {}
}
