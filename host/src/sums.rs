//! Tracks to sums.

use crate::flow::Track;
use shared::estimate::{Refusal, closed_form, least_squares, midpoint};
use shared::rig::Rig;
use shared::sums::View;
use shared::sums::centred::CentredSums;
use shared::sums::pair::PairSums;

/// Both kinds of sums over the same points.
#[derive(Clone, Debug)]
pub struct Sums {
    /// For the midpoint estimator.
    pub centred: CentredSums,
    /// For the paper's two estimators; the rig may not be made for them.
    pub pairs: Result<PairSums, Refusal>,
}

impl Sums {
    /// Over `tracks` seen by `rig`.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] for fewer than two cameras.
    pub fn new(rig: &Rig, tracks: &[Track]) -> Result<Self, Refusal> {
        let mut centred = CentredSums::new(rig)?;
        let mut pairs = PairSums::new(rig);
        for track in tracks {
            let cameras = rig.cameras.iter().zip(&track.pixels);
            let views: Vec<View> = cameras.map(|(camera, [start, end])| View::from_pixels(camera, *start, *end)).collect();
            let used = centred.add(&views);
            if let (true, Ok(pairs), [left, middle, right]) = (used, &mut pairs, views.as_slice()) {
                pairs.add([*left, *middle, *right]);
            }
        }
        Ok(Self { centred, pairs })
    }

    /// All three estimates, in floating point.
    pub fn estimates(&self) -> Estimates {
        let with_pairs = |solve: fn(&PairSums) -> Result<[f64; 3], Refusal>| self.pairs.as_ref().map_err(|r| *r).and_then(solve);
        Estimates {
            closed_form: with_pairs(closed_form::solve),
            least_squares: with_pairs(least_squares::solve),
            midpoint: midpoint::solve(&self.centred),
        }
    }
}

/// What each estimator makes of the same points.
#[derive(Clone, Debug)]
pub struct Estimates {
    /// The paper's eq. 9, mm.
    pub closed_form: Result<[f64; 3], Refusal>,
    /// The paper's eq. 7, mm.
    pub least_squares: Result<[f64; 3], Refusal>,
    /// With covariance.
    pub midpoint: Result<midpoint::Estimate, Refusal>,
}
