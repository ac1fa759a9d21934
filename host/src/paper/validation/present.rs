//! The validation as tables and figures for the screen and for the page.

use super::recovery::Printed;
use super::{ESTIMATORS, Validation, noise, recovery, scene};
use crate::report::{Cell, Figure, Page, Path3d, Scatter, Style, Table};

/// Bound on the difference between the closed form's mean and the paper's printed values, mm.
pub const PAPER_BOUND_MM: f64 = 0.01;
/// Bound on the midpoint's worst error, mm.
pub const MIDPOINT_BOUND_MM: f64 = 0.001;
/// Bound on the ratio of the midpoint's error to the Cramér-Rao bound.
pub const RATIO_BOUND: f64 = 1.10;

impl Validation {
    /// Returns all tables, in the order of the paper.
    pub fn tables(&self) -> [Table; 3] {
        [self.means(), self.spreads(), self.ratios()]
    }

    /// Returns Fig. 3: the points in space.
    pub fn space(&self) -> Path3d {
        let labels = ["X, mm", "Y, mm", "Z (depth), mm"];
        let points = self.sample.points_mm.iter().copied();
        Path3d::new("50 random points in space", labels).series("", Style::Points, points)
    }

    /// Returns Fig. 4: the same points in the left, the middle and the right image.
    pub fn images(&self) -> Vec<Figure> {
        let images = ["left", "middle", "right"]
            .iter()
            .zip(&self.sample.images_px);
        let figures = images.map(|(name, points)| {
            Scatter::new(format!("{name} camera"), "x, px", "y, px")
                .sized(320, 290)
                .y_down()
                .including([0.0, 0.0])
                .including(scene::IMAGE_PX.map(|side| f64::from(side) - 1.0))
                .series("", Style::Points, points.iter().copied())
                .into()
        });
        figures.collect()
    }

    /// Returns `page` with all tables and figures added.
    pub fn add_to(&self, page: Page) -> Page {
        let [means, spreads, ratios] = self.tables();
        let depth = scene::DEPTH_MM;
        page.section(
            "Numerical validation (section 3)",
            format!(
                "{} random sets of {} points, depth {} to {} mm, f = 530 px, h1 = 90 mm, h2 = 70 \
                 mm, without noise. Every move is recovered from every set; the paper prints the \
                 result of one.",
                self.recovery.sets,
                recovery::POINTS,
                depth[0],
                depth[1]
            ),
        )
        .table(means)
        .table(spreads)
        .plot(self.space())
        .plots(self.images())
        .section(
            "Noise",
            format!(
                "{} trials of each move, {} points, noise of {} px in every coordinate, f = \
                 533.32 px, gaps of 70 and 68 mm. The Cramér-Rao bound is the least error that any \
                 unbiased estimator can have; 1.00 is perfect.",
                self.noise.trials,
                noise::POINTS,
                noise::NOISE_PX
            ),
        )
        .table(ratios)
    }

    fn means(&self) -> Table {
        let [closed, least, middle] = ESTIMATORS;
        let caption = format!(
            "Tables 1 and 2: moves recovered without noise, mean of {} sets, mm",
            self.recovery.sets
        );
        let columns = ["", "true X Y Z", "paper", closed, least, middle];
        let mut table = Table::new(caption, columns);
        for row in &self.recovery.rows {
            let [closed, least, middle] = row.recovered.map(|spread| vector(spread.mean_mm));
            let worst = largest(row.recovered[2].worst_error_mm);
            table = table.row([
                name(&row.printed),
                truth(row.printed.true_mm),
                vector(row.printed.paper_mm).muted(),
                closed,
                least,
                judged(middle, worst <= MIDPOINT_BOUND_MM),
            ]);
        }
        table
    }

    fn spreads(&self) -> Table {
        let caption = "The closed form from set to set, and the midpoint's worst of all sets, mm";
        let columns = [
            "",
            "true X Y Z",
            "mean - paper, worst axis",
            "closed form: std. dev. X Y Z",
            "smallest X Y Z",
            "largest X Y Z",
            "midpoint: worst error",
        ];
        let mut table = Table::new(caption, columns);
        for row in &self.recovery.rows {
            let closed = &row.recovered[0];
            let paper = row.printed.paper_mm;
            let off = largest(std::array::from_fn(|axis| {
                closed.mean_mm[axis] - paper[axis]
            }));
            let worst = largest(row.recovered[2].worst_error_mm);
            table = table.row([
                name(&row.printed),
                truth(row.printed.true_mm),
                judged(Cell::number(off, 4), off <= PAPER_BOUND_MM),
                vector(closed.deviation_mm),
                vector(closed.least_mm),
                vector(closed.most_mm),
                judged(
                    Cell::right(format!("{worst:.1e}")),
                    worst <= MIDPOINT_BOUND_MM,
                ),
            ]);
        }
        table
    }

    fn ratios(&self) -> Table {
        let caption = format!(
            "Error over the Cramér-Rao bound, {} px noise, {} points, {} trials",
            noise::NOISE_PX,
            noise::POINTS,
            self.noise.trials
        );
        let [closed, least, middle] = ESTIMATORS;
        let columns = ["true X Y Z, mm", "bound X Y Z, µm", closed, least, middle];
        let mut table = Table::new(caption, columns);
        for row in &self.noise.rows {
            let ratio = |estimator| Cell::vector(&row.ratio(estimator), 2, 6);
            let reached = row.ratio(2).iter().all(|ratio| *ratio <= RATIO_BOUND);
            table = table.row([
                truth(row.true_mm),
                Cell::vector(&row.bound_mm.map(|mm| 1000.0 * mm), 1, 6),
                ratio(0),
                ratio(1),
                judged(ratio(2), reached),
            ]);
        }
        table
    }
}

fn name(printed: &Printed) -> Cell {
    Cell::text(format!("Table {}", printed.table))
}

fn truth(move_mm: [f64; 3]) -> Cell {
    Cell::vector(&move_mm, 1, 4)
}

fn vector(mm: [f64; 3]) -> Cell {
    Cell::vector(&mm, 4, 7)
}

fn judged(cell: Cell, within: bool) -> Cell {
    if within { cell.good() } else { cell.bad() }
}

fn largest(values: [f64; 3]) -> f64 {
    values
        .iter()
        .fold(0.0, |worst, value| worst.max(value.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_rows_are_within_bounds() {
        let validation = Validation {
            recovery: recovery::run(200).unwrap(),
            noise: noise::run(1000).unwrap(),
            sample: scene::Sample::draw(),
        };
        let [means, spreads, ratios] = validation.tables();
        assert_eq!(
            [means.rows.len(), spreads.rows.len(), ratios.rows.len()],
            [13, 13, 5]
        );
        let html = validation.add_to(Page::new("", "")).to_html();
        assert_eq!(html.matches("<svg").count(), 4);
        assert_eq!(html.matches(" bad\"").count(), 0);
        // One mark per row and judged column.
        assert_eq!(html.matches(" good\"").count(), 13 + 26 + 5);
    }
}
