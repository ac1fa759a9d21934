//! The page of a recording that this program did not make: its topics, and some of its images.

use super::Provenance;
use crate::report::{Cell, Moment, Page, Table, View};
use std::collections::BTreeMap;
use trinocular_recording::read::Source;
use trinocular_recording::read::image::{self, KINDS};
use trinocular_recording::read::survey::{Channels, Message, Survey};
use trinocular_rig::error::InputError;

/// Most topics whose images are shown.
const MOST_TOPICS: usize = 8;
/// Images per topic.
const MOST_IMAGES: u64 = 4;
/// Rows of the table of topics.
const MOST_ROWS: usize = 200;

/// Returns the number of topics with images that can be read.
pub fn image_topics(survey: &Survey) -> usize {
    let topics = survey.topics.values();
    let is_image = |kind: &str, encoding: &str| KINDS.contains(&kind) && encoding == "cdr";
    topics
        .filter(|topic| is_image(&topic.kind, &topic.encoding))
        .count()
}

/// Returns the page of a recording without measurements.
///
/// # Errors
/// [`InputError`] if the file is damaged.
pub fn page(title: &str, source: &Source, survey: &Survey) -> Result<Page, InputError> {
    let (moments, first_fault) = moments(source, survey)?;
    let cut = survey
        .cut
        .as_ref()
        .map(|cut| format!(" The end is missing: {cut}."));
    let note = format!(
        "This recording is not of this program: it holds no measurements and no station. Its \
         topics and some of its images are shown.{}",
        cut.unwrap_or_default()
    );
    let topics = survey.topics.iter().take(MOST_ROWS);
    let topics = topics.fold(
        Table::new(
            "",
            [
                "topic",
                "type",
                "encoding",
                "messages",
                "seconds",
                "per second",
            ],
        ),
        |table, (name, topic)| {
            let [first, last] = topic.span_ns;
            let seconds = last.saturating_sub(first) as f64 * 1e-9;
            let rate = match topic.period_us() {
                0 => f64::NAN,
                us => 1e6 / us as f64,
            };
            table.row([
                Cell::text(name),
                Cell::text(&topic.kind),
                Cell::text(&topic.encoding),
                Cell::right(topic.count.to_string()),
                Cell::number(seconds, 2),
                Cell::number(rate, 1),
            ])
        },
    );
    let page = Page::new(title, "a recording of another program")
        .section("Topics", note)
        .table(topics)
        .section("Images", first_fault.unwrap_or_default())
        .moments(moments);
    let provenance = Provenance {
        rig: survey.rig.clone(),
        ..Provenance::default()
    };
    Ok(provenance.add_to(page))
}

/// Returns a few images of each topic, and why others are missing.
fn moments(source: &Source, survey: &Survey) -> Result<(Vec<Moment>, Option<String>), InputError> {
    let start_ns = survey.topics.values().map(|topic| topic.span_ns[0]).min();
    let mut counts: BTreeMap<String, u64> = BTreeMap::new();
    let mut shots: BTreeMap<u64, Moment> = BTreeMap::new();
    let mut fault = None;
    let mut channels = Channels::default();
    for record in source.records() {
        let (file, record) = record?;
        let Some(Message {
            topic: name,
            kind,
            encoding: "cdr",
            log_time,
            data,
            ..
        }) = channels.message(file, record)
        else {
            continue;
        };
        // The survey leaves out the topics beyond its limit.
        let Some(topic) = survey.topics.get(name) else {
            continue;
        };
        let is_new = !counts.contains_key(name);
        if !KINDS.contains(&kind) || is_new && counts.len() >= MOST_TOPICS {
            continue;
        }
        let count = counts.entry(name.to_owned()).or_default();
        let number = *count;
        *count += 1;
        let all = topic.count;
        let stride = all.div_ceil(MOST_IMAGES).max(1);
        if !number.is_multiple_of(stride) {
            continue;
        }
        match image::read(kind, &data) {
            Ok(image) => {
                let moment = shots.entry(number / stride).or_default();
                if moment.caption.is_empty() {
                    let at_ns = log_time.saturating_sub(start_ns.unwrap_or(0));
                    moment.caption = format!("{:.3} s", at_ns as f64 * 1e-9);
                }
                moment.views.push(View::new(name, &image, &[]));
            }
            Err(refusal) => {
                fault.get_or_insert(format!("Not shown: an image on {name}: {refusal}."));
            }
        }
    }
    Ok((shots.into_values().collect(), fault))
}
