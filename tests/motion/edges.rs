//! Speed, acceleration and jerk of an axis from its step edges and nothing else.
//!
//! A step up to `n` says that the position passed `n` in that slot, a step down from `n` the same:
//! so at slot `t` it lies within one slot's motion `r` of `n`. Of samples `n_i` at `t_i` the
//! divided difference of order `k`, times `k!`, is a mean of the `k`th derivative over them, and
//! off by at most
//!
//! ```text
//! k! Σ (r/2) / Π |t_i - t_j|     j ≠ i
//! ```
//!
//! once `r/2` is added to all samples alike. So what exceeds a limit by more than this breaks it,
//! whatever made the edges. Samples at least [`SPACING`] apart make the error small against the
//! limits.

/// Least distance of the samples for speed, acceleration and jerk, s.
const SPACING: [f64; 3] = [0.002, 0.005, 0.010];

/// Factor on the jerk limit. The acceleration changes in steps once per millisecond, and a mean of
/// the jerk over 30 of these is within 1 % of that of a steady one.
const JERK_IN_STEPS: f64 = 1.01;

/// Limits of an axis, and the scale of its edges.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub steps_per_m: u32,
    pub slots_per_s: u32,
    pub speed_um_s: u32,
    pub acceleration_um_s2: u32,
    pub jerk_um_s3: u32,
}

/// The edges of one axis.
#[derive(Clone, Debug, Default)]
pub struct Edges {
    count: i64,
    /// Slot and position of each edge: the whole step that the axis passed.
    passed: Vec<(u64, i64)>,
}

impl Edges {
    /// Records a step in this slot.
    pub fn step(&mut self, slot: u64, forwards: bool) {
        let before = self.count;
        self.count += if forwards { 1 } else { -1 };
        self.passed.push((slot, before.max(self.count)));
    }

    /// Returns the number of steps in both directions.
    pub fn len(&self) -> usize {
        self.passed.len()
    }

    /// Returns the shares of the limits of speed, acceleration and jerk that were certainly
    /// reached.
    ///
    /// # Panics
    /// Panics if a limit was broken.
    pub fn check(&self, bounds: &Bounds) -> [f64; 3] {
        let steps = |um: u32| f64::from(um) * 1e-6 * f64::from(bounds.steps_per_m);
        let limits = [
            bounds.speed_um_s,
            bounds.acceleration_um_s2,
            bounds.jerk_um_s3,
        ]
        .map(steps);
        let limits = [limits[0], limits[1], limits[2] * JERK_IN_STEPS];
        let half = limits[0] / f64::from(bounds.slots_per_s) / 2.0;
        let mut reached = [0.0f64; 3];
        for first in 0..self.passed.len() {
            for order in 1..=3 {
                let Some((mean, error)) = self.derivative(first, order, bounds.slots_per_s) else {
                    continue;
                };
                let (limit, error) = (limits[order - 1], error * half);
                assert!(
                    mean.abs() - error <= limit,
                    "derivative {order} is {mean} ± {error} after slot {}, above {limit} \
                     steps/s^{order}",
                    self.passed[first].0
                );
                let share = &mut reached[order - 1];
                *share = share.max((mean.abs() - error) / limit);
            }
        }
        reached
    }

    /// Returns the mean derivative of this order from edge `first` on, and its error for an error
    /// of 1 in all samples.
    fn derivative(&self, first: usize, order: usize, slots_per_s: u32) -> Option<(f64, f64)> {
        let time = |edge: usize| self.passed[edge].0 as f64 / f64::from(slots_per_s);
        let mut samples = vec![first];
        while samples.len() <= order {
            let last = samples[samples.len() - 1];
            let mut later = last + 1..self.passed.len();
            samples.push(later.find(|edge| time(*edge) - time(last) >= SPACING[order - 1])?);
        }
        let factorial: f64 = (1..=order).map(|n| n as f64).product();
        let origin = self.passed[first].1;
        let (mut mean, mut error) = (0.0, 0.0);
        for &edge in &samples {
            let others = samples.iter().filter(|other| **other != edge);
            let weight = factorial
                / others
                    .map(|other| time(edge) - time(*other))
                    .product::<f64>();
            mean += weight * (self.passed[edge].1 - origin) as f64;
            error += weight.abs();
        }
        Some((mean, error))
    }
}
