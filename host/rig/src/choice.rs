//! Words of which only some are allowed: the refusal of any other word names the nearest and all.

use crate::printable::printable;

/// Least similarity (Jaro-Winkler, without regard to case) of a word that is suggested.
const LEAST_SIMILARITY: f64 = 0.8;

/// Returns the allowed word that is most like `given`, if one is like it at all.
fn nearest<'a>(given: &str, known: &[&'a str]) -> Option<&'a str> {
    let given = given.to_lowercase();
    let similarity = |word: &str| strsim::jaro_winkler(&given, &word.to_lowercase());
    let rated = known.iter().map(|word| (similarity(word), *word));
    let best = rated.max_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (best.0 >= LEAST_SIMILARITY).then_some(best.1)
}

/// Returns ` (did you mean ...?)` with the allowed word that is most like `given`; empty if none is.
pub fn hint(given: &str, known: &[&str]) -> String {
    let word = nearest(given, known);
    word.map_or(String::new(), |word| format!(" (did you mean `{word}`?)"))
}

/// Returns the refusal of `given`, which is none of the `known` words for a `kind` of thing.
///
/// ```
/// use trinocular_rig::choice::unknown;
///
/// assert_eq!(
///     unknown("driver", "a4988", &["A4988", "TMC2209"]),
///     "unknown driver `a4988` (did you mean `A4988`?); known here: A4988, TMC2209"
/// );
/// ```
pub fn unknown(kind: &str, given: &str, known: &[&str]) -> String {
    let hint = hint(given, known);
    let (given, known) = (printable(given), known.join(", "));
    format!("unknown {kind} `{given}`{hint}; known here: {known}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelled_word_gets_its_neighbour() {
        let drivers = ["A4988", "DRV8825", "TMC2209"];
        for (given, word) in [
            ("tmc2209", Some("TMC2209")),
            ("TMC 2209", Some("TMC2209")),
            ("DRV8852", Some("DRV8825")),
            ("A4899", Some("A4988")),
            ("LV8729", None),
            ("", None),
        ] {
            assert_eq!(nearest(given, &drivers), word, "{given}");
        }
        assert_eq!(nearest("x", &[]), None);
    }

    #[test]
    fn unlike_word_gets_the_list_alone() {
        let said = unknown("motion", "zigzag", &["still", "step"]);
        assert_eq!(said, "unknown motion `zigzag`; known here: still, step");
    }
}
