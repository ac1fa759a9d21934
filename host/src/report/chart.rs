//! Title, legend, axes and grid of a plane figure; and the legend of any figure.

use super::axis::Axis;
use super::band;
use super::canvas::{AXIS, GRID, INK, SOFT_INK, TEXT, TITLE_LINE, text_width};
use super::mark::{self, MarkKind};
use super::sheet::{Anchor, Lettering, Sheet, Spot, Stroke, units};
use super::stroke::{self, Look, SAMPLE};

/// Height of a legend's line, px.
const LEGEND_LINE: f64 = 20.0;

/// Sample of a legend entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Sample {
    /// A series.
    Series(Look),
    /// A band around the series of this number.
    Band(usize),
    /// Marks of a kind.
    Mark(MarkKind),
}

/// Legend entry.
pub(super) struct Entry<'a> {
    pub name: &'a str,
    pub sample: Sample,
}

/// Draws the legend under the title and returns the height of both, px. Series without a name are
/// left out. A single named series is shown, because its name says what is drawn.
pub(super) fn draw_legend(sheet: &mut Sheet, entries: &[Entry]) -> f64 {
    let [width, _] = sheet.size();
    let named: Vec<&Entry> = entries
        .iter()
        .filter(|entry| !entry.name.is_empty())
        .collect();
    let (mut x, mut y) = (8.0, TITLE_LINE + 0.5 * LEGEND_LINE);
    let lettering = Lettering::new(INK, TEXT, Anchor::Start);
    for entry in &named {
        let sample = match entry.sample {
            Sample::Mark(_) => 16.0,
            _ => SAMPLE,
        };
        let wide = sample + 6.0 + text_width(entry.name, TEXT) + 18.0;
        if x > 8.0 && x + wide > width {
            (x, y) = (8.0, y + LEGEND_LINE);
        }
        let at = (units(x), units(y));
        match entry.sample {
            Sample::Series(look) => stroke::sample(sheet, at, look),
            Sample::Band(index) => band::sample(sheet, at, index),
            Sample::Mark(kind) => mark::sample(sheet, at, kind),
        }
        let at = (units(x + sample + 6.0), units(y));
        sheet.text(entry.name, at, lettering);
        x += wide;
    }
    if named.is_empty() {
        TITLE_LINE
    } else {
        y + 0.5 * LEGEND_LINE
    }
}

/// Axes of a plane figure, before their size in pixels is known.
pub(super) struct Axes<'a> {
    pub x_label: &'a str,
    pub y_label: &'a str,
    pub x: Axis,
    pub y: Axis,
    /// True if both axes have the same scale; the shorter one is widened.
    pub equal: bool,
    /// True if y grows downwards, as in images.
    pub y_down: bool,
}

/// Space above and right of the grid, px.
const MARGIN: [f64; 2] = [8.0, 22.0];
/// Height of the labels and the name of a horizontal axis, px.
const BELOW: f64 = 2.0 * TEXT + 18.0;
/// Length of a tick mark, and its distance from a label, px.
const TICK: f64 = 4.0;
/// Distance of the middle of an axis's name from the edge of the sheet, px.
const NAME: f64 = 8.0;

/// Draws grid, axes and labels below `top` px, and returns the place of the data on the sheet.
pub(super) fn draw_axes(sheet: &mut Sheet, axes: &Axes, top: f64) -> Place {
    let [width, height] = sheet.size();
    let (top, right, bottom) = (top + MARGIN[0], width - MARGIN[1], height - BELOW);
    // An equal scale changes the labels of y, hence its width; a second pass converges.
    let (mut x, mut y) = (axes.x.clone(), axes.y.clone());
    let mut left = label_area(&y);
    if axes.equal {
        for _ in 0..2 {
            (x, y) = equalised(&axes.x, &axes.y, [right - left, bottom - top]);
            left = label_area(&y);
        }
    }
    let ends = match axes.y_down {
        true => [top, bottom],
        false => [bottom, top],
    };
    let place = Place {
        x: Scale::new(&x, [left, right]),
        y: Scale::new(&y, ends),
    };
    let [top, right, bottom, left] = [top, right, bottom, left].map(units);
    let (grid, axis) = (Stroke::solid(GRID, 1.0), Stroke::solid(AXIS, 1.2));
    let label = |anchor| Lettering::new(SOFT_INK, TEXT, anchor);
    for tick in &x.ticks {
        let at = place.x.at(*tick);
        sheet.line(&[(at, bottom), (at, top)], grid);
        sheet.line(&[(at, bottom), (at, bottom + units(TICK))], axis);
        let spot = (at, bottom + units(2.0 * TICK + 0.4 * TEXT));
        sheet.text(&x.label(*tick), spot, label(Anchor::Middle));
    }
    for tick in &y.ticks {
        let at = place.y.at(*tick);
        sheet.line(&[(left, at), (right, at)], grid);
        sheet.line(&[(left - units(TICK), at), (left, at)], axis);
        let spot = (left - units(2.0 * TICK), at);
        sheet.text(&y.label(*tick), spot, label(Anchor::End));
    }
    sheet.line(&[(left, top), (left, bottom), (right, bottom)], axis);
    let name = Lettering::new(INK, TEXT, Anchor::Middle);
    let spot = ((left + right) / 2, units(height - NAME));
    sheet.text(axes.x_label, spot, name);
    let upright = Lettering {
        is_upright: true,
        ..name
    };
    sheet.text(axes.y_label, (units(NAME), (top + bottom) / 2), upright);
    place
}

/// Linear mapping from the values of an axis to positions.
struct Scale {
    low: f64,
    /// Position of `low`, px.
    start: f64,
    /// Pixels per value, negative for an axis that runs upwards.
    slope: f64,
}

impl Scale {
    /// Creates a scale on which the axis runs between two positions in px.
    fn new(axis: &Axis, [from, to]: [f64; 2]) -> Self {
        Self {
            low: axis.low,
            start: from,
            slope: (to - from) / (axis.high - axis.low),
        }
    }

    fn at(&self, value: f64) -> i32 {
        units(self.start + self.slope * (value - self.low))
    }
}

/// Mapping from data to positions on the sheet.
pub(super) struct Place {
    x: Scale,
    y: Scale,
}

impl Place {
    /// Returns the spot of a drawable point.
    pub fn spot(&self, [x, y]: [f64; 2]) -> Spot {
        (self.x.at(x), self.y.at(y))
    }
}

/// Returns the width of the labels and the name of a vertical axis, px.
fn label_area(y: &Axis) -> f64 {
    y.label_length() as f64 * 0.65 * TEXT + TEXT + 26.0
}

/// Returns both axes at one scale for an area of `area_px` px.
pub(super) fn equalised(x: &Axis, y: &Axis, area_px: [f64; 2]) -> (Axis, Axis) {
    let [wide, high] = area_px.map(|side| side.max(1.0));
    let scale = ((x.high - x.low) / wide).max((y.high - y.low) / high);
    let widened = |axis: &Axis, pixels: f64| {
        let middle = 0.5 * (axis.low + axis.high);
        let half = 0.5 * scale * pixels;
        Axis::spanning(middle - half, middle + half, ticks_for(pixels))
    };
    (widened(x, wide), widened(y, high))
}

/// Returns the number of labels that fit on `pixels` px.
pub(super) fn ticks_for(pixels: f64) -> usize {
    (pixels / 52.0).floor().clamp(3.0, 12.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes(y_down: bool) -> Axes<'static> {
        Axes {
            x_label: "x, mm",
            y_label: "y, mm",
            x: Axis::spanning(0.0, 10.0, 4),
            y: Axis::spanning(-1.0, 1.0, 4),
            equal: false,
            y_down,
        }
    }

    #[test]
    fn axes_run_right_and_up_or_down() {
        for y_down in [false, true] {
            let place = draw_axes(&mut Sheet::new([400, 300]), &axes(y_down), 30.0);
            let [low, high] = [[0.0, -1.0], [10.0, 1.0]].map(|point| place.spot(point));
            assert!(low.0 < high.0);
            assert_eq!(high.0, 3780, "right margin");
            let [top, bottom] = if y_down { [low, high] } else { [high, low] };
            assert_eq!([top.1, bottom.1], [380, 2560]);
        }
    }

    #[test]
    fn ticks_have_grid_mark_and_label() {
        let mut sheet = Sheet::new([400, 300]);
        let axes = axes(false);
        let place = draw_axes(&mut sheet, &axes, 30.0);
        let svg = sheet.document("t", "");
        let has_line = |[a, b]: [Spot; 2]| {
            let points = format!("points=\"{},{} {},{}\"", a.0, a.1, b.0, b.1);
            assert!(svg.contains(&points), "{points} in {svg}");
        };
        assert_eq!((axes.x.ticks.len(), axes.y.ticks.len()), (3, 5));
        for tick in &axes.x.ticks {
            let (x, bottom) = place.spot([*tick, -1.0]);
            has_line([(x, bottom), (x, 380)]);
            has_line([(x, bottom), (x, bottom + 40)]);
        }
        for tick in &axes.y.ticks {
            let (left, y) = place.spot([0.0, *tick]);
            has_line([(left, y), (3780, y)]);
            has_line([(left - 40, y), (left, y)]);
        }
        for label in [
            "0",
            "5",
            "10",
            "\u{2212}1.0",
            "\u{2212}0.5",
            "0.0",
            "0.5",
            "1.0",
        ] {
            assert!(svg.contains(&format!(">{label}</text>")), "{label}");
        }
        for name in [axes.x_label, axes.y_label] {
            assert!(svg.contains(&format!(">{name}</text>")), "{name}");
        }
    }
}
