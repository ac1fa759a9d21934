//! `trinocular stop`: stops the stage until a reset.

use std::io::Write;
use std::time::{Duration, Instant};

use super::by_hand::{Hand, PortArgument, condition, position};
use super::json;
use crate::commands::failure::Failure;
use clap::Args;
use trinocular_client::serial::{Holder, OtherHost, end_other_host};
use trinocular_client::{diagnosis, ports};
use trinocular_core::frame::message::Status;
use trinocular_rig::notice;

/// Stop the stage on a ramp; it stays stopped until `reset`
///
/// The station obeys it before everything else, whatever its firmware, and keeps the position. It
/// is no emergency stop: that is a button. If another run of this program has the port, the stop goes
/// through that run, whose motion ends by it; one that does not react is interrupted as by Ctrl-C.
#[derive(Debug, Args)]
pub struct StopOptions {
    #[command(flatten)]
    port: PortArgument,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Time for which a stop is tried again when the owner of the port leaves it or does not answer.
const OWNER_PATIENCE: Duration = Duration::from_millis(500);

/// Pause between two tries.
const LOOK: Duration = Duration::from_millis(50);

/// Runs the command.
pub fn run(options: &StopOptions, out: &mut impl Write) -> Result<(), Failure> {
    let unconfirmed = |failure| Failure::Unstopped(Box::new(failure));
    let (hand, status) = stop_at_last(options).map_err(unconfirmed)?;
    if let Some(Holder { pid, command }) = hand.serial().owner() {
        notice!("the stop went through `{command}` (process {pid}), which has the port");
    }
    if options.json {
        return Ok(json::line(out, &condition(&status))?);
    }
    writeln!(
        out,
        "{} at {}, position {}",
        diagnosis::state(status.state).name,
        position(status.position_steps, None),
        diagnosis::position(status.trust)
    )?;
    Ok(())
}

/// Stops the stage, if need be by the end of the program that has the port.
fn stop_at_last(options: &StopOptions) -> Result<(Hand, Status), Failure> {
    let path =
        ports::resolve(&options.port.port).map_err(|error| Failure::of_station(None, error))?;
    // The owner of the port may be about to leave it, or to open its socket.
    let patience = Instant::now() + OWNER_PATIENCE;
    loop {
        match stop(&options.port) {
            Err(_) if Instant::now() < patience => std::thread::sleep(LOOK),
            Err(_) => {
                // Another program may have the port without letting others in.
                if let Some(other) = end_other_host(&path) {
                    told(&path, other)?;
                }
                return stop(&options.port);
            }
            stopped => return stopped,
        }
    }
}

/// Connects, and stops the stage; returns the connection and the status at rest.
fn stop(port: &PortArgument) -> Result<(Hand, Status), Failure> {
    let mut hand = Hand::connect_and_stop(port)?;
    let status = hand.stop_beside_others()?;
    Ok((hand, status))
}

/// Reports the end of the program that had the port.
///
/// # Errors
/// If that program still has the port, so that no stop can be sent.
fn told(path: &str, other: OtherHost) -> Result<(), Failure> {
    let stays = |Holder { pid, command }: Holder, why: &str, way_out: &str| {
        let text = format!(
            "{path}: no stop was sent, because `{command}` (process {pid}) has the port {why}; \
             {way_out}"
        );
        Err(Failure::Station(text.into()))
    };
    let kill = |pid: u32| format!("run `kill -9 {pid}` and `trinocular stop` again");
    match other {
        OtherHost::Left(Holder { pid, command }) => {
            notice!("`{command}` (process {pid}) had the port; it was interrupted and ended");
            Ok(())
        }
        OtherHost::Suspended(holder) => {
            let way_out = kill(holder.pid);
            stays(holder, "and is suspended, so it does not react", &way_out)
        }
        OtherHost::Stays(holder) => {
            let way_out = kill(holder.pid);
            stays(holder, "and did not end when interrupted", &way_out)
        }
        OtherHost::Foreign(holder) => {
            let way_out = format!("end process {} and run `trinocular stop` again", holder.pid);
            stays(holder, "and is a different program", &way_out)
        }
    }
}
