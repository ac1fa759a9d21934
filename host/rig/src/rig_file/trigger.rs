//! The `[trigger]` section: cameras that the station triggers.

use std::fmt::Write as _;

use super::field::Field;
use crate::error::InputError;
use trinocular_core::frame::message;

/// Triggers of the cameras by the station.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::RigFile;
///
/// let text = RigFile::paper().to_toml() + "[trigger]\nrate_hz = 60\npulse_us = 2000\n";
/// let trigger = RigFile::parse(Path::new("rig.toml"), &text)?.trigger.expect("a trigger");
/// assert_eq!((trigger.rate_hz, trigger.pulse_us, trigger.active_low), (60, 2_000, false));
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trigger {
    /// Triggers per second, 1 to 1000.
    pub rate_hz: u16,
    /// Length of a pulse, µs: 10 to 250 less than the period.
    pub pulse_us: u32,
    /// True if the pin is low during a pulse.
    pub active_low: bool,
    /// Exposure of the cameras, µs, whose middle is the capture time; at most the period.
    pub exposure_us: u32,
    /// True if a trigger waits, for a sixteenth of the period at most, until no motor steps during
    /// the exposure; or during the pulse, if `exposure_us` is 0.
    pub between_steps: bool,
}

impl Trigger {
    /// Returns the settings for the station.
    pub const fn settings(self) -> message::Trigger {
        let quiet_us = match (self.between_steps, self.exposure_us) {
            (false, _) => 0,
            (true, 0) => self.pulse_us,
            (true, exposure_us) => exposure_us,
        };
        message::Trigger {
            quiet_us,
            rate_hz: self.rate_hz,
            pulse_us: self.pulse_us,
            active_low: self.active_low,
        }
    }

    pub(super) fn read(section: &Field<'_>) -> Result<Self, InputError> {
        section.only(&[
            "rate_hz",
            "pulse_us",
            "active_low",
            "exposure_us",
            "between_steps",
        ])?;
        section.require(&[("rate_hz", "rate_hz = 60"), ("pulse_us", "pulse_us = 2000")])?;
        let flag = |name: &str| match section.optional(name)? {
            Some(field) => field.flag(),
            None => Ok(false),
        };
        let between_steps = flag("between_steps")?;
        let (highest, share) = match between_steps {
            true => (
                message::Trigger::HIGHEST_WAITING_HZ,
                message::Trigger::LATEST,
            ),
            false => (message::Trigger::HIGHEST_RATE_HZ, u32::MAX),
        };
        let rate_hz = section.required("rate_hz")?.whole(1..=highest.into())?;
        let period_us = 1_000_000 / rate_hz;
        // A trigger that waits leaves less time for its pulse.
        let longest = period_us - period_us / share - message::Trigger::SHORTEST_PAUSE_US;
        let active_low = flag("active_low")?;
        let longest_exposure = match between_steps {
            true => period_us.min(message::Trigger::LONGEST_QUIET_US),
            false => period_us,
        };
        let exposure_us = match section.optional("exposure_us")? {
            Some(field) => field.whole(0..=longest_exposure)?,
            None => 0,
        };
        // Without an exposure, no motor steps during the pulse.
        let longest = match between_steps && exposure_us == 0 {
            true => longest.min(message::Trigger::LONGEST_QUIET_US),
            false => longest,
        };
        let pulse = section.required("pulse_us")?;
        let pulse_us = pulse.whole(message::Trigger::SHORTEST_PULSE_US..=longest)?;
        Ok(Self {
            // At most 1000.
            rate_hz: rate_hz as u16,
            pulse_us,
            active_low,
            exposure_us,
            between_steps,
        })
    }

    pub(super) fn write_toml(&self, text: &mut String) {
        let _ = write!(
            text,
            "\n[trigger]\nrate_hz = {}\npulse_us = {}\nactive_low = {}\nexposure_us = {}\n\
             between_steps = {}\n",
            self.rate_hz, self.pulse_us, self.active_low, self.exposure_us, self.between_steps
        );
    }
}
