//! Reasons to refuse an estimate, and the station's gate.

use serde::{Deserialize, Serialize};

/// Reason for which an estimator or the gate gives no displacement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// Fewer points than the estimator or the gate needs.
    TooFewPoints,
    /// The points do not determine the displacement: vanishing disparity or spread.
    Degenerate,
    /// A number is not finite or leaves its fixed-point format.
    OutOfRange,
    /// The estimator does not support this rig.
    WrongRig,
    /// The standard deviation of the estimate is above the gate.
    TooUncertain,
    /// The displacement is longer than the gate allows for one frame set.
    TooLarge,
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::TooFewPoints => "too few points",
            Self::Degenerate => {
                "the points do not determine a displacement (no disparity or no spread)"
            }
            Self::OutOfRange => "a number is not finite or out of range",
            Self::WrongRig => "this estimator cannot be used with this rig",
            Self::TooUncertain => "the estimate is too uncertain",
            Self::TooLarge => "the displacement is too large for one frame",
        })
    }
}

impl core::error::Error for Refusal {}

/// Limits that an estimate must meet before the station moves anything. Part of the station's
/// configuration.
///
/// ```
/// use trinocular_core::estimate::{Gate, Refusal};
///
/// let gate = Gate::DEFAULT;
/// assert_eq!(gate.points(7), Err(Refusal::TooFewPoints));
/// assert_eq!(gate.displacement([0, 0, 100_000_001]), Err(Refusal::TooLarge));
/// // Sigma of 0.1, 0.1 and 0.9 mm passes; 0.3 mm along x does not.
/// assert_eq!(gate.variance([100_000_u64.pow(2), 100_000_u64.pow(2), 900_000_u64.pow(2)]), Ok(()));
/// assert_eq!(gate.variance([300_000_u64.pow(2), 0, 0]), Err(Refusal::TooUncertain));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gate {
    /// Smallest number of points.
    pub min_points: u16,
    /// Largest standard deviation per axis, nm. Does not apply to the paper's estimators, which
    /// state none.
    pub max_sigma_nm: [u32; 3],
    /// Largest displacement per axis, nm, in either direction.
    pub max_displacement_nm: u32,
}

impl Gate {
    /// Default gate: 8 points; sigma at most 0.2, 0.2, 1 mm; displacement at most 100 mm (the rated
    /// range).
    pub const DEFAULT: Self = Self {
        min_points: 8,
        max_sigma_nm: [200_000, 200_000, 1_000_000],
        max_displacement_nm: 100_000_000,
    };

    /// Checks the number of points, before an estimator runs.
    ///
    /// # Errors
    /// [`Refusal::TooFewPoints`] below the smallest number.
    pub fn points(&self, points: u16) -> Result<(), Refusal> {
        if points < self.min_points {
            return Err(Refusal::TooFewPoints);
        }
        Ok(())
    }

    /// Checks the length of a displacement.
    ///
    /// # Errors
    /// [`Refusal::TooLarge`] if it is too long on any axis.
    pub fn displacement(&self, displacement_nm: super::DisplacementNm) -> Result<(), Refusal> {
        if displacement_nm
            .iter()
            .any(|d| d.unsigned_abs() > self.max_displacement_nm)
        {
            return Err(Refusal::TooLarge);
        }
        Ok(())
    }

    /// Checks the variances, nm².
    ///
    /// # Errors
    /// [`Refusal::TooUncertain`] if one is too large.
    pub fn variance(&self, variance_nm2: [u64; 3]) -> Result<(), Refusal> {
        let above = |(variance, max): (u64, u32)| variance > u64::from(max) * u64::from(max);
        if variance_nm2.into_iter().zip(self.max_sigma_nm).any(above) {
            return Err(Refusal::TooUncertain);
        }
        Ok(())
    }
}
