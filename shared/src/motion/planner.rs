use super::{AxisLimits, Limits};
use crate::steps::{AXES, AxisMotion, Position, Segment};

/// Speed and change of speed per segment an axis keeps to, in the grid of the [module](super); both from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Pace {
    speed: u32,
    acceleration: u32,
}

impl Pace {
    /// The shortest way from speed `m` to rest, in distance quanta: full braking, the odd rest last.
    ///
    /// With `m = k a + r` the speeds are `m, m-a, ..., r, 0`; a segment from `u` to `w` is `u + w` long, hence
    /// `a k² + (2k + 1) r`. Below 2⁶⁰ for every speed on the grid.
    fn stopping_distance(self, m: u32) -> i64 {
        let a = i64::from(self.acceleration);
        let k = i64::from(m / self.acceleration);
        let r = i64::from(m % self.acceleration);
        a * k * k + (2 * k + 1) * r
    }

    /// The highest speed at the end of the next segment from which the axis can still stop within `ahead` quanta,
    /// counted from the segment's start, where its speed is `now`. When there is none, full braking.
    ///
    /// The largest `w` with `now + w + stopping_distance(w) <= ahead`. For `w = k a + r` the left side is
    /// `now + a k (k+1) + (2k+2) r`, which grows with `w`; and `w` lies within one `a` of `now`, so there are only
    /// three `k` to try.
    fn next_speed(self, now: u32, ahead: i64) -> u32 {
        let a = self.acceleration;
        let slowest = now.saturating_sub(a);
        let fastest = now.saturating_add(a).min(self.speed).max(slowest);
        let k_now = now / a;
        let candidates = [k_now.checked_add(1), Some(k_now), k_now.checked_sub(1)];
        for k in candidates.into_iter().flatten() {
            let k = i64::from(k);
            let a = i64::from(a);
            let spare = ahead - i64::from(now) - a * k * (k + 1);
            if spare >= 0 {
                let r = (spare / (2 * k + 2)).min(a);
                // Below 2³¹: k a is at most now + a.
                let speed = u32::try_from(k * a + r).unwrap_or(u32::MAX);
                return speed.clamp(slowest, fastest);
            }
        }
        slowest
    }
}

/// One axis between two segments.
#[derive(Clone, Copy, Debug)]
struct Axis {
    limits: AxisLimits,
    pace: Pace,
    position: Position,
    /// Speed quanta, negative backwards. At most 2²⁹.
    speed: i32,
    /// Where to be at the start of the next segment.
    target: Position,
    /// How fast the target moves: speed quanta.
    drift: i32,
}

impl Axis {
    fn new(limits: AxisLimits, position: Position) -> Self {
        Self {
            limits,
            pace: limits.pace(),
            position,
            speed: 0,
            target: position,
            drift: 0,
        }
    }

    /// The way to stop from `m` speed quanta at full braking, fine units, signed like `m`.
    fn stopping_way(&self, m: i32, slots: u16) -> i64 {
        let quantum = i64::from(slots) * i64::from(slots);
        let way = quantum.saturating_mul(self.limits.pace().stopping_distance(m.unsigned_abs()));
        if m < 0 { -way } else { way }
    }

    /// Chooses the next segment's ramp: start speed, end speed, backward.
    ///
    /// Planned as seen from the target, which moves steadily: relative to it the axis comes to rest.
    fn ramp(&mut self, slots: u16) -> (u32, u32, bool) {
        let quantum = i64::from(slots) * i64::from(slots);
        let way = self.target.fine().saturating_sub(self.position.fine());
        self.target = self
            .target
            .saturating_add(2 * quantum * i64::from(self.drift));

        let relative = self.speed - self.drift;
        let backward = if relative == 0 { way < 0 } else { relative < 0 };
        let (ahead, drift) = if backward {
            (way.saturating_neg(), -self.drift)
        } else {
            (way, self.drift)
        };
        // The drift is within the axis's speed; a pace below it (axes in step) has no drift.
        let fastest = self.pace.speed.saturating_add_signed(-drift);
        let pace = Pace {
            speed: fastest,
            ..self.pace
        };
        let next = pace
            .next_speed(relative.unsigned_abs(), ahead.div_euclid(quantum))
            .cast_signed();
        let wanted = self.drift + if backward { -next } else { next };

        // Turn at a segment border only, and keep able to stop within the soft limits.
        let [low, high] = self
            .limits
            .ends()
            .map(|end| end.fine().saturating_sub(self.position.fine()));
        let now = self.speed.unsigned_abs();
        let full = self.limits.pace();
        let backward = if self.speed == 0 {
            wanted < 0
        } else {
            self.speed < 0
        };
        let room = if backward { low.saturating_neg() } else { high };
        let bound = full.next_speed(now, room.div_euclid(quantum));
        let to = if (wanted < 0) == backward {
            wanted.unsigned_abs().min(bound)
        } else {
            0
        };
        (now, to, backward)
    }
}

impl AxisLimits {
    fn pace(&self) -> Pace {
        Pace {
            speed: self.speed,
            acceleration: self.acceleration,
        }
    }
}

/// The motion of a ramp from `from` to `to` speed quanta: see the [module](super).
fn ramp_motion(slots: u16, (from, to, backward): (u32, u32, bool)) -> AxisMotion {
    // Speeds on the grid times 2n fit a u32, so that none of this saturates; increments lie between both ends.
    let change = i64::from(to) - i64::from(from);
    let first = 2 * i64::from(slots) * i64::from(from) + change;
    AxisMotion {
        first: u32::try_from(first).unwrap_or(0),
        change: i32::try_from(2 * change).unwrap_or(0),
        backward,
    }
}

/// Plans the motion of all axes, segment by segment: velocity- and acceleration-limited, time-optimal on the grid,
/// ending at rest exactly in the step that was asked for. See the [module](super).
///
/// Each segment takes the highest end speed from which the axis can still stop in front of its goal. So there is no stored
/// profile: a new target takes effect with the next segment, whatever the axis is doing. A target too close to stop for,
/// or behind, is overrun at full braking and come back to.
///
/// *Invariants:* the position is the sum of all displacements planned, so its floor is what the generator will have emitted.
/// Between two segments no speed exceeds the limits (after they were lowered: no braking is below the limit).
///
/// *Stop bound:* from speed `v` at acceleration `a`, [`Planner::stop`] takes at most `v²/2a` plus one eighth of the way
/// of a full-speed-change segment, `a T²/8` with T = 250 µs, after the segments already handed out.
#[derive(Clone, Debug)]
pub struct Planner {
    limits: Limits,
    axes: [Axis; AXES],
}

impl Planner {
    /// At rest at `positions`, going nowhere.
    pub fn new(limits: Limits, positions: [Position; AXES]) -> Self {
        let [x, y, z] = limits.axes;
        let [px, py, pz] = positions;
        let axes = [Axis::new(x, px), Axis::new(y, py), Axis::new(z, pz)];
        Self { limits, axes }
    }

    /// Every axis goes to its target as fast as it can, on its own; outside of the soft limits, to the limit.
    ///
    /// `targets` may lie anywhere within a step; to stand exactly at step `n` give [`Position::centre`]`(n)`.
    pub fn set_target(&mut self, targets: [Position; AXES]) {
        self.follow(targets, [0; AXES]);
    }

    /// Follows a moving target without lag: `targets` is where it is at the start of the next segment planned, `speeds`
    /// how fast it moves, fine units (2⁻³² step) per slot, negative backwards. It is taken to move on like
    /// this until the next call, up to the soft limits.
    pub fn follow(&mut self, targets: [Position; AXES], speeds: [i64; AXES]) {
        let quantum = 2 * i64::from(self.slots());
        for ((axis, target), speed) in self.axes.iter_mut().zip(targets).zip(speeds) {
            let most = i64::from(axis.limits.speed);
            axis.pace = axis.limits.pace();
            axis.target = axis.limits.clamp(target);
            // Within the axis's own speed, hence within an i32.
            axis.drift = (speed / quantum).clamp(-most, most) as i32;
        }
    }

    /// Like [`Planner::set_target`], but when all axes are at rest they go in step: on the straight line, starting and
    /// arriving together. For that each axis's speed and acceleration are its share of the way times the highest that
    /// no axis's limits forbid. In mid-move each axis goes on its own.
    pub fn move_in_step(&mut self, targets: [Position; AXES]) {
        self.set_target(targets);
        if self.is_at_rest() {
            self.share_pace();
        }
    }

    /// Brakes every axis to rest at its full acceleration and stays there; the position is kept.
    pub fn stop(&mut self) {
        let slots = self.slots();
        for axis in &mut self.axes {
            axis.pace = axis.limits.pace();
            axis.target = axis
                .position
                .saturating_add(axis.stopping_way(axis.speed, slots));
            axis.drift = 0;
        }
    }

    /// Goes on from rest at `positions`, where an abrupt stop left the generator. Forgets the target.
    pub fn resume_at(&mut self, positions: [Position; AXES]) {
        for (axis, position) in self.axes.iter_mut().zip(positions) {
            *axis = Axis::new(axis.limits, position);
        }
    }

    /// The next 250 µs of motion.
    pub fn plan_segment(&mut self) -> Segment {
        let slots = self.slots();
        let [x, y, z] = &mut self.axes;
        let ramps = [x.ramp(slots), y.ramp(slots), z.ramp(slots)];
        let planned = Segment::new(slots, ramps.map(|ramp| ramp_motion(slots, ramp)));
        debug_assert!(planned.is_ok());
        // Speeds on the grid always make a segment. Were it not so, standing still is safe and the position stays true.
        let (segment, ends) = match planned {
            Ok(segment) => (segment, ramps.map(|(_, to, backward)| (to, backward))),
            Err(_) => (Segment::pause(slots), [(0, false); AXES]),
        };
        for ((axis, way), (to, backward)) in
            self.axes.iter_mut().zip(segment.displacement()).zip(ends)
        {
            axis.position = axis.position.saturating_add(way);
            let to = i32::try_from(to).unwrap_or(i32::MAX);
            axis.speed = if backward { -to } else { to };
        }
        segment
    }

    /// Where the axes will be after the segments planned so far.
    pub fn positions(&self) -> [Position; AXES] {
        self.axes.map(|axis| axis.position)
    }

    /// Where the axes are going, within the soft limits.
    pub fn targets(&self) -> [Position; AXES] {
        self.axes.map(|axis| axis.target)
    }

    /// Speeds after the segments planned so far, fine units (2⁻³² step) per slot, negative backwards.
    pub fn speeds(&self) -> [i64; AXES] {
        let quantum = 2 * i64::from(self.slots());
        self.axes.map(|axis| quantum * i64::from(axis.speed))
    }

    /// How far each axis would still go if [`Planner::stop`] were called now, 2⁻³² step, negative backwards. Exact.
    pub fn stopping_ways(&self) -> [i64; AXES] {
        self.axes
            .map(|axis| axis.stopping_way(axis.speed, self.slots()))
    }

    /// No axis moves after the segments planned so far.
    pub fn is_at_rest(&self) -> bool {
        self.axes.iter().all(|axis| axis.speed == 0)
    }

    /// Every axis is at rest within two distance quanta (less than 1/500 step) of its target, in the right step: no
    /// further motion will be planned.
    pub fn has_arrived(&self) -> bool {
        let quantum = i64::from(self.slots()) * i64::from(self.slots());
        let near = |axis: &Axis| {
            axis.target
                .fine()
                .saturating_sub(axis.position.fine())
                .unsigned_abs()
                < (2 * quantum).unsigned_abs()
        };
        self.axes
            .iter()
            .all(|axis| axis.speed == 0 && axis.drift == 0 && near(axis))
    }

    /// The limits planned to.
    pub const fn limits(&self) -> &Limits {
        &self.limits
    }

    const fn slots(&self) -> u16 {
        self.limits.rate.slots_per_segment()
    }

    /// Scales every axis's pace to its share of the way.
    fn share_pace(&mut self) {
        // Whole steps, rounded up, are exact enough and keep the products within a u64.
        let ways = self.axes.map(|axis| {
            let fine = axis
                .target
                .fine()
                .saturating_sub(axis.position.fine())
                .unsigned_abs();
            fine.div_ceil(1 << 32)
        });
        let speeds = self.axes.map(|axis| axis.limits.speed);
        let accelerations = self.axes.map(|axis| axis.limits.acceleration);
        let speeds = shares(ways, speeds);
        let accelerations = shares(ways, accelerations);
        for ((axis, speed), acceleration) in self.axes.iter_mut().zip(speeds).zip(accelerations) {
            axis.pace = Pace {
                speed,
                acceleration,
            };
        }
    }
}

/// The largest numbers in the ratio of `ways`, none above its limit; rounded to nearest, at least 1 each.
fn shares(ways: [u64; AXES], limits: [u32; AXES]) -> [u32; AXES] {
    // The axis with the smallest limit / way decides; compared crosswise, all below 2³³ times 2²⁹.
    let mut tightest: Option<(u64, u32)> = None;
    for (way, limit) in ways.into_iter().zip(limits).filter(|(way, _)| *way != 0) {
        let tighter = tightest.is_none_or(|(w, l)| u64::from(limit) * w < u64::from(l) * way);
        if tighter {
            tightest = Some((way, limit));
        }
    }
    let Some((tightest_way, tightest_limit)) = tightest else {
        return limits;
    };
    let mut shares = limits;
    for (share, way) in shares.iter_mut().zip(ways) {
        let scaled = (way * u64::from(tightest_limit) + tightest_way / 2) / tightest_way;
        *share = u32::try_from(scaled).unwrap_or(u32::MAX).clamp(1, *share);
    }
    shares
}

#[cfg(test)]
mod tests;
