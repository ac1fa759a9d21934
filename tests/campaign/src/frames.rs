//! Flow frames: valid ones, and some that no camera sends.

use crate::random::Random;
use trinocular_core::frame::message::{Frame, Sums};
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::sums::pair::FixedPairSums;
use trinocular_core::time::Instant;

/// Returns the flow sums of a target displaced by `mm`, with standard deviations of about
/// `sigma_mm` in x and y and 5.7 times that in z.
///
/// The spread is 2^-5 and the coupling is in units of 2^-38 mm, both as the midpoint estimator
/// defines them, so its displacement is exactly `mm`.
pub fn displaced(mm: [f64; 3], sigma_mm: f64) -> Sums {
    let fits = |value: f64| value.round().clamp(-2.1e9, 2.1e9) as i32;
    Sums::Midpoint(FixedCentredSums {
        points: 200,
        freedom: 1_000,
        mean_nm: [fits(mm[0] * 1e6), fits(mm[1] * 1e6)],
        centroid: [0, 0],
        spread: SPREAD,
        exponent: EXPONENT,
        coupling: fits(mm[2] * 1e6 * COUPLING_PER_NM),
        residual_nm: (sigma_mm * 1e6 * 1_000f64.sqrt()).round() as u32,
    })
}

const SPREAD: u32 = 1 << 31;
const EXPONENT: i8 = -4;
/// Units of the coupling that stand for 1 nm of z.
const COUPLING_PER_NM: f64 = 4.0;

/// The frames of a life: some agree with each other, and some with no other frame.
#[derive(Clone, Debug, Default)]
pub struct Views {
    /// Capture time of the last frame set, µs.
    last_us: u64,
    /// Apparent position of the target, mm.
    mm: [f64; 3],
}

impl Views {
    /// Returns a frame that a working camera might send at `now_us`, of a target that wanders.
    pub fn sound(&mut self, random: &mut Random, now_us: u64, origin_us: u64) -> Frame {
        let step = random.decades(0.001, 0.5);
        self.mm = self
            .mm
            .map(|mm| (mm + step * random.normal()).clamp(-30.0, 30.0));
        let capture = now_us.saturating_sub(random.range(1_000.0, 40_000.0) as u64);
        self.last_us = capture;
        Frame {
            capture: Instant::from_micros(capture),
            reference: Instant::from_micros(origin_us),
            sums: displaced(self.mm, 0.005),
        }
    }

    /// Returns a frame with random contents.
    pub fn hostile(&mut self, random: &mut Random, now_us: u64) -> Frame {
        let age = random.decades(1.0, 3e6) as u64;
        let capture = match random.below(6) {
            0 => random.bits() >> 16,
            1 => now_us + age,
            2 => self.last_us,
            _ => now_us.saturating_sub(age),
        };
        let reference = match random.below(5) {
            0 => 0,
            1 => random.bits() >> 16,
            2 => capture,
            3 => now_us.saturating_sub(random.decades(1.0, 3e6) as u64),
            _ => self.last_us,
        };
        self.last_us = capture;
        let any = |random: &mut Random| match random.below(4) {
            0 => random.pick(&[0, 1, -1, i32::MAX, i32::MIN]),
            _ => random.bits() as i32 >> random.below(31),
        };
        let sums = match random.below(4) {
            0 => displaced(
                std::array::from_fn(|_| random.normal() * random.decades(0.01, 200.0)),
                0.01,
            ),
            1 => Sums::ClosedForm(FixedPairSums {
                points: random.bits() as u16,
                a1: any(random),
                a2: any(random),
                a3: any(random),
                b1: any(random),
                b2: any(random),
                b3: any(random),
                d1: any(random),
                d2: any(random),
                d3: any(random),
                d4: any(random),
            }),
            _ => Sums::Midpoint(FixedCentredSums {
                points: random.bits() as u16,
                freedom: random.bits() as u16,
                mean_nm: [any(random), any(random)],
                centroid: [any(random), any(random)],
                spread: random.bits() as u32,
                exponent: (random.below(30) as i8) - 22,
                coupling: any(random),
                residual_nm: random.bits() as u32 >> random.below(31),
            }),
        };
        Frame {
            capture: Instant::from_micros(capture),
            reference: Instant::from_micros(reference),
            sums,
        }
    }
}
