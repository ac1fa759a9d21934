//! Images to flow sums, the twin, and the command line of Trinocular.

pub mod flow;
pub mod images;
