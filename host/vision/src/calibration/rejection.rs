//! Reasons for which images and instants are left out of a calibration.

use super::find::NotFound;

/// Reason why an image is left out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageRejection {
    /// The file cannot be read.
    #[error("{0}")]
    Unreadable(String),
    /// The image is not as large as the camera's first one.
    #[error(
        "{} x {} px, but the images before it are {} x {} px",
        found[0], found[1], first[0], first[1]
    )]
    Size {
        /// Width and height, px.
        found: [u32; 2],
        /// Width and height of the first image, px.
        first: [u32; 2],
    },
    /// The image does not show the whole board.
    #[error(transparent)]
    NotFound(#[from] NotFound),
    /// The image is there twice.
    #[error("the same image as {0}")]
    Repeated(String),
    /// Edges are much more blurred than those of the other images.
    #[error("blurred: edges {blur_px:.1} px wide, the median image's {median_px:.1} px")]
    Blurred {
        /// Width of the edges, px.
        blur_px: f64,
        /// Width of the median image's edges, px.
        median_px: f64,
    },
    /// The residual is much larger than those of the other images.
    #[error(
        "residual {rms_px:.3} px, {:.1} times the median image's {median_px:.3} px",
        rms_px / median_px
    )]
    Residual {
        /// Root mean square residual, px.
        rms_px: f64,
        /// Residual of the median image, px.
        median_px: f64,
    },
}

/// Reason why an instant is left out of the solution of the camera poses.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum InstantRejection {
    /// Only one camera saw the board, which does not determine its pose.
    #[error("fewer than two cameras have a usable image")]
    FewImages,
    /// The cameras do not see the board in one place.
    #[error(
        "the cameras disagree: residual {rms_px:.3} px, {:.1} times the median instant's \
         {median_px:.3} px",
        rms_px / median_px
    )]
    Residual {
        /// Root mean square residual, px.
        rms_px: f64,
        /// Residual of the median instant, px.
        median_px: f64,
    },
}
