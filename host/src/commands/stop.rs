//! `trinocular stop`: the stage stops, and stays stopped.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, position};
use crate::commands::failure::Failure;
use clap::Args;
use host::client::serial::{Holder, end_other_host};
use host::client::{diagnosis, ports};
use host::notice;
use shared::frame::message::Command;

/// Stop the stage on a ramp; it stays stopped until `reset`
///
/// Goes before everything else at the station, keeps the position, and is sent to a station of
/// other firmware, too. It is no emergency stop: that is a button. Another run of this program that
/// has the port is told to end, as Ctrl-C does, and stops its stage.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    port: PortArgument,
}

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let path =
        ports::resolve(&options.port.port).map_err(|error| Failure::of_station(None, error))?;
    if let Some(other) = end_other_host(&path) {
        let Holder { pid, command } = other;
        notice!("`{command}` (process {pid}) had the port and was told to end");
    }
    let mut hand = Hand::connect_and_stop(&options.port)?;
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
