//! Colours of figures, their title, and widths of texts.

use super::sheet::{Anchor, Colour, Lettering, Sheet, units};
use std::fmt::Write as _;

/// Font size of axis labels and legends, px.
pub(super) const TEXT: f64 = 13.0;
/// Font size of a figure's title, px.
pub(super) const TITLE: f64 = 15.0;
/// Height of the title's line, px.
pub(super) const TITLE_LINE: f64 = 28.0;

const PAPER: Colour = Colour::new(0xff_ff_ff);
pub(super) const INK: Colour = Colour::new(0x1f_29_33);
pub(super) const SOFT_INK: Colour = Colour::new(0x52_60_6d);
pub(super) const GRID: Colour = Colour::new(0xe4_e7_eb);
pub(super) const AXIS: Colour = Colour::new(0x9a_a5_b1);
pub(super) const SHADOW: Colour = Colour::new(0xc3_ca_d2);

/// Colours that people with any of the common colour vision deficiencies can distinguish, also on
/// paper in grey (Okabe and Ito's set without its yellow, which is unreadable on white).
const PALETTE: [Colour; 7] = [
    Colour::new(0x00_72_b2),
    Colour::new(0xd5_5e_00),
    Colour::new(0x00_9e_73),
    Colour::new(0xcc_79_a7),
    Colour::new(0x3d_3d_3d),
    Colour::new(0xe6_9f_00),
    Colour::new(0x56_b4_e9),
];

/// Number of colours of series.
pub(super) const COLOURS: usize = PALETTE.len();

/// Colours of figures by the name of their variable in the page: on paper and light screens, and on
/// dark ones.
const SHADES: [(&str, Colour, &str); 13] = [
    ("paper", PAPER, "#161b22"),
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
pub(super) fn shades(more: &[(&str, Colour, &str)]) -> String {
    let all = || SHADES.iter().chain(more);
    let mut css = String::from(":root{");
    for (name, light, _) in all() {
        let _ = write!(css, "--{name}:{light};");
    }
    css.push_str("}\n@media screen and (prefers-color-scheme:dark){:root{");
    for (name, _, dark) in all() {
        let _ = write!(css, "--{name}:{dark};");
    }
    css.push_str("}}\n");
    for (name, light, _) in all() {
        for part in ["fill", "stroke"] {
            let _ = writeln!(css, "svg [{part}=\"{light}\"]{{{part}:var(--{name})}}");
        }
    }
    css
}

/// Returns the colour of the series number `index`; colours repeat after seven.
pub(super) fn colour(index: usize) -> Colour {
    PALETTE[index % PALETTE.len()]
}

/// Returns a sheet of `size_px` px with its background and title.
pub(super) fn titled(title: &str, size_px: [u32; 2]) -> Sheet {
    let mut sheet = Sheet::new(size_px);
    let [width, height] = sheet.size();
    sheet.rectangle([(0, 0), (units(width), units(height))], PAPER);
    // A title wider than the figure is set smaller, down to the size of its other text, and then
    // cut: the document's own title holds all of it.
    let available = width - 16.0;
    let size = (TITLE * available / bold_width(title, TITLE).max(1.0)).clamp(TEXT - 1.0, TITLE);
    let mut shown = title.to_owned();
    while bold_width(&shown, size) > available && shown.pop().is_some() {}
    if shown.len() < title.len() {
        shown.pop();
        shown.push('\u{2026}');
    }
    let lettering = Lettering {
        is_bold: true,
        ..Lettering::new(INK, size, Anchor::Start)
    };
    sheet.text(&shown, (units(8.0), units(TITLE_LINE / 2.0)), lettering);
    sheet
}

fn bold_width(text: &str, pixels: f64) -> f64 {
    1.1 * text_width(text, pixels)
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
