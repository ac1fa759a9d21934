//! The sheet of a figure, and its lettering.
//!
//! `plotters` places everything on whole units. A unit here is a tenth of a pixel, so that a slow
//! curve is a curve and not a staircase; the document's header scales it back.

use super::Error;
use super::markup::{escape, printable_text};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Units per pixel.
pub(super) const UNIT: f64 = 10.0;
/// Font size of axis labels and legends, px.
pub(super) const TEXT: f64 = 13.0;
/// Font size of a figure's title, px.
pub(super) const TITLE: f64 = 15.0;
/// Height of the title's line, px.
pub(super) const TITLE_LINE: f64 = 28.0;

pub(super) const INK: RGBColor = RGBColor(0x1f, 0x29, 0x33);
pub(super) const SOFT_INK: RGBColor = RGBColor(0x52, 0x60, 0x6d);
pub(super) const GRID: RGBColor = RGBColor(0xe4, 0xe7, 0xeb);
pub(super) const AXIS: RGBColor = RGBColor(0x9a, 0xa5, 0xb1);
pub(super) const SHADOW: RGBColor = RGBColor(0xc3, 0xca, 0xd2);

/// Colours that people with any of the common colour vision deficiencies can distinguish, also on
/// paper in grey (Okabe and Ito's set without its yellow, which is unreadable on white).
const PALETTE: [RGBColor; 7] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0x3d, 0x3d, 0x3d),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
];

/// Returns the colour of the series number `index`; colours repeat after seven.
pub(super) fn colour(index: usize) -> RGBColor {
    PALETTE[index % PALETTE.len()]
}

/// Drawing area of a figure: positions in units, from the top left corner.
pub(super) type Sheet<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// Position on the sheet, units.
pub(super) type Spot = (i32, i32);

/// Converts pixels to units. Saturates, and converts NaN to 0, as `as` does.
pub(super) fn units(pixels: f64) -> i32 {
    (pixels * UNIT).round() as i32
}

/// Returns a stroke of `pixels` px.
pub(super) fn pen(colour: RGBColor, pixels: f64) -> ShapeStyle {
    ShapeStyle {
        color: colour.to_rgba(),
        filled: false,
        stroke_width: units(pixels).max(1).unsigned_abs(),
    }
}

/// Error of the drawing library.
pub(super) type DrawingError = DrawingAreaErrorKind<std::io::Error>;

/// Draws a figure of `size_px` px with its title, and returns the SVG document.
pub(super) fn render(
    title: &str,
    size_px: [u32; 2],
    draw: impl FnOnce(&Sheet) -> Result<(), DrawingError>,
) -> Result<String, Error> {
    let [width, height] = size_px.map(|side| side.clamp(200, 4000));
    let scale = UNIT as u32;
    let mut body = String::new();
    let drawn = {
        let sheet =
            SVGBackend::with_string(&mut body, (width * scale, height * scale)).into_drawing_area();
        sheet
            .fill(&WHITE)
            .and_then(|()| write_title(&sheet, title))
            .and_then(|()| draw(&sheet))
            .and_then(|()| sheet.present())
    };
    drawn.map_err(|error| Error::Draw {
        title: title.to_owned(),
        reason: error.to_string(),
    })?;
    // The library's header knows no scale and no name for readers who cannot see.
    let inside = body.split_once('>').map_or("", |(_, rest)| rest);
    let title = escape(title);
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{title}\"><title>{title}</title>{inside}",
        width * scale,
        height * scale,
    ))
}

fn write_title(sheet: &Sheet, title: &str) -> Result<(), DrawingError> {
    let style = lettering(TITLE, INK, HPos::Left, VPos::Center);
    // A title wider than the figure is set smaller, down to the size of its other text, and then
    // cut: the document's own title holds all of it.
    let available = f64::from(sheet.dim_in_pixel().0) / UNIT - 16.0;
    let size = (TITLE * available / bold_width(title, TITLE).max(1.0)).clamp(TEXT - 1.0, TITLE);
    let mut shown = title.to_owned();
    while bold_width(&shown, size) > available && shown.pop().is_some() {}
    if shown.len() < title.len() {
        shown.pop();
        shown.push('\u{2026}');
    }
    let font = ("sans-serif", size * SVG_FONT_RATIO * UNIT).into_font();
    let style = TextStyle {
        font: font.style(FontStyle::Bold),
        ..style
    };
    write_text(sheet, &shown, (units(8.0), units(TITLE_LINE / 2.0)), &style)
}

fn bold_width(text: &str, pixels: f64) -> f64 {
    1.1 * text_width(text, pixels)
}

/// Ratio by which `plotters` divides every font size when it writes SVG.
const SVG_FONT_RATIO: f64 = 1.24;

/// Returns the style of text of `pixels` px, anchored at the given side.
pub(super) fn lettering(
    pixels: f64,
    colour: RGBColor,
    side: HPos,
    level: VPos,
) -> TextStyle<'static> {
    ("sans-serif", pixels * SVG_FONT_RATIO * UNIT)
        .into_font()
        .color(&colour)
        .pos(Pos::new(side, level))
}

/// Writes one line of text.
pub(super) fn write_text(
    sheet: &Sheet,
    text: &str,
    at: Spot,
    style: &TextStyle,
) -> Result<(), DrawingError> {
    sheet.draw_text(&printable_text(text), style, at)
}

/// Estimates the width of a text, px. The reader's font is unknown, so this is the width in a wide
/// sans-serif (DejaVu, Verdana); narrower fonts fit as well.
pub(super) fn text_width(text: &str, pixels: f64) -> f64 {
    let ems = text.chars().map(|c| match c {
        'i' | 'j' | 'l' | '.' | ',' | ':' | ';' | '\'' | '|' | ' ' | 'I' | '(' | ')' | 'f'
        | 't' | 'r' => 0.38,
        'm' | 'w' | 'M' | 'W' | '\u{2212}' => 0.92,
        c if c.is_ascii_uppercase() => 0.72,
        c if c.is_ascii() => 0.63,
        c if (c as u32) < 0x2e80 => 0.68,
        _ => 1.0,
    });
    ems.sum::<f64>() * pixels
}
