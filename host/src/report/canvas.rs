//! The sheet of a figure, and its lettering.
//!
//! `plotters` places everything on whole units. A unit here is a tenth of a pixel, so that a slow
//! curve is a curve and not a staircase; the document's header scales it back.

use super::Error;
use super::markup::{escape, printable_text};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::fmt::Write as _;

/// Units per pixel.
pub(super) const UNIT: f64 = 10.0;
/// Font size of axis labels and legends, px.
pub(super) const TEXT: f64 = 13.0;
/// Font size of a figure's title, px.
pub(super) const TITLE: f64 = 15.0;
/// Height of the title's line, px.
pub(super) const TITLE_LINE: f64 = 28.0;

/// Strokes of curves: width in units, and dashes. `plotters` writes no dashes, so that each pattern
/// has a width of its own, which [`dashed`] finds in the document. No other stroke has these widths.
pub(super) const STROKES: [(u32, &str); 6] = [
    (22, ""),
    (19, "90 40"),
    (21, "24 34"),
    (17, "100 34 24 34"),
    (13, ""),
    (16, "45 30"),
];
/// Stroke of a reference, a bound or the truth.
pub(super) const DASHED: (u32, &str) = (18, "70 50");

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

/// Number of colours of series.
pub(super) const COLOURS: usize = PALETTE.len();

/// Colours of figures by the name of their variable in the page: on paper and light screens, and on
/// dark ones.
const SHADES: [(&str, RGBColor, &str); 13] = [
    ("paper", WHITE, "#161b22"),
    ("ink", INK, "#e6edf3"),
    ("soft", SOFT_INK, "#a3b0bd"),
    ("grid", GRID, "#2b333d"),
    ("axis", AXIS, "#66727f"),
    ("shadow", SHADOW, "#48525d"),
    ("c0", PALETTE[0], "#58b4f5"),
    ("c1", PALETTE[1], "#ff9248"),
    ("c2", PALETTE[2], "#3ecf9f"),
    ("c3", PALETTE[3], "#e79cc6"),
    ("c4", PALETTE[4], "#c9d1d9"),
    ("c5", PALETTE[5], "#f0b83c"),
    ("c6", PALETTE[6], "#8fd0f5"),
];

/// Returns the style sheet that gives every figure of a page its colours by variables, so that one
/// drawing suits light and dark screens.
pub(super) fn shades(more: &[(&str, RGBColor, &str)]) -> String {
    let all = || SHADES.iter().chain(more);
    let hex = |RGBColor(r, g, b): RGBColor| format!("#{r:02X}{g:02X}{b:02X}");
    let mut css = String::from(":root{");
    for (name, light, _) in all() {
        let _ = write!(css, "--{name}:{};", hex(*light));
    }
    css.push_str("}\n@media screen and (prefers-color-scheme:dark){:root{");
    for (name, _, dark) in all() {
        let _ = write!(css, "--{name}:{dark};");
    }
    css.push_str("}}\n");
    for (name, light, _) in all() {
        let light = hex(*light);
        for part in ["fill", "stroke"] {
            let _ = writeln!(css, "svg [{part}=\"{light}\"]{{{part}:var(--{name})}}");
        }
    }
    css
}

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
    let framed = |sheet: &Sheet| frame(sheet, title).and_then(|()| draw(sheet));
    let inside = drawn(title, size_px, framed)?;
    Ok(document(title, size_px, &inside, ""))
}

/// Draws elements for a figure of `size_px` px, and returns them without the document around them.
pub(super) fn drawn(
    title: &str,
    size_px: [u32; 2],
    draw: impl FnOnce(&Sheet) -> Result<(), DrawingError>,
) -> Result<String, Error> {
    let [width, height] = sides(size_px);
    let scale = UNIT as u32;
    let mut body = String::new();
    let outcome = {
        let sheet =
            SVGBackend::with_string(&mut body, (width * scale, height * scale)).into_drawing_area();
        draw(&sheet).and_then(|()| sheet.present())
    };
    outcome.map_err(|error| Error::Draw {
        title: title.to_owned(),
        reason: error.to_string(),
    })?;
    // The library's header knows no scale and no name for readers who cannot see.
    let inside = body.split_once('>').map_or("", |(_, rest)| rest);
    Ok(dashed(inside.trim_end().trim_end_matches("</svg>")))
}

/// Returns the SVG document around drawn elements, with more `attributes`.
pub(super) fn document(title: &str, size_px: [u32; 2], inside: &str, attributes: &str) -> String {
    let [width, height] = sides(size_px);
    let scale = UNIT as u32;
    let title = escape(title);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{title}\"{attributes}>\
         <title>{title}</title>{inside}</svg>\n",
        width * scale,
        height * scale,
    )
}

fn sides(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.clamp(200, 4000))
}

/// Adds the dashes of each stroke by its width.
fn dashed(svg: &str) -> String {
    let strokes = STROKES.iter().chain([&DASHED]);
    let strokes = strokes.filter(|(_, dashes)| !dashes.is_empty());
    strokes.fold(svg.to_owned(), |svg, (width, dashes)| {
        let plain = format!("stroke-width=\"{width}\"");
        svg.replace(&plain, &format!("{plain} stroke-dasharray=\"{dashes}\""))
    })
}

/// Fills the sheet and writes the title.
pub(super) fn frame(sheet: &Sheet, title: &str) -> Result<(), DrawingError> {
    sheet.fill(&WHITE).and_then(|()| write_title(sheet, title))
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
