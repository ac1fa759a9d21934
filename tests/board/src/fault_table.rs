//! The table FAULTS.md. Each test looks up the line that it observed, so the table holds
//! observations.

/// Asserts that the table has a line for this fault, its injection, the effect on the pins and the
/// reaction of the station.
///
/// # Panics
/// If the table lacks the line, which is then printed.
pub fn observed(fault: &str, how: &str, pins: &str, then: &str) {
    let line = format!("| {fault} | {how} | {pins} | {then} |");
    let table = include_str!("../FAULTS.md");
    assert!(
        table.lines().any(|known| known == line),
        "FAULTS.md lacks\n{line}"
    );
}
