//! Decision which images of several cameras are of one instant.
//!
//! Images of equal names are of one instant. Where names differ from camera to camera, their
//! endings, the times in them or their last numbers decide, whichever pairs most images. Pages of
//! stacks and frames of videos have no names: those of equal number are of one instant, if the
//! videos have the same rate.

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

/// Gives images of one instant the same [`Still::instant`]. Without a `rule`, the form of the names
/// decides that pairs most images, or numbers for stacks and videos.
///
/// # Errors
/// Reason why the rule cannot be applied, in words.
pub fn pair(series: &mut [Series], rule: Option<Rule>) -> Result<Pairing, String> {
    let is_numbered = series.iter().any(Series::is_numbered);
    match rule {
        Some(Rule::Order) => Ok(by_order(series)),
        Some(Rule::Time) => by_time(series),
        None if is_numbered => match differing_rates(series) {
            Some(reason) => Err(reason),
            None => Ok(by_order(series)),
        },
        Some(Rule::Name) if is_numbered => {
            Err("pages and frames have no names; use --pair order".to_owned())
        }
        Some(Rule::Name) => Ok(Pairing {
            said: by_name(series).unwrap_or_else(|| Some("equal names".to_owned())),
            ..Pairing::default()
        }),
        None => Ok(by_most(series)),
    }
}

/// Describes two videos of different frame rates, whose frames of equal number are not of one
/// instant; `None` if all known rates are equal.
pub fn differing_rates(series: &[Series]) -> Option<String> {
    let mut known = series.iter().filter_map(|one| Some((one, one.rate()?)));
    let (first, [above, below]) = known.next()?;
    let is_other =
        |[a, b]: [u32; 2]| u64::from(a) * u64::from(below) != u64::from(above) * u64::from(b);
    let (other, [a, b]) = known.find(|(_, rate)| is_other(*rate))?;
    let fps = |above: u32, below: u32| f64::from(above) / f64::from(below);
    Some(format!(
        "{} has {:.3} frames per second, {} has {:.3}, so that frames of equal number are not of \
         one instant: convert them to one rate (ffmpeg -r), or give --pair order to pair them \
         nevertheless",
        first.place.display(),
        fps(above, below),
        other.place.display(),
        fps(a, b)
    ))
}

/// Pairs by the names or by the times in them, whichever gives more instants of all cameras. Of as
/// many, equal names come first, then times, then the last numbers of the names.
fn by_most(series: &mut [Series]) -> Pairing {
    let (mut named, mut timed) = (series.to_vec(), series.to_vec());
    let said = by_name(&mut named);
    let is_exact = said
        .as_ref()
        .is_some_and(|said| said.as_deref() != Some(LAST_NUMBERS));
    let mut best = Pairing {
        said: said.clone().flatten(),
        ..Pairing::default()
    };
    let names = if said.is_some() { common(&named) } else { 0 };
    let least = series.iter().map(|one| one.stills().len()).min();
    // Names that pair all images need no comparison.
    if !(is_exact && Some(names) == least)
        && have_distinct_times(series)
        && let Ok(pairing) = by_time(&mut timed)
        && (common(&timed) > names || (!is_exact && common(&timed) >= names))
    {
        best = pairing;
        named = timed;
    }
    series.clone_from_slice(&named);
    best
}

/// Returns the number of instants of which every series has an image.
fn common(series: &[Series]) -> usize {
    shared(series, whole).unwrap_or(0)
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
    Some(without_ending(still).to_owned())
}

/// Returns the name of the instant without the file's ending, which may be off already.
fn without_ending(still: &Still) -> &str {
    let file = still.file.file_name().unwrap_or_default();
    match file.to_string_lossy().ends_with(&still.instant) {
        true => split_ending(&still.instant).0,
        false => &still.instant,
    }
}

/// Description of pairs by [`last_number`].
const LAST_NUMBERS: &str = "the last numbers of their names";

/// Returns the last number of a name, without leading zeros.
fn last_number(still: &Still) -> Option<String> {
    let stem = without_ending(still);
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
        (last_number, Some(LAST_NUMBERS)),
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
    // Images at the end without a partner are dropped, so that they do not count as lost. Without
    // any pair, all stay, so that the folder is refused by their names.
    let least = if least == 0 { usize::MAX } else { least };
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
    let time = |still: &Still| name_time::time_us(without_ending(still));
    let of_series = |one: &Series| one.stills().iter().map(time).collect();
    series.iter().map(of_series).collect()
}

/// Returns true if all names hold a time, and no two images of a series have the same: a date that
/// all names share is no time of an image.
fn have_distinct_times(series: &[Series]) -> bool {
    let is_distinct = |times: &Vec<i64>| {
        let distinct: BTreeSet<i64> = times.iter().copied().collect();
        distinct.len() == times.len()
    };
    times(series).is_some_and(|times| times.iter().all(is_distinct))
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
    let total: usize = series.iter().map(|one| one.stills().len()).sum();
    let mut largest = 0;
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
        largest = kept
            .values()
            .map(|(off, _)| *off)
            .max()
            .unwrap_or(0)
            .max(largest);
        one.images = Images::Stills(kept.into_values().map(|(_, still)| still).collect());
    }
    // The first series keeps all its images, also those that no other camera has a partner for.
    let mut cameras: BTreeMap<&str, usize> = BTreeMap::new();
    for still in series.iter().flat_map(Series::stills) {
        *cameras.entry(&still.instant).or_default() += 1;
    }
    let partnered: usize = cameras.values().filter(|count| **count > 1).sum();
    let alone = total - partnered;
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
