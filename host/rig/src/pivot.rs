//! The point of a turning target whose displacement is measured.

use std::fmt;
use std::str::FromStr;

/// Point of the target whose displacement is stated. The points of a target that turns move
/// differently.
///
/// ```
/// use trinocular_rig::pivot::Pivot;
///
/// assert_eq!("centroid".parse(), Ok(Pivot::Centroid));
/// assert_eq!("-12.5,8,850".parse(), Ok(Pivot::Place([-12.5, 8.0, 850.0])));
/// assert!("12,8".parse::<Pivot>().is_err());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Pivot {
    /// The mean of all points at the reference instant.
    #[default]
    Centroid,
    /// A place at the reference instant in the axes and from the origin of the rig file, mm.
    Place([f64; 3]),
}

/// Error of a pivot that could not be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotAPivot;

impl fmt::Display for NotAPivot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("expected centroid, or x, y and z in mm such as 12.5,-8,850")
    }
}

impl std::error::Error for NotAPivot {}

impl Pivot {
    /// Returns the place, mm, given the mean of all points at the reference instant.
    pub const fn place_mm(self, centroid_mm: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Centroid => centroid_mm,
            Self::Place(place) => place,
        }
    }
}

impl FromStr for Pivot {
    type Err = NotAPivot;

    fn from_str(text: &str) -> Result<Self, NotAPivot> {
        if text == "centroid" {
            return Ok(Self::Centroid);
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
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pivots_are_read_with_negative_numbers() {
        let read = |text: &str| text.parse::<Pivot>().ok();
        assert_eq!(read("centroid"), Some(Pivot::Centroid));
        assert_eq!(
            read("-12.5,8, 850"),
            Some(Pivot::Place([-12.5, 8.0, 850.0]))
        );
        for wrong in [
            "", "spot", "1,2", "1,2,3,4", "1,2,x", "1,nan,3", "inf,0,1", "1;2;3",
        ] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn written_pivot_is_read_back() {
        for pivot in [Pivot::Centroid, Pivot::Place([0.1, -2.5e-7, 850.0])] {
            assert_eq!(pivot.to_string().parse(), Ok(pivot));
        }
    }
}
