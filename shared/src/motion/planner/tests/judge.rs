//! Judge of a planner's segments.

use super::*;
use crate::steps::AxisMotion;

/// Judge that checks segments against the physical limits of the configuration, without knowledge
/// of the planner's grid.
pub(super) struct Judge {
    pub(super) configs: [AxisConfig; AXES],
    pub(super) rate: WordRate,
    pub(super) axes: [Seen; AXES],
    pub(super) position: [Position; AXES],
    /// Tolerance for rounding of accelerations and jerks, in acceleration quanta (2 fine units per
    /// slot²).
    pub(super) quanta: i64,
}

/// Observed state of an axis.
#[derive(Clone, Copy, Default)]
pub(super) struct Seen {
    /// Twice the speed at the end of the last segment, fine units per slot: the middle between two
    /// slots is halved.
    pub(super) ended: i64,
    /// Acceleration, fine units per slot².
    pub(super) acceleration: i64,
}

impl Judge {
    pub(super) fn new(configs: [AxisConfig; AXES], rate: WordRate) -> Self {
        Self {
            configs,
            rate,
            axes: [Seen::default(); AXES],
            position: [Position::centre(0); AXES],
            quanta: 0,
        }
    }

    pub(super) fn see(&mut self, segment: &Segment) {
        assert_eq!(segment.slots(), self.rate.slots_per_segment());
        let ways = segment.displacement();
        for (axis, motion) in segment.axes().iter().enumerate() {
            self.see_axis(axis, motion);
            self.position[axis] = self.position[axis].saturating_add(ways[axis]);
        }
    }

    pub(super) fn see_axis(&mut self, axis: usize, motion: &AxisMotion) {
        let slots = i64::from(self.rate.slots_per_segment());
        let sign = if motion.backward { -1 } else { 1 };
        let first = i64::from(motion.first);
        let change = i64::from(motion.change);
        // Twice the speeds half a slot before the first increment and half a slot after the last
        // one.
        let starts = sign * (2 * first - change);
        let mut ends = sign * (2 * first + (2 * slots - 1) * change);
        let was = self.axes[axis].ended;
        if starts == was {
            self.accelerate(axis, sign * change);
        } else {
            // A reversing axis gets the mean speed: a constant acceleration ends the segment as far
            // beyond the mean as the segment began before it. The next one starts there, unless it
            // reverses again.
            assert!(change == 0, "the speed jumps on axis {axis}");
            ends = 2 * starts - was;
            assert!(was * ends < 0, "no turn on axis {axis}");
            assert_eq!((ends - was) % (2 * slots), 0);
            self.accelerate(axis, (ends - was) / (2 * slots));
        }
        self.axes[axis].ended = ends;
        let speed_um_s =
            ends as f64 / 2.0 * self.um_per_fine(axis) * f64::from(self.rate.slots_per_s());
        assert!(
            speed_um_s.abs() <= f64::from(self.configs[axis].max_speed_um_s),
            "{speed_um_s} µm/s"
        );
    }

    pub(super) fn accelerate(&mut self, axis: usize, acceleration: i64) {
        let free = |value: i64| (value.abs() - 2 * self.quanta).max(0) as f64;
        let change = free(acceleration - self.axes[axis].acceleration);
        let slot_rate = f64::from(self.rate.slots_per_s());
        let to_um_s2 = self.um_per_fine(axis) * slot_rate * slot_rate;
        let config = self.configs[axis];
        let um_s2 = free(acceleration) * to_um_s2;
        assert!(
            um_s2 <= f64::from(config.max_acceleration_um_s2),
            "{um_s2} µm/s²"
        );
        // Changes at tick borders only, so by a tick's worth of jerk at most.
        let um_s3 = change * to_um_s2 * 1_000.0;
        assert!(um_s3 <= f64::from(config.max_jerk_um_s3), "{um_s3} µm/s³");
        self.axes[axis].acceleration = acceleration;
    }

    pub(super) fn um_per_fine(&self, axis: usize) -> f64 {
        1e6 / f64::from(self.configs[axis].steps_per_m) / 4_294_967_296.0
    }

    pub(super) fn tick(&mut self, planner: &mut Planner) {
        for segment in planner.plan_tick() {
            self.see(&segment);
        }
        assert_eq!(self.position, planner.positions());
    }
}
