//! Reasons to leave out a point, and their counts.

/// Reason to leave out one point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reject {
    /// Some camera does not see the place where the point should be.
    OutOfView,
    /// No window in some camera, or now, correlates with the point's window.
    Dissimilar,
    /// Several windows correlate with the point's window.
    Ambiguous,
    /// The window has too little contrast in some direction (aperture problem).
    LowTexture,
    /// The forward-backward error is too large: tracked there and back, the point does not return.
    NoReturn,
    /// The point is off its epipolar line: the paper's vertical test (2).
    Vertical,
    /// The point's disparities disagree: the paper's constraint (3).
    Disparity,
    /// The disparity is too small to know the depth.
    TooFar,
    /// The point does not move like most points.
    Outlier,
}

impl Reject {
    /// All reasons, in the order of the pipeline.
    pub const ALL: [Self; 9] = [
        Self::OutOfView,
        Self::Dissimilar,
        Self::Ambiguous,
        Self::LowTexture,
        Self::NoReturn,
        Self::Vertical,
        Self::Disparity,
        Self::TooFar,
        Self::Outlier,
    ];

    /// Returns the name of the reason, in a few words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OutOfView => "out of view",
            Self::Dissimilar => "not found",
            Self::Ambiguous => "ambiguous",
            Self::LowTexture => "too little texture",
            Self::NoReturn => "does not track back",
            Self::Vertical => "off its epipolar line",
            Self::Disparity => "disparities disagree",
            Self::TooFar => "too far away",
            Self::Outlier => "moves otherwise",
        }
    }
}

/// Number of points left out, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectCounts([usize; Reject::ALL.len()]);

impl RejectCounts {
    /// Counts one more point.
    pub fn add(&mut self, reject: Reject) {
        self.0[reject as usize] += 1;
    }

    /// Returns the count of one reason.
    pub fn of(&self, reject: Reject) -> usize {
        self.0[reject as usize]
    }

    /// Returns the sum of all counts.
    pub fn total(&self) -> usize {
        self.0.iter().sum()
    }
}
