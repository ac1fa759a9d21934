//! Tracks to sums.

use crate::flow::{Measurement, Track};
use shared::estimate::{Refusal, closed_form, least_squares, midpoint};
use shared::frame::message::Sums as FrameSums;
use shared::rig::Rig;
use shared::sums::View;
use shared::sums::centred::CentredSums;
use shared::sums::pair::PairSums;

/// The station's estimators.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// The paper's eq. 9.
    ClosedForm,
    /// The default.
    Midpoint,
}

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
            let views: Vec<View> = cameras
                .map(|(camera, [start, end])| View::from_pixels(camera, *start, *end))
                .collect();
            let used = centred.add(&views);
            if let (true, Ok(pairs), [left, middle, right]) = (used, &mut pairs, views.as_slice()) {
                pairs.add([*left, *middle, *right]);
            }
        }
        Ok(Self { centred, pairs })
    }

    /// Over the tracks of a measurement, in the cameras of `rig` that took part; sigma takes into
    /// account that its windows overlap and what all of them have in common.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] for fewer than two cameras.
    pub fn of(rig: &Rig, measurement: &Measurement) -> Result<Self, Refusal> {
        let mut sums = Self::new(&measurement.rig(rig), &measurement.tracks)?;
        if let Ok(white) = midpoint::solve(&sums.centred) {
            let count = f64::from(2 * sums.centred.observations());
            sums.centred.overlap = widening(measurement.scatter.widening, white.sigma_px, count);
        }
        Ok(sums)
    }

    /// As they cross the wire, for one of the station's estimators.
    ///
    /// # Errors
    /// If the rig is not made for the estimator, or a number does not fit.
    pub fn frame(&self, estimator: Estimator) -> Result<FrameSums, Refusal> {
        match estimator {
            Estimator::Midpoint => self.centred.quantise().map(FrameSums::Midpoint),
            Estimator::ClosedForm => self.pairs?.quantise().map(FrameSums::ClosedForm),
        }
    }

    /// All three estimates, in floating point.
    pub fn estimates(&self) -> Estimates {
        let with_pairs = |solve: fn(&PairSums) -> Result<[f64; 3], Refusal>| {
            self.pairs.as_ref().map_err(|r| *r).and_then(solve)
        };
        Estimates {
            closed_form: with_pairs(closed_form::solve),
            least_squares: with_pairs(least_squares::solve),
            midpoint: midpoint::solve(&self.centred),
        }
    }
}

/// Error of sub-pixel tracking that all points have in common, px: what is left of its dependence
/// on the phase of the pixel grid when the points are spread over all phases. No residual shows it.
/// `trinocular bench robustness --only bias` measures it: where all points move alike it is below
/// 0.00003 px at every phase; motions along z and scenes of several depths mix the phases. With
/// this value, errors of sharp posters at a noise of half a grey level are what sigma says or a
/// little less (the rows `plain`, `still` and `500-mm` with `--noise`).
const COMMON_PX: f64 = 0.000_05;

/// By how much the variance of a mean over `count` flow components is larger than their scatter
/// `sigma_px` tells, where `overlap` is for what they do not err independently in
/// ([`crate::flow::variance_inflation`] measures it):
///
/// ```text
/// variance = overlap s²/count + common² = (overlap + common² count/s²) s²/count
/// ```
///
/// It reaches the station as fewer degrees of freedom, so the wire has no field for it. Depth noise
/// is in the residual: where `g` is wrong, `v - g T` is not zero. A turn too small to be refused,
/// or a camera slightly off, is in `overlap` too ([`crate::flow::rotation`], [`crate::flow::sync`]).
pub(crate) fn widening(overlap: f64, sigma_px: f64, count: f64) -> f64 {
    let common = COMMON_PX * COMMON_PX * count / (sigma_px * sigma_px);
    // Without scatter there is nothing to widen.
    if common.is_finite() {
        overlap + common
    } else {
        overlap
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
