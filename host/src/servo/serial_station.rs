//! Instants and frames for a station on a serial line, and its answers.

use std::time::{Duration, Instant as HostInstant};
use trinocular_client::StationError;
use trinocular_client::serial::Serial;
use trinocular_core::frame::message::{Command, Denial, EstimateReport, Frame, Status};
use trinocular_core::time::Instant;

/// Timeout for a reply to a ping: pings go fifty times a second.
const CLOCK_PATIENCE: Duration = Duration::from_secs(3);

/// Timeout for the answer to a frame. Later it counts as lost on the line, and the loop goes on
/// with the next frame.
const ANSWER_PATIENCE: Duration = Duration::from_millis(250);

/// Reason why a frame that was sent is not known to have been used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameRefusal {
    /// The station did not use the frame.
    #[error("{0}")]
    Denied(Denial),
    /// No answer came.
    #[error("no answer from the station")]
    Unanswered,
    /// The line was interrupted.
    #[error("the line was interrupted")]
    Interrupted,
    /// The answer came, but the status after it did not.
    #[error("the station did not say what it saw")]
    Unreported,
}

/// Converts an instant of the line's clock ([`Serial::now_us`]) to the station's clock.
///
/// # Errors
/// If the line breaks; [`StationError::Silent`] if no reply to a ping comes for three seconds:
/// before the first, the station's clock is unknown.
pub fn station_time(serial: &Serial, at: Instant) -> Result<Instant, StationError> {
    let end = HostInstant::now() + CLOCK_PATIENCE;
    let station = serial.wait_until(end, |client| client.clock().station_us(at.micros()))?;
    station
        .map(Instant::from_micros)
        .ok_or(StationError::Silent {
            command: "ping",
            waited_ms: CLOCK_PATIENCE.as_millis() as u64,
        })
}

/// Sends a frame and waits for the station's estimate; the inner error is the reason for a missing
/// one.
///
/// # Errors
/// If the line is down for longer than the heartbeat timeout.
pub fn offer(
    serial: &mut Serial,
    frame: Frame,
) -> Result<Result<EstimateReport, FrameRefusal>, StationError> {
    let sequence = serial.send(Command::Frame(frame));
    match outcome(serial, sequence) {
        Ok(answer) => Ok(estimate(answer, serial.status(), sequence)),
        // The line may be back, with a station that lost no state.
        Err(StationError::Interrupted { .. }) if serial.resume().is_ok() => {
            Ok(Err(FrameRefusal::Interrupted))
        }
        Err(lost) => Err(lost),
    }
}

/// Returns the estimate of an answered frame by the status after it.
pub(super) fn estimate(
    answer: Option<Result<(), Denial>>,
    status: Option<Status>,
    sequence: u16,
) -> Result<EstimateReport, FrameRefusal> {
    match answer {
        None => Err(FrameRefusal::Unanswered),
        Some(Err(denial)) => Err(FrameRefusal::Denied(denial)),
        Some(Ok(())) => status
            .and_then(|status| status.estimate)
            .filter(|estimate| estimate.sequence == sequence)
            .ok_or(FrameRefusal::Unreported),
    }
}

/// Waits for the answer to a frame and the status after it; `None` if no answer came.
fn outcome(serial: &mut Serial, sequence: u16) -> Result<Option<Result<(), Denial>>, StationError> {
    let end = HostInstant::now() + ANSWER_PATIENCE;
    let answer = serial.wait_until(end, |client| client.answer(sequence))?;
    if answer == Some(Ok(())) {
        // The status comes right behind the answer.
        serial.wait_until(end, |client| {
            let estimate = client.status()?.estimate?;
            (estimate.sequence == sequence).then_some(())
        })?;
    }
    Ok(answer)
}
