//! Time in the name of a file.
//!
//! ```text
//! 1403636579763555584.png                  ns since 1970; also µs, ms and s, with a fraction
//! img_20260105_102910_250.png              date and time, with a fraction of a second
//! Image__2026-01-05__10-29-10.png
//! ```

/// Returns the time in a name without its ending, µs since 1970; `None` if the name holds none.
pub fn time_us(stem: &str) -> Option<i64> {
    let numbers = stem.split(|c: char| !c.is_ascii_digit());
    let numbers: Vec<&str> = numbers.filter(|number| !number.is_empty()).collect();
    calendar(&numbers).or_else(|| epoch(stem, &numbers))
}

/// Reads a count of seconds or of a fraction of a second since 1970: its length gives the unit, for
/// times from 2001 to 2286.
fn epoch(stem: &str, numbers: &[&str]) -> Option<i64> {
    let index = numbers.iter().position(|number| number.len() >= 10)?;
    let number = numbers[index];
    let value: i64 = number.parse().ok()?;
    match number.len() {
        10 => {
            let fraction = numbers.get(index + 1).filter(|fraction| {
                let with_point = |point| stem.contains(&format!("{number}{point}{fraction}"));
                [".", "_", "-"].into_iter().any(with_point)
            });
            Some(value * 1_000_000 + fraction.map_or(0, |fraction| micros(fraction)))
        }
        13 => Some(value * 1_000),
        16 => Some(value),
        19 => Some(value / 1_000),
        _ => None,
    }
}

/// Reads a date and a time of day, together or in parts.
fn calendar(numbers: &[&str]) -> Option<i64> {
    let joined = |lengths: &[usize], from: usize| -> Option<String> {
        let parts = numbers.get(from..from + lengths.len())?;
        let fits = parts
            .iter()
            .zip(lengths)
            .all(|(part, length)| part.len() == *length);
        fits.then(|| parts.concat())
    };
    let forms: [&[usize]; 4] = [&[4, 2, 2, 2, 2, 2], &[8, 6], &[14], &[8, 2, 2, 2]];
    let starts = 0..numbers.len();
    let mut found = starts.flat_map(|from| forms.iter().map(move |form| (from, *form)));
    found.find_map(|(from, form)| {
        let digits = joined(form, from)?;
        let part = |range: std::ops::Range<usize>| digits.get(range)?.parse::<i64>().ok();
        let (year, month, day) = (part(0..4)?, part(4..6)?, part(6..8)?);
        let (hour, minute, second) = (part(8..10)?, part(10..12)?, part(12..14)?);
        let is_time = (1970..2287).contains(&year)
            && (1..=12).contains(&month)
            && (1..=31).contains(&day)
            && hour < 24
            && minute < 60
            && second < 61;
        let seconds = days(year, month, day) * 86_400 + hour * 3_600 + minute * 60 + second;
        let fraction = numbers
            .get(from + form.len())
            .map_or(0, |text| micros(text));
        is_time.then_some(seconds * 1_000_000 + fraction)
    })
}

/// Converts the digits after the point of a number of seconds to µs.
fn micros(fraction: &str) -> i64 {
    let digits = fraction.chars().chain(std::iter::repeat('0')).take(6);
    digits.collect::<String>().parse().unwrap_or(0)
}

/// Returns the days from 1970-01-01 to a date (H. Hinnant, *chrono-Compatible Low-Level Date
/// Algorithms*, 2013: `days_from_civil`).
fn days(year: i64, month: i64, day: i64) -> i64 {
    let year = year - i64::from(month <= 2);
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_names_are_read() {
        for (name, expected) in [
            ("1403636579763555584", Some(1_403_636_579_763_555)),
            ("cam_1403636579763555", Some(1_403_636_579_763_555)),
            ("1403636579763", Some(1_403_636_579_763_000)),
            ("1403636579.7635", Some(1_403_636_579_763_500)),
            ("1403636579", Some(1_403_636_579_000_000)),
            ("Image__2026-01-05__10-29-10", Some(1_767_608_950_000_000)),
            ("img_20260105_102910_25", Some(1_767_608_950_250_000)),
            ("19700102000000", Some(86_400_000_000)),
            ("left_2000-02-29_23-59-59.5", Some(951_868_799_500_000)),
            ("000123", None),
            ("img_20261305_102910", None),
            ("left", None),
        ] {
            assert_eq!(time_us(name), expected, "{name}");
        }
    }
}
