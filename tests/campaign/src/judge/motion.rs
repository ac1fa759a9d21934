//! Checks of the port words of each segment.

use super::kinematics::Excess;
use super::{Bounds, Judge, SEGMENTS};
use crate::laws::Law;
use crate::pins::Edge;
use trinocular_core::frame::message::Side;
use trinocular_core::safety::{Inputs, State, Trust};
use trinocular_core::steps::DriverTiming;

/// Longest delay from a heartbeat timeout to its notice, µs: one check per control tick, and the
/// delay that a shell may add.
const NOTICED_US: u64 = 4_000;

/// Duration that the differences reach back, µs.
const REMEMBERED_US: u64 = 250_000;

/// Timing of a driver without requirements. It holds before the first configuration, when nothing
/// moves.
const ANY_DRIVER: DriverTiming = DriverTiming {
    step_high_ns: 0,
    step_low_ns: 0,
    dir_setup_ns: 0,
    dir_hold_ns: 0,
};

impl Judge {
    /// Checks a segment given out at `now_us` with the switches at that time. The reports of the
    /// same tick must already have been passed in.
    pub fn words(&mut self, now_us: u64, words: &[u32], inputs: &Inputs, motors: bool) {
        self.now_us = now_us;
        self.motors = motors;
        self.segments += 1;
        self.sense(inputs);
        self.check_silence();
        let driver = self.config.map_or(ANY_DRIVER, |config| config.driver);
        let (mut edges, mut short) = (Vec::new(), Vec::new());
        self.pins.feed(words, &driver, &mut edges, &mut short);
        if let Some(short) = short.first() {
            let (what, axis, words) = (short.what, short.axis, short.words);
            self.breaks(Law::Pulse, || {
                format!("{what} of axis {axis} lasts {words} words")
            });
        }
        self.counts.comparisons += 4 * edges.len() as u64;
        if !edges.is_empty() {
            self.may_move();
        }
        for edge in &edges {
            self.step(edge);
        }
        self.age();
        if self.segments.is_multiple_of(SEGMENTS.into()) {
            self.tick();
        }
    }

    /// Updates the causes. A cause counts once a control tick has taken it in, so the third segment
    /// after it must have no steps.
    fn sense(&mut self, inputs: &Inputs) {
        let tripped = inputs.limits.as_flattened().contains(&true);
        if inputs.emergency_stop || inputs.driver_fault || tripped {
            self.excused_us = Some(self.now_us);
        }
        self.emergency.sense(inputs.emergency_stop);
        self.driver.sense(inputs.driver_fault);
        let limits = inputs.limits.as_flattened().iter();
        for (cause, tripped) in self.limits.as_flattened_mut().iter_mut().zip(limits) {
            cause.sense(*tripped);
        }
    }

    /// Counts one more segment for every cause.
    fn age(&mut self) {
        self.emergency.age();
        self.driver.age();
        self.limits
            .as_flattened_mut()
            .iter_mut()
            .for_each(super::Cause::age);
    }

    fn check_silence(&mut self) {
        let Some(config) = &self.config else { return };
        let heard_us = self.pinged_us + u64::from(config.heartbeat_ms) * 1000 + NOTICED_US;
        if self.now_us > heard_us && self.silent_until_us.is_none() {
            self.silent_until_us = Some(self.now_us as f64 + self.ramp_us());
        }
    }

    /// Checks that a step on any axis is allowed now.
    fn may_move(&mut self) {
        let now = self.now_us as f64;
        self.counts.comparisons += 5;
        if let Some(state) = self.resting {
            self.breaks(Law::Silent, || format!("a step while {state:?}"));
        }
        if !self.motors {
            self.breaks(Law::Motors, || "a step with the motors off".to_string());
        }
        for (name, cause) in [
            ("emergency stop", self.emergency),
            ("driver fault", self.driver),
        ] {
            if cause.is_seen() {
                self.breaks(Law::Cause, || format!("a step with the {name} present"));
            }
        }
        if let Some(stop) = self.stop
            && now > stop.ended_us
        {
            let late = (now - stop.ended_us) / 1000.0;
            self.breaks(Law::LastWord, || {
                format!("a step {late:.1} ms after the ramp of a stop")
            });
        }
        if let Some(until) = self.silent_until_us
            && now > until
        {
            let late = (now - until) / 1000.0;
            self.breaks(Law::Heartbeat, || {
                format!("a step {late:.1} ms after silence and its ramp")
            });
        }
    }

    fn step(&mut self, edge: &Edge) {
        let axis = edge.axis;
        let inverted = self.config.is_some_and(|config| config.axes[axis].invert);
        let forward = edge.high != inverted;
        let by = if forward { 1 } else { -1 };
        self.check_asked(axis, forward);
        self.check_limit_switch(axis, forward);
        self.check_window(axis, edge.high);
        self.steps[axis] += by;
        let before = self.load[axis];
        self.load[axis] = self.pushed(axis, before);
        if self.load[axis] != before {
            self.check_soft_limit(axis, by);
        }
    }

    /// Returns the load position after the motor has moved to its present position.
    pub(super) fn pushed(&self, axis: usize, load: i64) -> i64 {
        load.clamp(self.steps[axis], self.steps[axis] + self.play(axis))
    }

    fn check_asked(&mut self, axis: usize, forward: bool) {
        self.counts.comparisons += 1;
        let mut ways = self.requests.iter().map(|request| request.ways[axis]);
        if ways.any(|ways| if forward { ways.forward } else { ways.backward }) {
            return;
        }
        let jogged = self.requests.iter().any(|request| {
            let ways = request.ways[axis];
            request.strict && (ways.forward || ways.backward)
        });
        let law = if jogged { Law::Direction } else { Law::Asked };
        let way = if forward { "forwards" } else { "backwards" };
        self.breaks(law, || format!("axis {axis} makes a step {way}"));
    }

    fn check_limit_switch(&mut self, axis: usize, forward: bool) {
        self.counts.comparisons += 1;
        let side = if forward {
            Side::Positive
        } else {
            Side::Negative
        };
        let cause = self.limits[axis][usize::from(forward)];
        if cause.is_seen() && self.sought(axis) != Some(side) {
            self.breaks(Law::Limit, || {
                format!("axis {axis} makes a step towards its tripped switch")
            });
        }
    }

    /// Checks that the axis's step stays within the window or leads back into it.
    fn check_window(&mut self, axis: usize, high: bool) {
        let Some(config) = &self.config else { return };
        let grain = 1e3 / f64::from(config.axes[axis].steps_per_m);
        let from = self.mm[axis];
        let to = from + if high { grain } else { -grain };
        self.mm[axis] = to;
        self.grain[axis] = self.grain[axis].max(grain);
        let moves = self
            .status
            .as_ref()
            .is_some_and(|status| status.state == State::Moving);
        if self.trust == Trust::Homed || !moves {
            return;
        }
        self.counts.comparisons += 1;
        let window = f64::from(config.stage.window_um) / 1e3;
        // Both ends are rounded to whole steps. After a change of direction or backlash the side on
        // which the motor pushes the load is unknown.
        let window = window + 4.0 * self.grain[axis] + 2.0 * self.slack[axis];
        let leaves = |anchor: &[f64; 3]| {
            let (before, after) = ((from - anchor[axis]).abs(), (to - anchor[axis]).abs());
            after > window && after > before
        };
        if self.anchors.iter().all(leaves) {
            let far = to - self.anchors[0][axis];
            let round = self.anchors.clone();
            self.breaks(Law::Window, || {
                format!(
                    "axis {axis} is {far:.4} mm away, allowed are {window:.4}, round {round:.4?} mm"
                )
            });
        }
    }

    fn check_soft_limit(&mut self, axis: usize, by: i64) {
        let (Some(config), Some(origin)) = (&self.config, self.origin) else {
            return;
        };
        if self.trust != Trust::Homed || self.homing {
            return;
        }
        self.counts.comparisons += 1;
        let limits = &config.axes[axis];
        let steps = |um: i32| i64::from(um) * i64::from(limits.steps_per_m) / 1_000_000;
        let [low, high] = limits.travel_um.map(steps);
        let place = self.load[axis] - origin[axis];
        if (low..=high).contains(&place) {
            self.rested[axis] = place;
        }
        // From outside, where it stood at the last rest, the axis may move inwards only.
        let (low, high) = (low.min(self.rested[axis]), high.max(self.rested[axis]));
        // Within a tick the motor may push the load by a step that the planner does not see.
        let play = i64::from(self.play(axis) > 0);
        if (by > 0 && place > high + play) || (by < 0 && place < low - play) {
            self.breaks(Law::SoftLimit, || {
                format!("axis {axis} goes on at {place} steps, {low} to {high} are allowed")
            });
        }
    }

    /// Checks speed, acceleration and jerk at the end of a control tick.
    fn tick(&mut self) {
        let caps = self.present_caps();
        for (axis, cap) in caps.into_iter().enumerate() {
            let bounds = Bounds {
                speed: cap,
                ..self.bounds[axis]
            };
            let Some((excess, text)) = self.trails[axis].push(self.steps[axis], bounds) else {
                continue;
            };
            self.trails[axis].cut();
            let recent = |us: u64| self.now_us - us < REMEMBERED_US;
            match (excess, self.excused_us) {
                (Excess::Speed, _) => self.breaks(Law::Speed, || format!("axis {axis}: {text}")),
                (_, Some(cause_us)) if recent(cause_us) => self.ended_abruptly(cause_us),
                (Excess::Acceleration, _) => {
                    self.breaks(Law::Acceleration, || format!("axis {axis}: {text}"));
                }
                (Excess::Jerk, _) => self.breaks(Law::Jerk, || format!("axis {axis}: {text}")),
            }
        }
    }

    fn ended_abruptly(&mut self, cause_us: u64) {
        let since = |us: Option<u64>| us.is_some_and(|us| us + REMEMBERED_US > cause_us);
        // A zero in between has restored the position.
        self.abrupt |= !since(self.zeroed_us);
        if since(self.named_us) {
            return;
        }
        self.unnamed_us = Some(cause_us);
        if since(self.reset_us) {
            self.breaks(Law::Named, || {
                "a reset came before any name for an abrupt end".to_string()
            });
        }
    }

    /// Returns true if the load is within its travel.
    fn is_inside(&self, axis: usize) -> bool {
        let (Some(config), Some(origin)) = (&self.config, self.origin) else {
            return true;
        };
        let limits = &config.axes[axis];
        let at = i128::from(self.load[axis] - origin[axis]) * 1_000_000;
        let [low, high] = limits
            .travel_um
            .map(|um| i128::from(um) * i128::from(limits.steps_per_m));
        (low..=high).contains(&at)
    }

    /// Returns the highest speeds allowed now, steps per tick.
    fn present_caps(&mut self) -> [f64; 3] {
        let Some(config) = self.config else {
            return [0.0; 3];
        };
        let now = self.now_us as f64;
        std::array::from_fn(|axis| {
            let scale = f64::from(config.axes[axis].steps_per_m) / 1e9;
            let full = self.bounds[axis].speed;
            let [first, second] = config.stage.home_speed_um_s;
            let cap = match (self.homing, self.trust) {
                (true, _) => full.min(f64::from(first.max(second)) * scale),
                (false, Trust::Homed) if self.is_inside(axis) => full,
                (false, _) => full.min(f64::from(config.slow_speed_um_s) * scale),
            };
            let (held, until) = self.caps[axis];
            // The ramp starts from a speed that was allowed before.
            if cap < held && now < until {
                return held;
            }
            let ramp =
                self.ramps[axis].stop_ticks(cap, self.ramps[axis].acceleration) * 1100.0 + 10_000.0;
            self.caps[axis] = (cap, now + ramp);
            cap
        })
    }
}
