//! Marks of events in plots over time: faults, occlusions, refused frames and the like.

use super::canvas::{DrawingError, Sheet, Spot, TEXT, lettering, units, write_text};
use super::chart::Place;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
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

    const fn colour(self) -> RGBColor {
        match self {
            Self::Fault => RGBColor(0xb4, 0x23, 0x18),
            Self::Limit => RGBColor(0x8a, 0x4b, 0x08),
            Self::Occlusion => RGBColor(0x5b, 0x5f, 0x97),
            Self::Refused => RGBColor(0x9c, 0x5a, 0x9c),
            Self::State => RGBColor(0x4a, 0x6f, 0x7c),
            Self::Note => RGBColor(0x2e, 0x6f, 0x40),
        }
    }
}

/// Colours of marks, as [`super::canvas::shades`] takes them.
pub(super) const SHADES: [(&str, RGBColor, &str); 6] = [
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
pub(super) fn draw(
    sheet: &Sheet,
    marks: &[Mark],
    place: &Place,
    x: [f64; 2],
    y: [f64; 2],
) -> Result<(), DrawingError> {
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
        let colour = mark.kind.colour();
        if until - from >= units(SHADED) {
            let corners = [(from, top), (until, bottom)];
            sheet.draw(&Rectangle::new(corners, colour.mix(0.12).filled()))?;
        }
        let line: Vec<Spot> = vec![(from, top), (from, bottom)];
        sheet.draw(&PathElement::new(line, colour.mix(0.75).stroke_width(11)))?;
        let near =
            |(kind, at): &(MarkKind, i32)| *kind == mark.kind && (from - at).abs() < units(LETTERS);
        if !letters.iter().any(near) {
            letters.push((mark.kind, from));
            let row = mark.kind as i32;
            let at = (from + units(2.0), top + units(2.0 + 12.0 * f64::from(row)));
            letter(sheet, mark.kind, at)?;
        }
    }
    Ok(())
}

/// Returns true if a part of the mark lies between the ends of the axis.
pub(super) fn is_within(mark: &Mark, x: [f64; 2]) -> bool {
    mark.from <= x[1] && mark.until >= x[0]
}

fn letter(sheet: &Sheet, kind: MarkKind, at: Spot) -> Result<(), DrawingError> {
    let font = lettering(TEXT - 2.0, kind.colour(), HPos::Left, VPos::Top);
    write_text(sheet, kind.letter(), at, &font)
}

/// Draws the sample of a kind in a legend, from `at` to the right.
pub(super) fn sample(sheet: &Sheet, at: Spot, kind: MarkKind) -> Result<(), DrawingError> {
    let (half, colour) = (units(6.0), kind.colour());
    let corners = [(at.0, at.1 - half), (at.0 + units(16.0), at.1 + half)];
    sheet.draw(&Rectangle::new(corners, colour.mix(0.12).filled()))?;
    let line = vec![(at.0, at.1 - half), (at.0, at.1 + half)];
    sheet.draw(&PathElement::new(line, colour.mix(0.75).stroke_width(11)))?;
    letter(sheet, kind, (at.0 + units(4.0), at.1 - units(5.0)))
}
