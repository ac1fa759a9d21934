//! `trinocular stop`: the stage stops, and stays stopped.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, position};
use clap::Args;
use host::error::Failure;
use host::notice;
use host::station::serial::{Holder, OtherHost, end_other_host};
use host::station::{diagnosis, ports};

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
    let path = ports::resolve(&options.port.port).map_err(super::station_failed)?;
    if let Some(other) = end_other_host(&path) {
        told(&path, other)?;
    }
    let mut hand = Hand::connect_and_stop(&options.port)?;
    hand.stop()?;
    let status = hand.status()?;
    writeln!(
        out,
        "{} at {}, position {}",
        diagnosis::state(status.state).name,
        position(status.position_steps, None),
        diagnosis::trust(status.trust)
    )?;
    Ok(())
}

/// Says what became of the program that had the port.
///
/// # Errors
/// If it still has the port: then no stop can be sent.
fn told(path: &str, other: OtherHost) -> Result<(), Failure> {
    let stays = |Holder { pid, command }: Holder, why: &str, way_out: &str| {
        let last = "if the stage moves, press the emergency stop or the board's button";
        Err(Failure::Station(format!(
            "{path}: no stop was sent, because `{command}` (process {pid}) has the port {why}; \
             {last}, then {way_out}"
        )))
    };
    let kill = |pid: u32| format!("run `kill -9 {pid}` and `trinocular stop` again");
    match other {
        OtherHost::Left(Holder { pid, command }) => {
            notice!("`{command}` (process {pid}) had the port and was told to end");
            Ok(())
        }
        OtherHost::Suspended(holder) => {
            let way_out = kill(holder.pid);
            stays(holder, "and is suspended, so it hears nothing", &way_out)
        }
        OtherHost::Stays(holder) => {
            let way_out = kill(holder.pid);
            stays(holder, "and did not end when it was told to", &way_out)
        }
        OtherHost::Foreign(holder) => {
            let way_out = format!("end process {} and run `trinocular stop` again", holder.pid);
            stays(
                holder,
                "and is no run of this program that it may end",
                &way_out,
            )
        }
    }
}
