//! Ranges of the numbers that a station sends, checked when they arrive.
//!
//! A checksum protects numbers on the line, not against faulty or foreign firmware. The host waits
//! for instants that a station names and lets a simulated world run up to them, so a number
//! outside these ranges is refused as [`Implausible`] and never acted on.
//!
//! | field | range |
//! |---|---|
//! | `hello.word_rate_hz` | 32,000 to 16,000,000 |
//! | `hello.delay_us` | 0 to 100,000 |
//! | `pong.host_us` | 0 to the host's clock: the ping was sent before |
//! | `pong.received`, `pong.sent` | 0 to 1,000 days in µs; `sent` at most 10 s after `received` |
//! | `status.time` | 0 to 1,000 days in µs; where the host waits, at most 1 s after its clock |
//! | `pong.sent`, `status.time` | at most 10 s ahead of the station's clock as the host knows it |
//! | `status.position_steps`, `status.target_steps` | -1,000,000,000 to 1,000,000,000 |
//! | `status.estimate.latency_us` | 0 to 10,000,000 |
//! | `answer.tick` | at most 60,000 from that of the latest status |
//!
//! All values of the remaining fields are possible.

use std::ops::RangeInclusive;
use trinocular_core::frame::message::{Hello, Report, Status};
use trinocular_core::time::Instant;

/// Longest uptime of a station, µs: 1,000 days.
const LONGEST_UPTIME_US: u64 = 1_000 * 24 * 3_600 * 1_000_000;

/// Longest lead of a status over the station's clock as the host knows it, µs.
const MOST_AHEAD_US: u64 = 10_000_000;

/// Longest lead of the instant of a status, output delay included, over the host's clock, µs.
const MOMENT_AHEAD_US: u64 = 1_000_000;

/// Longest time from a ping's arrival at the station to its reply, and oldest frame, µs.
const LONGEST_HOLD_US: u64 = 10_000_000;

/// Longest output delay, µs.
const LONGEST_DELAY_US: u32 = 100_000;

/// Farthest position, steps.
const FARTHEST_STEPS: i32 = 1_000_000_000;

/// Largest difference between the ticks of an answer and of the latest status.
const FARTHEST_TICKS: i32 = 60_000;

/// Implausible number from a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field} from the station is {value}, must be {least} to {most}: {cause}")]
pub struct Implausible {
    /// Report and its field.
    pub field: &'static str,
    /// Value that the station sent.
    pub value: i128,
    /// Lowest plausible value.
    pub least: i128,
    /// Highest plausible value.
    pub most: i128,
    /// Cause, in words.
    pub cause: &'static str,
}

const FIRMWARE: &str = "its firmware is faulty or foreign";

const CLOCKS: &str =
    "this computer slept meanwhile, or the station's firmware is faulty or foreign";

/// Host's knowledge when a report arrives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    /// Host's clock, µs.
    pub host_us: u64,
    /// Station's clock as the host knows it, µs.
    pub station_us: Option<u64>,
    /// Tick of the latest status since the hello.
    pub tick: Option<u32>,
}

/// Checks every number of a report.
pub(super) fn check(report: &Report, known: Known) -> Result<(), Implausible> {
    match report {
        Report::Hello(hello) => check_hello(hello),
        Report::Status(status) => check_status(status, known),
        Report::Pong {
            host_us,
            received,
            sent,
        } => {
            within("pong.host_us", *host_us, 0..=known.host_us)?;
            uptime("pong.received", *received)?;
            uptime("pong.sent", *sent)?;
            ahead("pong.sent", *sent, known)?;
            let earliest = received.micros();
            let latest = earliest + LONGEST_HOLD_US;
            within("pong.sent", sent.micros(), earliest..=latest)
        }
        Report::Answer { tick, .. } => {
            let Some(status_tick) = known.tick else {
                return Ok(());
            };
            // Ticks count modulo 2^32: only their difference says how far apart they are.
            let apart = tick.wrapping_sub(status_tick) as i32;
            let range = -FARTHEST_TICKS..=FARTHEST_TICKS;
            within("answer.tick minus status.tick", apart, range)
        }
        Report::LastRun(_) => Ok(()),
    }
}

/// Checks the instant, on the host's clock, at which the pins stand where a status says.
///
/// ```
/// use trinocular_client::plausible::check_moment;
///
/// assert!(check_moment(1_200_000, 1_000_000).is_ok());
/// assert!(check_moment(9_000_000, 1_000_000).is_err());
/// ```
///
/// # Errors
/// [`Implausible`] if it is more than 1 s after `now_us`: a caller would wait for it for ever.
pub fn check_moment(at_us: u64, now_us: u64) -> Result<(), Implausible> {
    let latest_us = now_us.saturating_add(MOMENT_AHEAD_US);
    within("status.time on this computer's clock", at_us, 0..=latest_us)
}

fn check_hello(hello: &Hello) -> Result<(), Implausible> {
    if !hello.mismatches().is_empty() {
        // The meaning of another firmware's numbers is unknown.
        return Ok(());
    }
    let word_rates_hz = 32_000..=16_000_000;
    within("hello.word_rate_hz", hello.word_rate_hz, word_rates_hz)?;
    within("hello.delay_us", hello.delay_us, 0..=LONGEST_DELAY_US)
}

fn check_status(status: &Status, known: Known) -> Result<(), Implausible> {
    uptime("status.time", status.time)?;
    ahead("status.time", status.time, known)?;
    for (field, steps) in [
        ("status.position_steps", status.position_steps),
        ("status.target_steps", status.target_steps),
    ] {
        for steps in steps {
            within(field, steps, -FARTHEST_STEPS..=FARTHEST_STEPS)?;
        }
    }
    status.estimate.map_or(Ok(()), |estimate| {
        let latency_us = u64::from(estimate.latency_us);
        let field = "status.estimate.latency_us";
        within(field, latency_us, 0..=LONGEST_HOLD_US)
    })
}

/// Checks that the station's clock has not jumped ahead of the host's knowledge of it.
fn ahead(field: &'static str, time: Instant, known: Known) -> Result<(), Implausible> {
    known.station_us.map_or(Ok(()), |station_us| {
        let latest = station_us.saturating_add(MOST_AHEAD_US);
        let plausible = within(field, time.micros(), 0..=latest);
        plausible.map_err(|implausible| Implausible {
            cause: CLOCKS,
            ..implausible
        })
    })
}

fn uptime(field: &'static str, time: Instant) -> Result<(), Implausible> {
    within(field, time.micros(), 0..=LONGEST_UPTIME_US)
}

fn within<T: Copy + PartialOrd + Into<i128>>(
    field: &'static str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), Implausible> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(Implausible {
        field,
        value: value.into(),
        least: (*range.start()).into(),
        most: (*range.end()).into(),
        cause: FIRMWARE,
    })
}

#[cfg(test)]
mod tests;
