/// Position of an axis: an `i64` count of 2⁻³² step (Q31.32), so ±2³¹ steps.
///
/// The motor stands at [`Position::whole_steps`], the floor. A resting axis lies at the
/// [`Position::centre`] of its step, half a step from either neighbour.
///
/// ```
/// use trinocular_core::steps::Position;
///
/// let middle = Position::centre(-3);
/// assert_eq!((middle.whole_steps(), middle.phase()), (-3, 1 << 31));
/// assert_eq!(middle.saturating_add(1 << 32), Position::centre(-2));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position(i64);

impl Position {
    /// Creates the position `fine` · 2⁻³² steps.
    pub const fn from_fine(fine: i64) -> Self {
        Self(fine)
    }

    /// Creates the position in the middle of step number `steps`: `steps` + ½.
    pub const fn centre(steps: i32) -> Self {
        // An i32 fits the upper half of an i64: the shift loses nothing.
        Self(((steps as i64) << 32) | (1 << 31))
    }

    /// Creates the position at `distance` · 2⁻³² steps from the zero of the stage, which is the
    /// middle of step 0.
    pub const fn from_zero(distance: i64) -> Self {
        Self::centre(0).saturating_add(distance)
    }

    /// Returns the distance from the zero of the stage, in 2⁻³² steps. Resting positions have whole
    /// steps.
    pub const fn distance_from_zero(self) -> i64 {
        self.0.saturating_sub(Self::centre(0).0)
    }

    /// Returns the resting position nearest to `distance` · 2⁻³² steps from the zero of the stage.
    ///
    /// ```
    /// use trinocular_core::steps::Position;
    ///
    /// let rest = Position::nearest_rest((7 << 32) + 5);
    /// assert_eq!(rest, Position::centre(7));
    /// assert_eq!(rest.distance_from_zero(), 7 << 32);
    /// ```
    pub const fn nearest_rest(distance: i64) -> Self {
        Self::centre(Self::from_zero(distance).whole_steps())
    }

    /// Returns the position in 2⁻³² step.
    pub const fn fine(self) -> i64 {
        self.0
    }

    /// Returns the floor in steps: the number of steps that the motor has been given.
    pub const fn whole_steps(self) -> i32 {
        (self.0 >> 32) as i32
    }

    /// Returns the fraction beyond the whole step, in 2⁻³² step.
    pub const fn phase(self) -> u32 {
        self.0 as u32
    }

    /// Returns the position moved by `fine` · 2⁻³² steps, saturating at the end of the range.
    pub const fn saturating_add(self, fine: i64) -> Self {
        Self(self.0.saturating_add(fine))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rest_is_nearest_whole_step_from_zero() {
        const HALF: i64 = 1 << 31;
        for (distance, steps) in [
            (0, 0),
            (HALF - 1, 0),
            (HALF, 1),
            (-HALF, 0),
            (-HALF - 1, -1),
        ] {
            assert_eq!(Position::nearest_rest(distance), Position::centre(steps));
            assert_eq!(Position::from_zero(distance).distance_from_zero(), distance);
        }
        let far = [i64::MIN, i64::MAX].map(|end| Position::nearest_rest(end).whole_steps());
        assert_eq!(far, [i32::MIN, i32::MAX]);
    }

    #[test]
    fn floor_and_phase_add_up() {
        for fine in [0, 1, -1, i64::MIN, i64::MAX, (5 << 32) + 7, -(5 << 32) - 7] {
            let p = Position::from_fine(fine);
            assert_eq!(
                (i64::from(p.whole_steps()) << 32) + i64::from(p.phase()),
                fine
            );
            // Complement law of the module documentation.
            let q = Position::from_fine(!fine);
            assert_eq!(q.whole_steps(), -1 - p.whole_steps());
            assert_eq!(q.phase(), !p.phase());
        }
        assert_eq!(Position::centre(-3).whole_steps(), -3);
        assert_eq!(Position::centre(i32::MIN).phase(), 1 << 31);
    }
}
