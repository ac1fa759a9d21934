//! Refusals: reasons why a frame set gives no measurement.

use crate::spot::NoSpot;

/// Reason why a frame set gives no keyframe or no measurement. The message states what was found
/// and what is needed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FlowRefusal {
    /// The rig has fewer than two cameras, or all are in one place.
    #[error("the rig has no baseline: two cameras in different places are the least")]
    WrongRig,
    /// The frame set does not have one image per camera.
    #[error("the frame set has {found} images, the rig {cameras} cameras")]
    WrongViews {
        /// Images in the frame set.
        found: usize,
        /// Cameras in the rig.
        cameras: usize,
    },
    /// The size of an image is not that of the rig file.
    #[error(
        "the image of camera {camera} is {} x {} px, but the rig's are {} x {} px",
        found[0], found[1], rig[0], rig[1]
    )]
    WrongSize {
        /// Index of the camera.
        camera: usize,
        /// Columns and rows of its image.
        found: [usize; 2],
        /// Columns and rows by the rig file.
        rig: [usize; 2],
    },
    /// There is no keyframe.
    #[error("no keyframe was accepted before")]
    NoKeyframe,
    /// The keyframe's image in the reference camera has too little texture.
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
        "ambiguous: the texture repeats, {ambiguous} corners match at several depths and \
         {matched} at one"
    )]
    AmbiguousDepth {
        /// Corners with several matches.
        ambiguous: usize,
        /// Corners with one match.
        matched: usize,
    },
    /// The texture repeats: several displacements explain the images.
    #[error(
        "ambiguous: the texture repeats, displacements of {first:.1?} mm and {second:.1?} mm \
         explain the images alike"
    )]
    AmbiguousMotion {
        /// Best displacement, mm.
        first: [f64; 3],
        /// Displacement that is nearly as good, mm.
        second: [f64; 3],
    },
    /// No displacement within the search range explains the images.
    #[error(
        "lost: no displacement within reach explains the images (best likeness {zncc:.2}); the \
         target moved too far, turned, or is hidden"
    )]
    Lost {
        /// Mean zncc of the best displacement, -1 to 1.
        zncc: f32,
    },
    /// Too few points were tracked in all cameras.
    #[error("too few points followed: {followed} of {matched}, {least} are the least")]
    FewTracks {
        /// Points tracked in all cameras.
        followed: usize,
        /// Points matched at the keyframe.
        matched: usize,
        /// Points needed.
        least: usize,
    },
    /// No camera whose image has the region of interest gives a usable image.
    #[error("the cameras that have the region of interest give no usable images at the keyframe")]
    RegionUnseen,
    /// Too few cameras give usable images.
    #[error("cameras with usable images: {left}; two in different places are the least")]
    FewCameras {
        /// Number of cameras with a usable image.
        left: usize,
    },
    /// The target rotates, and flow sums describe only displacements.
    #[error(
        "the target has turned by {:.2}, {:.2}, {:.2} degrees about x, y, z: only displacements \
         are measured",
        degrees[0], degrees[1], degrees[2]
    )]
    Turned {
        /// Rotation about the cameras' x, y and z, degrees.
        degrees: [f64; 3],
    },
    /// The points do not move as one.
    #[error(
        "no agreement: {agree} of {expected} points in view move alike, half are the least{}",
        residual(*median_px)
    )]
    NoAgreement {
        /// Number of inliers.
        agree: usize,
        /// Points that the displacement leaves in view.
        expected: usize,
        /// Median residual, px.
        median_px: f64,
    },
    /// The inliers move as one, but other parts of the image move differently, and the inliers
    /// are not most of it.
    #[error(
        "no agreement: {alike} of {all} parts of the image move alike and {otherwise} \
         otherwise: is it the target that moves, or what covers it or stands behind it? Half of \
         the image is the least then"
    )]
    Minority {
        /// Cells of the reference image that move as measured.
        alike: usize,
        /// Cells that move differently.
        otherwise: usize,
        /// Cells in view.
        all: usize,
    },
    /// The pivot is the spot of a laser whose ray meets no point of the target.
    #[error(transparent)]
    NoSpot(NoSpot),
}

impl FlowRefusal {
    /// Returns the name of the reason, in a word or two, for counts and tables.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::WrongRig => "wrong rig",
            Self::WrongViews { .. } => "wrong number of images",
            Self::WrongSize { .. } => "wrong size",
            Self::NoKeyframe => "no reference",
            Self::FewCorners { .. } => "few corners",
            Self::FewMatches { .. } => "few matches",
            Self::AmbiguousDepth { .. } => "ambiguous depth",
            Self::AmbiguousMotion { .. } => "ambiguous motion",
            Self::Lost { .. } => "lost",
            Self::FewTracks { .. } => "few tracks",
            Self::RegionUnseen => "region unseen",
            Self::FewCameras { .. } => "few cameras",
            Self::Turned { .. } => "turned",
            Self::NoAgreement { .. } => "no agreement",
            Self::Minority { .. } => "minority",
            Self::NoSpot(_) => "no spot",
        }
    }
}

/// Returns the median residual in words, if the points determine any motion.
fn residual(median_px: f64) -> String {
    match median_px.is_finite() {
        true => format!(" (median residual {median_px:.2} px)"),
        false => ", and they determine no motion".to_owned(),
    }
}
