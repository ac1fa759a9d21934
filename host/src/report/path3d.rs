//! Paths and points in space without perspective, so that equal lengths along an axis look equal
//! everywhere. The drawing has one direction; a script of the page turns it.

use super::axis::{Axis, drawable};
use super::canvas::{AXIS, COLOURS, GRID, INK, SHADOW, SOFT_INK, TEXT, text_width, titled};
use super::chart::draw_legend;
use super::markup::escape;
use super::plot::{Series, entries, looks, points, say_no_data, unbroken};
use super::sheet::{Anchor, Lettering, Sheet, Spot, Stroke, UNIT, units};
use super::stroke::{self, Look, Style};
use serde_json::json;

/// Positions in space. The box is as high as half its width for all ranges: depth moves are often
/// much smaller than the others, and their scale is on the axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Path3d {
    /// Title of the figure.
    pub title: String,
    /// The three quantities and their units; the third is drawn upwards.
    pub labels: [String; 3],
    /// Series, drawn from back to front.
    pub series: Vec<Series<3>>,
    /// Width and height, px.
    pub size_px: [u32; 2],
}

/// Half the box's extent along each axis.
const HALF: [f64; 3] = [1.0, 1.0, 0.62];

/// Direction of the eye: 35 degrees right of the x axis seen from the front, 24 degrees above the
/// floor.
const AZIMUTH_DEG: f64 = -55.0;
const ELEVATION_DEG: f64 = 24.0;

impl Path3d {
    /// Creates a figure without series, 530 by 420 px.
    pub fn new(title: impl Into<String>, labels: [&str; 3]) -> Self {
        Self {
            title: title.into(),
            labels: labels.map(str::to_owned),
            series: Vec::new(),
            size_px: [530, 420],
        }
    }

    /// Adds a series.
    pub fn series(
        mut self,
        name: &str,
        style: Style,
        points: impl IntoIterator<Item = [f64; 3]>,
    ) -> Self {
        self.series.push(Series::new(name, style, points));
        self
    }

    /// Sets the size, px.
    pub fn sized(mut self, width: u32, height: u32) -> Self {
        self.size_px = [width, height];
        self
    }

    /// Returns the figure as one SVG document.
    pub fn to_svg(&self) -> String {
        self.document(false)
    }

    /// Returns the figure with the data by which the script of a page turns it.
    pub(super) fn to_turnable_svg(&self) -> String {
        self.document(true)
    }

    fn document(&self, is_turnable: bool) -> String {
        let mut sheet = titled(&self.title, self.size_px);
        let top = draw_legend(&mut sheet, &entries(&self.series));
        let view = View::new(self.axes(), &sheet, top);
        // The script replaces this group.
        sheet.group(|sheet| self.draw(sheet, &view, top));
        let attributes = match is_turnable {
            true => format!(
                " class=\"turn\" data-scene=\"{}\"",
                escape(&self.turning(&view))
            ),
            false => String::new(),
        };
        sheet.document(&self.title, &attributes)
    }

    fn draw(&self, sheet: &mut Sheet, view: &View, top: f64) {
        view.draw_walls(sheet);
        view.draw_labels(sheet, &self.labels);
        for series in &self.series {
            view.draw_shadow(sheet, series);
        }
        for (series, look) in self.series.iter().zip(looks(&self.series)) {
            let runs = unbroken(series.points.iter().map(|point| view.visible(*point)));
            let style = match look.style {
                Style::Steps => Style::Line,
                style => style,
            };
            stroke::draw(sheet, &runs, Look { style, ..look });
        }
        if points(&self.series).next().is_none() {
            say_no_data(sheet, top);
        }
    }

    /// Returns the scene as JSON: the view, the ticks of each axis, and every series in the box,
    /// whose coordinates run from -1 to 1.
    fn turning(&self, view: &View) -> String {
        let axis = |i: usize| {
            let ticks = view.ticks(i).zip(&view.axes[i].ticks);
            let ticks: Vec<_> = ticks
                .map(|(at, tick)| json!([rounded(at), view.axes[i].label(*tick)]))
                .collect();
            json!({"name": self.labels[i], "ticks": ticks})
        };
        let series = self.series.iter().zip(looks(&self.series));
        let series: Vec<_> = series
            .map(|(series, look)| {
                let every = series.points.len().div_ceil(MOST_TURNED).max(1);
                let seen = |point: &[f64; 3]| point.iter().all(|value| drawable(*value));
                // The gaps stay, because the line is broken there.
                let is_kept = |(i, point): &(usize, &[f64; 3])| {
                    i.is_multiple_of(every) || i + 1 == series.points.len() || !seen(point)
                };
                let points = series.points.iter().enumerate().filter(is_kept);
                let points =
                    points.map(|(_, point)| seen(point).then(|| view.unit(*point).map(rounded)));
                let (width, dashes) = look.pattern();
                json!({
                    "colour": look.index % COLOURS,
                    "width": width,
                    "dashes": dashes,
                    "line": look.style.has_line(),
                    "dots": look.style.has_markers(),
                    "points": points.collect::<Vec<_>>(),
                })
            })
            .collect();
        json!({
            "scale": view.scale,
            "centre": view.centre,
            "azimuth": AZIMUTH_DEG,
            "elevation": ELEVATION_DEG,
            "half": HALF,
            "text": TEXT * UNIT,
            "axes": [axis(0), axis(1), axis(2)],
            "series": series,
        })
        .to_string()
    }

    fn axes(&self) -> [Axis; 3] {
        [5, 5, 4]
            .into_iter()
            .enumerate()
            .map(|(i, count)| Axis::around(points(&self.series).map(move |point| point[i]), count))
            .collect::<Vec<_>>()
            .try_into()
            .unwrap_or_else(|_| [0, 1, 2].map(|_| Axis::spanning(0.0, 1.0, 4)))
    }
}

/// Points per series in a figure that is turned; the drawing itself has all.
const MOST_TURNED: usize = 1_500;

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Projection of the box onto the sheet.
struct View {
    axes: [Axis; 3],
    /// Units per half length of the box.
    scale: f64,
    /// Position of the box's centre, units.
    centre: [f64; 2],
}

impl View {
    fn new(axes: [Axis; 3], sheet: &Sheet, top: f64) -> Self {
        let [width, height] = sheet.size().map(|side| side * UNIT);
        // Room for labels around the box, px.
        let (side, above, below) = (74.0 * UNIT, (top + 8.0) * UNIT, 58.0 * UNIT);
        let corners = (0..8)
            .map(|i| flat([0, 1, 2].map(|j| if i >> j & 1 == 1 { HALF[j] } else { -HALF[j] })));
        let reach = corners.fold([0.0_f64; 2], |reach, at| {
            [reach[0].max(at[0]), reach[1].max(at[1])]
        });
        let scale = ((width - 2.0 * side) / (2.0 * reach[0]))
            .min((height - above - below) / (2.0 * reach[1]));
        Self {
            axes,
            scale: scale.max(1.0),
            centre: [0.5 * width, above + 0.5 * (height - above - below)],
        }
    }

    /// Returns the spot of a point of the box; each coordinate runs from -1 to 1 between the walls.
    fn spot(&self, unit: [f64; 3]) -> Spot {
        let [x, y] = flat([0, 1, 2].map(|i| unit[i] * HALF[i]));
        (
            (self.centre[0] + self.scale * x).round() as i32,
            (self.centre[1] - self.scale * y).round() as i32,
        )
    }

    fn unit(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| 2.0 * self.axes[i].fraction(point[i]) - 1.0)
    }

    fn visible(&self, point: [f64; 3]) -> Option<Spot> {
        let seen = point.iter().all(|value| drawable(*value));
        seen.then(|| self.spot(self.unit(point)))
    }

    fn line(&self, sheet: &mut Sheet, ends: [[f64; 3]; 2], stroke: Stroke) {
        sheet.line(&ends.map(|end| self.spot(end)), stroke);
    }

    /// Draws the floor and the two walls behind, with grid lines at the labels.
    fn draw_walls(&self, sheet: &mut Sheet) {
        let grid = Stroke::solid(GRID, 1.0);
        for tick in self.ticks(0) {
            self.line(sheet, [[tick, -1.0, -1.0], [tick, 1.0, -1.0]], grid);
            self.line(sheet, [[tick, 1.0, -1.0], [tick, 1.0, 1.0]], grid);
        }
        for tick in self.ticks(1) {
            self.line(sheet, [[-1.0, tick, -1.0], [1.0, tick, -1.0]], grid);
            self.line(sheet, [[-1.0, tick, -1.0], [-1.0, tick, 1.0]], grid);
        }
        for tick in self.ticks(2) {
            self.line(sheet, [[-1.0, -1.0, tick], [-1.0, 1.0, tick]], grid);
            self.line(sheet, [[-1.0, 1.0, tick], [1.0, 1.0, tick]], grid);
        }
        let soft = Stroke::solid(SHADOW, 1.0);
        let axis = Stroke::solid(AXIS, 1.2);
        for (ends, style) in [
            ([[-1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]], soft),
            ([[-1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]], soft),
            ([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0]], soft),
            ([[1.0, 1.0, -1.0], [1.0, 1.0, 1.0]], soft),
            ([[-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]], soft),
            ([[-1.0, 1.0, -1.0], [1.0, 1.0, -1.0]], soft),
            ([[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0]], axis),
            ([[1.0, -1.0, -1.0], [1.0, 1.0, -1.0]], axis),
            ([[-1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]], axis),
        ] {
            self.line(sheet, ends, style);
        }
    }

    /// Returns the labelled positions of axis `i`, from -1 to 1.
    fn ticks(&self, i: usize) -> impl Iterator<Item = f64> + '_ {
        let axis = &self.axes[i];
        axis.ticks
            .iter()
            .map(|tick| (2.0 * axis.fraction(*tick) - 1.0).clamp(-1.0, 1.0))
    }

    fn draw_labels(&self, sheet: &mut Sheet, names: &[String; 3]) {
        // Each axis: its edge as a function of the position along it, where labels go from there,
        // how they are held.
        let edges: [fn(f64) -> [f64; 3]; 3] =
            [|t| [t, -1.0, -1.0], |t| [1.0, t, -1.0], |t| [-1.0, -1.0, t]];
        let away = [[-6.0, 14.0], [9.0, 12.0], [-9.0, 0.0]];
        let sides = [Anchor::End, Anchor::Start, Anchor::End];
        for i in 0..3 {
            let lettering = Lettering::new(SOFT_INK, TEXT, sides[i]);
            for (at, tick) in self.ticks(i).zip(&self.axes[i].ticks) {
                let edge = self.spot(edges[i](at));
                let spot = (edge.0 + units(away[i][0]), edge.1 + units(away[i][1]));
                sheet.text(&self.axes[i].label(*tick), spot, lettering);
            }
        }
        let label = |i: usize| self.axes[i].label_length() as f64 * 0.62 * TEXT;
        let ink = |anchor| Lettering::new(INK, TEXT, anchor);
        let middle = self.spot(edges[0](0.0));
        let at = (middle.0 - units(18.0 + label(0)), middle.1 + units(34.0));
        sheet.text(&names[0], at, ink(Anchor::Middle));
        let middle = self.spot(edges[1](0.0));
        // Keep the label within the right edge.
        let last = units(sheet.size()[0] - text_width(&names[1], TEXT) - 6.0);
        let x = middle.0 + units(16.0 + 0.8 * label(1));
        let at = (x.min(last), middle.1 + units(34.0));
        sheet.text(&names[1], at, ink(Anchor::Start));
        let end = self.spot(edges[2](1.0));
        let at = (end.0.max(units(8.0)), end.1 - units(14.0));
        sheet.text(&names[2], at, ink(Anchor::Middle));
    }

    /// Draws the series on the floor in grey, which distinguishes depth from height.
    fn draw_shadow(&self, sheet: &mut Sheet, series: &Series<3>) {
        let floor = |point: &[f64; 3]| {
            let seen = point.iter().all(|value| drawable(*value));
            let [x, y, _] = self.unit(*point);
            seen.then(|| self.spot([x, y, -1.0]))
        };
        for run in unbroken(series.points.iter().map(floor)) {
            if series.style == Style::Points || run.len() == 1 {
                for spot in run {
                    sheet.circle(spot, 1.6, SHADOW);
                }
            } else {
                sheet.line(&stroke::thinned(&run), Stroke::solid(SHADOW, 1.2));
            }
        }
    }
}

/// Projects a point along the line of sight: right and up.
fn flat([x, y, z]: [f64; 3]) -> [f64; 2] {
    let (sin_a, cos_a) = AZIMUTH_DEG.to_radians().sin_cos();
    let (sin_e, cos_e) = ELEVATION_DEG.to_radians().sin_cos();
    [
        cos_a * y - sin_a * x,
        cos_e * z - sin_e * (cos_a * x + sin_a * y),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::markup::balance;
    use super::*;

    const LABELS: [&str; 3] = ["X, mm", "Y, mm", "Z, mm"];

    #[test]
    fn x_and_y_run_right_and_z_up() {
        let origin = flat([0.0; 3]);
        assert!(flat([1.0, 0.0, 0.0])[0] > origin[0] && flat([0.0, 1.0, 0.0])[0] > origin[0]);
        assert_eq!(flat([0.0, 0.0, 1.0])[0], origin[0]);
        assert!(flat([0.0, 0.0, 1.0])[1] > origin[1]);
        // The near corner of the floor is the lowest.
        assert!(
            flat([1.0, -1.0, 0.0])[1] < flat([-1.0, -1.0, 0.0])[1].min(flat([1.0, 1.0, 0.0])[1])
        );
    }

    #[test]
    fn any_data_make_a_document() {
        let path = |n: i32| {
            (0..n)
                .map(|i| [f64::from(i), f64::from(i * i), -f64::from(i)])
                .collect::<Vec<_>>()
        };
        for style in [
            Style::Line,
            Style::Dashed,
            Style::Marked,
            Style::Points,
            Style::Steps,
        ] {
            for points in [
                vec![],
                vec![[f64::NAN; 3]],
                vec![[1.0, 2.0, 3.0]],
                path(20),
                vec![[5.0; 3]; 4],
            ] {
                let none = points.iter().all(|point| !point[0].is_finite());
                let svg = Path3d::new("a & b", LABELS)
                    .series("<path>", style, points)
                    .to_svg();
                assert_eq!(balance::fault(&svg), None, "{svg}");
                assert!(!svg.contains("NaN"));
                assert_eq!(svg.contains("no data"), none);
            }
        }
    }

    #[test]
    fn path_stays_on_sheet() {
        let points = [
            [0.0, 0.0, 0.0],
            [20.0, 20.0, 5.0],
            [0.0, 20.0, 0.0],
            [20.0, 0.0, 5.0],
        ];
        let svg = Path3d::new("t", LABELS)
            .series("", Style::Points, points)
            .to_svg();
        let numbers = |name: &str| -> Vec<f64> {
            let attribute = format!(" {name}=\"");
            let parts = svg.split(&attribute).skip(1);
            parts
                .map(|part| part.split('"').next().unwrap().parse().unwrap())
                .collect()
        };
        let (xs, ys) = (numbers("cx"), numbers("cy"));
        assert_eq!(xs.len(), 8, "four points and their shadows");
        assert!(xs.iter().all(|x| (0.0..5300.0).contains(x)), "{xs:?}");
        assert!(ys.iter().all(|y| (0.0..4200.0).contains(y)), "{ys:?}");
    }
}
