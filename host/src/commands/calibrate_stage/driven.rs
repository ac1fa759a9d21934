//! A station on a port that goes from place to place.

use super::super::by_hand::{Hand, PortArgument, why_it_stands};
use super::CalibrateStageOptions;
use crate::commands::failure::Failure;
use trinocular_client::allowance::Allowance;
use trinocular_client::stage::setpoint;
use trinocular_rig::rig_file::Stage;

/// Station on a port, with its stage.
pub struct Driven {
    pub hand: Hand,
    pub stage: Stage,
}

impl Driven {
    /// Connects, configures the station and starts the heartbeat.
    pub fn connect(
        options: &CalibrateStageOptions,
        port: &str,
        stage: &Stage,
    ) -> Result<Self, Failure> {
        let port = PortArgument {
            port: port.to_owned(),
        };
        let mut hand = Hand::connect(&port)?;
        hand.ready_to_move("setpoint", true)?;
        hand.configure(Some(stage), &options.stage)?;
        hand.start_heartbeat()?;
        Ok(Self {
            hand,
            stage: stage.clone(),
        })
    }

    /// Returns the position of the stage, mm from zero.
    pub fn position_mm(&self) -> Result<[f64; 3], Failure> {
        Ok(self.stage.in_mm(self.hand.status()?.position_steps))
    }

    /// Sends the stage to a position, mm from zero.
    pub fn send(&mut self, position_mm: [f64; 3]) -> Result<(), Failure> {
        self.hand
            .command("setpoint", setpoint(position_mm))
            .map(|_| ())
    }

    /// Waits until the stage stands; returns the position reached, mm from zero.
    pub fn arrive(&mut self) -> Result<[f64; 3], Failure> {
        let travel_mm = self
            .stage
            .travel_mm
            .map(|[least, greatest]| greatest - least);
        let allowance = Allowance::of_distance(&self.stage, travel_mm);
        let rest = self.hand.wait_for_rest(allowance, |_| {})?;
        let at_steps = rest.status.position_steps;
        why_it_stands(&self.hand, rest)?;
        Ok(self.stage.in_mm(at_steps))
    }
}
