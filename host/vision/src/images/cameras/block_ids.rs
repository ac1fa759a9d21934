//! Count of the images of a GenICam camera that never came, from the numbers of those that did.
//!
//! A camera numbers its images ("block ids"). GigE Vision has 16 bits without zero (1 to 65535,
//! then 1 again) or, as USB3 Vision, 64 bits, which do not wrap. The first packet of an image
//! carries the number; an image without it comes without a number.

/// Last number before the 16-bit count begins again at 1.
const WRAP: u64 = 65_535;

/// Largest step ahead in a 16-bit count; anything farther is a step back.
const AHEAD: u64 = WRAP / 2;

/// Numbers of a camera's images so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockIds {
    last: Option<u64>,
    /// Images without a number since the last one with a number.
    nameless: u64,
    lost: u64,
}

impl BlockIds {
    /// Notes an image, whole or not; `None` if its number did not come.
    pub fn saw(&mut self, id: Option<u64>) {
        let Some(id) = id else {
            self.nameless += 1;
            return;
        };
        let nameless = std::mem::take(&mut self.nameless);
        if let Some(last) = self.last.replace(id) {
            // The numbers of the nameless images are among those missing.
            self.lost += missing(last, id).saturating_sub(nameless);
        }
    }

    /// Returns the number of images missing between those that came.
    pub const fn lost(&self) -> u64 {
        self.lost
    }
}

/// Returns the count of numbers between `last` and `id`; 0 after a restart.
const fn missing(last: u64, id: u64) -> u64 {
    let is_short = last <= WRAP && id <= WRAP;
    let step = match id > last {
        true => id - last,
        false if is_short && id > 0 => id + WRAP - last,
        false => return 0,
    };
    match is_short && step > AHEAD {
        true => 0,
        false => step.saturating_sub(1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lost(ids: &[Option<u64>]) -> u64 {
        let mut seen = BlockIds::default();
        for id in ids {
            seen.saw(*id);
        }
        seen.lost()
    }

    fn lost_of(ids: &[u64]) -> u64 {
        lost(&ids.iter().copied().map(Some).collect::<Vec<_>>())
    }

    #[test]
    fn gaps_are_counted_across_the_wrap() {
        assert_eq!(lost_of(&[7, 8, 9, 12]), 2);
        assert_eq!(lost_of(&[65_534, 65_535, 1, 2]), 0);
        assert_eq!(lost_of(&[65_534, 2]), 2);
        // Long numbers pass the end of the short ones.
        assert_eq!(lost_of(&[65_535, 65_536, 65_540]), 3);
        assert_eq!(lost_of(&[0, 1, 3]), 1);
        assert_eq!(lost_of(&[1 << 40, (1 << 40) + 100_000]), 99_999);
    }

    #[test]
    fn restarted_count_loses_nothing() {
        assert_eq!(lost_of(&[500, 1, 2, 3]), 0);
        assert_eq!(lost_of(&[500, 0, 1]), 0);
        assert_eq!(lost_of(&[1 << 40, 5, 6]), 0);
        assert_eq!(lost_of(&[5, 5, 6]), 0);
    }

    #[test]
    fn nameless_images_are_not_lost() {
        assert_eq!(lost(&[Some(5), None, Some(7)]), 0);
        assert_eq!(lost(&[Some(5), None, Some(9)]), 2);
        assert_eq!(lost(&[None, None, Some(9), Some(11)]), 1);
        // The nameless image was one whose number has been seen already.
        assert_eq!(lost(&[Some(5), None, Some(6), Some(8)]), 1);
    }
}
