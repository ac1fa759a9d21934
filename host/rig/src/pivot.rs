//! The point of a turning target whose displacement is measured.

use std::fmt;
use std::str::FromStr;

use crate::rig_file::Laser;

/// Treatment of a target that turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rotation {
    /// Refuse a target that turns by more than 0.15 degrees.
    Refuse,
    /// Estimate the rotation vector with its standard deviation.
    Estimate,
}

/// Point of the target whose displacement is stated. The points of a target that turns move
/// differently.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Pivot {
    /// The mean of all points at the reference instant.
    #[default]
    Centroid,
    /// A place at the reference instant in the axes and from the origin of the rig file, mm.
    Place([f64; 3]),
    /// The point that the ray of this laser meets at the reference instant.
    Spot(Laser),
}

/// Pivot as options and files name it: the ray of a spot is that of the rig file.
///
/// ```
/// use trinocular_rig::pivot::{NoLaser, Pivot, PivotChoice};
///
/// assert_eq!("-12.5,8,850".parse(), Ok(PivotChoice::Place([-12.5, 8.0, 850.0])));
/// assert_eq!("centroid".parse::<PivotChoice>()?.in_rig(None), Ok(Pivot::Centroid));
/// assert_eq!("spot".parse::<PivotChoice>()?.in_rig(None), Err(NoLaser));
/// assert!("12,8".parse::<PivotChoice>().is_err());
/// # Ok::<(), trinocular_rig::pivot::NotAPivot>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PivotChoice {
    /// The mean of all points.
    Centroid,
    /// A place, mm.
    Place([f64; 3]),
    /// The point that the ray of the rig's laser meets.
    Spot,
}

/// Error of a pivot that could not be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotAPivot;

impl fmt::Display for NotAPivot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("expected centroid, spot, or x, y and z in mm such as 12.5,-8,850")
    }
}

impl std::error::Error for NotAPivot {}

/// Error of a spot in a rig that describes no laser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoLaser;

impl fmt::Display for NoLaser {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "the spot is where the ray of the rig file's [laser] meets the target, and there is \
             no such table; add `[laser]` with `from_mm = [0.0, 40.0, 0.0]` and `direction = \
             [0.0, -0.05, 1.0]`",
        )
    }
}

impl std::error::Error for NoLaser {}

impl PivotChoice {
    /// Returns the pivot in a rig with this laser.
    ///
    /// # Errors
    /// [`NoLaser`] for the spot in a rig without a laser.
    pub fn in_rig(self, laser: Option<Laser>) -> Result<Pivot, NoLaser> {
        match self {
            Self::Centroid => Ok(Pivot::Centroid),
            Self::Place(place) => Ok(Pivot::Place(place)),
            Self::Spot => laser.map(Pivot::Spot).ok_or(NoLaser),
        }
    }
}

impl FromStr for PivotChoice {
    type Err = NotAPivot;

    fn from_str(text: &str) -> Result<Self, NotAPivot> {
        match text {
            "centroid" => return Ok(Self::Centroid),
            "spot" => return Ok(Self::Spot),
            _ => {}
        }
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
        match numbers.as_deref() {
            Ok(&[x, y, z]) if [x, y, z].iter().all(|n| n.is_finite()) => Ok(Self::Place([x, y, z])),
            _ => Err(NotAPivot),
        }
    }
}

impl fmt::Display for Pivot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Centroid => f.write_str("centroid"),
            Self::Place([x, y, z]) => write!(f, "{x},{y},{z}"),
            Self::Spot(_) => f.write_str("spot"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LASER: Laser = Laser {
        from_mm: [0.0, 40.0, 0.0],
        direction: [0.0, -0.05, 1.0],
    };

    #[test]
    fn pivots_are_read_with_negative_numbers() {
        let read = |text: &str| text.parse::<PivotChoice>().ok();
        assert_eq!(read("centroid"), Some(PivotChoice::Centroid));
        assert_eq!(read("spot"), Some(PivotChoice::Spot));
        assert_eq!(
            read("-12.5,8, 850"),
            Some(PivotChoice::Place([-12.5, 8.0, 850.0]))
        );
        for wrong in [
            "", "laser", "1,2", "1,2,3,4", "1,2,x", "1,nan,3", "inf,0,1", "1;2;3",
        ] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn written_pivot_is_read_back() {
        for pivot in [
            Pivot::Centroid,
            Pivot::Place([0.1, -2.5e-7, 850.0]),
            Pivot::Spot(LASER),
        ] {
            let read: PivotChoice = pivot.to_string().parse().expect("a pivot");
            assert_eq!(read.in_rig(Some(LASER)), Ok(pivot));
        }
    }

    #[test]
    fn spot_needs_a_laser() {
        assert_eq!(PivotChoice::Spot.in_rig(None), Err(NoLaser));
        assert!(NoLaser.to_string().contains("add `[laser]`"));
    }
}
