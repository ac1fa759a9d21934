use super::Limits;
use super::backlash::Backlash;
use crate::fixed::{product, quotient, times};
use crate::steps::{AXES, Position, Segment, WordRate};
use axis::{AxisPlan, near, within};
use line::StraightMove;
use ramp::Ramp;

mod axis;
mod line;
mod ramp;

const SEGMENTS: usize = WordRate::SEGMENTS_PER_TICK;

/// Planner of the motion of all axes: limited in speed, acceleration and jerk, in the shortest time
/// on the grid, ending at rest exactly in the target's step. See the [module](super).
///
/// Each tick takes the highest acceleration after which the axis can still stop in front of its
/// goal. There is no stored profile: a new target takes effect with the next tick, in any state of
/// motion. If the target is behind, or too close to stop for, the axis overshoots and returns.
///
/// *Duration:* from any state the optimum, rounded up to whole ticks, and at most one tick more, as
/// long as the ramp to the full acceleration takes fewer than `2²⁴/N²` ticks (67 with words at 1
/// MHz). After longer ramps braking may leave more than 1/128 step, which takes some more ticks.
/// See the test `ten_thousand_states_take_optimal_time` and its neighbours.
///
/// *Invariants:* the position is the sum of all displacements handed out, so its floor is what the
/// generator will have emitted. At tick borders no speed, acceleration or jerk exceeds its limit.
///
/// *Stop bound:* from speed `v` and acceleration `a0` (positive if it increases the speed), with
/// limits `a` and `j`, [`Planner::stop`] takes at most
///
/// ```text
/// v a0/j + a0³/3j² + (v'/2)(v'/a + a/j) + (v' + a T) T      v' = v + a0²/2j      a0 > 0, T = 1 ms
/// ```
///
/// after the tick already planned ([`Planner::stopping_distances`] is exact); the last term is the
/// grid's.
///
/// # Example
/// ```
/// use trinocular_core::motion::{AxisConfig, Limits, Planner};
/// use trinocular_core::steps::{Position, WordRate};
///
/// let axis = AxisConfig {
///     steps_per_m: 80_000,
///     max_speed_um_s: 100_000,
///     max_acceleration_um_s2: 1_000_000,
///     max_jerk_um_s3: 50_000_000,
///     travel_um: [-150_000, 150_000],
///     invert: false,
/// };
/// let limits = Limits::new(&[axis; 3], WordRate::MHZ_1)?;
/// let mut planner = Planner::new(limits, [Position::centre(0); 3]);
/// planner.set_target([800, 0, -400].map(Position::centre)); // 10, 0 and -5 mm
/// let mut ticks = 0;
/// while !planner.has_arrived() {
///     planner.plan_tick();
///     ticks += 1;
/// }
/// assert_eq!(planner.positions().map(Position::whole_steps), [800, 0, -400]);
/// assert!((200..260).contains(&ticks)); // d/v + v/a + a/j is 0.22 s
/// # Ok::<(), trinocular_core::motion::ConfigFault>(())
/// ```
#[derive(Clone, Debug)]
pub struct Planner {
    limits: Limits,
    /// Axes at the end of the planned tick.
    axes: [AxisPlan; AXES],
    line: Option<StraightMove>,
    tick: [Segment; SEGMENTS],
    /// Number of the tick's segments that were handed out.
    given: usize,
    /// Positions after the segments handed out.
    positions: [Position; AXES],
    /// Backlash and loads after the segments handed out.
    backlashes: [Backlash; AXES],
}

impl Planner {
    /// Creates a planner at rest at `positions`, without a target. The backlash is taken up
    /// forwards.
    pub fn new(limits: Limits, positions: [Position; AXES]) -> Self {
        let [x, y, z] = limits.axes;
        let [px, py, pz] = positions;
        let axes = [
            AxisPlan::new(x, px),
            AxisPlan::new(y, py),
            AxisPlan::new(z, pz),
        ];
        Self {
            limits,
            axes,
            line: None,
            tick: [Segment::pause(limits.rate.slots_per_segment()); SEGMENTS],
            given: SEGMENTS,
            positions,
            backlashes: [
                Backlash::new(x.backlash(), px),
                Backlash::new(y.backlash(), py),
                Backlash::new(z.backlash(), pz),
            ],
        }
    }

    /// Returns a planner at rest at the same place, with other limits; it drops the rest of the
    /// tick. The load keeps its place between its flanks.
    pub fn relimited(&self, limits: Limits) -> Self {
        let mut planner = Self::new(limits, self.positions);
        let backlashes = planner.backlashes.iter_mut().zip(self.backlashes);
        for ((backlash, old), (axis, motor)) in
            backlashes.zip(limits.axes.iter().zip(self.positions))
        {
            *backlash = old.with_width(axis.backlash(), motor);
        }
        planner
    }

    /// Returns a planner at rest at the same place, with the origin moved back by `steps`: every
    /// position grows by as much. It drops the rest of the tick.
    pub fn shifted(&self, steps: [i64; AXES]) -> Self {
        let by = steps.map(|steps| times(steps, 1 << 32));
        let mut positions = self.positions;
        for (position, by) in positions.iter_mut().zip(by) {
            *position = position.saturating_add(by);
        }
        let mut planner = Self::new(self.limits, positions);
        for ((backlash, old), by) in planner.backlashes.iter_mut().zip(self.backlashes).zip(by) {
            *backlash = old.shifted(by);
        }
        planner
    }

    /// Sends every axis to its target as fast as it can, each on its own; a target outside the soft
    /// limits is replaced by the limit.
    ///
    /// `targets` may lie anywhere within a step; to stand exactly at step `n`, give
    /// [`Position::centre`]`(n)`.
    pub fn set_target(&mut self, targets: [Position; AXES]) {
        self.aim(targets, [0; AXES], false);
    }

    /// Sends the axes that have a target, as [`Planner::set_target`] does.
    ///
    /// An axis without a target continues to its earlier one; if it followed a moving target, it
    /// brakes to rest. At rest it makes no step, not even to take up backlash.
    pub fn set_targets_of(&mut self, targets: [Option<Position>; AXES]) {
        let quantum = self.distance_quantum();
        self.line = None;
        let axes = self.axes.iter_mut().zip(&mut self.backlashes);
        for ((axis, backlash), target) in axes.zip(targets) {
            match target {
                Some(target) => {
                    let target = axis.limits.clamp(target);
                    axis.aim(backlash.aim(target, false), 0);
                }
                None if backlash.is_following() => {
                    axis.aim(axis.stop(quantum), 0);
                    backlash.hold();
                }
                None => axis.aim(axis.target, 0),
            }
        }
    }

    /// Follows a moving target without lag.
    ///
    /// `targets` is its position at the start of the next tick planned, `speeds` its velocity, fine
    /// units (2⁻³² step) per slot, negative backwards. Until the next call the planner assumes that
    /// the target keeps this velocity. The axes stay within the soft limits in any case.
    pub fn follow(&mut self, targets: [Position; AXES], speeds: [i64; AXES]) {
        self.aim(targets, speeds, true);
    }

    /// Follows a moving target with the axis of this number alone, as [`Planner::follow`] does. The
    /// others keep their goals.
    pub fn follow_axis(&mut self, number: usize, target: Position, speed: i64) {
        self.aim_axis(number, target, speed, true);
    }

    fn aim(&mut self, targets: [Position; AXES], speeds: [i64; AXES], follows: bool) {
        for (number, (target, speed)) in targets.into_iter().zip(speeds).enumerate() {
            self.aim_axis(number, target, speed, follows);
        }
    }

    fn aim_axis(&mut self, number: usize, target: Position, speed: i64, follows: bool) {
        self.line = None;
        // Halves, because these have 32 bits, which a Cortex-M4 divides in hardware.
        let size = quotient(speed.saturating_abs() >> 1, self.speed_quantum() / 2);
        let quanta = if speed < 0 { -size } else { size };
        let axis = self.axes.get_mut(number);
        if let (Some(axis), Some(backlash)) = (axis, self.backlashes.get_mut(number)) {
            let target = axis.limits.clamp(target);
            axis.aim(backlash.aim(target, follows), quanta);
        }
    }

    /// Chooses the flank that brings each load to its goal.
    ///
    /// Not on a line, which chose at its beginning and ends at its goals: the share of an axis is
    /// not bound to the axis's own braking, which therefore says nothing about where it stops.
    fn choose_flanks(&mut self) {
        if !self.backlashes.iter().any(Backlash::has_backlash) {
            return;
        }
        let quantum = self.distance_quantum();
        for (axis, backlash) in self.axes.iter_mut().zip(&mut self.backlashes) {
            let distance = axis
                .own
                .stopping_distance(axis.speed - axis.drift, axis.acceleration);
            let stop = axis.position.saturating_add(times(quantum, distance));
            let change = backlash.turn(axis.target, stop, axis.drift, quantum, near(quantum));
            if change != 0 {
                axis.target = axis.target.saturating_add(change);
            }
        }
    }

    /// Sends the axes that have a target in step if all axes are at rest: on the straight line,
    /// starting and arriving together, as fast as the limits of all allow.
    ///
    /// In mid-move each axis goes on its own, as with [`Planner::set_target`]. Axes without a
    /// target are treated as in [`Planner::set_targets_of`].
    pub fn move_in_step(&mut self, targets: [Option<Position>; AXES]) {
        self.set_targets_of(targets);
        if self.is_at_rest() {
            self.choose_flanks();
            self.line = StraightMove::through(&self.axes);
            if let Some(line) = self.line {
                let pace = line.pace(&self.axes);
                if let Some(leader) = self.axes.get_mut(line.leader) {
                    leader.pace = pace;
                }
            }
        }
    }

    /// Brakes every axis to rest at its full acceleration and keeps it there; the position stays
    /// valid.
    pub fn stop(&mut self) {
        let quantum = self.distance_quantum();
        self.line = None;
        for (axis, backlash) in self.axes.iter_mut().zip(&mut self.backlashes) {
            axis.aim(axis.stop(quantum), 0);
            backlash.hold();
        }
    }

    /// Returns the next 250 µs of motion. Every fourth call, from the first, plans a tick, with all
    /// requests since the last one.
    pub fn plan_segment(&mut self) -> Segment {
        if self.given >= SEGMENTS {
            self.next_tick();
            self.given = 0;
        }
        let pause = Segment::pause(self.limits.rate.slots_per_segment());
        let segment = self.tick.get(self.given).copied().unwrap_or(pause);
        self.given += 1;
        let axes = self.positions.iter_mut().zip(&mut self.backlashes);
        for ((position, backlash), distance) in axes.zip(segment.displacement()) {
            *position = position.saturating_add(distance);
            backlash.advance(*position);
        }
        segment
    }

    /// Returns the next millisecond of motion: four segments.
    pub fn plan_tick(&mut self) -> [Segment; SEGMENTS] {
        [(); SEGMENTS].map(|()| self.plan_segment())
    }

    /// Plans a tick in place, because a copy of it costs hundreds of instructions.
    fn next_tick(&mut self) {
        let slots = self.limits.rate.slots_per_segment();
        let quantum = self.distance_quantum();
        if self.line.is_none() {
            self.choose_flanks();
        }
        let accelerations = self.accelerations(quantum);
        let ramp = |axis: &AxisPlan, acceleration| Ramp {
            speed: axis.speed,
            acceleration,
        };
        let ([x, y, z], [ax, ay, az]) = (&self.axes, accelerations);
        let [x, y, z] = [ramp(x, ax), ramp(y, ay), ramp(z, az)];
        let mut distances = [0; AXES];
        for (segment, quarter) in self.tick.iter_mut().zip(0..) {
            let motions = [
                x.quarter(slots, quarter),
                y.quarter(slots, quarter),
                z.quarter(slots, quarter),
            ];
            // Speeds on the grid always make a segment. If they did not, a pause would be safe and
            // the position would stay valid.
            *segment = Segment::new(slots, motions).unwrap_or(Segment::pause(slots));
            for (distance, part) in distances.iter_mut().zip(segment.displacement()) {
                *distance += part;
            }
        }
        for ((axis, distance), acceleration) in
            self.axes.iter_mut().zip(distances).zip(accelerations)
        {
            axis.advance(distance, acceleration, quantum);
        }
        self.line = self.line.filter(|line| {
            self.axes
                .get(line.leader)
                .is_some_and(|leader| !leader.is_at_rest())
        });
    }

    /// Returns the positions of the motors after the segments handed out so far.
    pub fn positions(&self) -> [Position; AXES] {
        self.positions
    }

    /// Returns the positions of the loads after the segments handed out so far: equal to those of
    /// the motors without backlash.
    pub fn loads(&self) -> [Position; AXES] {
        self.backlashes.each_ref().map(Backlash::load)
    }

    /// Returns the targets of the loads, within the soft limits.
    pub fn targets(&self) -> [Position; AXES] {
        let ([x, y, z], [a, b, c]) = (&self.axes, &self.backlashes);
        [a.goal(x.target), b.goal(y.target), c.goal(z.target)]
    }

    /// Returns the velocities of the motors after the segments handed out so far, fine units (2⁻³²
    /// step) per slot, negative backwards.
    pub fn speeds(&self) -> [i64; AXES] {
        let quantum = self.speed_quantum();
        let per_segment = quantum / SEGMENTS as i64;
        let left = (SEGMENTS - self.given) as i64;
        self.axes.each_ref().map(|axis| {
            product(quantum, axis.speed) - product(per_segment * left, axis.acceleration)
        })
    }

    /// Returns the distances that the axes would still move after the present tick if
    /// [`Planner::stop`] were called now, 2⁻³² step, negative backwards. Exact.
    pub fn stopping_distances(&self) -> [i64; AXES] {
        let quantum = self.distance_quantum();
        self.axes
            .each_ref()
            .map(|axis| axis.stopping_distance(quantum))
    }

    /// Returns true for each axis that does not move in the present tick and has no speed left
    /// after it.
    pub fn resting(&self) -> [bool; AXES] {
        self.axes.each_ref().map(AxisPlan::is_at_rest)
    }

    /// Returns true if no axis moves in the present tick or has speed left after it.
    pub fn is_at_rest(&self) -> bool {
        self.axes.iter().all(AxisPlan::is_at_rest)
    }

    /// Returns true if every axis is at rest less than 1/128 step from its target, or less than
    /// four distance quanta where these are more (with words above 5.7 MHz; at 16 MHz they are 1/16
    /// step).
    pub fn has_arrived(&self) -> bool {
        let near = near(self.distance_quantum());
        let arrived =
            |axis: &AxisPlan| axis.is_at_rest() && axis.drift == 0 && within(axis.distance(), near);
        self.axes.iter().all(arrived)
    }

    /// Returns the limits of the planner.
    pub const fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Returns the speed quantum: 2N fine units per slot, see the [module](super).
    fn speed_quantum(&self) -> i64 {
        2 * i64::from(self.limits.rate.slots_per_tick())
    }

    /// Returns the distance quantum: N² fine units.
    fn distance_quantum(&self) -> i64 {
        let slots = i64::from(self.limits.rate.slots_per_tick());
        slots * slots
    }

    /// Returns the acceleration of each axis in the next tick.
    fn accelerations(&mut self, quantum: i64) -> [i64; AXES] {
        let axes = &self.axes;
        let leader = self
            .line
            .as_mut()
            .and_then(|line| Some((axes.get(line.leader)?, line)));
        let Some((leader, line)) = leader else {
            let [x, y, z] = axes;
            return [x.free(quantum), y.free(quantum), z.free(quantum)];
        };
        let [a, b, c] = line.share(leader.speed + leader.choose(quantum));
        let [x, y, z] = axes;
        [a - x.speed, b - y.speed, c - z.speed]
    }
}

#[cfg(test)]
mod tests;
