//! Estimators of the target's displacement from flow sums.
//!
//! * [`closed_form`]: the paper's eq. 9;
//! * [`least_squares`]: the paper's eq. 7, `(A'A)^-1 A'd`;
//! * [`midpoint`]: exact for finite displacements, at the Cramér-Rao bound, with its covariance.
//!   This is the default;
//! * [`pose`]: the midpoint's extension to targets that turn, with the covariance of displacement
//!   and rotation. The host runs it, the station does not.
//!
//! The first three compute the displacement of the *target in the camera frame* since the
//! keyframe: mm, x right, y down, z away. `solve` is the floating-point form (host and oracle).
//! `solve_fixed` is the form that the station runs: integers, total, and within 1 µm of `solve`
//! over the rated range, quantisation of the sums included.

pub mod closed_form;
pub mod least_squares;
pub mod midpoint;
pub mod pose;
mod quality;

pub use quality::{Gate, Refusal};

/// Displacement per axis, nm.
pub type DisplacementNm = [i32; 3];

#[cfg(test)]
mod tests;
