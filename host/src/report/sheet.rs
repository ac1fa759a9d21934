//! The sheet of a figure: a writer of SVG elements.
//!
//! A position is two whole numbers of units; a unit is a tenth of a pixel. It is fine enough for a
//! slow curve to be a curve and not a staircase, short in the document, and never NaN. The
//! document's view box scales the units back to pixels.
//!
//! Every colour is an attribute in upper-case hex, because the page's style sheet selects elements
//! by it ([`super::canvas::shades`]).

use super::markup::escape;
use std::fmt::{self, Write as _};

/// Units per pixel.
pub(super) const UNIT: f64 = 10.0;

/// Position on the sheet from its top left corner, units.
pub(super) type Spot = (i32, i32);

/// Converts pixels to units. Saturates, and converts NaN to 0, as `as` does.
pub(super) fn units(pixels: f64) -> i32 {
    (pixels * UNIT).round() as i32
}

/// Colour and opacity of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colour {
    /// Red, green and blue as 0xRRGGBB.
    rgb: u32,
    /// Opacity, 0 to 100 %.
    percent: u8,
}

impl Colour {
    /// Creates an opaque colour from 0xRRGGBB.
    pub const fn new(rgb: u32) -> Self {
        Self { rgb, percent: 100 }
    }

    /// Returns the colour with an opacity of `percent` %.
    pub const fn faint(self, percent: u8) -> Self {
        Self { percent, ..self }
    }

    /// Returns the colour as attribute `name`, with an opacity unless it is opaque.
    fn attribute(self, name: &str) -> String {
        match self.percent {
            100.. => format!("{name}=\"{self}\""),
            percent => format!("{name}=\"{self}\" opacity=\"0.{percent:02}\""),
        }
    }
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{:06X}", self.rgb)
    }
}

/// Stroke of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    pub colour: Colour,
    /// Width, units.
    pub width_units: u32,
    /// Lengths of dashes and gaps, units; empty for a solid line.
    pub dashes: &'static str,
}

impl Stroke {
    /// Returns a solid stroke of `pixels` px.
    pub fn solid(colour: Colour, pixels: f64) -> Self {
        Self {
            colour,
            width_units: units(pixels).max(1).unsigned_abs(),
            dashes: "",
        }
    }
}

/// Part of a text that lies at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// Lettering of a text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lettering {
    pub colour: Colour,
    /// Font size, px.
    pub size_px: f64,
    pub anchor: Anchor,
    pub is_bold: bool,
    /// True for a text that runs upwards.
    pub is_upright: bool,
}

impl Lettering {
    /// Returns plain, level lettering of `size_px`.
    pub fn new(colour: Colour, size_px: f64, anchor: Anchor) -> Self {
        Self {
            colour,
            size_px,
            anchor,
            is_bold: false,
            is_upright: false,
        }
    }
}

/// Height of the middle of digits and capitals over the baseline, as a share of the font size.
const MIDDLE: f64 = 0.36;

/// Elements of a figure, in drawing order.
pub(super) struct Sheet {
    size_px: [u32; 2],
    elements: String,
}

impl Sheet {
    /// Creates an empty sheet; each side is clamped to 200 to 4000 px.
    pub fn new(size_px: [u32; 2]) -> Self {
        Self {
            size_px: size_px.map(|side| side.clamp(200, 4000)),
            elements: String::new(),
        }
    }

    /// Returns width and height, px.
    pub fn size(&self) -> [f64; 2] {
        self.size_px.map(f64::from)
    }

    /// Draws a line through all spots.
    pub fn line(&mut self, path: &[Spot], stroke: Stroke) {
        let (points, colour) = (Points(path), stroke.colour.attribute("stroke"));
        let dashes = match stroke.dashes {
            "" => String::new(),
            dashes => format!(" stroke-dasharray=\"{dashes}\""),
        };
        let _ = writeln!(
            self.elements,
            "<polyline points=\"{points}\" fill=\"none\" {colour} stroke-width=\"{}\"{dashes}/>",
            stroke.width_units
        );
    }

    /// Draws a filled polygon.
    pub fn polygon(&mut self, rim: &[Spot], fill: Colour) {
        let (points, fill) = (Points(rim), fill.attribute("fill"));
        let _ = writeln!(self.elements, "<polygon points=\"{points}\" {fill}/>");
    }

    /// Draws a filled rectangle between two opposite corners.
    pub fn rectangle(&mut self, [a, b]: [Spot; 2], fill: Colour) {
        let (x, y) = (a.0.min(b.0), a.1.min(b.1));
        let (width, height) = (a.0.abs_diff(b.0), a.1.abs_diff(b.1));
        let fill = fill.attribute("fill");
        let _ = writeln!(
            self.elements,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" {fill}/>"
        );
    }

    /// Draws a filled circle of `radius_px`.
    pub fn circle(&mut self, (x, y): Spot, radius_px: f64, fill: Colour) {
        let (radius, fill) = (units(radius_px).max(0), fill.attribute("fill"));
        let _ = writeln!(
            self.elements,
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" {fill}/>"
        );
    }

    /// Writes one line of text. Its anchor, at half the height of its digits, lies at the spot.
    pub fn text(&mut self, text: &str, (x, y): Spot, lettering: Lettering) {
        let size = units(lettering.size_px);
        let baseline = y.saturating_add(units(MIDDLE * lettering.size_px));
        let anchor = match lettering.anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let weight = match lettering.is_bold {
            true => " font-weight=\"bold\"",
            false => "",
        };
        let turn = match lettering.is_upright {
            true => format!(" transform=\"rotate(-90 {x} {y})\""),
            false => String::new(),
        };
        let (fill, text) = (lettering.colour.attribute("fill"), escape(text));
        let _ = writeln!(
            self.elements,
            "<text x=\"{x}\" y=\"{baseline}\"{anchor} font-size=\"{size}\" \
             {fill}{weight}{turn}>{text}</text>"
        );
    }

    /// Groups the elements that `draw` adds.
    pub fn group(&mut self, draw: impl FnOnce(&mut Self)) {
        self.elements.push_str("<g>\n");
        draw(self);
        self.elements.push_str("</g>\n");
    }

    /// Returns the SVG document of the sheet, with more `attributes`. Its title serves readers who
    /// cannot see.
    pub fn document(self, title: &str, attributes: &str) -> String {
        let [width, height] = self.size_px;
        let [units_wide, units_high] = self.size().map(units);
        let (title, elements) = (escape(title), self.elements);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {units_wide} {units_high}\" font-family=\"sans-serif\" role=\"img\" \
             aria-label=\"{title}\"{attributes}><title>{title}</title>\n{elements}</svg>\n"
        )
    }
}

/// Value of the attribute `points`.
struct Points<'a>(&'a [Spot]);

impl fmt::Display for Points<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (x, y)) in self.0.iter().enumerate() {
            let gap = if i == 0 { "" } else { " " };
            write!(f, "{gap}{x},{y}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::markup::balance;
    use super::*;

    const BLUE: Colour = Colour::new(0x00_72_b2);

    fn drawn(draw: impl FnOnce(&mut Sheet)) -> String {
        let mut sheet = Sheet::new([300, 200]);
        draw(&mut sheet);
        let svg = sheet.document("t", "");
        assert_eq!(balance::fault(&svg), None, "{svg}");
        svg.lines().nth(1).unwrap_or_default().to_owned()
    }

    #[test]
    fn pixels_are_rounded_to_tenths() {
        assert_eq!([0.04, 0.05, -1.26].map(units), [0, 1, -13]);
        assert_eq!(
            [f64::NAN, f64::INFINITY, -1e300].map(units),
            [0, i32::MAX, i32::MIN]
        );
    }

    #[test]
    fn line_has_its_stroke() {
        let path = [(0, -5), (10, 20)];
        assert_eq!(
            drawn(|sheet| sheet.line(&path, Stroke::solid(BLUE, 1.5))),
            "<polyline points=\"0,-5 10,20\" fill=\"none\" stroke=\"#0072B2\" stroke-width=\"15\"/>"
        );
        let stroke = Stroke {
            dashes: "70 50",
            ..Stroke::solid(BLUE, 1.5)
        };
        let svg = drawn(|sheet| sheet.line(&path, stroke));
        assert!(svg.ends_with(" stroke-dasharray=\"70 50\"/>"), "{svg}");
    }

    #[test]
    fn rectangle_takes_corners_in_any_order() {
        let svg = drawn(|sheet| sheet.rectangle([(30, 5), (10, 25)], BLUE.faint(5)));
        assert_eq!(
            svg,
            "<rect x=\"10\" y=\"5\" width=\"20\" height=\"20\" fill=\"#0072B2\" opacity=\"0.05\"/>"
        );
    }

    #[test]
    fn upright_text_turns_about_its_spot() {
        let lettering = Lettering {
            is_bold: true,
            is_upright: true,
            ..Lettering::new(BLUE, 10.0, Anchor::Middle)
        };
        assert_eq!(
            drawn(|sheet| sheet.text("a<\u{7}>", (40, 50), lettering)),
            "<text x=\"40\" y=\"86\" text-anchor=\"middle\" font-size=\"100\" fill=\"#0072B2\" \
             font-weight=\"bold\" transform=\"rotate(-90 40 50)\">a&lt;\u{fffd}&gt;</text>"
        );
    }
}
