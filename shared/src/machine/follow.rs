//! One flow frame: gate, estimate, target.

use super::Machine;
use crate::estimate::{DisplacementNm, closed_form, midpoint};
use crate::frame::message::{Denial, EstimateReport, Frame, Sums};
use crate::safety::State;
use crate::track::history::Unknown;

impl Machine {
    /// Uses one frame: the stage goes to where the target is.
    pub(super) fn follow(&mut self, sequence: u16, frame: &Frame) -> Result<(), Denial> {
        self.require_ready()?;
        self.require_homed()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let (displacement_nm, sigma_nm) = estimate(&frame.sums, active.gate())?;
        if frame.capture > self.now() {
            return Err(Denial::CaptureInFuture);
        }
        let stage = if active.on_stage() {
            self.history
                .at(frame.capture)
                .map_err(|unknown| match unknown {
                    Unknown::Future => Denial::CaptureInFuture,
                    Unknown::Past => Denial::CaptureTooOld,
                })?
        } else {
            [0; 3]
        };
        let displacement = active.to_stage(displacement_nm);
        let reference = self.tracker.reference(frame.reference, frame.capture)?;
        let view = reference.moved(frame.capture, displacement);
        self.go(view.target(stage), State::Following)?;
        self.tracker.keep(reference, view);
        let first_word = self.now().plus_micros(u64::from(self.board.delay_us));
        let latency_us = first_word.since(frame.capture);
        self.estimate = Some(EstimateReport {
            sequence,
            displacement_nm,
            sigma_nm,
            latency_us: u32::try_from(latency_us).unwrap_or(u32::MAX),
        });
        Ok(())
    }
}

/// The displacement, if the gate lets it pass.
fn estimate(
    sums: &Sums,
    gate: &crate::estimate::Gate,
) -> Result<(DisplacementNm, Option<[u32; 3]>), Denial> {
    let checked = || match sums {
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
    };
    checked().map_err(Denial::Estimate)
}
