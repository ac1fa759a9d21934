//! What comes out: the tracked points of one frame, and what is to be said of them.

use super::active_cameras::{self, Absence};
use super::refusal::Rejected;
use super::variance_inflation::Scatter;
use shared::rig::Rig;
use shared::sums::View;

/// One scene point, followed in every camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Per camera that took part, in the rig's order: pixel at the reference instant, pixel now (as
    /// seen, principal point and distortion not removed).
    pub pixels: Vec<[[f64; 2]; 2]>,
}

/// All tracked points of one frame.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Points that passed every test and agree.
    pub tracks: Vec<Track>,
    /// The same points, normalised: per point, one view per camera that took part.
    pub views: Vec<Vec<View>>,
    /// Which cameras of the rig took part, from 0.
    pub cameras: Vec<usize>,
    /// Which did not, and why.
    pub absent: Vec<(usize, Absence)>,
    /// The points that did not, by reason; those of the reference instant included.
    pub rejected: Rejected,
    /// The displacement they agree on (midpoint model), mm.
    pub displacement_mm: [f64; 3],
    /// What the points' scatter says about the error of their mean.
    pub scatter: Scatter,
}

impl Measurement {
    /// The cameras that took part, of the rig that has them all.
    pub fn rig(&self, all: &Rig) -> Rig {
        active_cameras::subset(all, &self.cameras)
    }

    /// What is to be said of the cameras that did not take part, by name.
    pub fn remarks(&self, names: &[String]) -> Vec<String> {
        active_cameras::remarks(&self.absent, names)
    }
}
