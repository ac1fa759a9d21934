//! Optional stage settings of a rig file: backlash, home switches, and the station's supervision of
//! the stage.
//!
//! ```toml
//! backlash_mm = [0.02, 0.02, 0.05]           # backlash of each axis; default 0
//! home_switch = ["negative", "negative", "none"] # end with the home switch; default none
//! home_position_mm = [-61.0, -61.0, 0.0]     # where the switch trips; required with a home switch
//! home_speed_mm_s = [10.0, 1.0]              # towards the switch: first and second approach
//! back_off_mm = 2.0                          # distance between the approaches, and afterwards
//! slow_speed_mm_s = 5.0                      # fastest motion while the position is unknown
//! unknown_window_mm = 10.0                   # farthest motion while the position is unknown
//! largest_error_mm = 20.0                    # largest distance of the target while following
//! longest_error_s = 1.0                      # fault 5 after this time above largest_error_mm
//! largest_unseen_mm = 10.0                   # fault 6 after this motion without approach; 0 = off
//! motors_off_after_s = 0                     # time at rest until the motors are off; 0 is never
//! ```

use std::fmt::Write as _;

use trinocular_core::frame::message::Side;

use super::field::Field;
use crate::error::InputError;

/// A limit switch that defines the position of its axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomeSwitch {
    /// End of the travel with the switch.
    pub side: Side,
    /// Position at which the switch trips when approached, mm.
    pub position_mm: f64,
}

/// Optional settings of the stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Care {
    /// Backlash per axis, mm, at least 0.
    pub backlash_mm: [f64; 3],
    /// Home switch per axis.
    pub home: [Option<HomeSwitch>; 3],
    /// Speed towards a home switch the first time and the second, mm/s, > 0.
    pub home_speed_mm_s: [f64; 2],
    /// Distance that an axis backs off from its home switch, mm, > 0.
    pub back_off_mm: f64,
    /// Fastest motion while the position is unknown, mm/s, > 0.
    pub slow_speed_mm_s: f64,
    /// Largest distance of an axis from the place where its position became unknown, mm, > 0.
    pub unknown_window_mm: f64,
    /// Largest distance of the target while following, on any axis, mm, > 0; `None` disables the
    /// limit.
    pub largest_error_mm: Option<f64>,
    /// Longest time above that distance, s.
    pub longest_error_s: f64,
    /// Largest motion towards the target that brings it no nearer, on any axis, mm, > 0; `None`
    /// disables the limit. Checked only while prediction is on.
    pub largest_unseen_mm: Option<f64>,
    /// Time at rest after which the motors are switched off, s; 0 is never.
    pub motors_off_after_s: u16,
}

impl Default for Care {
    /// Returns settings without backlash and home switches, with 5 mm/s and 10 mm while the
    /// position is unknown, and with 10 mm of motion without effect.
    fn default() -> Self {
        Self {
            backlash_mm: [0.0; 3],
            home: [None; 3],
            home_speed_mm_s: [10.0, 1.0],
            back_off_mm: 2.0,
            slow_speed_mm_s: 5.0,
            unknown_window_mm: 10.0,
            largest_error_mm: None,
            longest_error_s: 1.0,
            largest_unseen_mm: Some(10.0),
            motors_off_after_s: 0,
        }
    }
}

/// Largest distance, mm, and speed, mm/s, of a stage. Larger figures are mistakes of the unit.
const LIMIT_MM: f64 = 1e3;
/// Largest backlash of the protocol, mm.
const LIMIT_BACKLASH_MM: f64 = 65.0;
const LIMIT_SPEED_MM_S: f64 = 1e4;
const LIMIT_TIME_S: f64 = 60.0;
const LIMIT_PLACE_MM: f64 = 1e5;

impl Care {
    /// Returns true for each axis with a home switch.
    pub fn has_home(&self) -> [bool; 3] {
        self.home.map(|home| home.is_some())
    }

    pub(super) fn read(section: &Field<'_>) -> Result<Self, InputError> {
        let default = Self::default();
        let length = |key: &str| -> Result<Option<f64>, InputError> {
            let field = section.optional(key)?;
            field.map(|field| field.positive(LIMIT_MM)).transpose()
        };
        let backlash_mm = match section.optional("backlash_mm")? {
            Some(field) => field.each(|axis| from_zero(axis, LIMIT_BACKLASH_MM))?,
            None => default.backlash_mm,
        };
        let home_speed_mm_s = match section.optional("home_speed_mm_s")? {
            Some(field) => field.each(|speed| speed.positive(LIMIT_SPEED_MM_S))?,
            None => default.home_speed_mm_s,
        };
        let slow_speed_mm_s = match section.optional("slow_speed_mm_s")? {
            Some(field) => field.positive(LIMIT_SPEED_MM_S)?,
            None => default.slow_speed_mm_s,
        };
        let longest_error_s = match section.optional("longest_error_s")? {
            Some(field) => field.positive(LIMIT_TIME_S)?,
            None => default.longest_error_s,
        };
        let largest_unseen_mm = match section.optional("largest_unseen_mm")? {
            Some(field) => Some(from_zero(&field, LIMIT_MM)?).filter(|mm| *mm > 0.0),
            None => default.largest_unseen_mm,
        };
        let motors_off_after_s = match section.optional("motors_off_after_s")? {
            Some(field) => whole_seconds(&field)?,
            None => default.motors_off_after_s,
        };
        Ok(Self {
            backlash_mm,
            home: home(section)?,
            home_speed_mm_s,
            back_off_mm: length("back_off_mm")?.unwrap_or(default.back_off_mm),
            slow_speed_mm_s,
            unknown_window_mm: length("unknown_window_mm")?.unwrap_or(default.unknown_window_mm),
            largest_error_mm: length("largest_error_mm")?,
            longest_error_s,
            largest_unseen_mm,
            motors_off_after_s,
        })
    }

    /// Writes the settings that differ from the defaults.
    pub(super) fn write_toml(&self, text: &mut String) {
        let default = Self::default();
        if self.backlash_mm != default.backlash_mm {
            let _ = writeln!(text, "backlash_mm = {:?}", self.backlash_mm);
        }
        if self.home != default.home {
            let names = self.home.map(|home| side_name(home.map(|home| home.side)));
            let places = self
                .home
                .map(|home| home.map_or(0.0, |home| home.position_mm));
            let _ = writeln!(text, "home_switch = {names:?}");
            let _ = writeln!(text, "home_position_mm = {places:?}");
        }
        if self.home_speed_mm_s != default.home_speed_mm_s {
            let _ = writeln!(text, "home_speed_mm_s = {:?}", self.home_speed_mm_s);
        }
        let figures = [
            ("back_off_mm", self.back_off_mm, default.back_off_mm),
            (
                "slow_speed_mm_s",
                self.slow_speed_mm_s,
                default.slow_speed_mm_s,
            ),
            (
                "unknown_window_mm",
                self.unknown_window_mm,
                default.unknown_window_mm,
            ),
            (
                "longest_error_s",
                self.longest_error_s,
                default.longest_error_s,
            ),
        ];
        for (key, value, default) in figures {
            if value != default {
                let _ = writeln!(text, "{key} = {value:?}");
            }
        }
        if let Some(value) = self.largest_error_mm {
            let _ = writeln!(text, "largest_error_mm = {value:?}");
        }
        if self.largest_unseen_mm != default.largest_unseen_mm {
            let value = self.largest_unseen_mm.unwrap_or(0.0);
            let _ = writeln!(text, "largest_unseen_mm = {value:?}");
        }
        if self.motors_off_after_s != default.motors_off_after_s {
            let _ = writeln!(text, "motors_off_after_s = {}", self.motors_off_after_s);
        }
    }
}

fn whole_seconds(field: &Field<'_>) -> Result<u16, InputError> {
    let value = from_zero(field, u16::MAX.into())?;
    match value.fract() == 0.0 {
        true => Ok(value as u16),
        false => Err(field.fault(format!("{value} must be a whole number of seconds"))),
    }
}

fn from_zero(field: &Field<'_>, limit: f64) -> Result<f64, InputError> {
    let value = field.number(limit)?;
    match value >= 0.0 {
        true => Ok(value),
        false => Err(field.fault(format!("{value} must not be negative"))),
    }
}

/// Returns the name of a side in a rig file.
const fn side_name(side: Option<Side>) -> &'static str {
    match side {
        None => "none",
        Some(Side::Negative) => "negative",
        Some(Side::Positive) => "positive",
    }
}

fn side(axis: &Field<'_>) -> Result<Option<Side>, InputError> {
    let name = axis.text()?;
    [None, Some(Side::Negative), Some(Side::Positive)]
        .into_iter()
        .find(|side| side_name(*side) == name)
        .ok_or_else(|| axis.fault(format!("unknown end `{name}`: negative, positive or none")))
}

fn home(section: &Field<'_>) -> Result<[Option<HomeSwitch>; 3], InputError> {
    let Some(ends) = section.optional("home_switch")? else {
        if let Some(places) = section.optional("home_position_mm")? {
            return Err(places.fault("needs home_switch: the end of each axis"));
        }
        return Ok([None; 3]);
    };
    let ends: [Option<Side>; 3] = ends.each(side)?;
    if ends == [None; 3] {
        return Ok([None; 3]);
    }
    let places = section.required("home_position_mm")?;
    let places: [f64; 3] = places.each(|axis| axis.number(LIMIT_PLACE_MM))?;
    Ok(std::array::from_fn(|axis| {
        ends[axis].map(|side| HomeSwitch {
            side,
            position_mm: places[axis],
        })
    }))
}
