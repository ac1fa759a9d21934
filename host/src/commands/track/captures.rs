//! Frame sets from outside: follows each and prints its row.

use super::absences::Absences;
use super::page::{self, TrackPage};
use super::{TrackOptions, introduce, vector};
use crate::commands::failure::Failure;
use crate::commands::json;
use crate::commands::progress::{Count, StatusLine};
use serde_json::json;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use trinocular::run_report::HandEye;
use trinocular::servo::ServoError;
use trinocular::servo::frame_sets::{CaptureClock, Followed, FrameSetServo};
use trinocular::servo::recording::observers;
use trinocular::servo::station_link::StationLink;
use trinocular::servo::visual_servo::ServoStep;
use trinocular_client::observer::StationObserver;
use trinocular_client::{StationError, diagnosis};
use trinocular_core::frame::message::Mounting;
use trinocular_live::DropSource;
use trinocular_recording::recorder::Tap;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::flow::FlowRefusal;
use trinocular_vision::flow::mistake::explain_keyframe;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::cameras::stamp::offset_us;

/// Longest time of live cameras without a usable keyframe, µs: their automatic exposure settles
/// within a second or two after they are opened.
const LIGHT_US: u64 = 3_000_000;

/// Result of a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Summary {
    /// Number of frame sets after the first.
    pub frames: usize,
    /// Number of frame sets that were not used.
    pub refused: usize,
}

/// Frame sets and the station that follows them.
pub struct Captures<'a> {
    options: &'a TrackOptions,
    rig: &'a RigFile,
    servo: FrameSetServo,
    port: Option<&'a str>,
    /// Source that errors name.
    source: &'a Path,
    /// True if the frame sets are live.
    is_live: bool,
    absences: Absences,
    tap: Option<Arc<Tap>>,
    page: Option<TrackPage>,
}

impl<'a> Captures<'a> {
    /// Shows on the live page, if there is one, the images that never came to the loop.
    pub fn count_drops(&self, source: DropSource) {
        if let Some(page) = &self.page {
            page.count_drops(source);
        }
    }

    /// Starts the station: configured, its position zero. `now_us` is the clock of the frame set
    /// times, if the frame sets are live.
    pub fn new(
        options: &'a TrackOptions,
        rig: &'a RigFile,
        (stage, mounting): (&Stage, Mounting),
        port: Option<&'a str>,
        source: &'a Path,
        now_us: Option<&dyn Fn() -> u64>,
        tap: Option<Arc<Tap>>,
    ) -> Result<Self, Failure> {
        let failed = |error| Failure::of_servo(port, error);
        let place = options.station.place(port);
        let observer = tap.clone().map(|tap| tap as Arc<dyn StationObserver>);
        let station = StationLink::start_observed(place, stage, mounting, observer);
        let station = station.map_err(|error| failed(error.into()))?;
        introduce(&station);
        let clock = match (port, now_us) {
            (Some(_), Some(now_us)) => CaptureClock::Real {
                offset_us: offset_us(|| station.now().micros(), now_us),
            },
            _ => CaptureClock::Virtual {
                latency_us: options.latency_us(),
                period_us: options.period_us(),
            },
        };
        let page = options
            .page
            .open(rig, stage, mounting, &station, tap.clone())?;
        let servo = FrameSetServo::new(&rig.rig, options.method.into(), clock, station);
        let mut servo = servo.map_err(failed)?;
        let reported = options
            .report
            .observers(&rig.rig, HandEye::of(stage, mounting));
        for observer in observers(tap.clone(), &rig.rig).into_iter().chain(reported) {
            servo.add_observer(observer);
        }
        if let Some(page) = &page {
            servo.add_observer(page.observer());
        }
        Ok(Self {
            options,
            rig,
            servo,
            page,
            port,
            source,
            is_live: now_us.is_some(),
            absences: Absences::new(&rig.names),
            tap,
        })
    }

    /// Follows the frame sets to their end, and leaves the station at rest.
    pub fn follow(
        mut self,
        captures: impl Iterator<Item = Result<FrameSet, InputError>>,
        out: &mut impl Write,
    ) -> Result<Summary, Failure> {
        let outcome = self.print_all(captures, out);
        if let Err(Failure::Station(_)) = outcome {
            self.end();
            // The station has stopped by itself, or no stop can reach it.
            return outcome;
        }
        // After the end of live images the target may move on: without a stop, the stage would
        // run on to its predicted position.
        let rest = match self.is_live {
            true => self.servo.stop(),
            false => self.servo.rest(),
        };
        self.end();
        if let Ok(rest_mm) = rest
            && (self.is_live || outcome.is_ok())
        {
            let steps = match self.servo.station().counted_steps() {
                Some(steps) => format!(", {steps:?} steps"),
                None => String::new(),
            };
            notice!("the stage came to rest at {rest_mm:.4?} mm{steps}");
        }
        let summary = outcome?;
        rest.map_err(|error| Failure::of_station(self.port, error))?;
        Ok(summary)
    }

    /// Ends the recording at the station's present instant.
    fn end(&self) {
        if let Some(tap) = &self.tap {
            tap.end(self.servo.station().now().micros());
        }
    }

    fn print_all(
        &mut self,
        captures: impl Iterator<Item = Result<FrameSet, InputError>>,
        out: &mut impl Write,
    ) -> Result<Summary, Failure> {
        let mut summary = Summary::default();
        let mut count = Count::new("frame sets followed");
        let mut line = StatusLine::new(self.options.json);
        // Start of the time without a keyframe, and its reason.
        let mut dark: Option<(u64, InputError)> = None;
        for capture in captures {
            let capture = capture?;
            let followed = match self.servo.follow(&capture) {
                Err(ServoError::Reference(refusal)) => {
                    let since_us = dark
                        .as_ref()
                        .map_or(capture.time_us, |(since_us, _)| *since_us);
                    let error = self.no_reference(&capture, &refusal);
                    if !self.is_live || capture.time_us.saturating_sub(since_us) >= LIGHT_US {
                        return Err(error.into());
                    }
                    if dark.is_none() {
                        notice!("{}; waiting for a better one", error.reason);
                    }
                    dark = Some((since_us, error));
                    continue;
                }
                // A signal is the usual end of live images.
                Err(ServoError::Station(StationError::Cancelled)) if self.is_live => break,
                followed => followed.map_err(|error| Failure::of_servo(self.port, error))?,
            };
            dark = None;
            if self.page.as_ref().is_some_and(TrackPage::is_stopped) {
                return Err(Failure::of_station(self.port, page::stopped()));
            }
            if let Some(followed) = followed {
                summary.frames += 1;
                summary.refused += usize::from(!followed.turn.outcome.is_used());
                self.absences.warn(&followed.turn.absent);
                match &mut line {
                    Some(line) if self.is_live => line.show(|rate| status(&followed, rate)),
                    _ => print(
                        self.options.json,
                        summary.frames,
                        &followed,
                        &self.absences,
                        out,
                    )?,
                }
                count.at(summary.frames);
            }
        }
        match dark {
            Some((_, error)) => Err(error.into()),
            None => Ok(summary),
        }
    }

    fn no_reference(&self, capture: &FrameSet, refusal: &FlowRefusal) -> InputError {
        let RigFile { names, rig, .. } = self.rig;
        let refusal = explain_keyframe(rig, names, capture, refusal);
        let reason = format!("the first frame set cannot be the keyframe: {refusal}");
        InputError::file(self.source, reason)
    }
}

/// Returns the state of a live run in one line.
fn status(followed: &Followed, rate: f64) -> String {
    let Followed {
        time_s,
        stage_mm,
        turn,
    } = followed;
    let seen = match turn.outcome.estimate() {
        Some(estimate) => {
            let um = estimate
                .displacement_mm
                .map(|mm| format!("{:>7.1}", mm * 1e3));
            let sigma = estimate.sigma_mm.map_or(String::new(), |sigma| {
                let sigma = sigma.map(|mm| format!("{:.1}", mm * 1e3)).join(" ");
                format!("  sigma {sigma} um")
            });
            format!("target off by {} um{sigma}", um.join(" "))
        }
        None => turn.outcome.refusal().unwrap_or_default(),
    };
    format!(
        "{time_s:>6.1} s  stage {} mm  {seen}  {rate:.0}/s",
        vector(stage_mm)
    )
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
        stage_mm,
        turn,
    } = followed;
    let ServoStep {
        outcome,
        absent,
        trust,
    } = turn;
    let displacement_mm = outcome.estimate().map(|estimate| &estimate.displacement_mm);
    let refusal = outcome.refusal().unwrap_or_default();
    let known = diagnosis::position(*trust);
    if as_json {
        let trust = diagnosis::trust(*trust);
        let mut object =
            json!({"frame": frame, "time_s": time_s, "stage_mm": stage_mm, "trust": trust});
        absences.note(absent, &mut object);
        match displacement_mm {
            Some(displacement_mm) => object["displacement_mm"] = json!(displacement_mm),
            None => object["refused"] = json!(refusal),
        }
        json::line(out, &object)?;
    } else {
        if frame == 1 {
            let [target, stage] = ["target mm", "stage mm"];
            writeln!(out, "frame  {target:>26}  {stage:>26}  position  outcome")?;
        }
        let (seen, outcome) = match displacement_mm {
            Some(displacement_mm) => {
                let outcome = format!("used{}", absences.without(absent));
                (vector(displacement_mm), outcome)
            }
            None => (format!("{:>26}", "-"), refusal),
        };
        let stage = vector(stage_mm);
        writeln!(out, "{frame:>5}  {seen}  {stage}  {known:>8}  {outcome}")?;
    }
    // Flush, so that a reader gets each line at once.
    out.flush()?;
    Ok(())
}
