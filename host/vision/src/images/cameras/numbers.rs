//! Count of the images that a driver lost, from the sequence numbers of the images it delivers.
//!
//! A driver counts every image, including those for which it has no buffer and those that are
//! damaged. The number has 32 bits and wraps.

/// Sequence numbers of a camera's images so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Numbers {
    last: Option<u32>,
    lost: u64,
}

impl Numbers {
    /// Notes an image with this number. A number that is not ahead of the last means no loss,
    /// because the driver has started again or does not count at all.
    pub fn saw(&mut self, number: u32) {
        let last = self.last.replace(number);
        let step = last.map_or(1, |last| number.wrapping_sub(last));
        if (1..=u32::MAX / 2).contains(&step) {
            self.lost += u64::from(step - 1);
        }
    }

    /// Returns the number of images missing between those delivered.
    pub const fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lost(numbers: &[u32]) -> u64 {
        let mut seen = Numbers::default();
        for number in numbers {
            seen.saw(*number);
        }
        seen.lost()
    }

    #[test]
    fn gaps_are_counted_across_the_wrap() {
        assert_eq!(lost(&[]), 0);
        // Losses before the first image are unknown.
        assert_eq!(lost(&[7, 8, 9]), 0);
        assert_eq!(lost(&[7, 9, 10, 14]), 4);
        assert_eq!(lost(&[u32::MAX - 1, u32::MAX, 0, 1]), 0);
        assert_eq!(lost(&[u32::MAX - 1, 2]), 3);
        assert_eq!(lost(&[0, u32::MAX / 2]), u64::from(u32::MAX / 2) - 1);
    }

    #[test]
    fn restarted_count_loses_nothing() {
        assert_eq!(lost(&[0, 0, 0, 0]), 0);
        assert_eq!(lost(&[500, 501, 0, 1, 2]), 0);
        assert_eq!(lost(&[500, 503, 0, 1, 3]), 3);
    }
}
