//! Reads scenario files strictly: every error names file, line and field.

use super::expect::{Checkpoint, Expect};
use super::file::{self, Cameras, Event, Happening, Measure, Scenario};
use super::motion::{Leg, Motion};
use std::path::Path;
use toml::de::{DeTable, DeValue};
use trinocular_client::diagnosis;
use trinocular_client::stage::default_stage;
use trinocular_core::safety::{Fault, State};
use trinocular_core::track::pursuit::Sight;
use trinocular_rig::error::InputError;
use trinocular_rig::input::{self, Limit};
use trinocular_rig::rig_file::Stage;
use trinocular_rig::rig_file::field::{Field, Source};

/// Size limit of a scenario file.
const LIMIT: Limit = Limit {
    what: "a scenario",
    bytes: 1 << 20,
};
/// Longest duration in a scenario, s.
const LONGEST_S: f64 = 3_600.0;
/// Largest distance of a target, mm. A larger one is a mistake of the unit.
const FARTHEST_MM: f64 = 1e5;
/// Largest bound of any figure.
const LARGEST: f64 = 1e9;

impl Scenario {
    /// Reads and checks the scenario file at `path`.
    ///
    /// # Errors
    /// Returns the first fault of the file.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(path, &input::text(path, LIMIT)?)
    }

    /// Checks the text of a scenario file; errors name `file`.
    ///
    /// # Errors
    /// Returns the first fault of the file.
    pub fn parse(file: &Path, text: &str) -> Result<Self, InputError> {
        let source = Source { file, text };
        let table = DeTable::parse(text).map_err(|error| source.syntax(&error))?;
        let value = DeValue::Table(table.into_inner());
        let root = Field::root(source, &value);
        root.only(&[
            "title", "seed", "cameras", "target", "event", "measure", "stage", "expect",
        ])?;
        let legs = legs(&root.required("target")?)?;
        let seconds = legs.iter().map(|leg| leg.seconds).sum();
        let stage = match root.optional("stage")? {
            Some(section) => Stage::read(&section)?,
            None => default_stage(),
        };
        Ok(Self {
            title: root.required("title")?.text()?.to_owned(),
            seed: u64::from(root.required("seed")?.whole(0..=u32::MAX)?),
            cameras: cameras(&root.required("cameras")?)?,
            events: match root.optional("event")? {
                Some(list) => events(&list, seconds)?,
                None => Vec::new(),
            },
            measure: measure(root.optional("measure")?, seconds)?,
            expect: expect(&root.required("expect")?, seconds)?,
            legs,
            stage,
        })
    }
}

/// Reads a number between two bounds, both included.
fn between(field: &Field<'_>, low: f64, high: f64) -> Result<f64, InputError> {
    let value = field.number(f64::MAX)?;
    if (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(field.fault(format!("{value} is out of range ({low} to {high})")))
    }
}

fn vector(field: &Field<'_>, limit: f64) -> Result<[f64; 3], InputError> {
    field.each(|axis| axis.number(limit))
}

fn cameras(section: &Field<'_>) -> Result<Cameras, InputError> {
    const SHARED: [&str; 4] = ["kind", "frames_per_s", "latency_ms", "depth_mm"];
    let kind = section.required("kind")?;
    let sight = match kind.text()? {
        "rendered" => {
            section.only(&[&SHARED[..], &["texture", "noise_grey"]].concat())?;
            file::ImageSource::Rendered {
                texture: match section.optional("texture")? {
                    Some(field) => field.text()?.parse().map_err(
                        |unknown: trinocular_vision::images::texture::UnknownTexture| {
                            field.fault(unknown.to_string())
                        },
                    )?,
                    None => trinocular_vision::images::TextureKind::Natural,
                },
                noise_grey: between(&section.required("noise_grey")?, 0.0, 128.0)?,
            }
        }
        "points" => {
            section.only(&[&SHARED[..], &["points", "noise_px"]].concat())?;
            file::ImageSource::Points {
                count: section.required("points")?.whole(8..=4_000)? as usize,
                noise_px: between(&section.required("noise_px")?, 0.0, 10.0)?,
            }
        }
        _ => {
            return Err(kind.unknown("kind", &["rendered", "points"]));
        }
    };
    Ok(Cameras {
        sight,
        frames_per_s: between(&section.required("frames_per_s")?, 1.0, 200.0)?,
        latency_ms: between(&section.required("latency_ms")?, 0.0, 1_000.0)?,
        depth_mm: between(&section.required("depth_mm")?, 300.0, 2_000.0)?,
    })
}

fn legs(list: &Field<'_>) -> Result<Vec<Leg>, InputError> {
    let tables = list.elements()?;
    if tables.is_empty() {
        return Err(list.fault("a scenario needs at least one leg"));
    }
    let legs: Vec<Leg> = tables.iter().map(leg).collect::<Result<_, _>>()?;
    let seconds: f64 = legs.iter().map(|leg| leg.seconds).sum();
    if seconds > LONGEST_S {
        return Err(list.fault(format!(
            "{seconds} s in all, but a scenario lasts at most {LONGEST_S} s"
        )));
    }
    Ok(legs)
}

fn leg(table: &Field<'_>) -> Result<Leg, InputError> {
    const RAMPS: [&str; 2] = ["ramp_in_s", "ramp_out_s"];
    let kind = table.required("motion")?;
    let known = |own: &[&str]| table.only(&[&["motion", "seconds"][..], own].concat());
    let motion = match kind.text()? {
        "still" => {
            known(&[])?;
            Motion::Still
        }
        "step" => {
            known(&["by_mm"])?;
            Motion::Step {
                by_mm: vector(&table.required("by_mm")?, FARTHEST_MM)?,
            }
        }
        "line" => {
            known(&[&["velocity_mm_s"], &RAMPS[..]].concat())?;
            Motion::Line {
                velocity_mm_s: vector(&table.required("velocity_mm_s")?, FARTHEST_MM)?,
            }
        }
        "lissajous" => {
            known(&[&["amplitude_mm", "ratio", "peak_mm_s"], &RAMPS[..]].concat())?;
            let amplitude = table.required("amplitude_mm")?;
            let amplitude_mm = vector(&amplitude, FARTHEST_MM)?;
            if amplitude_mm == [0.0; 3] {
                return Err(amplitude.fault("zero on all axes is `still`"));
            }
            Motion::Lissajous {
                amplitude_mm,
                ratio: table
                    .required("ratio")?
                    .each(|axis| axis.positive(1_000.0))?,
                peak_mm_s: table.required("peak_mm_s")?.positive(FARTHEST_MM)?,
            }
        }
        _ => {
            return Err(kind.unknown("motion", &["still", "step", "line", "lissajous"]));
        }
    };
    let seconds = table.required("seconds")?.positive(LONGEST_S)?;
    let mut ramps_s = [0.0; 2];
    for (ramp, key) in ramps_s.iter_mut().zip(RAMPS) {
        if let Some(field) = table.optional(key)? {
            *ramp = between(&field, 0.0, seconds)?;
        }
    }
    if ramps_s[0] + ramps_s[1] > seconds {
        return Err(table
            .required(RAMPS[1])?
            .fault(format!("both ramps are longer than the leg's {seconds} s")));
    }
    Ok(Leg {
        motion,
        seconds,
        ramps_s,
    })
}

fn events(list: &Field<'_>, seconds: f64) -> Result<Vec<Event>, InputError> {
    let one = |table: &Field<'_>| {
        let what = happening(table)?;
        let at = table.required("at_s")?;
        Ok(Event {
            at_s: between(&at, 0.0, seconds)?,
            what,
        })
    };
    list.elements()?.iter().map(one).collect()
}

fn happening(table: &Field<'_>) -> Result<Happening, InputError> {
    let kind = table.required("what")?;
    let known = |own: &[&str]| table.only(&[&["what", "at_s"][..], own].concat());
    let lasting = || table.required("seconds")?.positive(LONGEST_S);
    let frames = || table.required("frames")?.whole(1..=1_000_000);
    Ok(match kind.text()? {
        "occlusion" => {
            known(&["seconds"])?;
            Happening::Occlusion {
                seconds: lasting()?,
            }
        }
        "drop" => {
            known(&["frames"])?;
            Happening::Drop { frames: frames()? }
        }
        "late" => {
            known(&["frames", "by_ms"])?;
            Happening::Late {
                frames: frames()?,
                by_ms: table.required("by_ms")?.positive(10_000.0)?,
            }
        }
        "outlier" => {
            known(&["frames", "by_mm"])?;
            Happening::Outlier {
                frames: frames()?,
                by_mm: vector(&table.required("by_mm")?, FARTHEST_MM)?,
            }
        }
        "silence" => {
            known(&["seconds"])?;
            Happening::Silence {
                seconds: lasting()?,
            }
        }
        "limit" => {
            known(&["seconds", "axis", "end"])?;
            Happening::Limit {
                axis: choice(&table.required("axis")?, &["x", "y", "z"])?,
                end: choice(&table.required("end")?, &["negative", "positive"])?,
                seconds: lasting()?,
            }
        }
        "emergency_stop" => {
            known(&["seconds"])?;
            Happening::EmergencyStop {
                seconds: lasting()?,
            }
        }
        "driver_fault" => {
            known(&["seconds"])?;
            Happening::DriverFault {
                seconds: lasting()?,
            }
        }
        "stop" => {
            known(&[])?;
            Happening::Stop
        }
        "reset" => {
            known(&[])?;
            Happening::Reset
        }
        "zero" => {
            known(&[])?;
            Happening::Zero
        }
        _ => {
            const EVENTS: [&str; 11] = [
                "occlusion",
                "drop",
                "late",
                "outlier",
                "silence",
                "limit",
                "emergency_stop",
                "driver_fault",
                "stop",
                "reset",
                "zero",
            ];
            return Err(kind.unknown("event", &EVENTS));
        }
    })
}

/// Reads one of these words and returns its index.
fn choice(field: &Field<'_>, words: &[&str]) -> Result<usize, InputError> {
    let given = field.text()?;
    let found = words.iter().position(|word| *word == given);
    found.ok_or_else(|| field.unknown("word", words))
}

fn measure(section: Option<Field<'_>>, seconds: f64) -> Result<Measure, InputError> {
    let mut measure = Measure {
        from_s: 0.0,
        until_s: seconds,
        settle_within_mm: [0.03, 0.03, 0.08],
    };
    let Some(section) = section else {
        return Ok(measure);
    };
    section.only(&["from_s", "until_s", "settle_within_mm"])?;
    if let Some(field) = section.optional("from_s")? {
        measure.from_s = between(&field, 0.0, seconds)?;
    }
    if let Some(field) = section.optional("until_s")? {
        measure.until_s = between(&field, 0.0, seconds)?;
    }
    if measure.from_s >= measure.until_s {
        return Err(section.fault("from_s must be before until_s, and before the end"));
    }
    if let Some(field) = section.optional("settle_within_mm")? {
        measure.settle_within_mm = field.each(|axis| axis.positive(FARTHEST_MM))?;
    }
    Ok(measure)
}

fn expect(section: &Field<'_>, seconds: f64) -> Result<Expect, InputError> {
    section.only(&[
        "rms_mm",
        "max_mm",
        "lag_mm",
        "settle_ms",
        "overshoot",
        "jitter_mm",
        "reversals_per_s",
        "latency_ms",
        "prediction_gain",
        "steps",
        "steps_within",
        "faults",
        "states",
        "sights",
        "at",
    ])?;
    let bound = |key: &str| match section.optional(key)? {
        Some(field) => between(&field, 0.0, LARGEST).map(Some),
        None => Ok(None),
    };
    let bounds = |key: &str| match section.optional(key)? {
        Some(field) => field.each(|axis| axis.positive(LARGEST)).map(Some),
        None => Ok(None),
    };
    let steps = match section.optional("steps")? {
        Some(field) => Some(field.each(whole_steps)?),
        None => None,
    };
    let steps_within = match section.optional("steps_within")? {
        Some(field) if steps.is_none() => {
            return Err(field.fault("there are no `steps` to be within"));
        }
        Some(field) => field.each(whole_steps)?,
        None => [0; 3],
    };
    Ok(Expect {
        rms_mm: bounds("rms_mm")?,
        max_mm: bounds("max_mm")?,
        lag_mm: bound("lag_mm")?,
        settle_ms: bound("settle_ms")?,
        overshoot: bound("overshoot")?,
        jitter_mm: bounds("jitter_mm")?,
        reversals_per_s: bound("reversals_per_s")?,
        latency_ms: bound("latency_ms")?,
        prediction_gain: bound("prediction_gain")?,
        steps,
        steps_within,
        faults: match section.optional("faults")? {
            Some(list) => named(&list, Fault::ALL, |fault| diagnosis::fault(fault).name)?,
            None => Vec::new(),
        },
        states: match section.optional("states")? {
            Some(list) => Some(named(&list, State::ALL, |state| {
                diagnosis::state(state).name
            })?),
            None => None,
        },
        sights: match section.optional("sights")? {
            Some(list) => {
                const ALL: [Sight; 4] =
                    [Sight::None, Sight::Tracking, Sight::Coasting, Sight::Lost];
                Some(named(&list, ALL, diagnosis::sight)?)
            }
            None => None,
        },
        at: match section.optional("at")? {
            Some(list) => {
                let points = list.elements()?;
                let read = points.iter().map(|point| checkpoint(point, seconds));
                read.collect::<Result<_, _>>()?
            }
            None => Vec::new(),
        },
    })
}

fn whole_steps(field: &Field<'_>) -> Result<i64, InputError> {
    // A 32-bit count of steps is exact in f64.
    let value = field.number(f64::from(i32::MAX))?;
    if value.fract() == 0.0 {
        Ok(value as i64)
    } else {
        Err(field.fault(format!("{value} is no whole number of steps")))
    }
}

fn checkpoint(table: &Field<'_>, seconds: f64) -> Result<Checkpoint, InputError> {
    table.only(&["time_s", "error_mm", "state", "standing"])?;
    Ok(Checkpoint {
        time_s: between(&table.required("time_s")?, 0.0, seconds)?,
        error_mm: match table.optional("error_mm")? {
            Some(field) => Some(field.each(|axis| axis.positive(LARGEST))?),
            None => None,
        },
        state: match table.optional("state")? {
            Some(field) => Some(one_of(&field, State::ALL, |state| {
                diagnosis::state(state).name
            })?),
            None => None,
        },
        standing: match table.optional("standing")? {
            Some(field) => Some(field.flag()?),
            None => None,
        },
    })
}

/// Returns the values with these names, in the list's order.
fn named<T: Copy, const N: usize>(
    list: &Field<'_>,
    all: [T; N],
    name: impl Fn(T) -> &'static str,
) -> Result<Vec<T>, InputError> {
    let fields = list.elements()?;
    fields
        .iter()
        .map(|field| one_of(field, all, &name))
        .collect()
}

fn one_of<T: Copy, const N: usize>(
    field: &Field<'_>,
    all: [T; N],
    name: impl Fn(T) -> &'static str,
) -> Result<T, InputError> {
    let names: Vec<&str> = all.iter().map(|each| name(*each)).collect();
    choice(field, &names).map(|index| all[index])
}

#[cfg(test)]
mod tests;
