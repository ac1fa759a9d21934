//! Hand-eye calibration: measures the matrix of the rig file's `[stage]` by moving the stage.
//!
//! The cameras watch a target at rest while the stage goes to known positions along each of its
//! axes. The displacement that they measure, with the midpoint, is the stage's own motion along
//! camera axes: see [`fit`](mod@fit).
//!
//! * [`delay`](mod@delay): the delay of the cameras' time stamps, from images of a moving stage;
//! * [`latency`](mod@latency): the delay of each camera's time stamps, from its own images alone;
//! * [`pixel_motion`]: the motion of one camera's points;
//! * [`fit`](mod@fit): the matrix and its standard deviations, from displacements at positions;
//! * [`plan`]: the stops of the stage;
//! * [`watch`]: displacements of later images against a keyframe;
//! * [`rewrite`]: replacement of matrix and delays in the user's own rig file.

pub mod delay;
pub mod fit;
pub mod latency;
pub mod pixel_motion;
pub mod plan;
pub mod rewrite;
pub mod watch;
