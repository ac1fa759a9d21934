//! Decision which images of several cameras are of one instant.
//!
//! Images of equal names are of one instant. Where names differ from camera to camera, their endings, their last
//! numbers or the times in them decide. Pages of stacks and frames of videos have no names: those
//! of equal number are of one instant.

use std::collections::{BTreeMap, BTreeSet};

use super::layout::split_ending;
use super::{Images, Series, Still, name_time};
use crate::images::folder::numbers_padded;

/// Rule by which images are of one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Equal names.
    Name,
    /// Equal places in the order of the names.
    Order,
    /// Nearest times, read from the names.
    Time,
}

/// Pairing that was made.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pairing {
    /// Description for the user; `None` for equal names, which are the usual case.
    pub said: Option<String>,
    /// Time of each instant by its name, µs since 1970, if names hold times that decided.
    pub times_us: BTreeMap<String, i64>,
}

/// Gives images of one instant the same [`Still::instant`]. Without a `rule`, names decide, or
/// numbers for stacks and videos, or times if no names agree but all hold a time.
///
/// # Errors
/// Reason why the rule cannot be applied, in words.
pub fn pair(series: &mut [Series], rule: Option<Rule>) -> Result<Pairing, String> {
    let is_numbered = series.iter().any(Series::is_numbered);
    match rule {
        Some(Rule::Order) => Ok(by_order(series)),
        Some(Rule::Time) => by_time(series),
        None if is_numbered => Ok(by_order(series)),
        Some(Rule::Name) if is_numbered => {
            Err("pages and frames have no names; use --pair order".to_owned())
        }
        Some(Rule::Name) | None => {
            let named = by_name(series);
            if named.is_none() && rule.is_none() && times(series).is_some() {
                return by_time(series);
            }
            let said = named.unwrap_or_else(|| rule.map(|_| "equal names".to_owned()));
            Ok(Pairing {
                said,
                ..Pairing::default()
            })
        }
    }
}

/// Returns the number of names that all series have, by a form of the name; `None` if two images of
/// a series have the same.
fn shared(series: &[Series], form: Form) -> Option<usize> {
    let mut all: Option<BTreeSet<String>> = None;
    for one in series {
        let names: BTreeSet<String> = one.stills().iter().map(form).collect::<Option<_>>()?;
        if names.len() != one.stills().len() {
            return None;
        }
        all = Some(match all {
            Some(all) => all.intersection(&names).cloned().collect(),
            None => names,
        });
    }
    all.map(|all| all.len())
}

/// Form of an image's name.
type Form = fn(&Still) -> Option<String>;

fn whole(still: &Still) -> Option<String> {
    Some(still.instant.clone())
}

fn stem(still: &Still) -> Option<String> {
    Some(split_ending(&still.instant).0.to_owned())
}

/// Returns the last number of a name, without leading zeros.
fn last_number(still: &Still) -> Option<String> {
    let (stem, _) = split_ending(&still.instant);
    let stem = stem.trim_end_matches(|c: char| !c.is_ascii_digit());
    let text = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = &stem[text.len()..];
    let short = number.trim_start_matches('0');
    (!number.is_empty()).then(|| if short.is_empty() { "0" } else { short }.to_owned())
}

/// Pairs by the form of the name that most images share. Returns the description, or `None` if no
/// form gives an instant of all cameras; names stay as they are then.
fn by_name(series: &mut [Series]) -> Option<Option<String>> {
    let forms: [(Form, Option<&str>); 3] = [
        (whole, None),
        (stem, Some("equal names, endings aside")),
        (last_number, Some("the last numbers of their names")),
    ];
    let mut best: Option<(usize, Form, Option<&str>)> = None;
    for (form, said) in forms {
        let count = shared(series, form).unwrap_or(0);
        // Cameras lack images: a looser form must explain the names better.
        if count > best.map_or(0, |(count, ..)| count) {
            best = Some((count, form, said));
        }
    }
    let (_, form, said) = best?;
    for still in series.iter_mut().filter_map(Series::stills_mut).flatten() {
        still.instant = form(still).unwrap_or_default();
    }
    Some(said.map(str::to_owned))
}

/// Pairs the first images, the second images, and so on.
fn by_order(series: &mut [Series]) -> Pairing {
    let mut counts = Vec::new();
    for one in series.iter_mut() {
        let is_numbered = one.is_numbered();
        let Some(stills) = one.stills_mut() else {
            continue;
        };
        if !is_numbered {
            stills.sort_by_cached_key(|still| {
                (numbers_padded(&still.instant), still.instant.clone())
            });
        }
        for (still, number) in stills.iter_mut().zip(1..) {
            still.instant = number.to_string();
        }
        let count = stills.len();
        counts.push((one.name.clone(), count));
    }
    let least = counts.iter().map(|(_, count)| *count).min().unwrap_or(0);
    let longer = counts.iter().filter(|(_, count)| *count > least);
    let longer: Vec<String> = longer
        .map(|(name, count)| format!("the last {} of {name} have no partners", count - least))
        .collect();
    let more = longer.iter().map(|text| format!("; {text}"));
    let said = format!("their order{}", more.collect::<String>());
    // Images at the end without a partner are dropped, so that they do not count as lost.
    for one in series.iter_mut() {
        if let Some(stills) = one.stills_mut() {
            stills.truncate(least);
        }
    }
    Pairing {
        said: Some(said),
        ..Pairing::default()
    }
}

/// Returns the time of each image of each series, µs, if all names hold one.
fn times(series: &[Series]) -> Option<Vec<Vec<i64>>> {
    let time = |still: &Still| name_time::time_us(split_ending(&still.instant).0);
    let of_series = |one: &Series| one.stills().iter().map(time).collect();
    series.iter().map(of_series).collect()
}

/// Pairs each image of the first series with the nearest in time of every other, within half the
/// time between two images.
fn by_time(series: &mut [Series]) -> Result<Pairing, String> {
    let Some(times) = times(series).filter(|times| times.iter().all(|one| !one.is_empty())) else {
        let reason = "not all names hold a time (such as 20260105_102910_250, or ns, us, ms or s \
                      since 1970); use --pair name or --pair order";
        return Err(reason.to_owned());
    };
    let mut first: Vec<i64> = times[0].clone();
    first.sort_unstable();
    let mut gaps: Vec<i64> = first.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    // A single image may be a second apart.
    let limit = gaps.get(gaps.len() / 2).map_or(1_000_000, |gap| gap / 2);
    let (mut largest, mut alone) = (0, 0);
    for (one, times) in series.iter_mut().zip(&times) {
        let mut kept: BTreeMap<i64, (i64, Still)> = BTreeMap::new();
        for (still, time) in one.stills().iter().zip(times) {
            let after = first.partition_point(|at| at < time);
            let near = [after.checked_sub(1), Some(after)].into_iter().flatten();
            let near = near.filter_map(|index| first.get(index));
            let Some(at) = near.min_by_key(|at| (*at - time).abs()) else {
                continue;
            };
            let off = (at - time).abs();
            let is_nearest = kept.get(at).is_none_or(|(other, _)| off < *other);
            if off <= limit && is_nearest {
                let mut still = still.clone();
                still.instant = at.to_string();
                kept.insert(*at, (off, still));
            }
        }
        alone += one.stills().len() - kept.len();
        largest = kept
            .values()
            .map(|(off, _)| *off)
            .max()
            .unwrap_or(0)
            .max(largest);
        one.images = Images::Stills(kept.into_values().map(|(_, still)| still).collect());
    }
    let ms = |us: i64| us as f64 * 1e-3;
    let said = format!(
        "nearest times in their names, at most {:.3} ms apart (limit {:.3} ms); {alone} images \
         without partners",
        ms(largest),
        ms(limit)
    );
    Ok(Pairing {
        said: Some(said),
        times_us: first.iter().map(|at| (at.to_string(), *at)).collect(),
    })
}
