//! Cameras and rigs from photographs of a chessboard.
//!
//! ```text
//! image -> saddle -> grid -> refine -> corners                       (find: one image)
//! corners -> homography -> lens, poses -> adjust -> Intrinsics       (intrinsics: one camera, Zhang's method)
//! corners of one instant, lenses -> adjust -> RigSolution            (rig: where the cameras are and how they are turned)
//! ```
//!
//! * [`board`] says which corner is which; [`find`] sees them, or says why not;
//! * [`intrinsics`] solves a camera and rejects images, [`rig`] places several, [`stand`] in axes
//!   of their own;
//! * [`adjust`] is the one least squares solver behind both, with its covariance;
//! * [`folder`] does all this for the [`photographs`] in a folder;
//! * [`exchange`] reads and writes what OpenCV and ROS know of a camera.

pub mod adjust;
pub mod blur;
pub mod board;
pub mod exchange;
pub mod find;
pub mod folder;
pub mod grid;
pub mod homography;
pub mod intrinsics;
pub mod lens;
pub mod photographs;
pub mod refine;
pub mod rig;
pub mod saddle;
pub mod stand;

#[cfg(test)]
mod tests;
