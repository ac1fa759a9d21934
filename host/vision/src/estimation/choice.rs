//! The caller's choice about method and rotation, completed by the rig file.

use std::path::Path;

use trinocular_rig::error::InputError;
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::RigFile;

use super::{Method, Rotation, Rule};

/// Choices of a caller; `None` where the rig file or the default decides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Choice {
    /// Method from points to the displacement.
    pub method: Option<Method>,
    /// Treatment of a target that turns.
    pub rotation: Option<Rotation>,
    /// Point of the target whose displacement is stated.
    pub pivot: Option<Pivot>,
}

/// Choices that contradict each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Contradiction {
    /// A rotation is demanded from a method that knows none.
    #[error("--rotation estimate: {0} knows no rotation; use --method midpoint")]
    NoRotation(Method),
    /// A pivot is given, but no rotation is estimated.
    #[error(
        "--pivot: without a rotation all points of the target move alike; give --rotation \
         estimate, or leave out what refuses it"
    )]
    PivotAlone,
}

impl Method {
    /// Returns true for a method that estimates no rotation.
    const fn knows_no_rotation(self) -> bool {
        matches!(self, Self::ClosedForm | Self::LeastSquares)
    }

    /// Refuses a rig that does not suit the method; errors name `file`.
    ///
    /// # Errors
    /// [`InputError`] with the field that breaks a rule.
    pub fn check_rig(self, file: &Path, rig: &RigFile) -> Result<(), InputError> {
        match self {
            Self::Midpoint => Ok(()),
            Self::ClosedForm | Self::LeastSquares => {
                RigFile::parse_in_line(file, &rig.to_toml()).map(drop)
            }
        }
    }
}

impl Choice {
    /// Returns the rule of the estimate: what is not chosen is as the rig file's `rotation` and
    /// `pivot` say, if the method knows a rotation.
    ///
    /// ```
    /// use trinocular_rig::pivot::Pivot;
    /// use trinocular_rig::rig_file::RigFile;
    /// use trinocular_vision::estimation::{Choice, Contradiction, Rotation};
    ///
    /// let mut rig = RigFile::paper();
    /// let pivot = Some(Pivot::Place([0.0, 0.0, 850.0]));
    /// let choice = Choice { pivot, ..Choice::default() };
    /// assert_eq!(choice.rule(&rig)?.pivot, Pivot::Place([0.0, 0.0, 850.0]));
    ///
    /// rig.rotation = Some(Rotation::Refuse);
    /// assert_eq!(choice.rule(&rig), Err(Contradiction::PivotAlone));
    /// # Ok::<(), Contradiction>(())
    /// ```
    ///
    /// # Errors
    /// [`Contradiction`] between the choices.
    pub fn rule(self, rig: &RigFile) -> Result<Rule, Contradiction> {
        let Self {
            method,
            rotation,
            pivot,
        } = self.completed(rig);
        if rotation == Some(Rotation::Estimate)
            && let Some(method) = method
            && method.knows_no_rotation()
        {
            return Err(Contradiction::NoRotation(method));
        }
        let rule = Rule {
            method,
            rotation,
            pivot: pivot.unwrap_or_default(),
        };
        match pivot {
            Some(_) if rule.estimated_pivot().is_none() => Err(Contradiction::PivotAlone),
            _ => Ok(rule),
        }
    }

    /// Adds what the rig file says about a target that turns.
    fn completed(self, rig: &RigFile) -> Self {
        let knows_none = self.method.is_some_and(Method::knows_no_rotation);
        match (self.rotation, rig.rotation) {
            (None, _) if knows_none => self,
            (None, Some(Rotation::Refuse)) => Self {
                rotation: Some(Rotation::Refuse),
                ..self
            },
            // The defaults.
            (None, None) if rig.pivot == Pivot::Centroid => self,
            (None | Some(Rotation::Estimate), _) => Self {
                rotation: Some(Rotation::Estimate),
                pivot: self.pivot.or(Some(rig.pivot)),
                ..self
            },
            (Some(Rotation::Refuse), _) => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::Use;

    const PLACE: Pivot = Pivot::Place([1.0, 2.0, 800.0]);

    fn turning(pivot: Pivot) -> RigFile {
        let mut rig = RigFile::paper();
        rig.pivot = pivot;
        rig
    }

    fn choice(method: Option<Method>, rotation: Option<Rotation>) -> Choice {
        Choice {
            method,
            rotation,
            pivot: None,
        }
    }

    #[test]
    fn rig_file_decides_what_is_not_chosen() {
        let rule = Choice::default().rule(&turning(PLACE)).unwrap();
        assert_eq!(rule.rotation, Some(Rotation::Estimate));
        assert_eq!(rule.pivot, PLACE);
        let chosen = Choice {
            pivot: Some(Pivot::Centroid),
            ..Choice::default()
        };
        let rule = chosen.rule(&turning(PLACE)).unwrap();
        assert_eq!(
            (rule.rotation, rule.pivot),
            (Some(Rotation::Estimate), Pivot::Centroid)
        );
        let mut rig = RigFile::paper();
        let rule = Choice::default().rule(&rig).unwrap();
        assert_eq!(rule.rotation_use(), Use::Offered);
        // What the file states holds beside a method, too.
        let midpoint = choice(Some(Method::Midpoint), None);
        assert_eq!(midpoint.rule(&rig).unwrap().rotation_use(), Use::Warned);
        rig.rotation = Some(Rotation::Estimate);
        assert_eq!(midpoint.rule(&rig).unwrap().rotation_use(), Use::Demanded);
        rig.rotation = Some(Rotation::Refuse);
        let rule = Choice::default().rule(&rig).unwrap();
        assert_eq!(rule.rotation_use(), Use::Refused);
    }

    #[test]
    fn choice_overrides_rig_file() {
        let refused = choice(None, Some(Rotation::Refuse));
        let rule = refused.rule(&turning(PLACE)).unwrap();
        assert_eq!(
            (rule.rotation, rule.pivot),
            (Some(Rotation::Refuse), Pivot::Centroid)
        );
        let closed = choice(Some(Method::ClosedForm), None);
        let rule = closed.rule(&turning(PLACE)).unwrap();
        assert_eq!((rule.rotation, rule.pivot), (None, Pivot::Centroid));
    }

    #[test]
    fn contradictions_are_refused() {
        let rig = RigFile::paper();
        for method in [Method::ClosedForm, Method::LeastSquares] {
            let turned = choice(Some(method), Some(Rotation::Estimate));
            let expected = Err(Contradiction::NoRotation(method));
            assert_eq!(turned.rule(&rig), expected);
        }
        let alone = |method, rotation| {
            let pivot = Some(PLACE);
            let choice = Choice {
                method,
                rotation,
                pivot,
            };
            choice.rule(&rig) == Err(Contradiction::PivotAlone)
        };
        assert!(!alone(None, None));
        assert!(alone(Some(Method::Midpoint), None));
        assert!(alone(None, Some(Rotation::Refuse)));
    }
}
