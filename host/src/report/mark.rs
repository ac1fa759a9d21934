//! Marks of events in plots over time: faults, occlusions, refused frames and the like.

use super::canvas::TEXT;
use super::chart::Place;
use super::sheet::{Anchor, Colour, Lettering, Sheet, Spot, Stroke, units};
use std::collections::HashSet;

/// Kind of an event. Each has a letter, so that colour alone carries no meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MarkKind {
    /// A latched fault.
    Fault,
    /// A limit switch, an emergency stop or another input of the stage.
    Limit,
    /// The target is not seen, or a camera is left out.
    Occlusion,
    /// Frame sets without effect.
    Refused,
    /// A change of the station's state.
    State,
    /// A note of the operator, of the scenario or of the recorder.
    Note,
}

impl MarkKind {
    /// All kinds, in the order of legends.
    pub const ALL: [Self; 6] = [
        Self::Fault,
        Self::Limit,
        Self::Occlusion,
        Self::Refused,
        Self::State,
        Self::Note,
    ];

    /// Returns the name in legends and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fault => "fault",
            Self::Limit => "limit or switch",
            Self::Occlusion => "occlusion",
            Self::Refused => "frames not used",
            Self::State => "state",
            Self::Note => "note",
        }
    }

    /// Returns the letter at the mark.
    pub const fn letter(self) -> &'static str {
        match self {
            Self::Fault => "F",
            Self::Limit => "L",
            Self::Occlusion => "O",
            Self::Refused => "R",
            Self::State => "S",
            Self::Note => "N",
        }
    }

    const fn colour(self) -> Colour {
        match self {
            Self::Fault => Colour::new(0xb4_23_18),
            Self::Limit => Colour::new(0x8a_4b_08),
            Self::Occlusion => Colour::new(0x5b_5f_97),
            Self::Refused => Colour::new(0x9c_5a_9c),
            Self::State => Colour::new(0x4a_6f_7c),
            Self::Note => Colour::new(0x2e_6f_40),
        }
    }
}

/// Colours of marks, as [`super::canvas::shades`] takes them.
pub(super) const SHADES: [(&str, Colour, &str); 6] = [
    ("mf", MarkKind::Fault.colour(), "#ff7b72"),
    ("ml", MarkKind::Limit.colour(), "#e0a458"),
    ("mo", MarkKind::Occlusion.colour(), "#a5a9e8"),
    ("mr", MarkKind::Refused.colour(), "#d69ad6"),
    ("ms", MarkKind::State.colour(), "#8fb8c6"),
    ("mn", MarkKind::Note.colour(), "#7ccf93"),
];

/// One event in a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Kind of the event.
    pub kind: MarkKind,
    /// Start on the horizontal axis.
    pub from: f64,
    /// End on the horizontal axis; equal to the start for an instant.
    pub until: f64,
    /// The event in words, for the table of events.
    pub text: String,
}

impl Mark {
    /// Creates a mark of an instant.
    pub fn at(kind: MarkKind, at: f64, text: impl Into<String>) -> Self {
        Self::spanning(kind, at, at, text)
    }

    /// Creates a mark of a span.
    pub fn spanning(kind: MarkKind, from: f64, until: f64, text: impl Into<String>) -> Self {
        Self {
            kind,
            from,
            until,
            text: text.into(),
        }
    }
}

/// Least distance of two letters of one kind, px.
const LETTERS: f64 = 12.0;
/// Least width of a span that is shaded, px.
const SHADED: f64 = 3.0;

/// Draws the marks that lie within the axes: `x` and `y` are the ends of both. Of several marks of
/// one kind in one column of pixels, one is drawn.
pub(super) fn draw(sheet: &mut Sheet, marks: &[Mark], place: &Place, x: [f64; 2], y: [f64; 2]) {
    let top = place.spot([x[0], y[1]]).1;
    let bottom = place.spot([x[0], y[0]]).1;
    let mut letters: Vec<(MarkKind, i32)> = Vec::new();
    let mut drawn: HashSet<(MarkKind, i32, i32)> = HashSet::new();
    for mark in marks.iter().filter(|mark| is_within(mark, x)) {
        let column = |at: f64| place.spot([at.clamp(x[0], x[1]), y[0]]).0;
        let (from, until) = (column(mark.from), column(mark.until));
        let pixel = units(1.0).max(1);
        if !drawn.insert((mark.kind, from / pixel, until / pixel)) {
            continue;
        }
        if until - from >= units(SHADED) {
            shade(sheet, mark.kind, [(from, top), (until, bottom)]);
        }
        edge(sheet, mark.kind, [(from, top), (from, bottom)]);
        let near =
            |(kind, at): &(MarkKind, i32)| *kind == mark.kind && (from - at).abs() < units(LETTERS);
        if !letters.iter().any(near) {
            letters.push((mark.kind, from));
            let row = mark.kind as i32;
            let at = (from + units(2.0), top + units(6.4 + 12.0 * f64::from(row)));
            letter(sheet, mark.kind, at);
        }
    }
}

/// Returns true if a part of the mark lies between the ends of the axis.
pub(super) fn is_within(mark: &Mark, x: [f64; 2]) -> bool {
    mark.from <= x[1] && mark.until >= x[0]
}

/// Shades a span between two corners.
fn shade(sheet: &mut Sheet, kind: MarkKind, corners: [Spot; 2]) {
    sheet.rectangle(corners, kind.colour().faint(12));
}

/// Draws the line at the start of a mark.
fn edge(sheet: &mut Sheet, kind: MarkKind, ends: [Spot; 2]) {
    sheet.line(&ends, Stroke::solid(kind.colour().faint(75), 1.1));
}

fn letter(sheet: &mut Sheet, kind: MarkKind, at: Spot) {
    let lettering = Lettering::new(kind.colour(), TEXT - 2.0, Anchor::Start);
    sheet.text(kind.letter(), at, lettering);
}

/// Draws the sample of a kind in a legend, from `at` to the right.
pub(super) fn sample(sheet: &mut Sheet, at: Spot, kind: MarkKind) {
    let (top, bottom) = (at.1 - units(6.0), at.1 + units(6.0));
    shade(sheet, kind, [(at.0, top), (at.0 + units(16.0), bottom)]);
    edge(sheet, kind, [(at.0, top), (at.0, bottom)]);
    letter(sheet, kind, (at.0 + units(4.0), at.1));
}
