//! Processing of one flow frame: gate, estimate, target, and the motion that follows from it.

use super::Machine;
use crate::estimate::{DisplacementNm, Gate, Refusal, closed_form, midpoint};
use crate::frame::message::{Denial, EstimateReport, Frame, Sums};
use crate::motion::Planner;
use crate::safety::{Inputs, State};
use crate::steps::Position;
use crate::time::Instant;
use crate::track::history::Unknown;
use crate::track::pursuit::{Aim, Measurement};
use crate::track::watch::{Advice, Sample};

/// Sigma of the paper's estimators, which state none, as one part in this many of the gate's
/// largest.
const UNSTATED: u32 = 10;

impl Machine {
    /// Uses one flow frame: the stage moves to the target's present position.
    pub(super) fn follow(&mut self, sequence: u16, frame: &Frame) -> Result<(), Denial> {
        self.require_ready()?;
        self.require_homed()?;
        self.require_inside()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let (displacement_nm, sigma_nm) = match estimate(&frame.sums, active.gate()) {
            Ok(estimate) => estimate,
            Err(refusal) => return Err(Denial::Estimate(refusal)),
        };
        let now = self.now();
        if frame.capture > now {
            return Err(Denial::CaptureInFuture);
        }
        let stage = if active.on_stage() {
            match self.history.at(frame.capture) {
                Ok(position) => position,
                Err(Unknown::Future) => return Err(Denial::CaptureInFuture),
                Err(Unknown::Past) => return Err(Denial::CaptureTooOld),
            }
        } else {
            [0; 3]
        };
        let displacement = active.to_stage(displacement_nm);
        let reference = self.tracker.reference(frame.reference, frame.capture)?;
        let view = reference.moved(frame.capture, displacement);
        let position = view.target(stage);
        for (axis, target) in position.into_iter().enumerate() {
            self.require_free_way(axis, Position::nearest_rest(target))?;
        }
        let unstated = || active.gate().max_sigma_nm.map(|most| most / UNSTATED);
        let measurement = Measurement {
            capture: frame.capture,
            position,
            variance: active.variance(sigma_nm.unwrap_or_else(unstated)),
        };
        let used = self
            .tracker
            .pursuit
            .measure(now, &measurement, &active.reach, &active.config.tracking)
            .is_ok();
        if used {
            self.tracker.keep(reference, view);
        }
        if active.on_stage()
            && let Some(bounds) = &active.bounds
        {
            let sample = Sample {
                capture: frame.capture,
                stage,
                error: view.target([0; 3]),
                variance: measurement.variance,
            };
            self.tracker
                .pursuit
                .doubt_stage(&sample.error, &bounds.unseen);
            let advice = self.tracker.watch.see(&sample, used, bounds);
            self.heed(advice);
            if matches!(advice, Advice::Fail(_)) {
                return Err(Denial::Faulted);
            }
        }
        if !used {
            return Err(Denial::Outlier);
        }
        self.state = State::Following;
        self.aim();
        let latency_us = self.first_word().since(frame.capture);
        self.estimate = Some(EstimateReport {
            sequence,
            displacement_nm,
            sigma_nm,
            latency_us: u32::try_from(latency_us).unwrap_or(u32::MAX),
        });
        Ok(())
    }

    /// Lets the watch do its work of a tick.
    pub(super) fn watch(&mut self) {
        if self.state == State::Following {
            let advice = self.tracker.watch.work(&self.history);
            self.heed(advice);
        }
    }

    /// Does as the watch says.
    fn heed(&mut self, advice: Advice) {
        match advice {
            Advice::GoOn => {}
            Advice::Stop => {
                if let Some(planner) = &mut self.planner {
                    planner.stop();
                }
            }
            Advice::Fail(fault) => self.fail(fault),
        }
    }

    /// Ramps down when no frame came for too long.
    pub(super) fn check_sight(&mut self) {
        let (State::Following, Some(active)) = (self.state, &self.active) else {
            return;
        };
        let now = self.now();
        if self.tracker.pursuit.lose(now, &active.config.tracking)
            && let Some(planner) = &mut self.planner
        {
            planner.stop();
        }
    }

    /// Sends the stage to where the target will be when the first word of the coming tick is on the
    /// pins. From there the planner continues at the target's velocity, tick by tick, until the
    /// next frame.
    fn aim(&mut self) {
        if self.tracker.watch.holds() {
            return;
        }
        let at = self.first_word();
        let (Some(active), Some(planner)) = (&self.active, &mut self.planner) else {
            return;
        };
        let Some(aims) = self
            .tracker
            .pursuit
            .aim(at, &active.reach, &active.config.tracking)
        else {
            return;
        };
        let loads = planner.loads();
        for ((axis, aim), load) in aims.into_iter().enumerate().zip(loads) {
            send(planner, (axis, load), aim, &self.inputs);
        }
    }

    /// Does a tick's share of the work on the target, and renews the goals of the axes that an
    /// oscillator leads. For ticks without a frame.
    pub(super) fn swing(&mut self) {
        if self.state != State::Following {
            return;
        }
        let at = self.first_word();
        let (Some(active), Some(planner)) = (&self.active, &mut self.planner) else {
            return;
        };
        let pursuit = &mut self.tracker.pursuit;
        pursuit.work(&active.reach);
        if self.tracker.watch.holds() {
            return;
        }
        let loads = planner.loads();
        let stage = loads.map(Position::distance_from_zero);
        let aims = pursuit.swing(at, stage, &active.reach, &active.config.tracking);
        for ((axis, aim), load) in aims.into_iter().enumerate().zip(loads) {
            if let Some(aim) = aim {
                send(planner, (axis, load), aim, &self.inputs);
            }
        }
    }

    /// Returns the instant at which the first word of the coming tick is on the pins.
    fn first_word(&self) -> Instant {
        self.now().plus_micros(u64::from(self.board.delay_us))
    }
}

/// Sends the axis of this number, whose load is at `load`, after the target. At a switch that is tripped towards the goal, the axis stays.
/// Beyond a soft limit it moves only to the limit and rests there.
fn send(planner: &mut Planner, (number, load): (usize, Position), aim: Aim, inputs: &Inputs) {
    let (Some(limits), Some([negative, positive])) = (
        planner.limits().axes().get(number),
        inputs.limits.get(number),
    ) else {
        return;
    };
    let wanted = resting_or_moving(aim);
    if (*negative && wanted < load) || (*positive && wanted > load) {
        planner.follow_axis(number, load, 0);
        return;
    }
    let [low, high] = limits.range();
    let mut speed = 0;
    if (low..high).contains(&wanted.whole_steps()) {
        speed = per_slot(aim.velocity, planner.limits().word_rate().slots_per_tick());
    }
    planner.follow_axis(number, wanted, speed);
}

/// Converts the aim to a position: a resting target lies in the middle of a step, a moving one
/// anywhere.
fn resting_or_moving(aim: Aim) -> Position {
    if aim.velocity == 0.0 {
        Position::nearest_rest(aim.position)
    } else {
        Position::from_zero(aim.position)
    }
}

/// Converts steps/ms to 2⁻³² step per slot, with `slots` per ms. Saturates at two steps per slot,
/// beyond the speed of any axis.
fn per_slot(speed: f32, slots: u32) -> i64 {
    const QUARTER: f32 = (1 << 30) as f32;
    i64::from((speed * (QUARTER / slots as f32)) as i32) << 2
}

/// Estimates the displacement, and checks it against the gate.
fn estimate(sums: &Sums, gate: &Gate) -> Result<(DisplacementNm, Option<[u32; 3]>), Refusal> {
    match sums {
        Sums::ClosedForm(sums) => {
            gate.points(sums.points)?;
            let displacement_nm = closed_form::solve_fixed(sums)?;
            gate.displacement(displacement_nm)?;
            Ok((displacement_nm, None))
        }
        Sums::Midpoint(sums) => {
            gate.points(sums.points)?;
            let estimate = midpoint::solve_fixed(sums)?;
            gate.displacement(estimate.displacement_nm)?;
            gate.variance(estimate.variance_nm2)?;
            Ok((estimate.displacement_nm, Some(estimate.sigma_nm())))
        }
    }
}
