use super::Limits;
use super::backlash::Play;
use crate::fixed::{product, quotient, times};
use crate::steps::{AXES, Position, Segment, WordRate};
use axis::{Axis, near, within};
use line::Line;
use ramp::Ramp;

mod axis;
mod line;
mod ramp;

const SEGMENTS: usize = WordRate::SEGMENTS_PER_TICK;

/// Plans the motion of all axes, tick by tick, and hands it out segment by segment: limited in
/// speed, acceleration and jerk, in the shortest time on the grid, ending at rest exactly in the
/// step that was asked for. See the [module](super).
///
/// Each tick takes the highest acceleration after which the axis can still stop in front of its
/// goal. So there is no stored profile: a new target takes effect with the next tick, whatever the
/// axis is doing. A target too close to stop for, or behind, is overrun and come back to.
///
/// *Duration:* from any state the optimum, rounded up to whole ticks, and at most one tick more, as
/// long as the ramp to the full acceleration takes fewer than `2²⁴/N²` ticks (67 with words at 1
/// MHz). After longer ones braking may leave more than 1/128 step, which takes some ticks more.
/// Test `ten_thousand_states_reach_their_targets_in_the_optimal_time` and its neighbours.
///
/// *Invariants:* the position is the sum of all displacements handed out, so its floor is what the
/// generator will have emitted. At tick borders no speed, acceleration or jerk exceeds its limit.
///
/// *Stop bound:* from speed `v` and acceleration `a0` (positive if it speeds the axis up), with
/// limits `a` and `j`, [`Planner::stop`] takes at most
///
/// ```text
/// v a0/j + a0³/3j² + (v'/2)(v'/a + a/j) + (v' + a T) T      v' = v + a0²/2j      a0 > 0, T = 1 ms
/// ```
///
/// after the tick already planned ([`Planner::stopping_ways`] is exact); the last term is the
/// grid's.
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

    /// At rest where this one is, with other limits; what is left of the tick is forgotten. The
    /// load stays where it is between its flanks.
    pub fn relimited(&self, limits: Limits) -> Self {
        let mut planner = Self::new(limits, self.positions);
        let plays = planner.plays.iter_mut().zip(self.plays);
        for ((play, old), (axis, motor)) in plays.zip(limits.axes.iter().zip(self.positions)) {
            *play = old.with_width(axis.backlash(), motor);
        }
        planner
    }

    /// At rest where this one is, with the origin moved back by `steps`: every position grows by as
    /// much. What is left of the tick is forgotten.
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

    /// Every axis goes to its target as fast as it can, on its own; outside of the soft limits, to
    /// the limit.
    ///
    /// `targets` may lie anywhere within a step; to stand exactly at step `n` give
    /// [`Position::centre`]`(n)`.
    pub fn set_target(&mut self, targets: [Position; AXES]) {
        self.aim(targets, [0; AXES], false);
    }

    /// Sends the axes that have a target, as [`Planner::set_target`] does.
    ///
    /// An axis without one goes on to its earlier target; if it followed a moving target it brakes
    /// to rest. At rest it makes no step, not even to take up lost motion.
    pub fn set_targets_of(&mut self, targets: [Option<Position>; AXES]) {
        let quantum = self.distance_quantum();
        self.line = None;
        let axes = self.axes.iter_mut().zip(&mut self.plays);
        for ((axis, play), target) in axes.zip(targets) {
            match target {
                Some(target) => {
                    let target = axis.limits.clamp(target);
                    axis.aim(play.aim(target, false), 0);
                }
                None if play.is_following() => {
                    axis.aim(axis.stop(quantum), 0);
                    play.hold();
                }
                None => axis.aim(axis.target, 0),
            }
        }
    }

    /// Follows a moving target without lag: `targets` is where it is at the start of the next tick
    /// planned, `speeds` how fast it moves, fine units (2⁻³² step) per slot, negative backwards. It
    /// is taken to move on like this until the next call; the axes stay within the soft limits
    /// whatever it does.
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

    /// Like [`Planner::set_target`], but when all axes are at rest they go in step: on the straight
    /// line, starting and arriving together, as fast as the limits of all allow. In mid-move each
    /// axis goes on its own. Axes without a target are treated as [`Planner::set_targets_of`] does.
    pub fn move_in_step(&mut self, targets: [Option<Position>; AXES]) {
        self.set_targets_of(targets);
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
            axis.aim(axis.stop(quantum), 0);
            play.hold();
        }
    }

    /// The next 250 µs of motion. Every fourth call, from the first, plans a tick; what was asked
    /// for since takes effect then.
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
            // Speeds on the grid always make a segment. Were it not so, a pause is safe and the
            // position stays true.
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

    /// Speeds of the motors after the segments handed out so far, fine units (2⁻³² step) per slot,
    /// negative backwards.
    pub fn speeds(&self) -> [i64; AXES] {
        let quantum = self.speed_quantum();
        let per_segment = quantum / SEGMENTS as i64;
        let left = (SEGMENTS - self.given) as i64;
        self.axes.each_ref().map(|axis| {
            product(quantum, axis.speed) - product(per_segment * left, axis.acceleration)
        })
    }

    /// How far each axis would still go after the present tick if [`Planner::stop`] were called
    /// now, 2⁻³² step, negative backwards. Exact.
    pub fn stopping_ways(&self) -> [i64; AXES] {
        let quantum = self.distance_quantum();
        self.axes.each_ref().map(|axis| axis.stopping_way(quantum))
    }

    /// Axes that do not move in the present tick and have no speed left after it.
    pub fn resting(&self) -> [bool; AXES] {
        self.axes.each_ref().map(Axis::is_at_rest)
    }

    /// No axis moves in the present tick, nor has speed left after it.
    pub fn is_at_rest(&self) -> bool {
        self.axes.iter().all(Axis::is_at_rest)
    }

    /// Every axis is at rest less than 1/128 step from its target, or than four distance quanta if
    /// these are more (from words at 5.7 MHz on; at 16 MHz they are 1/16 step).
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
