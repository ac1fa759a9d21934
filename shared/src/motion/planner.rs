use core::cmp::Ordering;

use super::backlash::Play;
use super::stopping::Pace;
use super::{AxisLimits, Limits};
use crate::fixed::{product, quotient, times};
use crate::steps::{AXES, AxisMotion, Position, Segment, WordRate};

const SEGMENTS: usize = WordRate::SEGMENTS_PER_TICK;

/// One axis between two ticks.
#[derive(Clone, Copy, Debug)]
struct Axis {
    limits: AxisLimits,
    /// That of the limits.
    own: Pace,
    /// The one in use: slower for the leader of a line.
    pace: Pace,
    position: Position,
    /// Speed quanta, negative backwards. Within the limits.
    speed: i64,
    /// Acceleration of the last tick, quanta.
    acceleration: i64,
    /// Where to be at the start of the next tick.
    target: Position,
    /// How fast the target moves, speed quanta. Within the limits.
    drift: i64,
    /// Farther than this from a soft limit nothing can run into it, distance quanta: a tick and braking, both from the highest speed and acceleration.
    margin: i64,
}

impl Axis {
    fn new(limits: AxisLimits, position: Position) -> Self {
        let own = Pace::of(&limits);
        Self {
            limits,
            own,
            pace: own,
            position,
            speed: 0,
            acceleration: 0,
            target: position,
            drift: 0,
            margin: 2 * own.speed + own.stopping_way(own.speed, own.acceleration),
        }
    }

    /// `target` lies within the limits.
    fn aim(&mut self, target: Position, drift: i64) {
        self.pace = self.own;
        self.target = target;
        self.drift = drift.clamp(-self.pace.speed, self.pace.speed);
    }

    fn is_at_rest(&self) -> bool {
        self.speed == 0 && self.acceleration == 0
    }

    /// From the position to the target, fine units.
    fn way(&self) -> i64 {
        self.target.fine().saturating_sub(self.position.fine())
    }

    /// The acceleration of the next tick; `quantum` is N² fine units.
    ///
    /// Planned as seen from the target, which moves steadily: relative to it the axis comes to rest. It is looked at
    /// from the side on which the goal lies ahead of the point where braking would end, so that it always can be reached
    /// without overshoot from there.
    fn choose(&self, quantum: i64) -> i64 {
        let speed = self.speed - self.drift;
        let way = self.way();
        let left = way.saturating_sub(product(speed, quantum));
        if within(left, near(quantum)) && self.pace.brake(speed, self.acceleration) == -speed {
            // Braking ends in this tick, near enough.
            return -speed;
        }
        let stop = self.pace.stopping_way(speed, self.acceleration);
        let (mut sign, mut ahead) = (1, quotient(way, quantum));
        if stop > ahead {
            (sign, ahead) = (-1, quotient(way.saturating_neg(), quantum));
        }
        let fastest = self.pace.speed - product(sign, self.drift);
        self.towards(sign, speed, ahead, fastest, stop)
    }

    /// The next acceleration, looked for in the direction of `sign`, where `ahead` is the room and `fastest` the limit. `speed` and `stop`, the way
    /// to rest, count forwards.
    #[inline(never)]
    fn towards(&self, sign: i64, speed: i64, ahead: i64, fastest: i64, stop: i64) -> i64 {
        let signed = |value: i64| product(sign, value);
        let (speed, last) = (signed(speed), signed(self.acceleration));
        signed(
            self.pace
                .next_acceleration(speed, last, ahead, fastest, signed(stop)),
        )
    }

    /// `wanted`, or the acceleration nearest to it after which the axis can still stop within the soft limits. (A target
    /// at rest lies within them, and so does every way to it. A moving target may leave them.)
    fn keep_inside(&self, wanted: i64, quantum: i64) -> i64 {
        let [low, high] = self
            .limits
            .motor_ends()
            .map(|end| end.fine().saturating_sub(self.position.fine()));
        let margin = times(quantum, self.margin);
        if low <= margin.saturating_neg() && high >= margin {
            return wanted;
        }
        let behind = quotient(low.saturating_neg(), quantum);
        let ahead = quotient(high, quantum);
        let (speed, fastest) = (self.speed, self.pace.speed);
        let end = speed + wanted;
        let way = speed + end + self.pace.stopping_way(end, wanted);
        if -behind <= way && way <= ahead {
            return wanted;
        }
        let brake = self.pace.brake(speed, self.acceleration);
        let stop = self.pace.stopping_way(speed, self.acceleration);
        let (sign, room) = match wanted.cmp(&brake) {
            Ordering::Equal => return wanted,
            Ordering::Greater => (1, ahead),
            Ordering::Less => (-1, behind),
        };
        let most = self.towards(sign, speed, room, fastest, stop);
        if sign > 0 {
            wanted.min(most)
        } else {
            wanted.max(most)
        }
    }

    /// What the axis does in the next tick when it goes on its own.
    fn free(&self, quantum: i64) -> i64 {
        let wanted = self.choose(quantum);
        if self.drift == 0 {
            wanted
        } else {
            self.keep_inside(wanted, quantum)
        }
    }

    /// Moves on by what was planned for a tick.
    fn advance(&mut self, way: i64, acceleration: i64, quantum: i64) {
        self.position = self.position.saturating_add(way);
        self.target = self.target.saturating_add(product(2 * quantum, self.drift));
        self.speed += acceleration;
        self.acceleration = acceleration;
    }

    /// The way to rest at full braking, fine units.
    fn stopping_way(&self, quantum: i64) -> i64 {
        let way = self.own.stopping_way(self.speed, self.acceleration);
        times(quantum, way)
    }
}

/// How near to its target an axis may come to rest, fine units: 1/128 step, or four distance quanta where these are coarser.
///
/// What braking leaves is mostly less. To go on for it would take two or three ticks, and be no use: the motor stands in the same step.
fn near(quantum: i64) -> i64 {
    (4 * quantum).max(1 << 25)
}

/// Whether `value` is at most `size`, which is positive, in size.
fn within(value: i64, size: i64) -> bool {
    value.unsigned_abs() <= size.unsigned_abs()
}

/// Axes on a straight line: the one with the longest way leads, each other one gets its share of the leader's speed.
#[derive(Clone, Copy, Debug)]
struct Line {
    leader: usize,
    /// Ways of all axes in one unit, below 2³¹ in size; the leader's is positive, the others' negative when opposed to it.
    ways: [i64; AXES],
    /// The leader's way.
    longest: i64,
    /// How far rounding has put each axis in front of its place: distance quanta times `longest`. Within ±2 quanta.
    excess: [i64; AXES],
}

impl Line {
    /// Through the targets of `axes`. `None` when no axis has a way to go.
    fn through(axes: &[Axis; AXES]) -> Option<Self> {
        let ways = axes.map(|axis| axis.way());
        let (leader, way) = ways
            .into_iter()
            .enumerate()
            .max_by_key(|(_, way)| way.unsigned_abs())?;
        // 31 bits of the longest way.
        let shift = 33u32.saturating_sub(way.unsigned_abs().leading_zeros());
        let ways = ways.map(|each| product(each >> shift, way.signum()));
        let longest = way.saturating_abs() >> shift;
        (longest > 0).then_some(Self {
            leader,
            ways,
            longest,
            excess: [0; AXES],
        })
    }

    /// The leader's pace of which no axis's share exceeds its limits. Rounding adds less than two quanta to the acceleration
    /// of the others and less than four to their jerk: these are left free where there is room.
    fn pace(&self, axes: &[Axis; AXES]) -> Pace {
        let least = |limit: fn(&AxisLimits) -> u32, margin: u32| {
            let mut least = u32::MAX;
            for (i, (axis, way)) in axes.iter().zip(self.ways).enumerate() {
                let limit = limit(&axis.limits);
                let limit = if i == self.leader {
                    limit
                } else {
                    limit.saturating_sub(margin).max(1)
                };
                if way != 0 {
                    let most = u64::from(limit) * self.longest.unsigned_abs() / way.unsigned_abs();
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

    /// The speeds that go with the leader's `speed` at the end of the tick. They are rounded down for an axis in front of
    /// its place and up for one behind, so that no error adds up.
    fn share(&mut self, speed: i64) -> [i64; AXES] {
        let mut shares = [0; AXES];
        for ((share, excess), way) in shares.iter_mut().zip(&mut self.excess).zip(self.ways) {
            let exact = product(speed, way);
            let up = *excess <= 0 && exact.rem_euclid(self.longest) != 0;
            *share = exact.div_euclid(self.longest) + i64::from(up);
            // The speed counts in the tick it ends and in the one it starts.
            *excess += 2 * (product(*share, self.longest) - exact);
        }
        shares
    }
}

/// One tick's ramp of an axis: speed at its start and acceleration, quanta.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    speed: i64,
    acceleration: i64,
}

impl Ramp {
    /// The motion in one quarter of the tick, from 0: see the [module](super).
    fn quarter(self, slots: u16, quarter: i64) -> AxisMotion {
        let n = i64::from(slots);
        let e = self.acceleration;
        // All below 2^40: speeds are below 2^32 fine units per slot.
        let start = product(2 * n, 4 * self.speed + product(e, quarter));
        let end = start + product(2 * n, e);
        if (start < 0 && end > 0) || (start > 0 && end < 0) {
            // Turning: the mean speed, which is a whole number too.
            let mean = start + product(n, e);
            return motion(mean, 0, mean < 0);
        }
        let backward = start < 0 || end < 0;
        motion(start + e, 2 * e, backward)
    }
}

/// From signed increments. Whatever did not fit would be rest; speeds on the grid do fit.
fn motion(first: i64, change: i64, backward: bool) -> AxisMotion {
    let forwards = |value: i64| {
        if backward {
            value.saturating_neg()
        } else {
            value
        }
    };
    match (
        u32::try_from(forwards(first)),
        i32::try_from(forwards(change)),
    ) {
        (Ok(first), Ok(change)) => AxisMotion {
            first,
            change,
            backward,
        },
        _ => AxisMotion::REST,
    }
}

/// Plans the motion of all axes, tick by tick, and hands it out segment by segment: limited in speed, acceleration and jerk, in the shortest time on the grid,
/// ending at rest exactly in the step that was asked for. See the [module](super).
///
/// Each tick takes the highest acceleration after which the axis can still stop in front of its goal. So there is no stored profile: a
/// new target takes effect with the next tick, whatever the axis is doing. A target too close to stop for, or behind, is overrun and
/// come back to.
///
/// *Duration:* from any state the optimum, rounded up to whole ticks, and at most one tick more, as long as the ramp to the full
/// acceleration takes fewer than `2²⁴/N²` ticks (67 with words at 1 MHz). After longer ones braking may leave more than 1/128 step, which
/// takes some ticks more. Test `ten_thousand_states_reach_their_targets_in_the_optimal_time` and its neighbours.
///
/// *Invariants:* the position is the sum of all displacements handed out, so its floor is what the generator will have emitted.
/// At tick borders no speed, acceleration or jerk exceeds its limit.
///
/// *Stop bound:* from speed `v` and acceleration `a0` (positive if it speeds the axis up), with limits `a` and `j`,
/// [`Planner::stop`] takes at most
///
/// ```text
/// v a0/j + a0³/3j² + (v'/2)(v'/a + a/j) + (v' + a T) T      v' = v + a0²/2j      a0 > 0, T = 1 ms
/// ```
///
/// after the tick already planned ([`Planner::stopping_ways`] is exact); the last term is the grid's.
#[derive(Clone, Debug)]
pub struct Planner {
    limits: Limits,
    /// At the end of the planned tick.
    axes: [Axis; AXES],
    line: Option<Line>,
    tick: [Segment; SEGMENTS],
    /// How many of the tick's segments were handed out.
    given: usize,
    /// After these.
    positions: [Position; AXES],
    /// What the motors push, after these.
    plays: [Play; AXES],
}

impl Planner {
    /// At rest at `positions`, going nowhere. Lost motion is taken up forwards.
    pub fn new(limits: Limits, positions: [Position; AXES]) -> Self {
        let [x, y, z] = limits.axes;
        let [px, py, pz] = positions;
        let axes = [Axis::new(x, px), Axis::new(y, py), Axis::new(z, pz)];
        Self {
            limits,
            axes,
            line: None,
            tick: [Segment::pause(limits.rate.slots_per_segment()); SEGMENTS],
            given: SEGMENTS,
            positions,
            plays: [
                Play::new(x.backlash(), px),
                Play::new(y.backlash(), py),
                Play::new(z.backlash(), pz),
            ],
        }
    }

    /// At rest where this one is, with other limits; what is left of the tick is forgotten. The load stays where it is between its flanks.
    pub fn relimited(&self, limits: Limits) -> Self {
        let mut planner = Self::new(limits, self.positions);
        let plays = planner.plays.iter_mut().zip(self.plays);
        for ((play, old), (axis, motor)) in plays.zip(limits.axes.iter().zip(self.positions)) {
            *play = old.with_width(axis.backlash(), motor);
        }
        planner
    }

    /// At rest where this one is, with the origin moved back by `steps`: every position grows by as much. What is left of the tick is forgotten.
    pub fn shifted(&self, steps: [i64; AXES]) -> Self {
        let by = steps.map(|steps| times(steps, 1 << 32));
        let mut positions = self.positions;
        for (position, by) in positions.iter_mut().zip(by) {
            *position = position.saturating_add(by);
        }
        let mut planner = Self::new(self.limits, positions);
        for ((play, old), by) in planner.plays.iter_mut().zip(self.plays).zip(by) {
            *play = old.shifted(by);
        }
        planner
    }

    /// Every axis goes to its target as fast as it can, on its own; outside of the soft limits, to the limit.
    ///
    /// `targets` may lie anywhere within a step; to stand exactly at step `n` give [`Position::centre`]`(n)`.
    pub fn set_target(&mut self, targets: [Position; AXES]) {
        self.aim(targets, [0; AXES], false);
    }

    /// Follows a moving target without lag: `targets` is where it is at the start of the next tick planned, `speeds`
    /// how fast it moves, fine units (2⁻³² step) per slot, negative backwards. It is taken to move on like this
    /// until the next call; the axes stay within the soft limits whatever it does.
    pub fn follow(&mut self, targets: [Position; AXES], speeds: [i64; AXES]) {
        self.aim(targets, speeds, true);
    }

    fn aim(&mut self, targets: [Position; AXES], speeds: [i64; AXES], follows: bool) {
        // Halves, for these have 32 bits, in which a Cortex-M4 divides by itself.
        let half_quantum = self.speed_quantum() / 2;
        let quanta = |speed: i64| {
            let size = quotient(speed.saturating_abs() >> 1, half_quantum);
            if speed < 0 { -size } else { size }
        };
        self.line = None;
        let axes = self.axes.iter_mut().zip(&mut self.plays);
        for ((axis, play), (target, speed)) in axes.zip(targets.into_iter().zip(speeds)) {
            let target = axis.limits.clamp(target);
            axis.aim(play.aim(target, follows), quanta(speed));
        }
    }

    /// Chooses the flank that brings each load to its goal.
    fn take_up(&mut self) {
        if !self.plays.iter().any(Play::is_loose) {
            return;
        }
        let quantum = self.distance_quantum();
        for (axis, play) in self.axes.iter_mut().zip(&mut self.plays) {
            let way = axis
                .own
                .stopping_way(axis.speed - axis.drift, axis.acceleration);
            let stop = axis.position.saturating_add(times(quantum, way));
            let change = play.turn(axis.target, stop, axis.drift, quantum, near(quantum));
            if change != 0 {
                // Only a new goal turns an axis of a line, and that ends the line by itself.
                axis.target = axis.target.saturating_add(change);
            }
        }
    }

    /// Like [`Planner::set_target`], but when all axes are at rest they go in step: on the straight line, starting and
    /// arriving together, as fast as the limits of all allow. In mid-move each axis goes on its own.
    pub fn move_in_step(&mut self, targets: [Position; AXES]) {
        self.set_target(targets);
        if self.is_at_rest() {
            self.take_up();
            self.line = Line::through(&self.axes);
            if let Some(line) = self.line {
                let pace = line.pace(&self.axes);
                if let Some(leader) = self.axes.get_mut(line.leader) {
                    leader.pace = pace;
                }
            }
        }
    }

    /// Brakes every axis to rest at its full acceleration and stays there; the position is kept.
    pub fn stop(&mut self) {
        let quantum = self.distance_quantum();
        self.line = None;
        for (axis, play) in self.axes.iter_mut().zip(&mut self.plays) {
            axis.pace = axis.own;
            axis.target = axis.position.saturating_add(axis.stopping_way(quantum));
            axis.drift = 0;
            play.hold();
        }
    }

    /// Goes on from rest at `positions`, where an abrupt stop left the generator. Forgets the target, what is left of the tick, and where the load was.
    pub fn resume_at(&mut self, positions: [Position; AXES]) {
        *self = Self::new(self.limits, positions);
    }

    /// The next 250 µs of motion. Every fourth call, from the first, plans a tick; what was asked for since takes effect then.
    pub fn plan_segment(&mut self) -> Segment {
        if self.given >= SEGMENTS {
            self.next_tick();
            self.given = 0;
        }
        let pause = Segment::pause(self.limits.rate.slots_per_segment());
        let segment = self.tick.get(self.given).copied().unwrap_or(pause);
        self.given += 1;
        let axes = self.positions.iter_mut().zip(&mut self.plays);
        for ((position, play), way) in axes.zip(segment.displacement()) {
            *position = position.saturating_add(way);
            play.advance(*position);
        }
        segment
    }

    /// The next millisecond of motion: four segments.
    pub fn plan_tick(&mut self) -> [Segment; SEGMENTS] {
        [(); SEGMENTS].map(|()| self.plan_segment())
    }

    /// Plans a tick, in place: a copy of it costs hundreds of instructions.
    fn next_tick(&mut self) {
        let slots = self.limits.rate.slots_per_segment();
        let quantum = self.distance_quantum();
        self.take_up();
        let accelerations = self.accelerations(quantum);
        let ramp = |axis: &Axis, acceleration| Ramp {
            speed: axis.speed,
            acceleration,
        };
        let ([x, y, z], [ax, ay, az]) = (&self.axes, accelerations);
        let [x, y, z] = [ramp(x, ax), ramp(y, ay), ramp(z, az)];
        let mut ways = [0; AXES];
        for (segment, quarter) in self.tick.iter_mut().zip(0..) {
            let motions = [
                x.quarter(slots, quarter),
                y.quarter(slots, quarter),
                z.quarter(slots, quarter),
            ];
            // Speeds on the grid always make a segment. Were it not so, a pause is safe and the position stays true.
            *segment = Segment::new(slots, motions).unwrap_or(Segment::pause(slots));
            for (way, part) in ways.iter_mut().zip(segment.displacement()) {
                *way += part;
            }
        }
        for ((axis, way), acceleration) in self.axes.iter_mut().zip(ways).zip(accelerations) {
            axis.advance(way, acceleration, quantum);
        }
        self.line = self.line.filter(|line| {
            self.axes
                .get(line.leader)
                .is_some_and(|leader| !leader.is_at_rest())
        });
    }

    /// Where the motors will be after the segments handed out so far.
    pub fn positions(&self) -> [Position; AXES] {
        self.positions
    }

    /// Where the loads will be then: the same without lost motion.
    pub fn loads(&self) -> [Position; AXES] {
        self.plays.each_ref().map(Play::load)
    }

    /// Where the loads are going, within the soft limits.
    pub fn targets(&self) -> [Position; AXES] {
        let ([x, y, z], [a, b, c]) = (&self.axes, &self.plays);
        [a.goal(x.target), b.goal(y.target), c.goal(z.target)]
    }

    /// Speeds of the motors after the segments handed out so far, fine units (2⁻³² step) per slot, negative backwards.
    pub fn speeds(&self) -> [i64; AXES] {
        let quantum = self.speed_quantum();
        let per_segment = quantum / SEGMENTS as i64;
        let left = (SEGMENTS - self.given) as i64;
        self.axes.each_ref().map(|axis| {
            product(quantum, axis.speed) - product(per_segment * left, axis.acceleration)
        })
    }

    /// How far each axis would still go after the present tick if [`Planner::stop`] were called now, 2⁻³² step, negative
    /// backwards. Exact.
    pub fn stopping_ways(&self) -> [i64; AXES] {
        let quantum = self.distance_quantum();
        self.axes.each_ref().map(|axis| axis.stopping_way(quantum))
    }

    /// No axis moves in the present tick, nor has speed left after it.
    pub fn is_at_rest(&self) -> bool {
        self.axes.iter().all(Axis::is_at_rest)
    }

    /// Every axis is at rest less than 1/128 step from its target, or than four distance quanta if these are more (from words at
    /// 5.7 MHz on; at 16 MHz they are 1/16 step).
    pub fn has_arrived(&self) -> bool {
        let near = near(self.distance_quantum());
        let arrived =
            |axis: &Axis| axis.is_at_rest() && axis.drift == 0 && within(axis.way(), near);
        self.axes.iter().all(arrived)
    }

    /// The limits planned to.
    pub const fn limits(&self) -> &Limits {
        &self.limits
    }

    /// 2N fine units per slot: see the [module](super).
    fn speed_quantum(&self) -> i64 {
        2 * i64::from(self.limits.rate.slots_per_tick())
    }

    /// N² fine units.
    fn distance_quantum(&self) -> i64 {
        let slots = i64::from(self.limits.rate.slots_per_tick());
        slots * slots
    }

    /// What each axis does in the next tick.
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
