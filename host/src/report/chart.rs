//! Title, legend, axes and grid of a plane figure; and the legend of any figure.

use super::axis::Axis;
use super::band;
use super::canvas::{
    AXIS, DrawingError, GRID, INK, SOFT_INK, Sheet, Spot, TEXT, TITLE_LINE, UNIT, lettering, pen,
    text_width, units, write_text,
};
use super::mark::{self, MarkKind};
use super::stroke::{self, Look, SAMPLE};
use plotters::coord::CoordTranslate as _;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

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
pub(super) fn draw_legend(sheet: &Sheet, entries: &[Entry]) -> Result<f64, DrawingError> {
    let width = f64::from(sheet.dim_in_pixel().0) / UNIT;
    let named: Vec<&Entry> = entries
        .iter()
        .filter(|entry| !entry.name.is_empty())
        .collect();
    let (mut x, mut y) = (8.0, TITLE_LINE + 0.5 * LEGEND_LINE);
    let style = lettering(TEXT, INK, HPos::Left, VPos::Center);
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
            Sample::Series(look) => stroke::sample(sheet, at, look)?,
            Sample::Band(index) => band::sample(sheet, at, index)?,
            Sample::Mark(kind) => mark::sample(sheet, at, kind)?,
        }
        let at = (units(x + sample + 6.0), units(y));
        write_text(sheet, entry.name, at, &style)?;
        x += wide;
    }
    Ok(if named.is_empty() {
        TITLE_LINE
    } else {
        y + 0.5 * LEGEND_LINE
    })
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

/// Draws grid, axes and labels below `top` px, and returns the place of the data on the sheet.
pub(super) fn draw_axes(sheet: &Sheet, axes: &Axes, top: f64) -> Result<Place, DrawingError> {
    let (width, height) = sheet.dim_in_pixel();
    let (width, height) = (f64::from(width) / UNIT, f64::from(height) / UNIT);
    let margin_right = 22.0;
    let below = 2.0 * TEXT + 18.0;
    // An equal scale changes the labels of y, hence its width; a second pass converges.
    let (mut x, mut y) = (axes.x.clone(), axes.y.clone());
    let mut left = label_area(&y);
    if axes.equal {
        for _ in 0..2 {
            let area = [width - left - margin_right, height - top - 8.0 - below];
            (x, y) = equalised(&axes.x, &axes.y, area);
            left = label_area(&y);
        }
    }
    let (_, area) = sheet.split_vertically(units(top));
    let y_ends = if axes.y_down {
        (y.high, y.low)
    } else {
        (y.low, y.high)
    };
    let mut chart = ChartBuilder::on(&area)
        .margin_top(units(8.0))
        .margin_right(units(margin_right))
        .set_label_area_size(LabelAreaPosition::Left, units(left))
        .set_label_area_size(LabelAreaPosition::Bottom, units(below))
        .build_cartesian_2d(
            Scale {
                ends: (x.low, x.high),
                ticks: x.ticks.clone(),
            },
            Scale {
                ends: y_ends,
                ticks: y.ticks.clone(),
            },
        )?;
    chart
        .configure_mesh()
        .bold_line_style(pen(GRID, 1.0))
        .light_line_style(TRANSPARENT)
        .axis_style(pen(AXIS, 1.2))
        .set_all_tick_mark_size(units(4.0))
        .label_style(lettering(TEXT, SOFT_INK, HPos::Center, VPos::Center))
        .axis_desc_style(lettering(TEXT, INK, HPos::Center, VPos::Center))
        .x_label_formatter(&|tick| x.label(*tick))
        .y_label_formatter(&|tick| y.label(*tick))
        .x_desc(axes.x_label)
        .y_desc(axes.y_label)
        .draw()?;
    Ok(Place(chart.as_coord_spec().clone()))
}

/// Axis for `plotters` with exactly the labels of [`Axis`].
#[derive(Clone)]
struct Scale {
    /// Values at the axis's two ends; the first may be the larger.
    ends: (f64, f64),
    ticks: Vec<f64>,
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let fraction = (value - self.ends.0) / (self.ends.1 - self.ends.0);
        (f64::from(from) + fraction * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() {
            Vec::new()
        } else {
            self.ticks.clone()
        }
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.ends.0..self.ends.1
    }
}

/// Mapping from data to positions on the sheet.
pub(super) struct Place(Cartesian2d<Scale, Scale>);

impl Place {
    /// Returns the spot of a drawable point, units.
    pub fn spot(&self, point: [f64; 2]) -> Spot {
        self.0.translate(&(point[0], point[1]))
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
