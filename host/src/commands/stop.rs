//! `trinocular stop`: the stage stops, and stays stopped.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, position};
use clap::Args;
use host::error::Failure;
use host::station::diagnosis;
use shared::frame::message::Command;

/// Stop the stage on a ramp; it stays stopped until `reset`
///
/// Goes before everything else at the station, keeps the position, and is sent to a station of other firmware, too. It is no emergency stop: that is a
/// button.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    port: PortArgument,
}

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let mut hand = Hand::connect_to_any(&options.port)?;
    hand.command("stop", Command::Stop)?;
    let (status, _) = hand.wait_for_rest(|_| {})?;
    writeln!(
        out,
        "{} at {}, position {}",
        diagnosis::state(status.state).name,
        position(status.position_steps, None),
        diagnosis::trust(status.trust)
    )?;
    Ok(())
}
