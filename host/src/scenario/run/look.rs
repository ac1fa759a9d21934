//! Steps and reversals, by looking at the pins often.

/// What was last seen at the pins.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Look {
    /// Steps made so far, backward ones subtracted.
    steps: [i64; 3],
    /// The last direction, 0 before the first step.
    direction: [i64; 3],
    /// Reversals of direction so far.
    pub reversals: [u32; 3],
}

impl Look {
    /// The first look.
    pub fn at(steps: [i64; 3]) -> Self {
        Self {
            steps,
            ..Self::default()
        }
    }

    /// Looks again.
    pub fn again(&mut self, steps: [i64; 3]) {
        for (axis, now) in steps.into_iter().enumerate() {
            let direction = (now - self.steps[axis]).signum();
            if direction != 0 {
                self.reversals[axis] += u32::from(direction == -self.direction[axis]);
                self.direction[axis] = direction;
            }
        }
        self.steps = steps;
    }
}
