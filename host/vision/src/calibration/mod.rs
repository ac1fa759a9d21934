//! Calibration of cameras and rigs from images of a chessboard.
//!
//! ```text
//! image -> saddle -> grid -> refine -> corners                       (find: one image)
//! corners -> homography -> lens, poses -> adjust -> Intrinsics     (intrinsics: one camera)
//! corners of one instant, lenses -> adjust -> RigSolution          (rig: poses of the cameras)
//! ```
//!
//! * [`board`] numbers the corners; [`find`] finds them in an image;
//! * [`intrinsics`] solves one camera and rejects bad images, [`rig`] solves the poses of several,
//!   [`stand`] expresses them in the rig's own axes;
//! * [`adjust`] is the bundle adjustment behind both, with its covariance;
//! * [`folder`] calibrates from the [`photographs`] in a folder, [`check`] refuses useless results,
//!   [`result_json`] shows the result;
//! * [`exchange`] reads and writes the camera files of OpenCV and ROS.
//!
//! Sources: Z. Zhang, *A Flexible New Technique for Camera Calibration*, IEEE PAMI 22(11), 2000;
//! D. C. Brown, *Close-Range Camera Calibration*, Photogrammetric Engineering 37(8), 1971, for the
//! distortion; B. Triggs et al., *Bundle Adjustment: A Modern Synthesis*, 1999.
//!
//! # Example
//!
//! Corners of a drawn board with 4 x 3 inner corners:
//!
//! ```
//! use trinocular_vision::calibration::board::Board;
//! use trinocular_vision::calibration::find::find;
//! use trinocular_vision::images::Image;
//!
//! let square = |i: usize| {
//!     let (x, y) = (i % 320, i / 320);
//!     let is_board = (60..260).contains(&x) && (40..200).contains(&y);
//!     if is_board && ((x - 60) / 40 + (y - 40) / 40) % 2 == 0 { 20 } else { 230 }
//! };
//! let image = Image { width: 320, height: 240, grey: (0..320 * 240).map(square).collect() };
//! let board = Board { corners: [4, 3], square_mm: 25.0 };
//! let found = find(&image, &board, None).expect("the board");
//! assert_eq!(found.corners.len(), 12);
//! ```

pub mod adjust;
pub mod blur;
pub mod board;
pub mod check;
mod contrast;
pub mod exchange;
pub mod find;
pub mod folder;
pub mod grid;
pub mod homography;
pub mod intrinsics;
pub mod lens;
pub mod photographs;
pub mod refine;
pub mod rejection;
pub mod result_json;
pub mod rig;
pub mod saddle;
pub mod stand;

#[cfg(test)]
mod tests;
