//! Delay of the cameras' time stamps, or the middle of the exposures that the station triggers, from
//! images of the moving stage.

use super::{CalibrateStageOptions, Pass, StageBench};
use crate::commands::failure::Failure;
use crate::commands::warnings;
use std::io::Write;
use trinocular_rig::rig_file::{RigFile, Trigger};
use trinocular_vision::hand_eye::delay::{self, Delay, Passing, Path};
use trinocular_vision::hand_eye::fit::Fit;
use trinocular_vision::hand_eye::watch::Watch;

/// Ends of the stage's passes while images are taken, as shares of the reach.
const PASSES: [f64; 4] = [-0.6, 0.6, -0.6, 0.0];

/// Least difference of an exposure from the rig file's that is worth a warning, ms, and as a
/// multiple of sigma.
const NOTED_MS: f64 = 0.2;
const NOTED_SIGMA: f64 = 4.0;

/// Source of the capture times.
#[derive(Clone, Copy, Debug)]
enum Source {
    /// Frame sets without times.
    Files,
    /// Time stamps as they are.
    Stamps,
    /// Time stamps less the rig file's delays.
    Corrected,
    /// Triggers of the station.
    Triggers(Trigger),
}

/// Delay that was measured, and its meaning.
pub struct Timing {
    source: Source,
    delay: Option<Delay>,
}

impl Timing {
    /// Moves the stage past the target and compares the measured displacements with its path.
    ///
    /// # Errors
    /// If the stage cannot be moved, or a delay of time stamps cannot be found. Triggers need none,
    /// and get a warning.
    pub fn measure(
        options: &CalibrateStageOptions,
        rig: &RigFile,
        bench: &mut dyn StageBench,
        watch: &mut Watch,
        centre_mm: [f64; 3],
        fit: &Fit,
    ) -> Result<Self, Failure> {
        let source = match (&options.cameras, rig.trigger, options.sim) {
            (Some(_), Some(trigger), _) => Source::Triggers(trigger),
            (Some(_), None, _) if rig.capture.iter().any(|it| it.delay_ms.is_some()) => {
                Source::Corrected
            }
            (Some(_), None, _) | (None, _, true) => Source::Stamps,
            (None, _, false) => Source::Files,
        };
        let (mut all, mut passings) = (Vec::<(f64, [f64; 3])>::new(), Vec::new());
        for share in PASSES {
            let to_mm = centre_mm.map(|mm| mm + share * options.reach);
            let Some(pass) = bench.pass(to_mm)? else {
                let delay = None;
                return Ok(Self { source, delay });
            };
            let Pass {
                path: way,
                captures,
            } = pass;
            // The time at rest behind the last pass ends with the next one.
            let begun_s = way.first().map_or(f64::INFINITY, |(time_s, _)| *time_s);
            let rest = all.iter().filter(|(time_s, _)| *time_s >= begun_s).count();
            all.truncate(all.len() - rest);
            all.extend(way);
            for capture in captures {
                // An unusable frame set gives no information about the delay either.
                if let Ok(sample) = watch.look(centre_mm, &capture) {
                    passings.push(Passing::new(capture.time_us as f64 * 1e-6, &sample));
                }
            }
        }
        let mut path = Path::default();
        for (time_s, position_mm) in all {
            path.push(time_s, position_mm);
        }
        let delay = match (delay::delay(&passings, &path, &fit.matrix), source) {
            (Err(refusal), Source::Triggers(_)) => {
                warnings::raise(format!(
                    "the middle of the exposure was not measured: {refusal}"
                ));
                None
            }
            (found, _) => Some(found.map_err(|refusal| Failure::Images(refusal.to_string()))?),
        };
        let timing = Self { source, delay };
        timing.doubt_exposure();
        Ok(timing)
    }

    /// Returns the delay.
    pub fn delay(&self) -> Option<&Delay> {
        self.delay.as_ref()
    }

    /// Returns the times from a trigger to the middle of its exposure, ms: that in the rig file, and
    /// that which was measured. `None` for cameras without triggers.
    pub fn middle_ms(&self) -> Option<(f64, Option<f64>)> {
        let Source::Triggers(trigger) = self.source else {
            return None;
        };
        let file_ms = f64::from(trigger.exposure_us) / 2e3;
        Some((file_ms, self.delay.map(|it| file_ms - it.delay_ms)))
    }

    /// Warns of an exposure that is not that of the rig file.
    fn doubt_exposure(&self) {
        if let (Some(delay), Some((file_ms, Some(middle_ms)))) = (self.delay, self.middle_ms())
            && delay.delay_ms.abs() > NOTED_MS.max(NOTED_SIGMA * delay.sigma_ms)
        {
            warnings::raise(format!(
                "the middle of the exposure is {middle_ms:.2} ms after the trigger, but half of \
                 `exposure_us` in [trigger] is {file_ms:.2} ms: write exposure_us = {:.0}, or set \
                 the cameras' exposure",
                (2e3 * middle_ms).max(0.0)
            ));
        }
    }

    /// Prints the delay.
    pub fn print(&self, out: &mut impl Write) -> Result<(), Failure> {
        let name = match self.source {
            Source::Triggers(_) => "exposure",
            _ => "cameras' delay",
        };
        write!(out, "{name:>16}: ")?;
        let Some(delay) = &self.delay else {
            let reason = match self.source {
                Source::Triggers(_) => "its middle was not measured",
                _ => "not measured: the images of --images have no time stamps",
            };
            writeln!(out, "{reason}")?;
            return Ok(());
        };
        let Delay {
            delay_ms,
            sigma_ms,
            pictures,
            ..
        } = delay;
        match self.middle_ms() {
            Some((file_ms, _)) => writeln!(
                out,
                "its middle is {:.2} ms ± {sigma_ms:.2} after the trigger, from {pictures} images \
                 of the moving stage; half of `exposure_us` is {file_ms:.2} ms",
                file_ms - delay_ms
            )?,
            None if matches!(self.source, Source::Corrected) => writeln!(
                out,
                "{delay_ms:.2} ms ± {sigma_ms:.2} beyond the rig file's `delay_ms`, from \
                 {pictures} images of the moving stage; `trinocular latency` measures each camera's"
            )?,
            None => writeln!(
                out,
                "{delay_ms:.2} ms ± {sigma_ms:.2}, from {pictures} images of the moving stage: use \
                 `track --delay {delay_ms:.1}`"
            )?,
        }
        Ok(())
    }
}
