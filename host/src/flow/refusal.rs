//! Why a point, or a whole frame, is not used.

/// Why a point was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// Some camera does not see the place where it should be.
    OutOfView,
    /// Nothing in some camera, or now, looks like it.
    Unlike,
    /// Several places look like it.
    Ambiguous,
    /// Not enough contrast around it in some direction.
    Flat,
    /// Followed forth and back, it does not return.
    NoReturn,
    /// Off its epipolar line: the vertical test (2).
    Vertical,
    /// Disparities do not agree: constraint (3).
    Disparity,
    /// Its disparity is too small to know its depth.
    TooFar,
    /// Its motion is not that of most points.
    Disagrees,
}

impl Reason {
    /// All of them, in the order of the pipeline.
    pub const ALL: [Self; 9] = [
        Self::OutOfView,
        Self::Unlike,
        Self::Ambiguous,
        Self::Flat,
        Self::NoReturn,
        Self::Vertical,
        Self::Disparity,
        Self::TooFar,
        Self::Disagrees,
    ];
}

/// How many points were dropped, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejected([usize; Reason::ALL.len()]);

impl Rejected {
    /// Counts one.
    pub fn add(&mut self, reason: Reason) {
        self.0[reason as usize] += 1;
    }

    /// How many for this reason.
    pub fn of(&self, reason: Reason) -> usize {
        self.0[reason as usize]
    }

    /// How many in all.
    pub fn total(&self) -> usize {
        self.0.iter().sum()
    }
}

/// Why there is no measurement. The message says what was found and what would be needed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The rig has fewer than two cameras, or all are in one place.
    #[error("the rig has no baseline: two cameras in different places are the least")]
    WrongRig,
    /// The capture has not one view per camera.
    #[error("the capture has {found} views, the rig {cameras} cameras")]
    WrongViews {
        /// Views in the capture.
        found: usize,
        /// Cameras in the rig.
        cameras: usize,
    },
    /// A view's size is not the rig's.
    #[error("view {camera} is {}x{} px, the rig's images are {}x{}", found[0], found[1], rig[0], rig[1])]
    WrongSize {
        /// Which view, from 0.
        camera: usize,
        /// Its columns and rows.
        found: [usize; 2],
        /// The rig's.
        rig: [usize; 2],
    },
    /// Nothing to measure against.
    #[error("no reference capture was accepted before")]
    NoReference,
    /// The reference image has too little texture.
    #[error("too little texture: {found} corners in the reference image, {least} are the least")]
    FewCorners {
        /// Corners found.
        found: usize,
        /// Corners needed.
        least: usize,
    },
    /// Too few corners are seen by all cameras.
    #[error(
        "too few matches between the cameras: {matched} of {corners} corners, {least} are the least"
    )]
    FewMatches {
        /// Corners matched in all cameras.
        matched: usize,
        /// Corners tried.
        corners: usize,
        /// Matches needed.
        least: usize,
    },
    /// The texture repeats along the epipolar lines: depth is ambiguous.
    #[error(
        "ambiguous: the texture repeats, {ambiguous} corners match at several depths and {matched} at one"
    )]
    AmbiguousDepth {
        /// Corners with several matches.
        ambiguous: usize,
        /// Corners with one.
        matched: usize,
    },
    /// The texture repeats: several displacements explain the images.
    #[error(
        "ambiguous: the texture repeats, displacements of {first:.1?} mm and {second:.1?} mm explain the images alike"
    )]
    AmbiguousMotion {
        /// The best.
        first: [f64; 3],
        /// Nearly as good.
        second: [f64; 3],
    },
    /// No displacement within reach explains the images.
    #[error("lost: no displacement within reach explains the images (best likeness {likeness:.2})")]
    Lost {
        /// Mean likeness of the best displacement, -1 to 1.
        likeness: f32,
    },
    /// Too few points could be followed in all cameras.
    #[error("too few points followed: {followed} of {matched}, {least} are the least")]
    FewTracks {
        /// Points followed in all cameras.
        followed: usize,
        /// Points matched at the reference instant.
        matched: usize,
        /// Points needed.
        least: usize,
    },
    /// Too few cameras give pictures of use.
    #[error("cameras that give pictures of use: {left}; two in different places are the least")]
    FewCameras {
        /// That do.
        left: usize,
    },
    /// The target turns, and sums know only displacements.
    #[error(
        "the target has turned by {:.2}, {:.2}, {:.2} degrees about x, y, z: only displacements are measured",
        degrees[0], degrees[1], degrees[2]
    )]
    Turned {
        /// About the cameras' x, y and z.
        degrees: [f64; 3],
    },
    /// The points do not move as one.
    #[error(
        "no agreement: {agree} of {expected} points in view move alike, half are the least (median residual {median_px:.2} px)"
    )]
    NoAgreement {
        /// Points that agree.
        agree: usize,
        /// Points that the displacement leaves in view.
        expected: usize,
        /// Median residual, px.
        median_px: f64,
    },
    /// The points move as one, but other parts of the picture move otherwise, and these are not
    /// most of it.
    #[error(
        "no agreement: {alike} of {all} parts of the picture move alike and {otherwise} otherwise: is it the target that moves, or what covers it or stands behind it? Half of the picture is the least then"
    )]
    Minority {
        /// Cells of the reference image that move as measured.
        alike: usize,
        /// Cells that move otherwise.
        otherwise: usize,
        /// Cells in view.
        all: usize,
    },
}

impl Refusal {
    /// In a word or two, without what was found: to count by.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::WrongRig => "wrong rig",
            Self::WrongViews { .. } => "wrong views",
            Self::WrongSize { .. } => "wrong size",
            Self::NoReference => "no reference",
            Self::FewCorners { .. } => "few corners",
            Self::FewMatches { .. } => "few matches",
            Self::AmbiguousDepth { .. } => "ambiguous depth",
            Self::AmbiguousMotion { .. } => "ambiguous motion",
            Self::Lost { .. } => "lost",
            Self::FewTracks { .. } => "few tracks",
            Self::FewCameras { .. } => "few cameras",
            Self::Turned { .. } => "turned",
            Self::NoAgreement { .. } => "no agreement",
            Self::Minority { .. } => "minority",
        }
    }
}
