//! The whole vision path, from images to millimetres, against known truth: rendered posters and
//! photographs.
//!
//! Every measurement must be right, or be refused with a reason. The bound of a case is stated
//! beside it.

#[path = "pipeline/bench.rs"]
mod bench;
#[path = "pipeline/moves.rs"]
mod moves;
#[path = "pipeline/photograph.rs"]
mod photograph;
#[path = "pipeline/poster.rs"]
mod poster;
#[path = "pipeline/repetition.rs"]
mod repetition;
#[path = "pipeline/rigs.rs"]
mod rigs;
#[path = "pipeline/sigma.rs"]
mod sigma;
#[path = "pipeline/table.rs"]
mod table;
