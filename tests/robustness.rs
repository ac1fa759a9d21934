//! A small part of `trinocular bench robustness`, which asserts more with more measurements.

use trinocular::accuracy_study::tally::{Tally, failures_of_all};
use trinocular::accuracy_study::{condition, phase, sweep};
use trinocular::turning_study;

/// Every condition with one poster: measured or refused as expected, no gross error, and sigma near
/// the truth. Some 330 measurements share a poster, so the limits are 1.5 times those of the full
/// sweep.
#[test]
fn conditions_are_measured_or_refused() {
    let all: Vec<&condition::Condition> = condition::ALL.iter().collect();
    let rows = sweep::run(&all, 1, 2, |_| {}).expect("scenes that can be rendered");
    let mut total = Tally::default();
    let mut failures = Vec::new();
    for row in &rows {
        failures.extend(row.tally.failures(row.condition));
        total.merge(&row.tally);
    }
    failures.extend(failures_of_all(&total, 1.5));
    println!(
        "{} measured, error²/sigma² {:.2?}",
        total.measured,
        total.normalised()
    );
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(
        total.measured > 200 && total.refused.len() >= 4,
        "{total:?}"
    );
}

/// Bound of the sub-pixel bias, with two posters.
#[test]
fn pixel_phase_causes_no_common_bias() {
    let phases = phase::run(2, |_| {}).expect("a scene that can be rendered");
    assert_eq!(phases.len(), phase::PHASES);
    for phase in phases {
        println!("{phase:+.5?}");
        assert!(phase.is_small(), "{phase:?}");
        assert!(
            phase.uncertainty_px.iter().all(|u| *u < 0.0006),
            "{phase:?}"
        );
    }
}

/// Targets that turn, alone and beside other objects, with two posters: no gross error with a
/// rotation.
#[test]
fn turning_targets_have_no_gross_error() {
    let rows = turning_study::sweep::run(2, 2, |_| {}).expect("scenes that can be rendered");
    println!("{}", turning_study::present::table(&rows, true).to_text());
    let failures = turning_study::sweep::failures(&rows, 3.0);
    assert!(failures.is_empty(), "{failures:#?}");
    let measured = |name: &str| {
        let mut rows = rows.iter().filter(|row| row.layout.name == name);
        rows.next().map_or(0, |row| row.moved.measured)
    };
    assert_eq!(measured("alone"), 12);
    assert!(measured("before-background") >= 3 && measured("covered") >= 3);
}
