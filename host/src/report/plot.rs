//! Plots of values over an axis, and the series of any figure.

use super::axis::{Axis, drawable};
use super::band::{self, Band};
use super::canvas::{SOFT_INK, TEXT, titled};
use super::chart::{Axes, Entry, Place, Sample, draw_axes, draw_legend, ticks_for};
use super::mark::{self, Mark, MarkKind};
use super::sheet::{Anchor, Lettering, Sheet, Spot, units};
use super::stroke::{self, Look, Style};

/// Named points of a figure with `N` axes, in the axes' units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series<const N: usize> {
    /// Name in the legend; an unnamed series is not in the legend.
    pub name: String,
    /// Values of each point, in drawing order. A point that is not a number breaks the line.
    pub points: Vec<[f64; N]>,
    /// Style of the connection between points. In space, steps are drawn as a line, because there
    /// is no held axis.
    pub style: Style,
}

impl<const N: usize> Series<N> {
    pub(super) fn new(
        name: &str,
        style: Style,
        points: impl IntoIterator<Item = [f64; N]>,
    ) -> Self {
        Self {
            name: name.to_owned(),
            points: points.into_iter().collect(),
            style,
        }
    }
}

/// Values over an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct LinePlot {
    /// Title of the plot.
    pub title: String,
    /// Horizontal quantity and its unit.
    pub x_label: String,
    /// Vertical quantity and its unit.
    pub y_label: String,
    /// Series, drawn from back to front.
    pub series: Vec<Series<2>>,
    /// Bands, drawn behind the series.
    pub bands: Vec<Band>,
    /// Events, drawn behind the bands. They do not extend the horizontal axis.
    pub marks: Vec<Mark>,
    /// Values that the vertical axis always includes (a bound, zero).
    pub y_include: Vec<f64>,
    /// Width and height, px.
    pub size_px: [u32; 2],
}

impl LinePlot {
    /// Creates a plot without series, 760 by 340 px.
    pub fn new(
        title: impl Into<String>,
        x_label: impl Into<String>,
        y_label: impl Into<String>,
    ) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            series: Vec::new(),
            bands: Vec::new(),
            marks: Vec::new(),
            y_include: Vec::new(),
            size_px: [760, 340],
        }
    }

    /// Adds a series.
    pub fn series(
        mut self,
        name: &str,
        style: Style,
        points: impl IntoIterator<Item = [f64; 2]>,
    ) -> Self {
        self.series.push(Series::new(name, style, points));
        self
    }

    /// Adds a band in the colour of the next series: position, lower and upper end.
    pub fn band(mut self, name: &str, points: impl IntoIterator<Item = [f64; 3]>) -> Self {
        self.bands.push(Band {
            name: name.to_owned(),
            points: points.into_iter().collect(),
            index: self.series.len(),
        });
        self
    }

    /// Adds marks of events.
    pub fn marked(mut self, marks: &[Mark]) -> Self {
        self.marks.extend_from_slice(marks);
        self
    }

    /// Extends the vertical axis to `value`.
    pub fn including(mut self, value: f64) -> Self {
        self.y_include.push(value);
        self
    }

    /// Sets the size, px.
    pub fn sized(mut self, width: u32, height: u32) -> Self {
        self.size_px = [width, height];
        self
    }

    /// Returns the plot as one SVG document.
    pub fn to_svg(&self) -> String {
        let mut sheet = titled(&self.title, self.size_px);
        let [width, height] = sheet.size();
        let drawn = || self.bands.iter().flat_map(Band::drawable);
        let x = points(&self.series).map(|point| point[0]);
        let x = x.chain(drawn().map(|point| point[0]));
        let x = Axis::around(x, ticks_for(width - 80.0));
        let ends = [x.low, x.high];
        let top = draw_legend(&mut sheet, &self.legend(ends));
        let y = points(&self.series).map(|point| point[1]);
        let y = y.chain(drawn().flat_map(|[_, low, high]| [low, high]));
        let y = Axis::around(
            y.chain(self.y_include.iter().copied()),
            ticks_for(1.4 * (height - top - 60.0)),
        );
        let y_ends = [y.low, y.high];
        let axes = Axes {
            x_label: &self.x_label,
            y_label: &self.y_label,
            x,
            y,
            equal: false,
            y_down: false,
        };
        let place = draw_axes(&mut sheet, &axes, top);
        mark::draw(&mut sheet, &self.marks, &place, ends, y_ends);
        for band in &self.bands {
            band::draw(&mut sheet, band, &place);
        }
        draw_series(&mut sheet, &self.series, &place, top);
        sheet.document(&self.title, "")
    }

    /// Returns the legend: series, bands, and the kinds of marks between the ends of the axis.
    fn legend(&self, ends: [f64; 2]) -> Vec<Entry<'_>> {
        let mut legend = entries(&self.series);
        legend.extend(self.bands.iter().map(|band| Entry {
            name: &band.name,
            sample: Sample::Band(band.index),
        }));
        let shown = |kind: &MarkKind| {
            let mut marks = self.marks.iter();
            marks.any(|mark| mark.kind == *kind && mark::is_within(mark, ends))
        };
        let kinds = MarkKind::ALL.into_iter().filter(shown);
        legend.extend(kinds.map(|kind| Entry {
            name: kind.name(),
            sample: Sample::Mark(kind),
        }));
        legend
    }
}

pub(super) fn looks<const N: usize>(series: &[Series<N>]) -> Vec<Look> {
    Look::all(series.iter().map(|series| series.style))
}

pub(super) fn entries<const N: usize>(series: &[Series<N>]) -> Vec<Entry<'_>> {
    let all = series.iter().zip(looks(series));
    all.map(|(series, look)| Entry {
        name: &series.name,
        sample: Sample::Series(look),
    })
    .collect()
}

/// Returns all drawable points.
pub(super) fn points<const N: usize>(series: &[Series<N>]) -> impl Iterator<Item = [f64; N]> + '_ {
    let all = series
        .iter()
        .flat_map(|series| series.points.iter().copied());
    all.filter(|point| point.iter().all(|value| drawable(*value)))
}

pub(super) fn draw_series(sheet: &mut Sheet, series: &[Series<2>], place: &Place, top: f64) {
    for (series, look) in series.iter().zip(looks(series)) {
        let spots = series.points.iter().map(|point| {
            let seen = point.iter().all(|value| drawable(*value));
            seen.then(|| place.spot(*point))
        });
        stroke::draw(sheet, &unbroken(spots), look);
    }
    if points(series).next().is_none() {
        say_no_data(sheet, top);
    }
}

/// Splits the points at their gaps.
pub(super) fn unbroken(spots: impl Iterator<Item = Option<Spot>>) -> Vec<Vec<Spot>> {
    let mut runs = vec![Vec::new()];
    for spot in spots {
        match (spot, runs.last_mut()) {
            (Some(spot), Some(run)) => run.push(spot),
            _ => runs.push(Vec::new()),
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}

/// Writes "no data" in the middle of an empty figure.
pub(super) fn say_no_data(sheet: &mut Sheet, top: f64) {
    let [width, height] = sheet.size();
    let middle = (units(0.5 * width), units(0.5 * (top + height)));
    let lettering = Lettering::new(SOFT_INK, TEXT + 1.0, Anchor::Middle);
    sheet.text("no data", middle, lettering);
}

#[cfg(test)]
mod tests {
    use super::super::markup::balance;
    use super::*;

    fn checked(svg: String) -> String {
        assert_eq!(balance::fault(&svg), None, "{svg}");
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        svg
    }

    #[test]
    fn mark_within_the_axis_is_drawn_once() {
        let marks = [
            Mark::at(MarkKind::Fault, 1.5, "fault 3"),
            Mark::at(MarkKind::Fault, 1.5, "the same column"),
            Mark::at(MarkKind::Limit, 900.0, "beyond the axis"),
        ];
        let plot = LinePlot::new("marked", "t, s", "x, mm");
        let plot = plot.series("", Style::Line, [[0.0, 1.0], [3.0, 2.0]]);
        let plain = checked(plot.clone().to_svg());
        let marked = checked(plot.clone().marked(&marks).to_svg());
        let one = checked(plot.marked(&marks[..1]).to_svg());
        let lines = |svg: &str| svg.matches("<polyline").count() + svg.matches("<path").count();
        assert!(lines(&one) > lines(&plain), "{one}");
        assert_eq!(marked, one);
    }

    #[test]
    fn gap_breaks_line() {
        let points = [
            [0.0, 1.0],
            [1.0, 2.0],
            [2.0, f64::NAN],
            [3.0, 1.0],
            [4.0, 1.0],
            [f64::INFINITY, 0.0],
        ];
        let plot = LinePlot::new("gap", "t, s", "x, mm").series("", Style::Line, points);
        let svg = checked(plot.to_svg());
        // The grid and the axes are polylines too; the series' colour distinguishes it.
        assert_eq!(svg.matches("stroke=\"#0072B2\"").count(), 2, "{svg}");
    }

    #[test]
    fn undrawable_data_are_reported() {
        for style in [
            Style::Line,
            Style::Dashed,
            Style::Marked,
            Style::Points,
            Style::Steps,
        ] {
            for points in [vec![], vec![[f64::NAN, 1.0]], vec![[1e300, -1e300]; 3]] {
                let plot = LinePlot::new("t", "x", "y").series("a", style, points.clone());
                assert!(checked(plot.to_svg()).contains("no data"));
                let plot = super::super::Scatter::new("t", "x", "y")
                    .series("a", style, points)
                    .circle([0.0; 2], f64::NAN, "c");
                assert!(checked(plot.to_svg()).contains("no data"));
            }
        }
    }

    #[test]
    fn single_point_is_visible() {
        for style in [
            Style::Line,
            Style::Dashed,
            Style::Marked,
            Style::Points,
            Style::Steps,
        ] {
            let svg = checked(
                LinePlot::new("t", "x", "y")
                    .series("", style, [[3.0, 4.0]])
                    .to_svg(),
            );
            assert_eq!(svg.matches("<circle").count(), 1, "{style:?}");
        }
    }

    #[test]
    fn names_are_escaped() {
        let plot = LinePlot::new("a<b & \"c\"", "x<", "y&").series(
            "<s>&\u{1}",
            Style::Points,
            [[0.0, 0.0]],
        );
        let svg = checked(plot.to_svg());
        assert!(
            svg.contains("a&lt;b &amp; &quot;c&quot;") && svg.contains("&lt;s&gt;&amp;"),
            "{svg}"
        );
    }

    #[test]
    fn long_recording_stays_small() {
        let noise =
            (0..200_000_u32).map(|i| [f64::from(i), f64::from(i.wrapping_mul(2_654_435_761) >> 8)]);
        for style in [Style::Line, Style::Steps, Style::Dashed] {
            let plot = LinePlot::new("t", "x", "y").series("", style, noise.clone());
            let svg = checked(plot.to_svg());
            assert!(svg.len() < 100_000, "{style:?}: {} bytes", svg.len());
        }
    }
}
