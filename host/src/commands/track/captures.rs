//! Frame sets from outside: follows each and prints its row.

use super::absences::Absences;
use super::others::{self, Targets};
use super::page::{self, TrackPage};
use super::row::{add_outcome, add_warnings, known, vector};
use super::shift::ShiftObserver;
use super::{TrackOptions, introduce, row};
use crate::commands::exposures::Exposures;
use crate::commands::failure::Failure;
use crate::commands::progress::{Count, StatusLine};
use crate::commands::{csv_rows, json};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use trinocular::run_report::HandEye;
use trinocular::servo::ServoError;
use trinocular::servo::frame_sets::{CaptureClock, Followed, FrameSetServo};
use trinocular::servo::recording::observers;
use trinocular::servo::station_link::StationLink;
use trinocular::servo::triggering::Triggering;
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

/// Count of the images of live cameras that never came to the loop.
struct LiveDrops<'a>(Box<dyn Fn() -> u64 + 'a>);

/// Clock of the times of live frame sets.
#[derive(Clone, Copy)]
pub enum LiveClock<'a> {
    /// A clock of this computer, µs.
    Host(&'a dyn Fn() -> u64),
    /// The clock of the station, which triggers the cameras.
    Station(&'a Triggering),
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
    exposures: Exposures,
    drops: Option<LiveDrops<'a>>,
    tap: Option<Arc<Tap>>,
    page: Option<TrackPage>,
    targets: Option<Targets>,
}

impl<'a> Captures<'a> {
    /// Shows on the live page, if there is one, the images that never came to the loop.
    pub fn count_drops(&self, source: DropSource) {
        if let Some(page) = &self.page {
            page.count_drops(source);
        }
    }

    /// Writes in each row the number of images so far that never came to the loop.
    pub fn tell_drops(&mut self, count: impl Fn() -> u64 + 'a) {
        self.drops = Some(LiveDrops(Box::new(count)));
    }

    /// Starts the station: configured, its position zero. `live` is the clock of the frame set
    /// times, if the frame sets are live; a station that triggers the cameras does so from now on.
    pub fn new(
        options: &'a TrackOptions,
        rig: &'a RigFile,
        (stage, mounting): (&Stage, Mounting),
        port: Option<&'a str>,
        source: &'a Path,
        live: Option<LiveClock<'_>>,
        tap: Option<Arc<Tap>>,
    ) -> Result<Self, Failure> {
        let failed = |error| Failure::of_servo(port, error);
        let regions = options.regions(rig)?;
        let targets = Targets::of(rig, &options.given_regions(rig)?, source)?;
        let place = options.station.place(port);
        let observer = tap.clone().map(|tap| tap as Arc<dyn StationObserver>);
        let station = StationLink::start_observed(place, stage, mounting, observer.clone());
        let station = station.map_err(|error| failed(error.into()))?;
        introduce(&station);
        let clock = match (port, live) {
            (_, Some(LiveClock::Station(_))) => CaptureClock::Station,
            (Some(_), Some(LiveClock::Host(now_us))) => CaptureClock::Real {
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
        servo.set_regions(regions);
        servo.set_pivot(rig.estimated_pivot());
        let reported = options
            .report
            .observers(&rig.rig, HandEye::of(stage, mounting));
        let published = options.zenoh.observers(&rig.rig);
        let recorded = observers(tap.clone(), &rig.rig);
        for observer in recorded.into_iter().chain(reported).chain(published) {
            servo.add_observer(observer);
        }
        if let Some(page) = &page {
            servo.add_observer(page.observer());
        }
        if options.reference.is_some() {
            servo.add_observer(Box::new(ShiftObserver::of(rig)));
        }
        // Last: nothing fails after it that would leave the cameras triggered.
        if let Some(LiveClock::Station(triggering)) = live {
            let started = servo.station_mut().trigger(triggering, observer);
            started.map_err(failed)?;
        }
        Ok(Self {
            options,
            rig,
            servo,
            page,
            port,
            source,
            is_live: live.is_some(),
            absences: Absences::new(&rig.names),
            exposures: Exposures::new(&rig.names),
            drops: None,
            tap,
            targets,
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
            // The run of live cameras ends with a stop.
            let next = match self.port.filter(|_| self.is_live) {
                Some(_) => "; `trinocular reset` lets other commands move it again",
                None => "",
            };
            notice!("the stage came to rest at {rest_mm:.4?} mm{steps}{next}");
        }
        let summary = outcome?;
        rest.map_err(|error| Failure::of_station(self.port, error))?;
        Ok(summary)
    }

    /// Ends the triggers, and the recording at the station's present instant.
    fn end(&mut self) {
        self.servo.station_mut().end_triggers();
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
        let mut line = StatusLine::new(self.options.json || self.options.csv);
        // Start of the time without a keyframe, and its reason.
        let mut dark: Option<(u64, InputError)> = None;
        // Sentences about the exposure for the next row. A keyframe has no row of its own.
        let mut exposure = Vec::new();
        for capture in captures {
            let capture = capture?;
            let noted = self.exposures.note(&capture);
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
            exposure.extend(noted);
            if self.page.as_ref().is_some_and(TrackPage::is_stopped) {
                return Err(Failure::of_station(self.port, page::stopped()));
            }
            if followed.is_none()
                && let Some(targets) = &mut self.targets
            {
                targets.refer_to(&capture);
            }
            if let Some(followed) = followed {
                summary.frames += 1;
                summary.refused += usize::from(!followed.turn.outcome.is_used());
                self.absences.warn(&followed.turn.absent);
                let exposure = std::mem::take(&mut exposure);
                match &mut line {
                    Some(line) if self.is_live => line.show(|rate| status(&followed, rate)),
                    _ => {
                        let targets = self.targets.as_mut();
                        let targets = targets.map(|targets| targets.measure(self.rig, &capture));
                        let more = (exposure, targets);
                        self.print(summary.frames, &followed, more, out)?;
                    }
                }
                count.at(summary.frames);
            }
        }
        match dark {
            Some((_, error)) => Err(error.into()),
            None => Ok(summary),
        }
    }

    /// Prints the row of a frame set, with sentences about its exposure, and all targets.
    fn print(
        &self,
        frame: usize,
        followed: &Followed,
        (exposure, targets): (Vec<String>, Option<Value>),
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
            stage_mm: _,
        } = turn;
        if self.options.json || self.options.csv {
            let trust = diagnosis::trust(*trust);
            let mut object =
                json!({"frame": frame, "time_s": time_s, "stage_mm": stage_mm, "trust": trust});
            self.absences.note(absent, &mut object);
            add_warnings(&mut object, exposure);
            add_outcome(&mut object, outcome);
            if let Some(LiveDrops(count)) = &self.drops {
                object["drops"] = json!(count());
            }
            if let Some(targets) = targets {
                object["targets"] = targets;
            }
            let columns = row::columns(self.rig);
            if self.options.json {
                json::line(out, &object)?;
            } else {
                if frame == 1 {
                    csv_rows::header(out, &columns)?;
                }
                csv_rows::row(out, &columns, object)?;
            }
        } else {
            if frame == 1 {
                let [target, stage] = ["target mm", "stage mm"];
                writeln!(out, "frame  {target:>26}  {stage:>26}  position  outcome")?;
            }
            let (seen, outcome) = match outcome.estimate() {
                Some(estimate) => {
                    let without = self.absences.without(absent);
                    let outcome = format!("used{without}, {}", known(estimate));
                    (vector(&estimate.displacement_mm), outcome)
                }
                None => {
                    let reason = outcome.refusal().unwrap_or_default();
                    (format!("{:>26}", "-"), reason)
                }
            };
            let (stage, position) = (vector(stage_mm), diagnosis::position(*trust));
            writeln!(out, "{frame:>5}  {seen}  {stage}  {position:>8}  {outcome}")?;
            for target in targets.iter().filter_map(Value::as_array).flatten() {
                writeln!(out, "{}", others::line(target))?;
            }
        }
        // Flush, so that a reader gets each line at once.
        out.flush()?;
        Ok(())
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
