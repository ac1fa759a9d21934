//! Counts steps and reversals by frequent inspection of the pins.

/// State of the pins at the last inspection.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Look {
    /// Steps made so far, backward ones subtracted.
    steps: [i64; 3],
    /// Last direction, 0 before the first step.
    direction: [i64; 3],
    /// Number of reversals of direction so far.
    pub reversals: [u32; 3],
}

impl Look {
    /// Creates the state at the first inspection.
    pub fn at(steps: [i64; 3]) -> Self {
        Self {
            steps,
            ..Self::default()
        }
    }

    /// Inspects the pins again.
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
