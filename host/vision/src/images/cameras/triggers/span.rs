//! Times between two bounds.

/// Times between two bounds, µs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    pub from_us: i64,
    pub to_us: i64,
}

impl Span {
    /// Returns the times that lie at most `by_us` outside.
    pub fn wider(self, by_us: i64) -> Self {
        Self {
            from_us: self.from_us - by_us,
            to_us: self.to_us + by_us,
        }
    }

    /// Returns the times that lie in both; `None` if there are none.
    pub fn common(self, other: Self) -> Option<Self> {
        let from_us = self.from_us.max(other.from_us);
        let to_us = self.to_us.min(other.to_us);
        (from_us <= to_us).then_some(Self { from_us, to_us })
    }

    /// Returns the time from an event in this span to `at_us`.
    pub fn until(self, at_us: i64) -> Self {
        Self {
            from_us: at_us - self.to_us,
            to_us: at_us - self.from_us,
        }
    }

    pub fn width_us(self) -> i64 {
        self.to_us - self.from_us
    }
}
