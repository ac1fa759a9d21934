//! Replacement of the matrix in the user's own rig file. All other text stays, comments included.

use std::path::Path;

use toml_edit::Item;

use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::edit::{edited, replace, rounded};

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
