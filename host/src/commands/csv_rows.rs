//! Rows of `--csv`: the columns of a command, filled from the object that `--json` prints.

use std::io::{self, Write};

use serde_json::Value;

use super::json;
use trinocular::scenario::csv::quoted;

/// Column: its name, and the way to the value in the object, as a JSON pointer.
pub type Column = (&'static str, &'static str);

/// Columns of a displacement with its covariance.
pub const DISPLACEMENT: [Column; 12] = [
    ("x_mm", "/displacement_mm/0"),
    ("y_mm", "/displacement_mm/1"),
    ("z_mm", "/displacement_mm/2"),
    ("sigma_x_mm", "/sigma_mm/0"),
    ("sigma_y_mm", "/sigma_mm/1"),
    ("sigma_z_mm", "/sigma_mm/2"),
    ("cov_xx_mm2", "/covariance_mm2/0/0"),
    ("cov_xy_mm2", "/covariance_mm2/0/1"),
    ("cov_xz_mm2", "/covariance_mm2/0/2"),
    ("cov_yy_mm2", "/covariance_mm2/1/1"),
    ("cov_yz_mm2", "/covariance_mm2/1/2"),
    ("cov_zz_mm2", "/covariance_mm2/2/2"),
];

/// Columns of a rotation and of the pivot whose displacement is stated.
pub const TURN: [Column; 9] = [
    ("rotation_x_deg", "/rotation_deg/0"),
    ("rotation_y_deg", "/rotation_deg/1"),
    ("rotation_z_deg", "/rotation_deg/2"),
    ("rotation_sigma_x_deg", "/rotation_sigma_deg/0"),
    ("rotation_sigma_y_deg", "/rotation_sigma_deg/1"),
    ("rotation_sigma_z_deg", "/rotation_sigma_deg/2"),
    ("pivot_x_mm", "/pivot_mm/0"),
    ("pivot_y_mm", "/pivot_mm/1"),
    ("pivot_z_mm", "/pivot_mm/2"),
];

/// Groups of columns, in their order.
pub type Columns = [&'static [Column]];

/// Writes the header.
pub fn header(out: &mut impl Write, columns: &Columns) -> io::Result<()> {
    let names: Vec<&str> = columns
        .iter()
        .copied()
        .flatten()
        .map(|(name, _)| *name)
        .collect();
    writeln!(out, "{}", names.join(","))
}

/// Writes the row of an object, with its numbers rounded as in `--json`. What the object lacks is
/// empty.
pub fn row(out: &mut impl Write, columns: &Columns, object: Value) -> io::Result<()> {
    let object = json::rounded(object);
    let cell = |(_, way): &Column| object.pointer(way).map_or(String::new(), text);
    let cells: Vec<String> = columns.iter().copied().flatten().map(cell).collect();
    writeln!(out, "{}", cells.join(","))
}

/// Formats a value as a cell: lists as sentences with semicolons in between.
fn text(value: &Value) -> String {
    let plain = |value: &Value| match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let text = match value {
        // Objects stay JSON.
        Value::Array(items) if items.iter().any(Value::is_object) => value.to_string(),
        Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join("; "),
        other => plain(other),
    };
    quoted(&text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn cells_follow_columns() {
        let columns: [&[Column]; 2] = [
            &[
                ("frame", "/frame"),
                ("x_mm", "/displacement_mm/0"),
                ("z_mm", "/displacement_mm/2"),
            ],
            &[("refused", "/refused"), ("warnings", "/warnings")],
        ];
        let mut out = Vec::new();
        header(&mut out, &columns).unwrap();
        let object = json!({"frame": 3, "displacement_mm": [1.0 / 3.0, 0.0, -2.5]});
        row(&mut out, &columns, object).unwrap();
        let object = json!({"frame": 4, "refused": "lost, \"dark\"", "warnings": ["a", "b"]});
        row(&mut out, &columns, object).unwrap();
        let text = String::from_utf8(out).unwrap();
        let expected = "frame,x_mm,z_mm,refused,warnings\n3,0.333333,-2.5,,\n\
             4,,,\"lost, \"\"dark\"\"\",a; b\n";
        assert_eq!(text, expected);
    }
}
