//! Straight moves of several axes in step.

use super::axis::AxisPlan;
use crate::fixed::product;
use crate::motion::AxisLimits;
use crate::motion::stopping::Pace;
use crate::steps::AXES;

/// Axes on a straight line: the axis with the longest distance leads, each other axis gets its
/// share of the leader's speed.
#[derive(Clone, Copy, Debug)]
pub(super) struct StraightMove {
    pub(super) leader: usize,
    /// Distances of all axes in one unit, below 2³¹ in size; the leader's is positive, the others'
    /// negative when opposed to it.
    distances: [i64; AXES],
    /// Distance of the leader.
    longest: i64,
    /// Distance by which rounding has put each axis ahead of its place: distance quanta times
    /// `longest`. Within ±2 quanta.
    excess: [i64; AXES],
}

impl StraightMove {
    /// Creates the line through the targets of `axes`, or returns `None` if no axis has to move.
    pub(super) fn through(axes: &[AxisPlan; AXES]) -> Option<Self> {
        let distances = axes.map(|axis| axis.distance());
        let (leader, distance) = distances
            .into_iter()
            .enumerate()
            .max_by_key(|(_, distance)| distance.unsigned_abs())?;
        // 31 bits of the longest distance.
        let shift = 33u32.saturating_sub(distance.unsigned_abs().leading_zeros());
        let distances = distances.map(|each| product(each >> shift, distance.signum()));
        let longest = distance.saturating_abs() >> shift;
        (longest > 0).then_some(Self {
            leader,
            distances,
            longest,
            excess: [0; AXES],
        })
    }

    /// Returns the fastest pace of the leader at which no axis's share exceeds its limits.
    ///
    /// Rounding adds less than two quanta to the acceleration of the others and less than four to
    /// their jerk, which this leaves free where there is room.
    pub(super) fn pace(&self, axes: &[AxisPlan; AXES]) -> Pace {
        let least = |limit: fn(&AxisLimits) -> u32, margin: u32| {
            let mut least = u32::MAX;
            for (i, (axis, distance)) in axes.iter().zip(self.distances).enumerate() {
                let limit = limit(&axis.limits);
                let limit = if i == self.leader {
                    limit
                } else {
                    limit.saturating_sub(margin).max(1)
                };
                if distance != 0 {
                    let most =
                        u64::from(limit) * self.longest.unsigned_abs() / distance.unsigned_abs();
                    least = least.min(u32::try_from(most).unwrap_or(u32::MAX));
                }
            }
            least
        };
        Pace::new(
            least(|l| l.speed, 0),
            least(|l| l.acceleration, 1),
            least(|l| l.jerk, 3),
        )
    }

    /// Returns the speeds of all axes for the leader's `speed` at the end of the tick. They are
    /// rounded down for an axis ahead of its place and up for one behind, so that no error adds up.
    pub(super) fn share(&mut self, speed: i64) -> [i64; AXES] {
        let mut shares = [0; AXES];
        for ((share, excess), distance) in
            shares.iter_mut().zip(&mut self.excess).zip(self.distances)
        {
            let exact = product(speed, distance);
            let up = *excess <= 0 && exact.rem_euclid(self.longest) != 0;
            *share = exact.div_euclid(self.longest) + i64::from(up);
            // The speed counts in the tick it ends and in the one it starts.
            *excess += 2 * (product(*share, self.longest) - exact);
        }
        shares
    }
}
