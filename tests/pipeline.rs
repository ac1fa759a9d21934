//! The whole vision path, images to millimetres, against known truth: rendered posters, and
//! photographs.
//!
//! Whatever is measured must be right or be refused with a reason. What a case may be off by is
//! stated beside it.

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
