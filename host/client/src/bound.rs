//! A refused configuration in the terms of the rig file: its field, and the value allowed there.

use trinocular_core::frame::message::{ConfigField, Denial, Setting};
use trinocular_core::motion::Bound;

/// A field of a rig file's `[stage]`, or an option of the command line, and its allowed values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Field with its index, such as `max_jerk_mm_s3[0]`.
    pub field: String,
    /// Bound in words, such as `must be at least 1456`.
    pub reason: String,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.field, self.reason)
    }
}

/// Translates the station's field into the rig file's, and its bound into the rig file's unit.
pub fn refused(field: &ConfigField) -> Refused {
    let of = |field: &str, reason: &str| Refused {
        field: field.to_owned(),
        reason: reason.to_owned(),
    };
    match field {
        ConfigField::Matrix => of("matrix", "is singular"),
        ConfigField::Driver => of("driver", "cannot take this board's word rate"),
        ConfigField::Value {
            setting,
            axis,
            bound,
        } => {
            let (name, per_unit, has_axes) = rig_field(*setting);
            let index = axis.filter(|_| has_axes);
            let index = index.map_or(String::new(), |axis| format!("[{axis}]"));
            let reason = match bound {
                Bound::AtLeast(least) => {
                    format!("must be at least {}", *least as f64 / per_unit)
                }
                Bound::AtMost(most) => format!("must be at most {}", *most as f64 / per_unit),
            };
            // Ends and speeds have their own index behind the axis's.
            match name.split_once('[') {
                Some((name, end)) => of(&format!("{name}{index}[{end}"), &reason),
                None => of(&format!("{name}{index}"), &reason),
            }
        }
    }
}

/// Returns the reason of a denial; for a configuration, in the terms of the rig file.
pub fn denial(denial: Denial) -> String {
    match denial {
        Denial::Config(field) => refused(&field).to_string(),
        other => other.to_string(),
    }
}

/// Returns the field of the rig file, the number of the station's units in one of the rig file's,
/// and true if the field has a value for each axis.
const fn rig_field(setting: Setting) -> (&'static str, f64, bool) {
    match setting {
        Setting::StepsPerM => ("steps_per_mm", 1e3, true),
        Setting::MaxSpeed => ("max_speed_mm_s", 1e3, true),
        Setting::MaxAcceleration => ("max_acceleration_mm_s2", 1e3, true),
        Setting::MaxJerk => ("max_jerk_mm_s3", 1e3, true),
        Setting::TravelLow => ("travel_mm[0]", 1e3, true),
        Setting::TravelHigh => ("travel_mm[1]", 1e3, true),
        Setting::GateSigma => ("gate.max_sigma_mm", 1e6, true),
        Setting::GateDisplacement => ("gate.max_displacement_mm", 1e6, false),
        Setting::Heartbeat => ("--heartbeat", 1.0, false),
        Setting::SlowSpeed => ("slow_speed_mm_s", 1e3, false),
        Setting::Coast => ("coast_ms", 1.0, false),
        Setting::Backlash => ("backlash_mm", 1e3, true),
        Setting::HomePosition => ("home_position_mm", 1e3, true),
        Setting::HomeSpeedFirst => ("home_speed_mm_s[0]", 1e3, false),
        Setting::HomeSpeedSecond => ("home_speed_mm_s[1]", 1e3, false),
        Setting::BackOff => ("back_off_mm", 1e3, false),
        Setting::Window => ("unknown_window_mm", 1e3, false),
        Setting::LargestError => ("largest_error_mm", 1e3, false),
        Setting::LongestError => ("longest_error_s", 1e3, false),
        Setting::Unseen => ("largest_unseen_mm", 1e3, false),
        Setting::TriggerRate => ("trigger.rate_hz", 1.0, false),
        Setting::TriggerPulse => ("trigger.pulse_us", 1.0, false),
        Setting::TriggerQuiet => ("trigger.quiet_us", 1.0, false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(setting: Setting, axis: Option<u8>, bound: Bound) -> String {
        refused(&ConfigField::Value {
            setting,
            axis,
            bound,
        })
        .to_string()
    }

    #[test]
    fn bounds_name_rig_file_fields() {
        let cases = [
            (
                text(Setting::SlowSpeed, Some(2), Bound::AtLeast(2)),
                "slow_speed_mm_s must be at least 0.002",
            ),
            (
                text(Setting::MaxJerk, Some(1), Bound::AtLeast(1_455_192)),
                "max_jerk_mm_s3[1] must be at least 1455.192",
            ),
            (
                text(Setting::TravelHigh, Some(0), Bound::AtMost(5_000)),
                "travel_mm[0][1] must be at most 5",
            ),
            (
                text(Setting::HomeSpeedSecond, Some(0), Bound::AtLeast(2)),
                "home_speed_mm_s[1] must be at least 0.002",
            ),
        ];
        for (text, wanted) in cases {
            assert_eq!(text, wanted);
        }
    }
}
