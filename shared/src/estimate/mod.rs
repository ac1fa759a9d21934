//! From sums to the target's displacement: three estimators.
//!
//! * [`closed_form`]: the paper's eq. 9;
//! * [`least_squares`]: the paper's eq. 7, `(A'A)^-1 A'd`;
//! * [`midpoint`]: exact for finite displacements, at the Cramér-Rao bound, with its covariance.
//!   The default.
//!
//! All give the displacement of the *target in the camera frame* since the reference instant: mm, x
//! right, y down, z away. `solve` is the floating-point form (host and oracle); `solve_fixed` is
//! the station's run path: integers, total, and within 1 µm of `solve` over the rated range,
//! quantisation of the sums included.

pub mod closed_form;
pub mod least_squares;
pub mod midpoint;
mod quality;

pub use quality::{Gate, Refusal};

/// A displacement in whole nanometres per axis.
pub type DisplacementNm = [i32; 3];
