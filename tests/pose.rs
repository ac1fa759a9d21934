//! The pose estimator against reference cases, maximum likelihood, and the Cramér-Rao bound.

#[path = "pose/bound.rs"]
mod bound;
#[path = "pose/exact.rs"]
mod exact;
#[path = "pose/likelihood.rs"]
mod likelihood;
#[path = "pose/scene.rs"]
mod scene;
#[path = "pose/vectors.rs"]
mod vectors;
