//! `trinocular status`: shows the condition of a station.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, condition};
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::json;
use trinocular_client::diagnosis::{self, next_step};
use trinocular_client::serial::Holder;
use trinocular_client::{StationError, reset_cause};
use trinocular_core::frame::message::{Drops, EstimateReport, Hello, LastRun, Status};
use trinocular_core::track::pursuit::Sight;

/// Show the station's state, fault and position
///
/// Changes nothing. With a latched fault the exit code is 3; `trinocular diagnose` explains all
/// states and faults.
#[derive(Debug, Args)]
pub struct StatusOptions {
    #[command(flatten)]
    port: PortArgument,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &StatusOptions, out: &mut impl Write) -> Result<(), Failure> {
    let hand = Hand::connect_to_watch(&options.port)?;
    let (hello, last) = who(&hand)?;
    let status = hand.status()?;
    if options.json {
        let object = to_json(&hand, &hello, last.as_ref(), &status);
        super::json::line(out, &object)?;
    } else {
        writeln!(out, "{} on {}", hello.board, hand.port())?;
        let clock = hand.serial().offset_us().map(|(_, bound_us)| bound_us);
        if let Some(Holder { pid, command }) = hand.serial().owner() {
            writeln!(out, "{:<12}  by `{command}` (process {pid})", "in use")?;
        }
        for (name, value) in lines(&hello, last.as_ref(), &status, clock) {
            writeln!(out, "{name:<12}  {value}")?;
        }
    }
    match status.fault {
        None => Ok(()),
        Some(fault) => Err(hand.failed(StationError::Faulted(fault))),
    }
}

/// Returns the station's hello and its report of the last run.
pub fn who(hand: &Hand) -> Result<(Hello, Option<LastRun>), Failure> {
    let last = hand
        .serial()
        .last_run()
        .map_err(|error| hand.failed(error))?;
    let hello = hand.serial().who();
    let hello =
        hello.ok_or_else(|| Failure::Station(format!("{}: no hello", hand.port()).into()))?;
    Ok((hello, last))
}

/// Returns all items of the status, each with its name.
pub fn lines(
    hello: &Hello,
    last: Option<&LastRun>,
    status: &Status,
    clock_bound_us: Option<u64>,
) -> Vec<(&'static str, String)> {
    let state = diagnosis::state(status.state);
    let steps = |[x, y, z]: [i32; 3]| format!("{x} {y} {z} steps");
    let mut lines = vec![("state", format!("{}: {}", state.name, state.meaning))];
    for (rank, fault) in status.faults.iter().enumerate() {
        let cause = diagnosis::fault(fault).cause;
        let name = if rank == 0 { "fault" } else { "also fault" };
        lines.push((name, format!("{}: {cause}", fault.number())));
    }
    let motors = if status.motors { "on" } else { "off" };
    lines.push(("motors", motors.to_owned()));
    let known = diagnosis::position(status.trust);
    let position = format!("{}, {known}", steps(status.position_steps));
    lines.push(("position", position));
    if status.target_steps != status.position_steps {
        lines.push(("target", steps(status.target_steps)));
    }
    if status.frames_used > 0 || status.frames_refused > 0 {
        let (used, refused) = (status.frames_used, status.frames_refused);
        lines.push(("frames", format!("{used} used, {refused} refused")));
    }
    if let Some(estimate) = &status.estimate {
        lines.push(("last frame", last_frame(estimate)));
    }
    if status.sight != Sight::None {
        let (sight, ms) = (diagnosis::sight(status.sight), status.seen_ms);
        lines.push(("sight", format!("{sight}, seen {ms} ms ago")));
    }
    if let Some(bound_us) = clock_bound_us {
        lines.push(("clock", format!("known to {bound_us} us")));
    }
    let dropped: Vec<_> = drops(&status.drops)
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{count} {}", name.replace('_', " ")))
        .collect();
    if !dropped.is_empty() {
        lines.push(("not taken", format!("packets: {}", dropped.join(", "))));
    }
    let ended = last.and_then(|last| diagnosis::last_run(hello, last));
    let cause = reset_cause(hello.reset_cause);
    let start = ended.map_or(cause.to_owned(), |ended| {
        format!("{cause}: {ended} (`trinocular hello` says where)")
    });
    lines.push(("last start", start));
    if let Some(next) = next_step(status) {
        lines.push(("next", next));
    }
    lines
}

fn last_frame(estimate: &EstimateReport) -> String {
    let text = |mm: f64| format!("{mm:.4}");
    let moved = estimate.displacement_mm().map(text);
    let sigma = estimate.sigma_mm().map_or(String::new(), |sigma| {
        format!(" +- {}", sigma.map(text).join(" "))
    });
    let latency_ms = f64::from(estimate.latency_us) * 1e-3;
    format!(
        "{}{sigma} mm, {latency_ms:.1} ms after the image",
        moved.join(" ")
    )
}

fn drops(drops: &Drops) -> [(&'static str, u16); 8] {
    [
        ("too_long", drops.rejects.too_long),
        ("framing", drops.rejects.framing),
        ("checksum", drops.rejects.checksum),
        ("malformed", drops.rejects.malformed),
        ("duplicate", drops.duplicate),
        ("stale", drops.stale),
        ("overflow", drops.overflow),
        ("answers_lost", drops.answers),
    ]
}

/// Returns the status with all its items.
pub fn to_json(
    hand: &Hand,
    hello: &Hello,
    last: Option<&LastRun>,
    status: &Status,
) -> serde_json::Value {
    let mut object = condition(status);
    let estimate = status.estimate.map(|estimate| {
        json!({
            "sequence": estimate.sequence,
            "displacement_mm": estimate.displacement_mm(),
            "sigma_mm": estimate.sigma_mm(),
            "latency_ms": f64::from(estimate.latency_us) * 1e-3,
        })
    });
    object["port"] = json!(hand.port());
    object["owner_pid"] = json!(hand.serial().owner().map(|owner| owner.pid));
    object["board"] = json!(hello.board.as_str());
    object["time_us"] = json!(status.time.micros());
    object["tick"] = json!(status.tick);
    object["frames_used"] = json!(status.frames_used);
    object["frames_refused"] = json!(status.frames_refused);
    object["drops"] = drops(&status.drops)
        .map(|(name, count)| (name.to_owned(), json!(count)))
        .into_iter()
        .collect();
    object["estimate"] = json!(estimate);
    object["sight"] = json!(diagnosis::sight(status.sight));
    object["seen_ms"] = json!(status.seen_ms);
    object["clock_bound_us"] = json!(hand.serial().offset_us().map(|(_, bound_us)| bound_us));
    object["last_run"] = json!(last.map(super::hello::last_run_json));
    object["next"] = json!(next_step(status));
    object
}
