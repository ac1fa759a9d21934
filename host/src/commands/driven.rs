//! A station on a port that goes from place to place.

use super::by_hand::{Hand, PortArgument, StageArgument, why_it_stands};
use crate::commands::failure::Failure;
use trinocular_client::allowance::Allowance;
use trinocular_client::serial::Serial;
use trinocular_client::stage::setpoint;
use trinocular_rig::rig_file::Stage;

/// Station on a port, with its stage.
pub struct Driven {
    pub hand: Hand,
    pub stage: Stage,
}

impl Driven {
    /// Connects, configures the station and starts the heartbeat.
    pub fn connect(argument: &StageArgument, port: &str, stage: &Stage) -> Result<Self, Failure> {
        let port = PortArgument {
            port: port.to_owned(),
        };
        let mut hand = Hand::connect(&port)?;
        hand.ready_to_move("setpoint", true)?;
        hand.configure(Some(stage), argument)?;
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

    /// Sends the stage to a position, mm from zero; returns the control tick at which the command
    /// took effect, if the station has said it.
    pub fn begin(&mut self, position_mm: [f64; 3]) -> Result<Option<u32>, Failure> {
        self.send(position_mm)?;
        Ok(self.hand.serial().client().answered_tick())
    }

    /// Returns the connection to the station for changes.
    pub fn serial_mut(&mut self) -> &mut Serial {
        self.hand.serial_mut()
    }

    /// Returns how often the station's clock has jumped against this computer's.
    pub fn clock_jumps(&self) -> u32 {
        self.hand.serial().client().clock().jumps()
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

/// Refuses to go `farthest_mm` either way along an axis, from a centre that has not as much room
/// within the soft limits.
pub fn within_travel(
    stage: &Stage,
    centre_mm: [f64; 3],
    farthest_mm: [f64; 3],
) -> Result<(), Failure> {
    for axis in 0..3 {
        let [least, greatest] = stage.travel_mm[axis];
        let (centre, farthest) = (centre_mm[axis], farthest_mm[axis]);
        if farthest > 0.0 && (centre - farthest < least || centre + farthest > greatest) {
            let name = ['x', 'y', 'z'][axis];
            return Err(Failure::Usage(format!(
                "{name} is at {centre:.3} mm and would go {farthest:.3} mm either way, but its \
                 soft limits are {least} to {greatest} mm: move it, or take a shorter --reach"
            )));
        }
    }
    Ok(())
}
