//! How the cameras sit on the stage, found by moving it: the matrix of the rig file's `[stage]`.
//!
//! A target at rest is watched while the stage goes to known positions along each of its axes. What
//! the cameras measure of it, with the midpoint, is the stage's own motion as they see it: see
//! [`fit`](mod@fit).
//!
//! * [`delay`](mod@delay): how late the cameras' stamps are, from pictures of a moving stage;
//! * [`fit`](mod@fit): displacements at positions to a matrix with standard deviations;
//! * [`plan`]: where the stage goes;
//! * [`watch`]: a reference and what later pictures show against it;
//! * [`rewrite`]: the matrix in the user's own rig file.

pub mod delay;
pub mod fit;
pub mod plan;
pub mod rewrite;
pub mod watch;
