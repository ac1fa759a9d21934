//! Time stamps of a camera with a clock of its own, on the computer's clock.
//!
//! The camera's clock has any zero and runs up to `LARGEST_DRIFT` fast or slow. Each image gives
//! one comparison: its stamp, and its arrival, which is later by a delay that varies but is never
//! negative. The clocks are related by the line below all comparisons of the last `BLOCKS` blocks
//! that is nearest to them: a side of their lower convex hull (Moon, Skelly and Towsley, *Estimation
//! and Removal of Clock Skew from Network Delay Measurements*, INFOCOM 1999).
//!
//! The first images have no time, because a single comparison may have any delay.
//!
//! A converted time is later than the true one by the least delay: half the exposure and the time
//! until the image's first packet, the same for equal cameras with equal settings.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Length of a block, s. Of each block the comparison with the least delay is kept.
const BLOCK_S: f64 = 0.5;

/// Number of blocks that are compared: 16 s.
const BLOCKS: usize = 32;

/// Time for which comparisons are collected before the drift is estimated, s. Before, it counts as
/// zero.
const SETTLING_S: f64 = 4.0;

/// Comparisons, or time that they span in s, before the first image with a time.
const LEAST: u32 = 16;
const LEAST_S: f64 = 0.5;

/// Largest drift between two crystal clocks that work.
const LARGEST_DRIFT: f64 = 2e-4;

/// Largest time by which an image may be early, s. The camera's clock was set anew if it is more.
const EARLY_S: f64 = 0.05;

/// Largest time by which an image may be late, s.
const LATE_S: f64 = 3.0;

/// One comparison: the stamp, and the arrival less the stamp, both since the first image, s.
type Comparison = (f64, f64);

/// Relation of a camera's clock to the computer's.
#[derive(Clone, Debug, Default)]
pub struct DeviceClock {
    /// Stamp in ns and arrival of the first image.
    first: Option<(u64, Instant)>,
    /// Best comparison of each block, oldest first.
    blocks: VecDeque<Comparison>,
    /// Stamp at which the present block ends, s.
    block_end_s: f64,
    /// Number of comparisons.
    count: u32,
}

impl DeviceClock {
    /// Returns the capture time of an image with the stamp `stamp_ns` that arrived at `arrived`;
    /// `None` for the first images after the start, and after a jump of the camera's clock.
    pub fn instant(&mut self, stamp_ns: u64, arrived: Instant) -> Option<Instant> {
        let (first_ns, first) = *self.first.get_or_insert((stamp_ns, arrived));
        let stamp_s = seconds_between(first_ns, stamp_ns);
        let arrived_s = match arrived.checked_duration_since(first) {
            Some(since) => since.as_secs_f64(),
            None => -first.duration_since(arrived).as_secs_f64(),
        };
        let comparison = (stamp_s, arrived_s - stamp_s);
        if let Some(offset_s) = self.offset_s(stamp_s) {
            let late_s = comparison.1 - offset_s;
            if !(-EARLY_S..=LATE_S).contains(&late_s) {
                // The camera's clock has jumped, as at the first synchronisation by PTP.
                *self = Self::default();
                return self.instant(stamp_ns, arrived);
            }
        }
        self.note(comparison);
        self.count = self.count.saturating_add(1);
        if self.count < LEAST && stamp_s < LEAST_S {
            return None;
        }
        let offset_s = self.offset_s(stamp_s)?;
        let since_s = stamp_s + offset_s;
        let since = Duration::from_secs_f64(since_s.abs());
        match since_s < 0.0 {
            true => first.checked_sub(since),
            false => first.checked_add(since),
        }
    }

    fn note(&mut self, comparison: Comparison) {
        match self.blocks.back_mut() {
            Some(best) if comparison.0 < self.block_end_s => {
                if comparison.1 < best.1 {
                    *best = comparison;
                }
            }
            _ => {
                self.block_end_s = comparison.0 + BLOCK_S;
                self.blocks.push_back(comparison);
            }
        }
        if self.blocks.len() > BLOCKS {
            self.blocks.pop_front();
        }
    }

    /// Returns the offset of the computer's clock at a stamp; `None` before the first comparison.
    fn offset_s(&self, stamp_s: f64) -> Option<f64> {
        let drift = self.drift();
        let offsets = self.blocks.iter();
        let offsets = offsets.map(|(at_s, offset_s)| offset_s + drift * (stamp_s - at_s));
        offsets.reduce(f64::min)
    }

    /// Returns the slope of the hull's side below the mean of the comparisons.
    fn drift(&self) -> f64 {
        let span_s = match (self.blocks.front(), self.blocks.back()) {
            (Some(first), Some(last)) => last.0 - first.0,
            _ => 0.0,
        };
        if span_s < SETTLING_S {
            return 0.0;
        }
        let sum_s: f64 = self.blocks.iter().map(|(at_s, _)| at_s).sum();
        let mean_s = sum_s / self.blocks.len() as f64;
        let hull = lower_hull(self.blocks.iter().copied());
        let mut sides = hull.windows(2);
        let side = sides.find(|side| side[1].0 >= mean_s);
        let slope = side.map_or(0.0, |side| {
            (side[1].1 - side[0].1) / (side[1].0 - side[0].0)
        });
        slope.clamp(-LARGEST_DRIFT, LARGEST_DRIFT)
    }
}

/// Returns the lower convex hull of points in the order of their first coordinates.
fn lower_hull(points: impl Iterator<Item = Comparison>) -> Vec<Comparison> {
    let mut hull: Vec<Comparison> = Vec::new();
    for point in points {
        while let [.., a, b] = hull[..] {
            let is_below = (b.0 - a.0) * (point.1 - a.1) > (b.1 - a.1) * (point.0 - a.0);
            if is_below {
                break;
            }
            hull.pop();
        }
        hull.push(point);
    }
    hull
}

fn seconds_between(from_ns: u64, to_ns: u64) -> f64 {
    match to_ns.checked_sub(from_ns) {
        Some(later_ns) => later_ns as f64 * 1e-9,
        None => -((from_ns - to_ns) as f64 * 1e-9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_rig::random::Random;

    /// Returns how much later each converted time is than the true one, µs, but for the first 15
    /// images, for a camera whose clock gains `drift` and whose images are 1 ms under way, or up to 11 ms longer.
    fn errors_us(drift: f64, images: usize) -> Vec<f64> {
        let (start, mut clock) = (Instant::now(), DeviceClock::default());
        let mut random = Random::new(5, 0);
        let errors = (0..images).filter_map(|n| {
            let true_s = n as f64 / 60.0;
            let stamp_ns = 7e15 + true_s * (1.0 + drift) * 1e9;
            let way_s = 1e-3 + random.between(0.0, 0.105_f64).powi(2);
            let arrived = start + Duration::from_secs_f64(true_s + way_s);
            let found = clock.instant(stamp_ns as u64, arrived)?;
            Some((found.duration_since(start).as_secs_f64() - true_s) * 1e6)
        });
        errors.collect()
    }

    /// Bound of the error after settling: 0.05 ms besides the least delay of 1 ms, for any drift
    /// between two crystals.
    #[test]
    fn drifting_clock_is_followed_to_50_us() {
        for drift in [-1e-4, -3e-5, 0.0, 3e-5, 1e-4] {
            let errors = errors_us(drift, 60 * 120);
            let settled = &errors[60 * 8..];
            let worst = settled.iter().map(|error| (error - 1000.0).abs());
            let worst = worst.fold(0.0, f64::max);
            println!("{drift}: {worst:.1} us");
            assert!(worst <= 50.0, "{drift}: {worst} us");
            // Before, the error is the drift of a few seconds.
            let early = errors[60..60 * 8]
                .iter()
                .map(|error| (error - 1000.0).abs());
            assert!(early.fold(0.0, f64::max) <= 800.0, "{drift}");
        }
    }

    #[test]
    fn clock_that_is_set_anew_is_followed() {
        let (start, mut clock) = (Instant::now(), DeviceClock::default());
        for (shift_ns, from) in [(0, 0), (1_700_000_000_000_000_000, 300), (5, 600)] {
            for n in from..from + 300u64 {
                let at = Duration::from_micros(16_667 * n);
                let stamp_ns = shift_ns + at.as_nanos() as u64;
                let found = clock.instant(stamp_ns, start + at + Duration::from_millis(2));
                assert_eq!(found.is_none(), n < from + 15, "{n}");
                let off = found.map(|found| found.duration_since(start + at));
                assert!(off <= Some(Duration::from_micros(2_001)), "{n}: {off:?}");
            }
        }
    }

    #[test]
    fn slow_camera_has_times_after_half_a_second() {
        let (start, mut clock) = (Instant::now(), DeviceClock::default());
        let later = start + Duration::from_secs(1);
        assert_eq!(clock.instant(0, start), None);
        assert_eq!(clock.instant(1_000_000_000, later), Some(later));
    }

    #[test]
    fn image_that_was_held_up_keeps_its_time() {
        let (start, mut clock) = (Instant::now(), DeviceClock::default());
        for n in 0..200u64 {
            let at = Duration::from_micros(16_667 * n);
            let held_up = Duration::from_millis(if n == 150 { 400 } else { 1 });
            let found = clock.instant(at.as_nanos() as u64, start + at + held_up);
            let off = found.map(|found| found.duration_since(start + at));
            assert!(off <= Some(Duration::from_micros(1_001)), "{n}: {off:?}");
        }
    }
}
