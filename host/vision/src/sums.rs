//! Flow sums of correspondences.

use crate::flow::{Correspondence, Measurement};
use trinocular_core::estimate::{Refusal, closed_form, least_squares, midpoint};
use trinocular_core::frame::message::Sums as FrameSums;
use trinocular_core::rig::Rig;
use trinocular_core::sums::centred::CentredSums;
use trinocular_core::sums::pair::PairSums;

/// Estimator of the station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// Closed form, the paper's eq. 9.
    ClosedForm,
    /// Midpoint model, the default.
    Midpoint,
}

/// Both kinds of flow sums over the same points.
///
/// ```
/// use trinocular_core::rig::Rig;
/// use trinocular_vision::flow::Correspondence;
/// use trinocular_vision::sums::Sums;
///
/// let rig = Rig::paper();
/// let points = [[-60.0, -40.0, 900.0], [55.0, -35.0, 940.0], [5.0, 60.0, 880.0]];
/// let seen = points.map(|[x, y, z]| {
///     let pixels = rig.cameras.iter();
///     let pixels = pixels.map(|camera| [[x, y, z], [x + 1.0, y, z]].map(|mm| camera.project(mm)));
///     Correspondence::from_pixels(&rig, pixels.collect())
/// });
/// let estimates = Sums::new(&rig, &seen)?.estimates();
/// assert!((estimates.midpoint?.displacement_mm[0] - 1.0).abs() < 1e-9);
/// assert!((estimates.closed_form?[0] - 1.0).abs() < 1e-9);
/// # Ok::<(), trinocular_core::estimate::Refusal>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sums {
    /// Sums for the midpoint estimator.
    pub centred: CentredSums,
    /// Sums for the paper's two estimators, or the reason why the rig does not suit them.
    pub pairs: Result<PairSums, Refusal>,
}

impl Sums {
    /// Computes the sums over `correspondences` of the cameras of `rig`, with the variance of
    /// independent errors.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] for fewer than two cameras.
    pub fn new(rig: &Rig, correspondences: &[Correspondence]) -> Result<Self, Refusal> {
        let mut centred = CentredSums::new(rig)?;
        let mut pairs = PairSums::new(rig);
        for Correspondence { views, .. } in correspondences {
            let used = centred.add(views);
            if let (true, Ok(pairs), [left, middle, right]) = (used, &mut pairs, views.as_slice()) {
                pairs.add([*left, *middle, *right]);
            }
        }
        Ok(Self { centred, pairs })
    }

    /// Computes the sums over the inliers of a measurement, given the whole rig, with the measured
    /// variance inflation. Those of a rotation have the pivot's displacement and its variance, and
    /// suit the midpoint estimator alone.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] for fewer than two cameras, [`Refusal::Degenerate`] for a displacement
    /// without a variance.
    pub fn of(rig: &Rig, measurement: &Measurement) -> Result<Self, Refusal> {
        let rig = measurement.rig(rig);
        if let Some(turn) = &measurement.turn {
            let points = measurement.correspondences.len() as u32;
            let (moved_mm, sigma) = (measurement.displacement_mm, turn.sigma);
            return Ok(Self {
                centred: CentredSums::of_displacement(
                    &rig,
                    points,
                    moved_mm,
                    turn.covariance_mm2,
                    sigma,
                )?,
                pairs: Err(Refusal::WrongRig),
            });
        }
        let mut sums = Self::new(&rig, &measurement.correspondences)?;
        sums.centred.overlap = measurement.variance_inflation.factor;
        Ok(sums)
    }

    /// Converts the sums to the fixed-point form of the wire, for one of the station's estimators.
    ///
    /// # Errors
    /// [`Refusal`] if the rig does not suit the estimator, or a number does not fit its format.
    pub fn frame(&self, estimator: Estimator) -> Result<FrameSums, Refusal> {
        match estimator {
            Estimator::Midpoint => self.centred.quantise().map(FrameSums::Midpoint),
            Estimator::ClosedForm => self.pairs?.quantise().map(FrameSums::ClosedForm),
        }
    }

    /// Computes all three estimates, in floating point.
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

/// Estimates of the same points by all three estimators.
#[derive(Clone, Debug)]
pub struct Estimates {
    /// Displacement by the closed form, the paper's eq. 9, mm.
    pub closed_form: Result<[f64; 3], Refusal>,
    /// Displacement by least squares, the paper's eq. 7, mm.
    pub least_squares: Result<[f64; 3], Refusal>,
    /// Displacement by the midpoint model, with its covariance.
    pub midpoint: Result<midpoint::Estimate, Refusal>,
}
