//! Device and capture settings of a camera in the rig file: which camera it is, the delay of its
//! time stamps, and how a GenICam camera (GigE Vision, USB3 Vision) is set up.
//!
//! The camera's own ranges are known only when it is open. [`fault`] then names the line of a value
//! that the camera does not take.

use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::Path;

use toml::de::{DeTable, DeValue};

use super::field::{Field, Source};
use crate::choice;
use crate::error::InputError;

/// Beginning of the names of GenICam cameras: `genicam:SERIAL`.
pub const GENICAM: &str = "genicam:";

/// Beginning of the names of cameras behind a GStreamer pipeline: `gstreamer:PIPELINE`.
pub const GSTREAMER: &str = "gstreamer:";

/// Fields of a camera that describe its device.
pub(super) const KEYS: [&str; 13] = [
    "device",
    "delay_ms",
    "exposure_us",
    "gain",
    "pixel_format",
    "trigger_mode",
    "trigger_source",
    "trigger_activation",
    "packet_size_bytes",
    "packet_delay_us",
    "packet_resend",
    "bandwidth_mb_s",
    "ptp",
];

/// Pixel formats that are read, by their names in GenICam's Pixel Format Naming Convention.
pub const PIXEL_FORMATS: [&str; 8] = [
    "Mono8",
    "Mono10",
    "Mono12",
    "Mono16",
    "Mono10Packed",
    "Mono12Packed",
    "Mono10p",
    "Mono12p",
];

/// Values of `trigger_mode`.
const TRIGGER_MODES: [&str; 2] = ["Off", "On"];

/// Range of `delay_ms`, ms. The station remembers where the stage was for half a second.
pub const DELAY_MS: RangeInclusive<f64> = -100.0..=300.0;

/// Device of a camera and its settings. A setting that is `None` stays as the camera has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Capture {
    /// Name of the device: `genicam:SERIAL`, `gstreamer:PIPELINE`, or the path of a V4L2 device.
    pub device: Option<String>,
    /// Delay from the middle of the exposure to the time stamp, ms, -100 to 300.
    pub delay_ms: Option<f64>,
    /// Exposure time, µs, above 0 to 6e7.
    pub exposure_us: Option<f64>,
    /// Gain in the camera's unit, mostly dB, -100 to 1e5.
    pub gain: Option<f64>,
    /// One of [`PIXEL_FORMATS`].
    pub pixel_format: Option<String>,
    /// True if a trigger starts each exposure.
    pub trigger: Option<bool>,
    /// Source of the trigger, such as `Line1`.
    pub trigger_source: Option<String>,
    /// Edge of the trigger, such as `RisingEdge`.
    pub trigger_activation: Option<String>,
    /// Size of a packet on the network with its headers, bytes, 220 to 65500.
    pub packet_size_bytes: Option<u32>,
    /// Pause between two packets, µs, 0 to 1e6.
    pub packet_delay_us: Option<f64>,
    /// True if packets that were lost are requested again.
    pub packet_resend: Option<bool>,
    /// Largest rate of data, MB/s, above 0 to 1e5.
    pub bandwidth_mb_s: Option<f64>,
    /// True if the camera's clock is synchronised by PTP (IEEE 1588).
    pub ptp: Option<bool>,
}

impl Capture {
    /// Reads the fields of a `[[camera]]` table.
    pub(super) fn read(table: &Field<'_>) -> Result<Self, InputError> {
        let text = |key| -> Result<Option<String>, InputError> {
            let Some(field) = table.optional(key)? else {
                return Ok(None);
            };
            match field.text()? {
                "" => Err(field.fault("must not be empty")),
                text => Ok(Some(text.to_owned())),
            }
        };
        let flag = |key| table.optional(key)?.map(|field| field.flag()).transpose();
        let positive = |key, limit| {
            let field = table.optional(key)?;
            field.map(|field| field.positive(limit)).transpose()
        };
        let capture = Self {
            device: text("device")?,
            delay_ms: within(table, "delay_ms", DELAY_MS)?,
            exposure_us: positive("exposure_us", 6e7)?,
            gain: within(table, "gain", -100.0..=1e5)?,
            pixel_format: word(table, "pixel_format", "pixel format", &PIXEL_FORMATS)?,
            trigger: word(table, "trigger_mode", "trigger mode", &TRIGGER_MODES)?
                .map(|mode| mode == "On"),
            trigger_source: text("trigger_source")?,
            trigger_activation: text("trigger_activation")?,
            packet_size_bytes: table
                .optional("packet_size_bytes")?
                .map(|field| field.whole(220..=65_500))
                .transpose()?,
            packet_delay_us: within(table, "packet_delay_us", 0.0..=1e6)?,
            packet_resend: flag("packet_resend")?,
            bandwidth_mb_s: positive("bandwidth_mb_s", 1e5)?,
            ptp: flag("ptp")?,
        };
        if capture.trigger != Some(true) {
            for key in ["trigger_source", "trigger_activation"] {
                if let Some(field) = table.optional(key)? {
                    return Err(field.fault("has an effect only with `trigger_mode = \"On\"`"));
                }
            }
        }
        Ok(capture)
    }

    /// Returns the name of the first field that only a GenICam camera has.
    pub fn genicam_field(&self) -> Option<&'static str> {
        let [_device, _delay, settings @ ..] = self.fields();
        let set = settings.into_iter().find(|(_, value)| value.is_some());
        set.map(|(key, _)| key)
    }

    /// Returns all fields with the values of those that are set, the device first.
    fn fields(&self) -> [(&'static str, Option<toml::Value>); KEYS.len()] {
        let word = |text: &Option<String>| text.clone().map(toml::Value::from);
        let mode = self.trigger.map(|is_on| TRIGGER_MODES[usize::from(is_on)]);
        let values = [
            word(&self.device),
            self.delay_ms.map(toml::Value::from),
            self.exposure_us.map(toml::Value::from),
            self.gain.map(toml::Value::from),
            word(&self.pixel_format),
            mode.map(toml::Value::from),
            word(&self.trigger_source),
            word(&self.trigger_activation),
            self.packet_size_bytes.map(toml::Value::from),
            self.packet_delay_us.map(toml::Value::from),
            self.packet_resend.map(toml::Value::from),
            self.bandwidth_mb_s.map(toml::Value::from),
            self.ptp.map(toml::Value::from),
        ];
        let mut values = values.into_iter();
        KEYS.map(|key| (key, values.next().flatten()))
    }

    /// Writes the fields that are set into a `[[camera]]` table.
    pub(super) fn write_toml(&self, text: &mut String) {
        for (key, value) in self.fields() {
            if let Some(value) = value {
                let _ = writeln!(text, "{key} = {value}");
            }
        }
    }
}

fn within(
    table: &Field<'_>,
    key: &str,
    range: RangeInclusive<f64>,
) -> Result<Option<f64>, InputError> {
    let Some(field) = table.optional(key)? else {
        return Ok(None);
    };
    let value = field.number(f64::MAX)?;
    match range.contains(&value) {
        true => Ok(Some(value)),
        false => {
            let (low, high) = (range.start(), range.end());
            Err(field.fault(format!("{value} is out of range ({low} to {high})")))
        }
    }
}

fn word(
    table: &Field<'_>,
    key: &str,
    kind: &str,
    known: &[&str],
) -> Result<Option<String>, InputError> {
    let Some(field) = table.optional(key)? else {
        return Ok(None);
    };
    let given = field.text()?;
    match known.contains(&given) {
        true => Ok(Some(given.to_owned())),
        false => Err(field.fault(choice::unknown(kind, given, known))),
    }
}

/// Returns the error of a value that the camera `name` of a rig file refuses, with the line of the
/// value, or of the camera if it has none. `text` is the file's content.
pub fn fault(
    file: &Path,
    text: &str,
    name: &str,
    key: &str,
    reason: impl Into<String>,
) -> InputError {
    let reason = reason.into();
    let without_line = |reason: String| {
        InputError::file(file, format!("camera `{name}`, field `{key}`: {reason}"))
    };
    let Ok(table) = DeTable::parse(text) else {
        return without_line(reason);
    };
    let value = DeValue::Table(table.into_inner());
    let root = Field::root(Source { file, text }, &value);
    let is_named = |table: &Field<'_>| {
        let field = table.optional("name").ok().flatten();
        field.is_some_and(|field| field.text() == Ok(name))
    };
    let tables = root.required("camera").and_then(|list| list.elements());
    let table = tables.unwrap_or_default().into_iter().find(is_named);
    let Some(table) = table else {
        return without_line(reason);
    };
    match table.optional(key) {
        Ok(Some(field)) => field.fault(reason),
        _ => table.fault_under(key, reason),
    }
}

#[cfg(test)]
mod tests {
    use super::super::RigFile;
    use super::*;

    const FILE: &str = "rig.toml";

    fn with(lines: &str) -> Result<RigFile, InputError> {
        let text = RigFile::paper().to_toml();
        let text = text.replace("name = \"middle\"", &format!("name = \"middle\"\n{lines}"));
        RigFile::parse(Path::new(FILE), &text)
    }

    #[test]
    fn settings_survive_writing() {
        let file = with(
            "device = \"genicam:GV01\"\ndelay_ms = -7.25\nexposure_us = 1500\ngain = -3.5\n\
             pixel_format = \"Mono12p\"\ntrigger_mode = \"On\"\ntrigger_source = \"Line1\"\n\
             trigger_activation = \"RisingEdge\"\npacket_size_bytes = 9000\n\
             packet_delay_us = 2.5\npacket_resend = false\nbandwidth_mb_s = 40\nptp = true",
        )
        .expect("a rig file");
        assert_eq!(file.capture.len(), 3);
        assert_eq!(file.capture[0], Capture::default());
        let middle = &file.capture[1];
        assert_eq!(middle.device.as_deref(), Some("genicam:GV01"));
        assert_eq!(middle.trigger, Some(true));
        assert_eq!(middle.packet_size_bytes, Some(9000));
        assert!(middle.fields().iter().all(|(_, value)| value.is_some()));
        let again = RigFile::parse(Path::new(FILE), &file.to_toml()).expect("a rig file");
        assert_eq!(again, file);
        assert!(with("").expect("a rig file").capture.is_empty());
    }

    #[test]
    fn genicam_fields_are_told_from_the_device() {
        let device = Capture {
            device: Some("/dev/video0".to_owned()),
            delay_ms: Some(12.5),
            ..Capture::default()
        };
        assert_eq!(device.genicam_field(), None);
        let ptp = Capture {
            ptp: Some(true),
            ..device
        };
        assert_eq!(ptp.genicam_field(), Some("ptp"));
    }

    #[test]
    fn invalid_settings_are_refused() {
        for (line, words) in [
            ("delay_ms = 301", "out of range (-100 to 300)"),
            ("exposure_us = 0", "greater than 0"),
            ("exposure_us = 1e9", "out of range"),
            ("gain = 1e6", "out of range (-100 to 100000)"),
            ("pixel_format = \"Mono12P\"", "did you mean `Mono12p`?"),
            ("pixel_format = \"BayerRG8\"", "known here: Mono8, Mono10"),
            ("trigger_mode = \"on\"", "did you mean `On`?"),
            ("trigger_source = \"Line1\"", "trigger_mode = \"On\""),
            ("packet_size_bytes = 100", "220 to 65500"),
            ("packet_delay_us = -1", "0 to 1000000"),
            ("ptp = 1", "true or false"),
            ("device = \"\"", "must not be empty"),
            ("exposure = 5", "did you mean `exposure_us`?"),
        ] {
            let error = with(line).expect_err(line);
            assert_eq!(error.line, Some(11), "{error}");
            let field = error.field.clone().unwrap_or_default();
            assert!(field.starts_with("camera[1]."), "{error}");
            assert!(error.reason.contains(words), "{error}");
        }
    }

    #[test]
    fn fault_names_line_and_field() {
        let text = RigFile::paper().to_toml();
        let text = text.replace("name = \"middle\"", "name = \"middle\"\ngain = 99");
        let file = Path::new(FILE);
        let error = fault(file, &text, "middle", "gain", "is 0 to 10");
        assert_eq!(
            error.to_string(),
            "rig.toml:11: field `camera[1].gain`: is 0 to 10"
        );
        let error = fault(file, &text, "middle", "ptp", "has none");
        assert!(
            error
                .to_string()
                .ends_with("field `camera[1].ptp`: has none"),
            "{error}"
        );
        let error = fault(file, &text, "top", "gain", "is 0 to 10");
        assert!(error.to_string().contains("camera `top`"), "{error}");
    }
}
