//! Tracking in closed loop with the simulator.

use super::super::by_hand;
use super::super::progress::{Progress, StatusLine};
use super::absences::Absences;
use super::page::{self, TrackPage};
use super::row::{add_outcome, known, vector};
use super::{TrackOptions, introduce, row};
use crate::commands::failure::Failure;
use crate::commands::{csv_rows, json};
use serde_json::json;
use std::io::Write;
use std::sync::Arc;
use trinocular::run_report::HandEye;
use trinocular::servo::path::TargetPath;
use trinocular::servo::recording::observers;
use trinocular::servo::simulated::{ServoTiming, SimulatedServo, SimulatedStep};
use trinocular::servo::visual_servo::{ServoOutcome, ServoStep};
use trinocular::servo::world::SimulatedWorld;
use trinocular_client::diagnosis;
use trinocular_client::observer::StationObserver;
use trinocular_client::serial::Serial;
use trinocular_client::stage::{default_stage, setpoint};
use trinocular_core::frame::message::{Command, Mounting};
use trinocular_recording::recorder::Tap;
use trinocular_rig::interruption;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::Texture;

/// Returns the default duration of the run, s: the Lissajous figure is whole after 16 s.
fn default_seconds(path: TargetPath) -> f64 {
    match path {
        TargetPath::Lissajous => 16.0,
        _ => 8.0,
    }
}

/// Runs for the duration, then prints a summary on standard error.
pub fn run(options: &TrackOptions, out: &mut impl Write) -> Result<(), Failure> {
    let mut file = match &options.rig {
        Some(path) => options.read_rig(path)?,
        None => {
            let mut paper = RigFile::paper();
            options.turn(&mut paper)?;
            paper
        }
    };
    file.stage.get_or_insert_with(default_stage);
    let recording = options.recording(&file)?;
    let outcome = follow(options, file, recording.tap(), out);
    recording.close(outcome)
}

fn follow(
    options: &TrackOptions,
    file: RigFile,
    tap: Option<Arc<Tap>>,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let rig = file.rig.clone();
    let stage = file.stage.clone().unwrap_or_else(default_stage);
    let texture = Texture::of_kind(options.scene.texture, options.scene.seed);
    let settings = options.scene.settings();
    let port = options.station.resolve()?;
    let failed = |error| Failure::of_servo(port.as_deref(), error);
    let world = SimulatedWorld::new_observed(
        &rig,
        &stage,
        options.station.place(port.as_deref()),
        &texture,
        settings,
        options.scene.seed,
        tap.clone().map(|tap| tap as Arc<dyn StationObserver>),
    );
    let mut world = world.map_err(failed)?;
    let timing = ServoTiming {
        frames_per_s: options.fps(),
        latency_us: options.latency_us(),
    };
    introduce(&world.b);
    let page = options
        .page
        .open(&file, &stage, Mounting::OnStage, &world.b, tap.clone())?;
    let mut observers = observers(tap.clone(), &rig);
    observers.extend(page.iter().map(TrackPage::observer));
    observers.extend(
        options
            .report
            .observers(&rig, HandEye::of(&stage, Mounting::OnStage)),
    );
    observers.extend(options.zenoh.observers(&rig));
    let estimator = options.method.into();
    let servo = SimulatedServo::start_observed(&mut world, &rig, timing, estimator, observers);
    let mut servo = servo.map_err(failed)?;
    servo.set_pivot(file.estimated_pivot());
    let columns = row::columns(&file);
    let mut absences = Absences::new(&file.names);
    let mut line = StatusLine::new(options.json || options.csv);
    let mut progress = match line {
        Some(_) => Progress::hidden(),
        None => Progress::new("following"),
    };
    let (mut squares, mut worst, mut count, mut unused) = ([0.0; 3], [0.0f64; 3], 0u32, 0u32);
    if options.csv {
        csv_rows::header(out, &columns)?;
    } else if !options.json && line.is_none() {
        writeln!(
            out,
            "{:>8}  {:>26}  {:>26}  {:>26}  position  outcome",
            "time s", "target mm", "cameras mm", "cameras - target mm"
        )?;
    }
    let seconds = options.seconds.unwrap_or(default_seconds(options.path));
    // Ctrl-C ends the run with its summary, and a recording whole.
    by_hand::on_interrupt()?;
    let mut follow = || -> Result<bool, Failure> {
        while servo.time_s(&world) + 1.0 / options.fps() <= seconds && !interruption::is_requested()
        {
            // A gets its setpoint at every frame set, one frame set ahead.
            let next_mm = options.path.at(servo.time_s(&world));
            world.a.send(setpoint(next_mm));
            let step = servo.step(&mut world).map_err(failed)?;
            if world.b.twin().is_some() {
                options.zenoh.pace(step.time_s);
            }
            if let Some(page) = &page {
                if world.b.twin().is_some() {
                    page.pace(step.time_s);
                }
                if page.is_stopped() {
                    return Ok(true);
                }
            }
            progress.at(step.time_s / seconds);
            let error: [f64; 3] = std::array::from_fn(|i| step.camera_mm[i] - step.target_mm[i]);
            // The first second is for catching up.
            if step.time_s > 1.0 {
                count += 1;
                for i in 0..3 {
                    squares[i] += error[i] * error[i];
                    worst[i] = worst[i].max(error[i].abs());
                }
            }
            unused += u32::from(!step.turn.outcome.is_used());
            absences.warn(&step.turn.absent);
            match &mut line {
                Some(line) => line.show(|rate| status(&step, error, rate)),
                None => print((options, &columns), &step, error, &absences, out)?,
            }
        }
        Ok(false)
    };
    let followed = follow();
    drop((line, progress));
    // After a failure the line itself stops the stage as it is dropped, and says so.
    let stopped = match followed {
        Ok(_) => world.b.command("stop", Command::Stop),
        Err(_) => Ok(()),
    };
    // A run that fails leaves a whole recording, too.
    if let Some(tap) = tap {
        tap.end(world.b.now().micros());
    }
    let is_stopped = followed?;
    stopped.map_err(|error| failed(error.into()))?;
    let rms = squares.map(|sum| (sum / f64::from(count.max(1))).sqrt());
    if let Some((_, bound_us)) = world.b.serial().and_then(Serial::offset_us) {
        notice!("the station's clock was known to {bound_us} us");
    }
    let error = match count {
        0 => "no image after the first second, which is for catching up".to_owned(),
        _ => {
            format!(
                "following error after the first second: rms {rms:.4?} mm, largest {worst:.4?} mm"
            )
        }
    };
    notice!("{error}; {unused} images not used");
    match is_stopped {
        true => Err(failed(page::stopped().into())),
        false => interruption::signal().map_or(Ok(()), |signal| Err(Failure::Interrupted(signal))),
    }
}

/// Returns the state of the run in one line.
fn status(step: &SimulatedStep, error: [f64; 3], rate: f64) -> String {
    let um = error.map(|mm| format!("{:>7.1}", mm * 1e3)).join(" ");
    let sigma = step.turn.outcome.estimate().and_then(|seen| seen.sigma_mm);
    let sigma = sigma.map_or(String::new(), |sigma| {
        let sigma = sigma.map(|mm| format!("{:.1}", mm * 1e3)).join(" ");
        format!("  sigma {sigma} um")
    });
    format!(
        "{:>6.1} s  stage {} mm  error {um} um{sigma}  {rate:.0}/s  {}",
        step.time_s,
        vector(&step.camera_mm),
        reason(&step.turn.outcome)
    )
}

fn print(
    (options, columns): (&TrackOptions, &csv_rows::Columns),
    step: &SimulatedStep,
    error: [f64; 3],
    absences: &Absences,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let SimulatedStep {
        time_s,
        target_mm,
        camera_mm,
        turn,
    } = step;
    let ServoStep {
        outcome,
        absent,
        trust,
        stage_mm: _,
    } = turn;
    let position = diagnosis::position(*trust);
    if options.json || options.csv {
        let trust = diagnosis::trust(*trust);
        let mut object = json!({
            "time_s": time_s, "target_mm": target_mm, "camera_mm": camera_mm, "trust": trust,
        });
        absences.note(absent, &mut object);
        add_outcome(&mut object, outcome);
        return match options.json {
            true => Ok(json::line(out, &object)?),
            false => Ok(csv_rows::row(out, columns, object)?),
        };
    }
    writeln!(
        out,
        "{time_s:>8.3}  {}  {}  {}  {position:>8}  {}{}",
        vector(target_mm),
        vector(camera_mm),
        vector(&error),
        reason(outcome),
        absences.without(absent)
    )?;
    Ok(())
}

fn reason(outcome: &ServoOutcome) -> String {
    match outcome {
        ServoOutcome::Used(estimate) => known(estimate),
        other => other.refusal().unwrap_or_default(),
    }
}
