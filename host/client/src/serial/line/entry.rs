//! Way to a station: through the program that has its port, or by the port itself.
//!
//! A run of this program that begins or ends has the port and lets no other one in, for a tenth of
//! a second in all if it only shows a status. Whoever comes then tries again.

use super::super::super::StationError;
use super::super::super::owner::{self, Purpose, Reception};
use super::super::busy;
use super::super::holder::{Holder, is_this_program};
use super::super::port::{self, Half};
use std::time::{Duration, Instant};
use trinocular_rig::interruption;

/// Period of attempts.
const PERIOD: Duration = Duration::from_millis(10);

/// Returns the timeout for an owner that begins or ends.
///
/// A command that moves the stage waits no longer than its own start takes on a busy computer: a
/// stop that comes meanwhile is not undone by a motion seconds later. A stop does not wait: it ends
/// the other run.
fn patience(purpose: Purpose) -> Duration {
    match purpose {
        Purpose::Stop => Duration::ZERO,
        Purpose::Drive => Duration::from_millis(500),
        Purpose::Watch => Duration::from_secs(3),
    }
}

/// Returns the two halves of the way to the station, and the program through which it leads if
/// another one has the port.
///
/// # Errors
/// As [`Serial::connect`](super::super::Serial::connect).
pub(super) fn enter(
    path: &str,
    purpose: Purpose,
) -> Result<(Half, Half, Option<Holder>), StationError> {
    let end = Instant::now() + patience(purpose);
    loop {
        let error = match attempt(path, purpose) {
            Err(Obstacle::Passing(error)) => error,
            Err(Obstacle::Lasting(error)) => return Err(error),
            Ok(way) => return Ok(way),
        };
        if Instant::now() >= end || interruption::is_requested() {
            return Err(error);
        }
        std::thread::sleep(PERIOD);
    }
}

/// Reason why there is no way to the station.
enum Obstacle {
    /// A run of this program has the port, and neither lets this one in nor refuses it.
    Passing(StationError),
    /// Anything else.
    Lasting(StationError),
}

fn attempt(path: &str, purpose: Purpose) -> Result<(Half, Half, Option<Holder>), Obstacle> {
    let named = || path.to_owned();
    let (halves, owner) = match owner::connect_to_owner(path, purpose) {
        Some(Reception::Welcome(stream, owner)) => {
            let halves = port::through(stream).map_err(serialport::Error::from);
            (halves, Some(owner))
        }
        Some(Reception::Refused(holder)) => {
            return Err(Obstacle::Lasting(StationError::Busy {
                path: named(),
                holder: Some(holder),
            }));
        }
        Some(Reception::Silent(holder)) => {
            return Err(Obstacle::Lasting(StationError::OwnerSilent {
                path: named(),
                holder,
            }));
        }
        None => (port::open(path), None),
    };
    let (reader, writer) = halves.map_err(|cause| match busy::explain(path, &cause) {
        error if is_passing(&error) => Obstacle::Passing(error),
        error => Obstacle::Lasting(error),
    })?;
    Ok((reader, writer, owner))
}

/// Returns true if a run of this program has the port, or one that has just left it.
fn is_passing(error: &StationError) -> bool {
    match error {
        StationError::Busy { holder, .. } => holder.as_ref().is_none_or(is_this_program),
        _ => false,
    }
}
