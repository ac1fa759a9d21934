//! The trace of a run as a CSV table: one row per millisecond.

use super::trace::{Sample, Trace};
use std::fmt::Write as _;
use trinocular_client::diagnosis;

/// Names of the columns.
const HEADER: &str = "scenario,time_s,target_x_mm,target_y_mm,target_z_mm,\
camera_x_mm,camera_y_mm,camera_z_mm,error_x_mm,error_y_mm,error_z_mm,state\n";

/// Makes the table of several runs, each with the name of its scenario. Positions are true ones, mm
/// from those at the keyframe, rounded to nm; the error is cameras minus target.
pub fn table<'a>(runs: impl IntoIterator<Item = (&'a str, &'a Trace)>) -> String {
    let mut text = HEADER.to_owned();
    for (name, trace) in runs {
        let name = quoted(name);
        for sample in &trace.samples {
            row(&mut text, &name, sample);
        }
    }
    text
}

fn row(text: &mut String, name: &str, sample: &Sample) {
    let _ = write!(text, "{name},{:.3}", sample.time_s);
    for mm in [sample.target_mm, sample.camera_mm, sample.error_mm()].as_flattened() {
        let _ = write!(text, ",{mm:.6}");
    }
    let _ = writeln!(text, ",{}", diagnosis::state(sample.state).name);
}

/// Quotes a field if it needs that (RFC 4180).
pub fn quoted(field: &str) -> String {
    match field.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", field.replace('"', "\"\"")),
        false => field.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_core::safety::State;

    #[test]
    fn rows_have_every_column() {
        let trace = Trace {
            samples: vec![Sample {
                time_s: 0.001,
                target_mm: [1.0, -2.5, 0.0],
                camera_mm: [1.5, -2.5, 0.0125],
                reversals: [0; 3],
                state: State::Following,
            }],
            ..Trace::default()
        };
        let text = table([("a,\"b\"", &trace)]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(
            lines[1],
            "\"a,\"\"b\"\"\",0.001,1.000000,-2.500000,0.000000,1.500000,-2.500000,0.012500,\
             0.500000,0.000000,0.012500,following"
        );
        assert_eq!(lines[0].split(',').count(), 12);
    }
}
