//! The paper's Tables 1 and 2: known moves of random point sets, recovered without noise.
//!
//! The paper prints one result per move. Its closed form depends on the points (a finite move in
//! depth scales the result by about `Z/(Z + Vz)`), so one draw proves little. Here every move is
//! recovered from many sets, and the result is the mean, the spread and the worst case.

use super::scene::{SEED, point, section_3_rig, views};
use super::{estimates, in_parallel};
use serde::Serialize;
use trinocular_core::estimate::Refusal;
use trinocular_rig::random::Random;

/// Number of points in a set, as in the paper.
pub const POINTS: usize = 50;

/// One row of the paper's tables.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Printed {
    /// Number of the table, 1 or 2.
    pub table: u8,
    /// True displacement, mm.
    pub true_mm: [f64; 3],
    /// Displacement printed in the paper, mm.
    pub paper_mm: [f64; 3],
}

const fn printed(table: u8, true_mm: [f64; 3], paper_mm: [f64; 3]) -> Printed {
    Printed {
        table,
        true_mm,
        paper_mm,
    }
}

/// Every row of Tables 1 and 2.
pub const PRINTED: [Printed; 13] = [
    printed(1, [0.1, 0.1, 0.0], [0.1, 0.1, 0.0]),
    printed(1, [0.0, 0.0, 0.1], [0.0, 0.0, 0.1]),
    printed(1, [0.1, 0.1, 0.1], [0.1, 0.1, 0.1]),
    printed(1, [10.0, 10.0, 0.0], [10.0, 10.0, 0.0]),
    printed(1, [15.0, 15.0, 0.0], [15.0, 15.0, 0.0]),
    printed(1, [20.0, 20.0, 0.0], [20.0, 20.0, 0.0]),
    printed(1, [0.0, 0.0, 3.0], [0.0, 0.0, 2.9898]),
    printed(1, [0.0, 0.0, 5.0], [0.0001, 0.0, 4.9718]),
    printed(1, [0.0, 0.0, 7.0], [0.0001, 0.0, 6.9449]),
    printed(1, [15.0, 15.0, 15.0], [14.7529, 14.7524, 14.7494]),
    printed(1, [20.0, 20.0, 20.0], [19.5632, 19.5622, 19.5570]),
    printed(2, [15.0, 15.0, 2.0], [14.9665, 14.9665, 1.9955]),
    printed(2, [20.0, 20.0, 2.0], [19.9553, 19.9553, 1.9955]),
];

/// Displacements of one estimator over all sets, per axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean displacement, mm.
    pub mean_mm: [f64; 3],
    /// Standard deviation from set to set, mm.
    pub deviation_mm: [f64; 3],
    /// Smallest displacement, mm.
    pub least_mm: [f64; 3],
    /// Largest displacement, mm.
    pub most_mm: [f64; 3],
    /// Largest error, mm.
    pub worst_error_mm: [f64; 3],
}

impl Spread {
    fn of(results: impl Iterator<Item = [f64; 3]> + Clone, true_mm: [f64; 3]) -> Self {
        let count = results.clone().count().max(1) as f64;
        let per_axis = |value: &dyn Fn(usize) -> f64| [0, 1, 2].map(value);
        let mean_mm = per_axis(&|axis| results.clone().map(|t| t[axis]).sum::<f64>() / count);
        Self {
            mean_mm,
            deviation_mm: per_axis(&|axis| {
                let squares = results.clone().map(|t| (t[axis] - mean_mm[axis]).powi(2));
                (squares.sum::<f64>() / count).sqrt()
            }),
            least_mm: per_axis(&|axis| {
                results
                    .clone()
                    .map(|t| t[axis])
                    .fold(f64::INFINITY, f64::min)
            }),
            most_mm: per_axis(&|axis| {
                results
                    .clone()
                    .map(|t| t[axis])
                    .fold(f64::NEG_INFINITY, f64::max)
            }),
            worst_error_mm: per_axis(&|axis| {
                let errors = results.clone().map(|t| (t[axis] - true_mm[axis]).abs());
                errors.fold(0.0, f64::max)
            }),
        }
    }
}

/// One row: the paper's values and this program's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Values printed in the paper.
    #[serde(flatten)]
    pub printed: Printed,
    /// Displacements of [`super::ESTIMATORS`], in that order.
    pub recovered: [Spread; 3],
}

/// Tables 1 and 2.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recovery {
    /// Number of sets of [`POINTS`] points of each row.
    pub sets: usize,
    /// Rows, one per printed row, in the paper's order.
    pub rows: Vec<Row>,
}

/// Recovers every move of the tables from `sets` random sets.
///
/// # Errors
/// If an estimator refuses, which does not happen with sets of this size.
pub fn run(sets: usize) -> Result<Recovery, Refusal> {
    let rig = section_3_rig();
    let rows = PRINTED.iter().map(|printed| {
        let results = in_parallel(sets, |set| {
            let mut random = Random::new(SEED, set as u64);
            let mut draw = || point(&rig, printed.true_mm, &mut random);
            let points: Vec<_> = (0..POINTS)
                .map(|_| views(&rig, draw(), printed.true_mm))
                .collect();
            estimates(&rig, &points)
        });
        let results = results.into_iter().collect::<Result<Vec<_>, _>>()?;
        let of = |estimator: usize| {
            Spread::of(
                results.iter().map(|three| three[estimator]),
                printed.true_mm,
            )
        };
        Ok(Row {
            printed: *printed,
            recovered: [0, 1, 2].map(of),
        })
    });
    Ok(Recovery {
        sets,
        rows: rows.collect::<Result<_, Refusal>>()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn far(a: [f64; 3], b: [f64; 3]) -> f64 {
        (0..3)
            .map(|axis| (a[axis] - b[axis]).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn closed_form_matches_tables() {
        let recovery = run(1000).unwrap();
        assert_eq!(recovery.rows.len(), 13);
        for row in &recovery.rows {
            let [closed, _, midpoint] = &row.recovered;
            let off = far(closed.mean_mm, row.printed.paper_mm);
            assert!(off <= 0.01, "{:?}: {:?}", row.printed, closed.mean_mm);
            let worst = far(midpoint.worst_error_mm, [0.0; 3]);
            assert!(worst <= 0.001, "{:?}: {worst}", row.printed);
        }
    }

    #[test]
    fn bias_is_of_paper_estimators() {
        // 20 mm away at 890 mm shortens everything by 2.2 %.
        let row = &run(50).unwrap().rows[10];
        let expected = 20.0 * 890.0 / 910.0;
        for estimator in [0, 1] {
            let mean = row.recovered[estimator].mean_mm;
            assert!(far(mean, [expected; 3]) < 0.02, "{mean:?}");
        }
    }

    #[test]
    fn runs_repeat_to_the_bit() {
        assert_eq!(run(7).unwrap(), run(7).unwrap());
    }
}
