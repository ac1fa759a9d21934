//! The committed results: `tests/golden/pipeline.txt`, rewritten by running these tests with
//! `REGENERATE=1`.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use trinocular_vision::images::{SceneSettings, Texture, TextureKind};

use super::bench::{Bench, Got, table_5_mm};

const HEADER: &str = "\
# Estimates of the whole vision path on rendered posters: the paper's rig, 850 mm, noise of 2 \
grey levels, midpoint.
# poster seed, true x y z -> estimated x y z, sigma x y z (mm), points
";

fn file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/pipeline.txt")
}

/// One line of the table: a case and its results.
struct Row {
    case: String,
    /// Displacement, sigma and number of points; `None` if refused.
    numbers: Option<[f64; 7]>,
}

impl Row {
    fn new(case: String, got: Option<&Got>) -> Self {
        let numbers = got.map(|got| {
            let ([x, y, z], [a, b, c]) = (got.displacement_mm, got.sigma_mm);
            [x, y, z, a, b, c, got.points as f64]
        });
        Self { case, numbers }
    }

    fn parse(line: &str) -> Self {
        let (case, result) = line.split_once(" -> ").expect("an arrow");
        let numbers = (result != "refused").then(|| {
            let numbers = result
                .split_whitespace()
                .map(|n| n.parse().expect("a number"));
            let numbers: Vec<f64> = numbers.collect();
            numbers.try_into().expect("seven numbers")
        });
        let case = case.to_owned();
        Self { case, numbers }
    }

    fn print(&self, out: &mut String) {
        let result = match self.numbers {
            None => "refused".to_owned(),
            Some([x, y, z, a, b, c, points]) => {
                format!("{x:.4} {y:.4} {z:.4} {a:.4} {b:.4} {c:.4} {points}")
            }
        };
        writeln!(out, "{} -> {result}", self.case).expect("text grows");
    }

    /// Returns true if the results agree but for differences of another machine's arithmetic.
    ///
    /// The renderer's noise is drawn with logarithms, sines and cosines of the system's own
    /// library, whose last bits differ between systems. A grey level near the edge between two
    /// values may then fall on the other side. Only a few of many pixels do, so an estimate changes
    /// by much less than its standard deviation; but a point at the limit of a test may appear or
    /// disappear.
    fn agrees_with(&self, other: &Self) -> bool {
        let numbers_agree = match (self.numbers, other.numbers) {
            (None, None) => true,
            (Some(a), Some(b)) => {
                (0..3).all(|i| (a[i] - b[i]).abs() <= 0.3 * b[i + 3] + 1e-4)
                    && (3..6).all(|i| (a[i] - b[i]).abs() <= 0.1 * b[i] + 1e-4)
                    && (a[6] - b[6]).abs() <= 3.0
            }
            _ => false,
        };
        self.case == other.case && numbers_agree
    }
}

fn measured() -> Vec<Row> {
    let mut rows = Vec::new();
    for kind in TextureKind::ALL {
        for seed in 10..12 {
            let texture = Texture::of_kind(kind, seed);
            let bench = Bench::new(&texture, SceneSettings::default());
            let got = bench.measure_all(&table_5_mm(), seed);
            for ([x, y, z], got) in table_5_mm().into_iter().zip(got) {
                let case = format!("{kind} {seed}, {x} {y} {z}");
                rows.push(Row::new(case, got.as_ref().ok()));
            }
        }
    }
    rows
}

#[test]
fn results_match_committed_table() {
    let measured = measured();
    if std::env::var_os("REGENERATE").is_some() {
        let mut text = HEADER.to_owned();
        measured.iter().for_each(|row| row.print(&mut text));
        fs::write(file(), text).expect("the table can be written");
    }
    let text = fs::read_to_string(file()).expect("the table; REGENERATE=1 makes it");
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let committed: Vec<Row> = lines.map(Row::parse).collect();
    assert_eq!(measured.len(), committed.len());
    for (now, then) in measured.iter().zip(&committed) {
        assert!(
            now.agrees_with(then),
            "now {} {:?}, committed {} {:?}",
            now.case,
            now.numbers,
            then.case,
            then.numbers
        );
    }
}
