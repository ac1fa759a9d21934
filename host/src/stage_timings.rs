//! Where the time goes, stage by stage.

use std::time::{Duration, Instant};

/// The stages of a frame set, in the order of their work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Gaussian filter and pyramids.
    Filter,
    /// Choice of the points.
    Corners,
    /// Their matches in the other cameras, with the templates that are followed from there.
    Spatial,
    /// The rough displacement.
    Search,
    /// Every point in every camera.
    Temporal,
    /// Which points move as one.
    Consensus,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Self; 6] = [
        Self::Filter,
        Self::Corners,
        Self::Spatial,
        Self::Search,
        Self::Temporal,
        Self::Consensus,
    ];

    /// In lower case.
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

/// Time spent in each stage since the laps began.
#[derive(Clone, Copy, Debug)]
pub struct Laps {
    last: Instant,
    spent: [Duration; Stage::ALL.len()],
}

impl Laps {
    /// From now on.
    pub fn start() -> Self {
        Self {
            last: Instant::now(),
            spent: [Duration::ZERO; Stage::ALL.len()],
        }
    }

    /// The time since the last lap belongs to `stage`.
    pub(crate) fn lap(&mut self, stage: Stage) {
        let now = Instant::now();
        self.spent[stage as usize] += now - self.last;
        self.last = now;
    }

    /// Time spent in `stage`.
    pub fn of(&self, stage: Stage) -> Duration {
        self.spent[stage as usize]
    }

    /// Time spent in all stages.
    pub fn total(&self) -> Duration {
        self.spent.iter().sum()
    }
}
