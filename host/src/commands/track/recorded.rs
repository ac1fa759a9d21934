//! Driven by a folder of images, cameras beside the stage.

use super::{Estimator, Options};
use host::error::{Failure, InputError};
use host::flow::{Flow, Settings};
use host::images::Capture;
use host::images::folder::Folder;
use host::rig_file::RigFile;
use host::station::stage::default_stage;
use host::station::twin::Twin;
use host::sums::Sums;
use serde_json::json;
use shared::frame::message::{Command, Frame, Mounting, Sums as FrameSums};
use shared::rig::Rig;
use shared::time::Instant;
use std::io::Write;
use std::path::Path;

/// Feeds every capture to the station at its time; prints where the stage went.
pub fn run(
    options: &Options,
    folder: &Path,
    rig_path: &Path,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let rig = match options.method {
        Estimator::ClosedForm => RigFile::read_in_line(rig_path)?,
        Estimator::Midpoint => RigFile::read(rig_path)?,
    };
    let period_us = (1e6 / options.fps).round() as u64;
    let captures = Folder::open(folder, &rig.names, rig.rig.image_size_px, period_us)?;
    let count = captures.len();
    let mut captures = captures.captures();
    let (Some(first), 2..) = (captures.next(), count) else {
        return Err(InputError::file(
            folder,
            format!("{count} capture; following takes at least two"),
        )
        .into());
    };
    let mut flow = Flow::new(&rig.rig, Settings::default())
        .map_err(|refusal| InputError::file(rig_path, refusal.to_string()))?;
    let first = first?;
    flow.set_reference(&first).map_err(|refusal| {
        InputError::file(
            folder,
            format!("the first capture cannot be the reference: {refusal}"),
        )
    })?;
    let stage = rig.stage.clone().unwrap_or_else(default_stage);
    let mut twin = Twin::start(&stage, "twin B", Mounting::Fixed)
        .map_err(|error| Failure::Station(error.to_string()))?;
    let reference = twin.now();
    let (mut frames, mut refused) = (0, 0);
    if !options.json {
        writeln!(
            out,
            "frame  {:>26}  {:>26}  outcome",
            "target mm", "stage mm"
        )?;
    }
    for capture in captures {
        let capture = capture?;
        frames += 1;
        let taken = reference.plus_micros(capture.time_us - first.time_us);
        let outcome = follow(&mut flow, &rig.rig, options.method, &capture).and_then(|sums| {
            twin.advance(taken.plus_micros(options.latency * 1000));
            let sequence = twin.send(Command::Frame(Frame {
                capture: taken,
                reference,
                sums,
            }));
            twin.advance(twin.now().plus_micros(2_000));
            match twin.answer(sequence) {
                Some(Ok(())) => Ok(()),
                Some(Err(denial)) => Err(denial.to_string()),
                None => Err("no answer from the station".to_owned()),
            }
        });
        refused += usize::from(outcome.is_err());
        let target = outcome.as_ref().ok().and_then(|()| displacement(&twin));
        let stage_mm = settle(&mut twin, taken, period_us);
        print(options.json, frames, target, stage_mm, outcome.err(), out)?;
    }
    // The last frame's motion ends after it.
    twin.advance(twin.now().plus_micros(2_000_000));
    eprintln!(
        "the stage came to rest at {:.4?} mm, {:?} steps",
        twin.position_mm(),
        twin.steps_from_zero()
    );
    if refused == 0 {
        return Ok(());
    }
    Err(Failure::Refused {
        file: folder.to_owned(),
        refused,
        frames,
    })
}

fn follow(
    flow: &mut Flow,
    rig: &Rig,
    method: Estimator,
    capture: &Capture,
) -> Result<FrameSums, String> {
    let measured = flow
        .measure(capture)
        .map_err(|refusal| refusal.to_string())?;
    let frame = Sums::of(rig, &measured).and_then(|sums| sums.frame(method.into()));
    frame.map_err(|refusal| refusal.to_string())
}

/// The station's own estimate, mm.
fn displacement(twin: &Twin) -> Option<[f64; 3]> {
    let estimate = twin.status()?.estimate?;
    Some(estimate.displacement_nm.map(|nm| f64::from(nm) * 1e-6))
}

/// Lets time pass until just before the next frame; gives where the stage is then.
fn settle(twin: &mut Twin, taken: Instant, period_us: u64) -> [f64; 3] {
    twin.advance(taken.plus_micros(period_us));
    twin.position_mm()
}

fn print(
    as_json: bool,
    frame: usize,
    target: Option<[f64; 3]>,
    stage: [f64; 3],
    refused: Option<String>,
    out: &mut impl Write,
) -> Result<(), Failure> {
    if as_json {
        let line = match (target, refused) {
            (Some(target), _) => {
                json!({"frame": frame, "displacement_mm": target, "stage_mm": stage})
            }
            (None, refused) => json!({"frame": frame, "refused": refused, "stage_mm": stage}),
        };
        writeln!(out, "{line}")?;
        return Ok(());
    }
    let vector = |v: [f64; 3]| format!("{:>8.4} {:>8.4} {:>8.4}", v[0], v[1], v[2]);
    let seen = target.map_or_else(|| format!("{:>26}", "-"), vector);
    writeln!(
        out,
        "{frame:>5}  {seen}  {}  {}",
        vector(stage),
        refused.unwrap_or_else(|| "used".to_owned())
    )?;
    Ok(())
}
