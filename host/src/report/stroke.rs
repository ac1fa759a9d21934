//! Strokes of series in the plane of the sheet, for plots and for paths in space.

use super::canvas::colour;
use super::sheet::{Sheet, Spot, Stroke, UNIT, units};
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
    pub(super) fn has_line(self) -> bool {
        self != Self::Points
    }

    pub(super) fn has_markers(self) -> bool {
        matches!(self, Self::Marked | Self::Points)
    }
}

/// Strokes of curves: width and dashes, units.
const STROKES: [(u32, &str); 6] = [
    (22, ""),
    (19, "90 40"),
    (21, "24 34"),
    (17, "100 34 24 34"),
    (13, ""),
    (16, "45 30"),
];
/// Stroke of a reference, a bound or the truth.
const DASHED: (u32, &str) = (18, "70 50");
/// Half the size of a marker, px.
const MARKER: f64 = 3.6;

/// Look of a series: curves that lie on each other differ in width and dashes, points in shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Look {
    pub style: Style,
    /// Number of the series, which selects colour and marker.
    pub index: usize,
    /// Number of the series among those that are not [`Style::Dashed`], which selects the stroke.
    pub rank: usize,
}

impl Look {
    /// Returns the looks of all series of a figure.
    pub fn all(styles: impl IntoIterator<Item = Style>) -> Vec<Self> {
        let mut next = 0;
        let numbered = styles.into_iter().enumerate();
        let look = |(index, style)| {
            let rank = next;
            next += usize::from(style != Style::Dashed);
            Self { style, index, rank }
        };
        numbered.map(look).collect()
    }

    /// Returns width and dashes of the stroke, units.
    pub fn pattern(self) -> (u32, &'static str) {
        match self.style {
            Style::Dashed => DASHED,
            _ => STROKES[self.rank % STROKES.len()],
        }
    }

    fn stroke(self) -> Stroke {
        let (width, dashes) = self.pattern();
        Stroke {
            colour: colour(self.index),
            width_units: width,
            dashes,
        }
    }
}

/// Draws one series. `runs` are its unbroken stretches; a stretch of a single point gets a marker,
/// because a line of one point is invisible.
pub(super) fn draw(sheet: &mut Sheet, runs: &[Vec<Spot>], look: Look) {
    let Look { style, index, .. } = look;
    for run in runs {
        if style.has_line() && run.len() > 1 {
            let path = if style == Style::Steps {
                held(run)
            } else {
                run.clone()
            };
            sheet.line(&thinned(&path), look.stroke());
        }
    }
    let mut seen = BTreeSet::new();
    for run in runs {
        if style.has_markers() || run.len() == 1 {
            for spot in run {
                // Markers closer than half a pixel are one marker.
                if seen.insert((spot.0 / 5, spot.1 / 5)) {
                    marker(sheet, *spot, index);
                }
            }
        }
    }
}

/// Draws the marker of series number `index`: shapes differ as well as colours.
fn marker(sheet: &mut Sheet, at: Spot, index: usize) {
    let fill = colour(index);
    let corner = |x: f64, y: f64| (at.0 + units(MARKER * x), at.1 + units(MARKER * y));
    match index % 4 {
        0 => sheet.circle(at, MARKER, fill),
        1 => sheet.polygon(
            &[
                corner(0.0, -1.35),
                corner(1.35, 0.0),
                corner(0.0, 1.35),
                corner(-1.35, 0.0),
            ],
            fill,
        ),
        2 => sheet.rectangle([corner(-0.9, -0.9), corner(0.9, 0.9)], fill),
        _ => sheet.polygon(
            &[corner(0.0, -1.3), corner(1.2, 0.85), corner(-1.2, 0.85)],
            fill,
        ),
    }
}

/// Width of a sample in a legend, px.
pub(super) const SAMPLE: f64 = 28.0;

/// Draws the sample of a series in a legend, from `at` to the right.
pub(super) fn sample(sheet: &mut Sheet, at: Spot, look: Look) {
    let width = units(SAMPLE);
    if look.style.has_line() {
        sheet.line(&[at, (at.0 + width, at.1)], look.stroke());
    }
    if look.style.has_markers() {
        marker(sheet, (at.0 + width / 2, at.1), look.index);
    }
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
    fn equal_curves_differ_in_stroke() {
        let looks = Look::all([Style::Dashed, Style::Line, Style::Line, Style::Steps]);
        let patterns: BTreeSet<(u32, &str)> = looks.iter().map(|look| look.pattern()).collect();
        assert_eq!(patterns.len(), looks.len(), "{looks:?}");
        assert_eq!(looks[1].stroke().dashes, "", "the first line is solid");
    }

    #[test]
    fn steps_hold_the_value() {
        assert_eq!(held(&[(0, 0), (10, 5)]), [(0, 0), (10, 0), (10, 5)]);
        assert!(held(&[]).is_empty());
    }
}
