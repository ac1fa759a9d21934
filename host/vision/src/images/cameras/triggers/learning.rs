//! Learns the time from a trigger to the time stamp of its image.
//!
//! A few triggers are given, and then none until all their images must have come. If a camera has
//! as many images as there were triggers, they belong together in their order, however late the
//! time stamps are. That all of them are equally late is the check: a missed and a doubled image
//! would compensate each other in the count only.

use super::count::{SHARP, STEADY};
use super::reports::Reports;
use super::span::Span;
use trinocular_rig::error::InputError;

/// Least number of triggers from which a delay is learnt.
pub const LEAST: u32 = 2;

impl Reports {
    pub(super) fn learn(&mut self) -> Result<(), InputError> {
        let mut delays = Vec::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            let delay = self.delay(index);
            delays.push(delay.map_err(|reason| InputError::file(&camera.path, reason))?);
        }
        for (camera, delay) in self.cameras.iter_mut().zip(delays) {
            camera.delay = Some(delay);
        }
        Ok(())
    }

    fn delay(&self, camera: usize) -> Result<Span, String> {
        let triggers = &self.given;
        let is_whole = triggers
            .iter()
            .zip(1..)
            .all(|(one, n)| one.number == n && one.is_reported);
        let spans: Option<Vec<Span>> = triggers.iter().map(|one| one.here).collect();
        let spans = spans.filter(|spans| is_whole && spans.len() >= LEAST as usize);
        let Some(spans) = spans else {
            return Err(format!(
                "the station reported {} triggers, not all of those that it gave: see to the line",
                triggers.len()
            ));
        };
        let steady_us = self.period_us / STEADY;
        let first_us = spans[0].from_us - steady_us;
        // Images from before the triggers are of a camera that ran freely until then.
        let stamps = self.cameras[camera].stamps_us.iter();
        let stamps: Vec<i64> = stamps.copied().filter(|stamp| *stamp >= first_us).collect();
        if stamps.len() != spans.len() {
            return Err(format!(
                "gave {} images of {} triggers: see to its trigger input and mode, and let \
                 exposure and read-out be shorter than a period",
                stamps.len(),
                spans.len()
            ));
        }
        let since = spans
            .iter()
            .zip(&stamps)
            .map(|(span, stamp)| span.until(*stamp));
        let halves = since.map(|since| since.wider(steady_us / 2));
        let common = halves.map(Some).reduce(|one, other| one?.common(other?));
        let Some(delay) = common.flatten() else {
            return Err("has time stamps that are not equally late after each trigger".to_owned());
        };
        let widest_us = spans.iter().map(|span| span.width_us()).max().unwrap_or(0);
        if widest_us * SHARP > self.period_us {
            return Err(format!(
                "has images whose triggers are not certain at this rate, because a report takes \
                 up to {:.1} ms: lower rate_hz",
                widest_us as f64 * 1e-3
            ));
        }
        Ok(delay)
    }
}
