//! Captures from outside: each is followed and printed in its line.

use super::absences::Absences;
use super::{Options, introduce, vector};
use crate::commands::failed_at;
use crate::commands::progress::Count;
use host::error::{Failure, InputError};
use host::experiment::Error;
use host::experiment::follower::Follower;
use host::experiment::pursuit::{Clock, Followed, Pursuit};
use host::images::Capture;
use host::rig_file::{RigFile, Stage};
use host::station::diagnosis;
use serde_json::json;
use shared::frame::message::Mounting;
use std::io::Write;
use std::path::Path;

/// How it went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Summary {
    /// Captures after the first.
    pub frames: usize,
    /// Of them, those that were not used.
    pub refused: usize,
}

/// Captures and the station that follows them.
pub struct Captures<'a> {
    options: &'a Options,
    pursuit: Pursuit,
    port: Option<&'a str>,
    /// What errors name.
    source: &'a Path,
    absences: Absences,
}

impl<'a> Captures<'a> {
    /// Makes the station ready: configured, its position zero. `now_us` tells the captures' clock, if the captures are taken now.
    pub fn new(
        options: &'a Options,
        rig: &RigFile,
        (stage, mounting): (&Stage, Mounting),
        port: Option<&'a str>,
        source: &'a Path,
        now_us: Option<&dyn Fn() -> u64>,
    ) -> Result<Self, Failure> {
        let failed = |error| failed_at(port, error);
        let place = options.station.place(port);
        let station = Follower::start_as(place, stage, mounting);
        let station = station.map_err(|error| failed(error.into()))?;
        introduce(&station);
        let clock = match (port, now_us) {
            (Some(_), Some(now_us)) => Clock::Real {
                offset_us: station.now().micros() as i64 - now_us() as i64,
            },
            _ => Clock::Virtual {
                latency_us: options.latency * 1000,
                period_us: options.period_us(),
            },
        };
        let pursuit = Pursuit::new(&rig.rig, options.method.into(), clock, station);
        Ok(Self {
            options,
            pursuit: pursuit.map_err(failed)?,
            port,
            source,
            absences: Absences::new(&rig.names),
        })
    }

    /// Follows them to their end. The station is left at rest.
    pub fn follow(
        mut self,
        captures: impl Iterator<Item = Result<Capture, InputError>>,
        out: &mut impl Write,
    ) -> Result<Summary, Failure> {
        let outcome = self.print_all(captures, out);
        if let Err(Failure::Station(_)) = outcome {
            // It has stopped by itself, or cannot be told to.
            return outcome;
        }
        let rest = self.pursuit.rest();
        let summary = outcome?;
        let rest_mm = rest.map_err(|error| failed_at(self.port, error.into()))?;
        let steps = match self.pursuit.station().counted_steps() {
            Some(steps) => format!(", {steps:?} steps"),
            None => String::new(),
        };
        eprintln!("the stage came to rest at {rest_mm:.4?} mm{steps}");
        Ok(summary)
    }

    fn print_all(
        &mut self,
        captures: impl Iterator<Item = Result<Capture, InputError>>,
        out: &mut impl Write,
    ) -> Result<Summary, Failure> {
        let mut summary = Summary::default();
        let mut count = Count::new("captures followed");
        for capture in captures {
            let followed = self
                .pursuit
                .follow(&capture?)
                .map_err(|error| match error {
                    Error::Reference(refusal) => {
                        let reason =
                            format!("the first capture cannot be the reference: {refusal}");
                        InputError::file(self.source, reason).into()
                    }
                    error => failed_at(self.port, error),
                })?;
            if let Some(followed) = followed {
                summary.frames += 1;
                summary.refused += usize::from(followed.displacement_mm.is_err());
                self.absences.warn(&followed.absent);
                print(
                    self.options.json,
                    summary.frames,
                    &followed,
                    &self.absences,
                    out,
                )?;
                count.at(summary.frames);
            }
        }
        Ok(summary)
    }
}

fn print(
    as_json: bool,
    frame: usize,
    followed: &Followed,
    absences: &Absences,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let Followed {
        time_s,
        displacement_mm,
        stage_mm,
        trust,
        absent,
    } = followed;
    let trust = diagnosis::trust(*trust);
    if as_json {
        let mut object =
            json!({"frame": frame, "time_s": time_s, "stage_mm": stage_mm, "trust": trust});
        absences.note(absent, &mut object);
        match displacement_mm {
            Ok(displacement_mm) => object["displacement_mm"] = json!(displacement_mm),
            Err(reason) => object["refused"] = json!(reason),
        }
        writeln!(out, "{object}")?;
    } else {
        if frame == 1 {
            let [target, stage] = ["target mm", "stage mm"];
            writeln!(out, "frame  {target:>26}  {stage:>26}  position  outcome")?;
        }
        let (seen, outcome) = match displacement_mm {
            Ok(displacement_mm) => {
                let outcome = format!("used{}", absences.without(absent));
                (vector(displacement_mm), outcome)
            }
            Err(reason) => (format!("{:>26}", "-"), reason.clone()),
        };
        let stage = vector(stage_mm);
        writeln!(out, "{frame:>5}  {seen}  {stage}  {trust:>8}  {outcome}")?;
    }
    // Whoever reads along sees each line when it comes.
    out.flush()?;
    Ok(())
}
