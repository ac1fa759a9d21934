//! Commands and their answers.

use super::{Bounds, Judge, Request, Sent, Stop, Ways, accepted, kind};
use crate::laws::Law;
use trinocular_core::frame::message::{Command, Config, Outcome};
use trinocular_core::safety::{Fault, State, Trust};

/// Longest delay from a command to the start of its ramp, µs: one control tick, and the delay that
/// a shell may add.
const BEGINS_US: f64 = 4_000.0;

impl Judge {
    /// Records that a whole packet with a new sequence number was sent to the station.
    pub fn sent(&mut self, now_us: u64, sequence: u16, command: &Command) {
        self.now_us = now_us;
        self.counts.commands += 1;
        let order = self.counts.commands;
        match command {
            Command::Ping { .. } => {
                self.greetings += 1;
                self.pinged_us = now_us;
                self.silent_until_us = None;
                return;
            }
            Command::Hello => {
                self.note(now_us, || "hello".to_string());
                self.greetings += 1;
                return;
            }
            Command::Stop => {
                let ramp = self.ramp_us();
                let stop = Stop {
                    order,
                    obeyed_us: now_us + BEGINS_US as u64,
                    ended_us: now_us as f64 + BEGINS_US + ramp,
                };
                // The ramp of the first stop is the one in force.
                self.stop = Some(match self.stop {
                    Some(first) => Stop {
                        obeyed_us: first.obeyed_us,
                        ended_us: first.ended_us.min(stop.ended_us),
                        ..stop
                    },
                    None => stop,
                });
            }
            _ => self.request(sequence, command),
        }
        self.note(now_us, || format!("{sequence}: {}", said(command)));
        self.sent.insert(
            sequence,
            Sent {
                command: *command,
                order,
            },
        );
    }

    /// Records that a packet which must have no effect was sent to the station.
    pub fn sent_stale(&mut self, sequence: u16) {
        self.stale.push(sequence);
    }

    fn request(&mut self, sequence: u16, command: &Command) {
        let any = |named: bool| Ways {
            backward: named,
            forward: named,
        };
        let rests = self.requests.is_empty();
        let ways = match command {
            Command::Jog { distance_um } => distance_um.map(|um| match rests {
                true => Ways {
                    backward: um < 0,
                    forward: um > 0,
                },
                false => any(um != 0),
            }),
            Command::Setpoint { .. } | Command::Frame(_) => [any(true); 3],
            Command::Home { axes } => axes.map(any),
            _ => return,
        };
        self.requests.push(Request {
            sequence,
            ways,
            strict: rests && matches!(command, Command::Jog { .. }),
        });
        // In motion the newest command may reverse every axis that is under way.
        if !rests {
            for request in &mut self.requests {
                request.ways = request.ways.map(|ways| any(ways != Ways::default()));
                request.strict = false;
            }
        }
    }

    /// Returns the longest duration of a ramp to rest from the present motion, µs.
    pub(super) fn ramp_us(&self) -> f64 {
        let axes = self.trails.iter().zip(&self.ramps);
        let ticks = axes.map(|(trail, bounds)| {
            // The axis may accelerate for two more ticks before it obeys.
            let speed = (trail.speed(bounds) + 2.0 * bounds.acceleration).min(bounds.speed);
            bounds.stop_ticks(speed, trail.acceleration(bounds))
        });
        // Add the grid's rounding.
        let ticks = ticks.fold(0.0, f64::max);
        (ticks * 1.1 + 3.0) * 1000.0
    }

    /// Checks the station's answer to a command.
    pub(super) fn answered(&mut self, sequence: u16, outcome: Outcome) {
        self.counts.comparisons += 1;
        let Some(sent) = self.sent.remove(&sequence) else {
            let law = match self.stale.contains(&sequence) {
                true => Law::Stale,
                false => Law::Answered,
            };
            self.breaks(law, || format!("{sequence} is answered: {outcome:?}"));
            return;
        };
        if !accepted(outcome) {
            self.requests.retain(|request| request.sequence != sequence);
            return;
        }
        match &sent.command {
            Command::Config(config) => self.configured(config),
            Command::Zero => self.zeroed(),
            Command::Reset => self.was_reset(sent.order),
            Command::Home { .. } => self.homing = true,
            // An operator may have moved the stage by hand.
            Command::Motors { on: false } => self.abrupt = true,
            _ => {}
        }
    }

    fn configured(&mut self, config: &Config) {
        self.config = Some(*config);
        self.silent_until_us = None;
        let steps =
            |um: u32, axis: usize| f64::from(um) * f64::from(config.axes[axis].steps_per_m) / 1e6;
        self.bounds = std::array::from_fn(|axis| {
            let limits = &config.axes[axis];
            let speed = steps(limits.max_speed_um_s, axis) / 1e3;
            Bounds {
                speed,
                // A larger change than the whole speed in one tick is impossible.
                acceleration: (steps(limits.max_acceleration_um_s2, axis) / 1e6).min(speed),
                jerk: (steps(limits.max_jerk_um_s3, axis) / 1e9).min(speed),
            }
        });
        self.ramps = self.bounds.map(|bounds| bounds.on_grid(self.quantum));
        for axis in 0..3 {
            self.trails[axis].cut();
            let slack = f64::from(config.stage.backlash_um[axis]) / 1e3;
            self.slack[axis] = self.slack[axis].max(slack);
            self.load[axis] = self.pushed(axis, self.load[axis]);
        }
        if self.resting == Some(State::Unconfigured) {
            self.resting = None;
        }
        self.caps = [(0.0, 0.0); 3];
    }

    fn zeroed(&mut self) {
        let faulted = self.resting == Some(State::Faulted);
        let present = self.emergency.is_seen() || self.driver.is_seen();
        self.counts.comparisons += 1;
        if faulted || present {
            self.breaks(Law::Zero, || {
                format!("zero is accepted: fault latched {faulted}, cause present {present}")
            });
        }
        self.origin = Some(self.load);
        self.rested = [0; 3];
        self.trust = Trust::Homed;
        self.abrupt = false;
        self.zeroed_us = Some(self.now_us);
    }

    fn was_reset(&mut self, order: u64) {
        let causes = [
            (Fault::EmergencyStop, self.emergency),
            (Fault::Driver, self.driver),
        ];
        self.counts.comparisons += 3;
        for (fault, cause) in causes {
            if cause.is_seen() {
                self.breaks(Law::Reset, || {
                    format!("reset is accepted with {fault:?} present")
                });
            }
        }
        self.told.clear();
        if let Some(fault) = self.owed.pop() {
            self.breaks(Law::Named, || format!("reset clears {fault:?} unnamed"));
        }
        if self.unnamed_us.take().is_some() {
            self.breaks(Law::Named, || {
                "reset clears an abrupt end unnamed".to_string()
            });
        }
        self.resting = None;
        self.reset_us = Some(self.now_us);
        if self.stop.is_some_and(|stop| order > stop.order) {
            self.stop = None;
        }
    }
}

/// Formats a command for the trace.
fn said(command: &Command) -> String {
    match command {
        Command::Config(config) => format!("config {config:?}"),
        Command::Frame(frame) => {
            let age = frame.capture.micros();
            format!(
                "frame captured at {age} us against {}",
                frame.reference.micros()
            )
        }
        Command::Setpoint { position_um } => format!("setpoint {position_um:?} um"),
        Command::Jog { distance_um } => format!("jog {distance_um:?} um"),
        Command::Home { axes } => format!("home {axes:?}"),
        other => kind(other).to_string(),
    }
}
