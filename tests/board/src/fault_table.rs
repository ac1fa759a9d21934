//! FAULTS.md, whose lines are looked up by the tests that observed them: so the table says what was
//! observed.

/// Asserts that the table has a line for this fault, how it was injected, what the pins do and what
/// the station does then.
///
/// # Panics
/// If it lacks the line, which is printed.
pub fn observed(fault: &str, how: &str, pins: &str, then: &str) {
    let line = format!("| {fault} | {how} | {pins} | {then} |");
    let table = include_str!("../FAULTS.md");
    assert!(
        table.lines().any(|known| known == line),
        "FAULTS.md lacks\n{line}"
    );
}
