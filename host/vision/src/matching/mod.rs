//! Matching of image windows between the cameras of a rig and between instants.
//!
//! Building blocks of [`flow`](crate::flow), each usable alone. They know images, cameras and
//! points, but no keyframe and no target.
//!
//! | module | method | nearest in OpenCV |
//! |---|---|---|
//! | [`pyramid`] | Gaussian pyramid | `pyrDown` |
//! | [`corner`] | Shi-Tomasi corners, spread over the image | `goodFeaturesToTrack` |
//! | [`zncc`] | zero-mean normalised cross-correlation | `matchTemplate`, `TM_CCOEFF_NORMED` |
//! | [`lucas_kanade`] | inverse compositional, with gain and offset | `calcOpticalFlowPyrLK` |
//! | `epipolar` | correlation along an epipolar line | |
//! | [`stereo`] | multi-baseline match over inverse depth | `StereoBM`, for two cameras |
//! | [`geometry`] | projections of the rig, residuals of one point | `undistortPoints` |
//!
//! Sources:
//!
//! * J. Shi and C. Tomasi, *Good Features to Track*, CVPR 1994;
//! * B. D. Lucas and T. Kanade, *An Iterative Image Registration Technique with an Application to
//!   Stereo Vision*, IJCAI 1981;
//! * J.-Y. Bouguet, *Pyramidal Implementation of the Lucas Kanade Feature Tracker*, Intel 2000;
//! * S. Baker and I. Matthews, *Lucas-Kanade 20 Years On: A Unifying Framework*, IJCV 56(3), 2004;
//! * M. Okutomi and T. Kanade, *A Multiple-Baseline Stereo*, IEEE PAMI 15(4), 1993.
//!
//! # Example
//!
//! A corner of one image, found again in an image shifted by three pixels:
//!
//! ```
//! use trinocular_vision::images::Image;
//! use trinocular_vision::matching::lucas_kanade::FineTemplate;
//! use trinocular_vision::matching::pyramid::Pyramid;
//!
//! let shifted = |by: usize| {
//!     let blob = |i: usize| {
//!         let (x, y) = ((i % 64) as f64 - by as f64, (i / 64) as f64);
//!         (120.0 + 60.0 * (0.4 * x).sin() + 40.0 * (0.5 * y + 0.1 * x).cos()) as u8
//!     };
//!     let grey = (0..64 * 64).map(blob).collect();
//!     Image { width: 64, height: 64, grey }
//! };
//! let [before, now] = [0, 3].map(|by| Pyramid::new(&shifted(by), 1));
//! let template = FineTemplate::new(&before.levels[0], [30.0, 32.0]).expect("texture");
//! let unwarped = [[1.0, 0.0], [0.0, 1.0]];
//! let found = template.find(&now.levels[0], [32.0, 32.0], unwarped, 20);
//! let found = found.expect("the shifted place");
//! assert!((found.at[0] - 33.0).abs() < 0.05 && found.zncc > 0.99);
//! ```

pub mod corner;
mod epipolar;
pub mod geometry;
pub mod lucas_kanade;
pub mod pyramid;
mod reject;
mod settings;
pub mod stereo;
pub mod zncc;

pub use reject::{Reject, RejectCounts};
pub use settings::MatchSettings;
