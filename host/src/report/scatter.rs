//! Plots of positions in a plane.

use super::axis::{Axis, drawable};
use super::canvas::{AXIS, SOFT_INK, TEXT, titled};
use super::chart::{Axes, Place, draw_axes, draw_legend};
use super::plot::{Series, draw_series, entries, points};
use super::sheet::{Anchor, Lettering, Sheet, Spot, Stroke, units};
use super::stroke::Style;

/// A circle of a [`Scatter`]: a scale, a bound, a target.
#[derive(Clone, Debug, PartialEq)]
pub struct Circle {
    /// Centre, in the axes' units.
    pub centre: [f64; 2],
    /// Radius, in the axes' units.
    pub radius: f64,
    /// Name, written at the circle.
    pub name: String,
}

/// Positions in a plane, both axes at the same scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Scatter {
    /// Title of the figure.
    pub title: String,
    /// Horizontal quantity and its unit.
    pub x_label: String,
    /// Vertical quantity and its unit.
    pub y_label: String,
    /// Series, drawn from back to front.
    pub series: Vec<Series<2>>,
    /// Circles, drawn behind the series.
    pub circles: Vec<Circle>,
    /// Points that the axes always include (the corners of an image).
    pub include: Vec<[f64; 2]>,
    /// True if the vertical axis grows downwards, as in images and in the rig's frame.
    pub y_down: bool,
    /// Width and height, px.
    pub size_px: [u32; 2],
}

impl Scatter {
    /// Creates a figure without points, 420 by 420 px, y upwards.
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
            circles: Vec::new(),
            include: Vec::new(),
            y_down: false,
            size_px: [420, 420],
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

    /// Adds a circle.
    pub fn circle(mut self, centre: [f64; 2], radius: f64, name: &str) -> Self {
        self.circles.push(Circle {
            centre,
            radius,
            name: name.to_owned(),
        });
        self
    }

    /// Extends the axes to `point`.
    pub fn including(mut self, point: [f64; 2]) -> Self {
        self.include.push(point);
        self
    }

    /// Turns the vertical axis downwards.
    pub fn y_down(mut self) -> Self {
        self.y_down = true;
        self
    }

    /// Sets the size, px.
    pub fn sized(mut self, width: u32, height: u32) -> Self {
        self.size_px = [width, height];
        self
    }

    /// Returns the figure as one SVG document.
    pub fn to_svg(&self) -> String {
        let mut sheet = titled(&self.title, self.size_px);
        let top = draw_legend(&mut sheet, &entries(&self.series));
        let values = |i: usize| {
            let circles = self.circles.iter().filter(|circle| whole(circle));
            let ends = circles.flat_map(move |circle| {
                [
                    circle.centre[i] - circle.radius,
                    circle.centre[i] + circle.radius,
                ]
            });
            points(&self.series)
                .map(move |point| point[i])
                .chain(ends)
                .chain(self.include.iter().map(move |point| point[i]))
        };
        let axes = Axes {
            x_label: &self.x_label,
            y_label: &self.y_label,
            x: Axis::around(values(0), 5),
            y: Axis::around(values(1), 5),
            equal: true,
            y_down: self.y_down,
        };
        let place = draw_axes(&mut sheet, &axes, top);
        for circle in self.circles.iter().filter(|circle| whole(circle)) {
            draw_circle(&mut sheet, circle, &place);
        }
        draw_series(&mut sheet, &self.series, &place, top);
        sheet.document(&self.title, "")
    }
}

fn whole(circle: &Circle) -> bool {
    circle.centre.iter().all(|value| drawable(*value))
        && drawable(circle.radius)
        && circle.radius > 0.0
}

fn draw_circle(sheet: &mut Sheet, circle: &Circle, place: &Place) {
    let [x, y] = circle.centre;
    let turn = (0..=96).map(|i| f64::from(i) / 96.0 * std::f64::consts::TAU);
    let rim: Vec<Spot> = turn
        .map(|angle| {
            place.spot([
                x + circle.radius * angle.cos(),
                y + circle.radius * angle.sin(),
            ])
        })
        .collect();
    let top = rim
        .iter()
        .copied()
        .min_by_key(|spot| spot.1)
        .unwrap_or_default();
    sheet.line(&rim, Stroke::solid(AXIS, 1.4));
    let lettering = Lettering::new(SOFT_INK, TEXT - 1.0, Anchor::Middle);
    sheet.text(&circle.name, (top.0, top.1 + units(10.0)), lettering);
}

#[cfg(test)]
mod tests {
    use super::super::markup::balance;
    use super::*;

    #[test]
    fn circle_is_round_and_inside() {
        let plot = Scatter::new("t", "x", "y").circle([5.0, -3.0], 2.0, "2 mm");
        let svg = plot.to_svg();
        assert_eq!(balance::fault(&svg), None, "{svg}");
        let rim = svg
            .lines()
            .filter(|line| line.contains("polyline"))
            .max_by_key(|line| line.len())
            .unwrap();
        let spots = rim
            .split("points=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap();
        let spots: Vec<[f64; 2]> = spots
            .split_whitespace()
            .map(|spot| {
                let (x, y) = spot.split_once(',').unwrap();
                [x.parse().unwrap(), y.parse().unwrap()]
            })
            .collect();
        let extent = |i: usize| {
            let values = spots.iter().map(|spot| spot[i]);
            (
                values.clone().fold(f64::MAX, f64::min),
                values.fold(f64::MIN, f64::max),
            )
        };
        let ((left, right), (top, bottom)) = (extent(0), extent(1));
        assert!(
            ((right - left) - (bottom - top)).abs() <= 4.0,
            "{left} {right} {top} {bottom}"
        );
        assert!(left > 0.0 && top > 0.0 && right < 4200.0 && bottom < 4200.0);
    }
}
