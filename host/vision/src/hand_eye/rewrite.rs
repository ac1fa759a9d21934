//! Replacement of the matrix and of the cameras' delays in the user's own rig file. All other text
//! stays, comments included.

use std::path::Path;

use toml_edit::{Item, Value};

use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::edit::{camera, edited, put, replace, rounded};

/// Reciprocal of the resolution of an element: a µm in a metre.
const DECIMALS: f64 = 1e6;

/// Returns `text`, a rig file, with another matrix in its `[stage]`. Errors name `file`.
///
/// # Errors
/// If the text is no rig file with a stage, or the result would be none.
pub fn with_matrix(file: &Path, text: &str, matrix: &[[f64; 3]; 3]) -> Result<String, InputError> {
    edited(file, text, |document| {
        let rows = document
            .get_mut("stage")
            .and_then(Item::as_table_like_mut)
            .and_then(|stage| stage.get_mut("matrix"))
            .and_then(Item::as_array_mut)
            .ok_or_else(|| InputError::file(file, "has no [stage] with a matrix"))?;
        for (row, elements) in rows.iter_mut().zip(matrix) {
            if let Some(row) = row.as_array_mut() {
                replace(row, elements.iter().map(|e| rounded(*e, DECIMALS)));
            }
        }
        Ok(())
    })
}

/// Reciprocal of the resolution of a delay: 10 µs in a ms.
const DELAY_DECIMALS: f64 = 1e2;

/// Returns `text`, a rig file, with other delays of its cameras' time stamps, ms. Errors name
/// `file`.
///
/// # Errors
/// If the text is no rig file with cameras of these names, or the result would be none.
pub fn with_delays<'a>(
    file: &Path,
    text: &str,
    delays_ms: impl IntoIterator<Item = (&'a str, f64)>,
) -> Result<String, InputError> {
    edited(file, text, |document| {
        for (name, delay_ms) in delays_ms {
            let table = camera(document, name)
                .ok_or_else(|| InputError::file(file, format!("there is no camera `{name}`")))?;
            let delay_ms = rounded(delay_ms, DELAY_DECIMALS);
            match table.get_mut("delay_ms").and_then(Item::as_value_mut) {
                Some(old) => put(old, delay_ms),
                None => {
                    table.insert("delay_ms", Item::Value(Value::from(delay_ms)));
                }
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_client::stage::default_stage;
    use trinocular_rig::rig_file::RigFile;

    const MATRIX: [[f64; 3]; 3] = [
        [0.999_999_9, 0.1, -0.000_000_1],
        [-0.1, -0.987_654_321, 0.0],
        [0.0, 0.25, 1.5],
    ];

    #[test]
    fn only_the_matrix_changes() {
        let mut rig = RigFile::paper();
        rig.stage = Some(default_stage());
        let was = "matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n";
        let text = rig.to_toml();
        assert!(text.contains(was));
        let commented = text.replace(
            was,
            "matrix = [ # as bolted on in spring\n  [1, 0, 0],\n  [ 0.0, 1.0, 0.0 ], # y\n  \
             [0.0, 0.0, 1.0],\n]\n",
        );
        let new = with_matrix(Path::new("rig.toml"), &commented, &MATRIX).unwrap();
        let expected = text.replace(
            was,
            "matrix = [ # as bolted on in spring\n  [1.0, 0.1, 0.0],\n  [ -0.1, -0.987654, 0.0 ], \
             # y\n  [0.0, 0.25, 1.5],\n]\n",
        );
        assert_eq!(new, expected);
    }

    #[test]
    fn only_the_delays_change() {
        let file = Path::new("rig.toml");
        let text = format!("# our bench\n{}", RigFile::paper().to_toml());
        let text = text.replace(
            "name = \"middle\"\n",
            "name = \"middle\"\ndelay_ms = 7 # of May\n",
        );
        let delays_ms = [("left", -4.123), ("middle", 12.506)];
        let new = with_delays(file, &text, delays_ms).expect("a rig file");
        let lines: Vec<&str> = new
            .lines()
            .filter(|line| line.contains("delay_ms"))
            .collect();
        assert_eq!(lines, ["delay_ms = -4.12", "delay_ms = 12.51 # of May"]);
        let kept = |text: &str| -> Vec<String> {
            let lines = text.lines().filter(|line| !line.contains("delay_ms"));
            lines.map(str::to_owned).collect()
        };
        assert_eq!(kept(&new), kept(&text));
        let read = RigFile::parse(file, &new).expect("a rig file");
        let delays: Vec<_> = read
            .capture
            .iter()
            .map(|capture| capture.delay_ms)
            .collect();
        assert_eq!(delays, [Some(-4.12), Some(12.51), None]);
    }

    #[test]
    fn cameras_in_one_line_get_delays() {
        let file = Path::new("rig.toml");
        let text = "image_size_px = [64, 48]\ncamera = [\n  { name = \"a\", focal_px = [60, 60], \
                    principal_px = [31, 23], offset_mm = [0, 0] },\n  { name = \"b\", focal_px = \
                    [60, 60], principal_px = [31, 23], offset_mm = [50, 0] }, # new\n]\n";
        let new = with_delays(file, text, [("b", 1.5)]).expect("a rig file");
        assert!(new.contains("delay_ms = 1.5 }, # new\n"), "{new}");
        let other = with_delays(file, text, [("c", 1.5)]).expect_err("no such camera");
        assert!(other.to_string().contains("no camera `c`"), "{other}");
    }

    #[test]
    fn invalid_result_is_refused() {
        let cameras = RigFile::paper().to_toml();
        let refused = with_matrix(Path::new("rig.toml"), &cameras, &MATRIX);
        assert!(refused.unwrap_err().to_string().contains("[stage]"));
        let mut rig = RigFile::paper();
        rig.stage = Some(default_stage());
        let singular = with_matrix(Path::new("rig.toml"), &rig.to_toml(), &[[1.0; 3]; 3]);
        assert!(singular.unwrap_err().to_string().contains("not invertible"));
    }
}
