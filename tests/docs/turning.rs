//! The figures of `docs/turning.md` that `verify` predicts.

use super::page::{Page, root};
use super::table::{numbers, rows};
use serde_json::Value;
use trinocular_tests::binary::{Outcome, trinocular};

/// Returns the predictions at 850 mm for 100 points on a target, "W,H" in mm.
fn predicted(target: &str) -> Value {
    let mut command = trinocular();
    command.args([
        "verify",
        "examples/data/rig.toml",
        "--json",
        "--points",
        "100",
    ]);
    command.args(["--depth-range", "850", "1000", "--target", target]);
    let outcome = Outcome::of(command.current_dir(root()));
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    outcome.json()[0]["depths"][0]["rotation"].clone()
}

/// Every figure is the predicted one within half a unit of its last digit.
#[test]
fn turning_page_states_predictions() {
    let page = Page::read("docs/turning.md").section("Before you build");
    let rows = rows(&page);
    assert!(rows.len() >= 3);
    for row in rows {
        let found = predicted(row.cells[0]);
        let pivots = &found["pivots"];
        let sigma = |value: &Value| {
            (0..3)
                .map(|i| value[0][i].as_f64().expect("a number"))
                .collect()
        };
        let expected: [Vec<f64>; 4] = [
            sigma(&found["rotation_sigma_deg"]),
            sigma(&pivots[0]["sigma_mm"]),
            sigma(&pivots[2]["sigma_mm"]),
            sigma(&found["without_rotation_sigma_mm"]),
        ];
        for (cell, expected) in row.cells[1..].iter().zip(expected) {
            let stated = numbers(cell);
            assert_eq!(stated.len(), 3, "{cell}");
            for ((stated, expected), text) in stated.iter().zip(expected).zip(cell.split(' ')) {
                let digits = text.split('.').nth(1).map_or(0, str::len);
                let unit = 0.1f64.powi(digits as i32);
                assert!(
                    (stated - expected).abs() <= 0.51 * unit,
                    "{cell}: {expected}"
                );
            }
        }
    }
}
