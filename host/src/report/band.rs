//! Bands around curves: the range of one standard deviation, for example.

use super::axis::drawable;
use super::canvas::colour;
use super::chart::Place;
use super::sheet::{Sheet, Spot, UNIT, units};
use super::stroke::SAMPLE;

/// Range of values over an axis, filled in the colour of a series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Band {
    /// Name in the legend; an unnamed band is not in the legend.
    pub name: String,
    /// Position on the horizontal axis, lower and upper end. A point that is not a number breaks
    /// the band.
    pub points: Vec<[f64; 3]>,
    /// Number of the series whose colour it has.
    pub index: usize,
}

/// Opacity of a band, %.
const OPACITY: u8 = 22;

impl Band {
    pub(super) fn drawable(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let is_drawable = |point: &[f64; 3]| point.iter().all(|value| drawable(*value));
        self.points.iter().copied().filter(is_drawable)
    }
}

/// Draws the band, one polygon per unbroken stretch.
pub(super) fn draw(sheet: &mut Sheet, band: &Band, place: &Place) {
    let is_drawable = |point: &[f64; 3]| point.iter().all(|value| drawable(*value));
    let runs = band.points.split(|point| !is_drawable(point));
    for run in runs.filter(|run| !run.is_empty()) {
        let spots: Vec<(Spot, Spot)> = run
            .iter()
            .map(|[x, low, high]| (place.spot([*x, *low]), place.spot([*x, *high])))
            .collect();
        // Of the points in one pixel column, the widest range is left.
        let column = |(low, _): &(Spot, Spot)| f64::from(low.0).div_euclid(UNIT);
        let columns = spots.chunk_by(|a, b| column(a) == column(b));
        let (mut lower, mut upper) = (Vec::new(), Vec::new());
        for column in columns {
            let x = column[0].0.0;
            let low = column.iter().map(|(low, _)| low.1).max();
            let high = column.iter().map(|(_, high)| high.1).min();
            lower.extend(low.map(|y| (x, y)));
            upper.extend(high.map(|y| (x, y)));
        }
        let rim: Vec<Spot> = lower.into_iter().chain(upper.into_iter().rev()).collect();
        sheet.polygon(&rim, colour(band.index).faint(OPACITY));
    }
}

/// Draws the sample of a band in a legend, from `at` to the right.
pub(super) fn sample(sheet: &mut Sheet, at: Spot, index: usize) {
    let corners = [
        (at.0, at.1 - units(5.0)),
        (at.0 + units(SAMPLE), at.1 + units(5.0)),
    ];
    sheet.rectangle(corners, colour(index).faint(OPACITY));
}

#[cfg(test)]
mod tests {
    use super::super::{LinePlot, Style};

    #[test]
    fn band_is_thinned_and_broken_at_gaps() {
        let points = (0..50_000).map(|i| {
            let x = f64::from(i);
            let low = if i == 25_000 {
                f64::NAN
            } else {
                (x * 0.1).sin() - 1.0
            };
            [x, low, (x * 0.1).sin() + 1.0]
        });
        let plot = LinePlot::new("t", "x", "y").band("sigma", points);
        let svg = plot
            .series("a", Style::Line, [[0.0, 0.0], [5e4, 0.0]])
            .to_svg();
        assert_eq!(svg.matches("<polygon").count(), 2, "two stretches");
        assert!(svg.len() < 60_000, "{} bytes", svg.len());
        assert!(svg.contains("sigma"));
    }
}
