//! Monte Carlo study of rotation and displacement: the pose estimator of this program and the
//! alignment of triangulated points (Kabsch) against the Cramér-Rao bound.
//!
//! * [`scene`] holds the targets and their motion;
//! * [`kabsch`] aligns triangulated points, for comparison;
//! * [`bound`] is the least error of any unbiased estimator;
//! * [`trial`] estimates once, [`row`] many times;
//! * [`present`] prints.
//!
//! *Invariant:* every number depends on the number of trials alone, not on threads or time.

pub mod bound;
pub mod kabsch;
pub mod present;
pub mod row;
pub mod scene;
pub mod trial;
