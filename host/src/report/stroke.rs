//! Strokes of series in the plane of the sheet, for plots and for paths in space.

use super::canvas::{DrawingError, Sheet, Spot, UNIT, colour, pen, units};
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use std::collections::BTreeSet;

/// Style of the connection between the points of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// A line.
    #[default]
    Line,
    /// A dashed line: a reference, a bound, the truth.
    Dashed,
    /// A line with a marker at each point.
    Marked,
    /// Markers only.
    Points,
    /// Each value held until the next, as a sampled output does.
    Steps,
}

impl Style {
    fn has_line(self) -> bool {
        self != Self::Points
    }

    fn has_markers(self) -> bool {
        matches!(self, Self::Marked | Self::Points)
    }
}

/// Half the size of a marker, px.
const MARKER: f64 = 3.6;
/// Width of a series' line, px.
const LINE: f64 = 1.8;
/// Length of a dash and of a gap, px.
const DASH: f64 = 7.0;
const GAP: f64 = 5.0;
/// Longest curve drawn with dashes, px. Dashes are separate elements of the file, so a longer curve
/// is drawn solid and thin.
const LONGEST_DASHED: f64 = 6000.0;

/// Draws one series. `runs` are its unbroken stretches; a stretch of a single point gets a marker,
/// because a line of one point is invisible.
pub(super) fn draw(
    sheet: &Sheet,
    runs: &[Vec<Spot>],
    style: Style,
    index: usize,
) -> Result<(), DrawingError> {
    for run in runs {
        if style.has_line() && run.len() > 1 {
            let path = if style == Style::Steps {
                held(run)
            } else {
                run.clone()
            };
            draw_line(sheet, thinned(&path), style, index)?;
        }
    }
    let mut seen = BTreeSet::new();
    for run in runs {
        if style.has_markers() || run.len() == 1 {
            for spot in run {
                // Markers closer than half a pixel are one marker.
                if seen.insert((spot.0 / 5, spot.1 / 5)) {
                    marker(sheet, *spot, index)?;
                }
            }
        }
    }
    Ok(())
}

fn draw_line(
    sheet: &Sheet,
    path: Vec<Spot>,
    style: Style,
    index: usize,
) -> Result<(), DrawingError> {
    let solid = pen(colour(index), LINE);
    if style != Style::Dashed {
        return sheet.draw(&PathElement::new(path, solid));
    }
    if length_px(&path) > LONGEST_DASHED {
        let thin = pen(colour(index), LINE / 2.0);
        return sheet.draw(&PathElement::new(path, thin));
    }
    let dashes = DashedPathElement::new(path, units(DASH), units(GAP), solid);
    sheet.draw(&dashes)
}

/// Draws the marker of series number `index`: shapes differ as well as colours.
fn marker(sheet: &Sheet, at: Spot, index: usize) -> Result<(), DrawingError> {
    let fill = colour(index).filled();
    let r = units(MARKER);
    let corner = |x: f64, y: f64| {
        (
            at.0 + (f64::from(r) * x) as i32,
            at.1 + (f64::from(r) * y) as i32,
        )
    };
    match index % 4 {
        0 => sheet.draw(&Circle::new(at, r, fill)),
        1 => sheet.draw(&Polygon::new(
            vec![
                corner(0.0, -1.35),
                corner(1.35, 0.0),
                corner(0.0, 1.35),
                corner(-1.35, 0.0),
            ],
            fill,
        )),
        2 => sheet.draw(&Rectangle::new(
            [corner(-0.9, -0.9), corner(0.9, 0.9)],
            fill,
        )),
        _ => sheet.draw(&Polygon::new(
            vec![corner(0.0, -1.3), corner(1.2, 0.85), corner(-1.2, 0.85)],
            fill,
        )),
    }
}

/// Width of a sample in a legend, px.
pub(super) const SAMPLE: f64 = 28.0;

/// Draws the sample of a series in a legend, from `at` to the right.
pub(super) fn sample(
    sheet: &Sheet,
    at: Spot,
    style: Style,
    index: usize,
) -> Result<(), DrawingError> {
    let width = units(SAMPLE);
    if style.has_line() {
        draw_line(sheet, vec![at, (at.0 + width, at.1)], style, index)?;
    }
    if style.has_markers() {
        marker(sheet, (at.0 + width / 2, at.1), index)?;
    }
    Ok(())
}

/// Converts points to steps: to the right first, then up or down.
fn held(run: &[Spot]) -> Vec<Spot> {
    let mut path: Vec<Spot> = run.first().copied().into_iter().collect();
    for pair in run.windows(2) {
        if let [before, after] = pair {
            path.extend([(after.0, before.1), *after]);
        }
    }
    path
}

/// Removes invisible detail from a path: of the points in one pixel column only the first, the
/// lowest, the highest and the last stay. A path that turns back keeps its order; only neighbours
/// merge.
pub(super) fn thinned(path: &[Spot]) -> Vec<Spot> {
    let mut kept = Vec::new();
    let column = |spot: &Spot| f64::from(spot.0).div_euclid(UNIT);
    for run in path.chunk_by(|a, b| column(a) == column(b)) {
        let lowest = (0..run.len()).min_by_key(|i| run[*i].1);
        let highest = (0..run.len()).max_by_key(|i| run[*i].1);
        let ends = [0, run.len().saturating_sub(1)];
        let chosen: BTreeSet<usize> = ends.into_iter().chain(lowest).chain(highest).collect();
        kept.extend(chosen.into_iter().filter_map(|i| run.get(i).copied()));
    }
    kept.dedup();
    kept
}

fn length_px(path: &[Spot]) -> f64 {
    let steps = path.windows(2).map(|pair| match pair {
        [a, b] => f64::from(b.0.saturating_sub(a.0)).hypot(f64::from(b.1.saturating_sub(a.1))),
        _ => 0.0,
    });
    steps.sum::<f64>() / UNIT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_every_extreme() {
        let path: Vec<Spot> = (0..100_000).map(|i| (i / 20, (i * 7919) % 3001)).collect();
        let thin = thinned(&path);
        assert!(thin.len() <= 4 * 501, "{}", thin.len());
        for column in 0..500 {
            let of = |spots: &[Spot]| {
                let ys = spots
                    .iter()
                    .filter(|spot| spot.0 / 10 == column)
                    .map(|spot| spot.1);
                (ys.clone().min(), ys.max())
            };
            assert_eq!(of(&thin), of(&path), "column {column}");
        }
    }

    #[test]
    fn steps_hold_the_value() {
        assert_eq!(held(&[(0, 0), (10, 5)]), [(0, 0), (10, 0), (10, 5)]);
        assert!(held(&[]).is_empty());
    }
}
