//! Plain values of a run over time, and the parts of a page that show them.

use crate::report::{Cell, Figure, LinePlot, Mark, Moment, Page, Path3d, Style, Table};
use trinocular_core::frame::message::Mounting;

const AXES: [&str; 3] = ["X", "Y", "Z"];

/// Size of a plot of which two stand side by side, px.
const HALF: [u32; 2] = [516, 270];

/// Largest table on a page, bytes.
const LARGEST_TABLE: usize = 700_000;

/// Rows of the table of events.
const MOST_EVENTS: usize = 200;

/// Position at an instant: time, s, and position, mm.
pub type Point = (f64, [f64; 3]);

/// What the images of one frame set measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Capture time, s.
    pub time_s: f64,
    /// Capture time of its keyframe, s.
    pub reference_s: f64,
    /// Displacement of the target since the keyframe along the stage's axes, mm: past the cameras.
    pub displacement_mm: [f64; 3],
    /// Its standard deviation per axis, mm; NaN without one.
    pub sigma_mm: [f64; 3],
    /// Number of points used.
    pub points: usize,
    /// Number of points left out.
    pub rejected: u64,
    /// Time from the capture to the first step that it could change, ms; NaN without one.
    pub latency_ms: f64,
    /// False if the station did not use it.
    pub is_used: bool,
}

/// Values of a run over time, in s from its keyframe.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunCurves {
    /// Place of the cameras.
    pub mounting: Mounting,
    /// True positions of the target, if they are known. Then those of the stage are true, too, and
    /// both have the same instants.
    pub target: Vec<Point>,
    /// Positions of the stage, mm from that at the keyframe.
    pub stage: Vec<Point>,
    /// Measurements of the images.
    pub measured: Vec<Measured>,
    /// Marks of events.
    pub marks: Vec<Mark>,
    /// Pictures.
    pub moments: Vec<Moment>,
}

impl RunCurves {
    /// Returns true if the true positions of the target are known.
    pub fn is_true(&self) -> bool {
        !self.target.is_empty()
    }

    /// Returns the position of the stage at `time_s`, between the two samples around it.
    fn stage_at(&self, time_s: f64) -> [f64; 3] {
        let after = self.stage.partition_point(|(at_s, _)| *at_s < time_s);
        let before = self.stage.get(after.wrapping_sub(1));
        match (before, self.stage.get(after)) {
            (Some((s0, a)), Some((s1, b))) if s1 > s0 => {
                let share = (time_s - s0) / (s1 - s0);
                std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
            }
            (_, Some((_, mm))) | (Some((_, mm)), None) => *mm,
            (None, None) => [f64::NAN; 3],
        }
    }

    /// Returns the measured positions of the target.
    fn measured_target(&self) -> Vec<Point> {
        let used = self.measured.iter().filter(|measured| measured.is_used);
        let position = |measured: &Measured| {
            let stage_mm = match self.mounting {
                Mounting::OnStage => self.stage_at(measured.time_s),
                Mounting::Fixed => self.stage_at(measured.reference_s),
            };
            let seen_mm = measured.displacement_mm;
            let target_mm = std::array::from_fn(|i| stage_mm[i] + seen_mm[i]);
            (measured.time_s, target_mm)
        };
        used.map(position).collect()
    }

    /// Returns stage minus target as the cameras measured it, with its sigma, mm.
    pub fn measured_error(&self) -> Vec<(Point, [f64; 3])> {
        let used = self.measured.iter().filter(|measured| measured.is_used);
        let error = |measured: &Measured| {
            let stage_mm = match self.mounting {
                Mounting::OnStage => [0.0; 3],
                // The stage's own way since the keyframe.
                Mounting::Fixed => {
                    let (now, then) = (measured.time_s, measured.reference_s);
                    let [now, then] = [now, then].map(|at_s| self.stage_at(at_s));
                    std::array::from_fn(|i| now[i] - then[i])
                }
            };
            let seen_mm = measured.displacement_mm;
            let error = std::array::from_fn(|i| stage_mm[i] - seen_mm[i]);
            ((measured.time_s, error), measured.sigma_mm)
        };
        used.map(error).collect()
    }

    /// Returns the longest pause between two measurements of one line, s. Longer ones are gaps.
    fn longest_pause_s(&self) -> f64 {
        let times = self.measured.iter().map(|seen| seen.time_s);
        let mut pauses: Vec<f64> = times
            .clone()
            .zip(times.skip(1))
            .map(|(a, b)| b - a)
            .collect();
        pauses.sort_by(f64::total_cmp);
        let usual = pauses.get(pauses.len() / 2);
        usual.map_or(f64::INFINITY, |usual| 1.6 * usual)
    }

    /// Breaks a line where measurements are missing.
    fn with_gaps<const N: usize>(&self, points: Vec<[f64; N]>) -> Vec<[f64; N]> {
        let longest_s = self.longest_pause_s();
        let mut last_s = f64::INFINITY;
        let mut broken = Vec::with_capacity(points.len());
        for point in points {
            if point[0] - last_s > longest_s {
                broken.push([f64::NAN; N]);
            }
            last_s = point[0];
            broken.push(point);
        }
        broken
    }

    /// Returns stage minus target by their true positions, mm; nothing if they are not known.
    pub fn true_error(&self) -> Vec<Point> {
        let pairs = self.stage.iter().zip(&self.target);
        let error = |((at_s, stage), (_, target)): (&Point, &Point)| {
            (*at_s, std::array::from_fn(|i| stage[i] - target[i]))
        };
        pairs.map(error).collect()
    }

    /// Returns the name and the positions of the target that are drawn. True positions have no
    /// gaps.
    fn shown_target(&self) -> (&'static str, Vec<Point>) {
        if self.is_true() {
            return ("target", self.target.clone());
        }
        let points = self.measured_target();
        let points = points.iter().map(|(at_s, [x, y, z])| [*at_s, *x, *y, *z]);
        let broken = self.with_gaps(points.collect()).into_iter();
        let points = broken.map(|[at_s, x, y, z]| (at_s, [x, y, z]));
        ("target, measured", points.collect())
    }

    /// Returns target and stage over time, one plot per axis.
    pub fn positions(&self) -> Vec<Figure> {
        let (name, target) = self.shown_target();
        let plot = |i: usize| {
            let title = format!("{} of target and stage", AXES[i]);
            LinePlot::new(title, "time, s", "mm")
                .series("stage", Style::Line, axis(&self.stage, i, 1.0))
                .series(name, Style::Dashed, axis(&target, i, 1.0))
                .marked(&self.marks)
                .sized(HALF[0], HALF[1])
                .into()
        };
        (0..3).map(plot).collect()
    }

    /// Returns the error in µm, one plot per axis, with the band of one sigma.
    pub fn errors(&self) -> Vec<Figure> {
        self.errors_within(f64::INFINITY, "")
    }

    /// Returns the error about zero, enlarged, if single errors hide the others.
    pub fn small_errors(&self) -> Vec<Figure> {
        let errors = match self.is_true() {
            true => self.true_error(),
            false => self
                .measured_error()
                .into_iter()
                .map(|(point, _)| point)
                .collect(),
        };
        let sizes = errors
            .iter()
            .flat_map(|(_, mm)| mm.map(|mm| (1e3 * mm).abs()));
        let mut sizes: Vec<f64> = sizes.filter(|um| um.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        let at = |share: f64| sizes.get((sizes.len() as f64 * share) as usize);
        match (at(0.6), sizes.last()) {
            (Some(usual), Some(largest)) if *largest > 12.0 * usual.max(1.0) => {
                self.errors_within(4.0 * usual.max(1.0), ", enlarged")
            }
            _ => Vec::new(),
        }
    }

    fn errors_within(&self, limit_um: f64, note: &str) -> Vec<Figure> {
        let (truth, measured) = (self.true_error(), self.measured_error());
        let within = |um: f64| if um.abs() <= limit_um { um } else { f64::NAN };
        let plot = |i: usize| {
            let title = format!("Error {}, stage - target{note}", AXES[i]);
            let band = measured.iter().map(|((at_s, error), sigma)| {
                let ends = [error[i] - sigma[i], error[i] + sigma[i]];
                let [low, high] = ends.map(|mm| within(1e3 * mm));
                [*at_s, low, high]
            });
            let seen = measured.iter();
            let seen = seen.map(|((at_s, error), _)| [*at_s, within(1e3 * error[i])]);
            let plot = LinePlot::new(title, "time, s", "µm").including(0.0);
            let plot = plot
                .band("± 1 sigma", self.with_gaps(band.collect()))
                .series("measured", Style::Line, self.with_gaps(seen.collect()));
            let plot = match truth.is_empty() {
                true => plot,
                false => {
                    let truth = axis(&truth, i, 1e3).map(|[at_s, um]| [at_s, within(um)]);
                    plot.series("true", Style::Line, truth)
                }
            };
            plot.marked(&self.marks).sized(HALF[0], HALF[1]).into()
        };
        (0..3).map(plot).collect()
    }

    /// Returns sigma, points and latency of the measurements over time.
    pub fn measurements(&self) -> Vec<Figure> {
        let of = |value: &dyn Fn(&Measured) -> f64| -> Vec<[f64; 2]> {
            let measured = self.measured.iter();
            self.with_gaps(measured.map(|seen| [seen.time_s, value(seen)]).collect())
        };
        let plot = |title: &str, unit: &str| {
            let plot = LinePlot::new(title, "time, s", unit).including(0.0);
            plot.marked(&self.marks).sized(HALF[0], HALF[1])
        };
        let sigma = plot("Standard deviation of each measurement", "µm");
        let sigma = (0..3).fold(sigma, |plot, i| {
            plot.series(AXES[i], Style::Line, of(&|seen| 1e3 * seen.sigma_mm[i]))
        });
        let points = plot("Points of each measurement", "points")
            .series("used", Style::Line, of(&|seen| seen.points as f64))
            .series("left out", Style::Line, of(&|seen| seen.rejected as f64));
        let latency = of(&|seen| seen.latency_ms);
        let mut figures = vec![sigma.into(), points.into()];
        if latency.iter().any(|[_, ms]| ms.is_finite()) {
            let plot = plot("Latency from the images to the first step", "ms");
            figures.push(plot.series("", Style::Line, latency).into());
        }
        figures
    }

    /// Returns the path of target and stage in space.
    pub fn path(&self) -> Path3d {
        let (name, target) = self.shown_target();
        let place = |points: &[Point]| points.iter().map(|(_, mm)| *mm).collect::<Vec<_>>();
        Path3d::new("Path in space", ["X, mm", "Y, mm", "Z, mm"])
            .series("stage", Style::Line, place(&self.stage))
            .series(name, Style::Dashed, place(&target))
            .sized(760, 520)
    }

    /// Returns the table of events.
    pub fn events(&self) -> Table {
        let table = Table::new("", ["", "from, s", "until, s", "kind", "event"]);
        let marks = self.marks.iter().take(MOST_EVENTS);
        marks.fold(table, |table, mark| {
            let until = match mark.until > mark.from {
                true => Cell::number(mark.until, 3),
                false => Cell::right(""),
            };
            table.row([
                Cell::text(mark.kind.letter()).strong(),
                Cell::number(mark.from, 3),
                until,
                Cell::text(mark.kind.name()),
                Cell::words(mark.text.as_str()),
            ])
        })
    }

    /// Adds the parts that pages of all runs have: sections of a page of one run, or parts of a
    /// section.
    pub fn add_to(&self, page: Page, is_part: bool) -> Page {
        let under = |page: Page, heading: &str, text: String| match is_part {
            true => page.subsection(heading, text),
            false => page.section(heading, text),
        };
        let mut page = page;
        if self.is_true() || self.stage.len() + self.measured.len() > 0 {
            page = under(page, "Over time", String::new()).plots(self.positions());
            let text = match self.is_true() {
                true => {
                    "Stage minus target: by their true positions, and as the cameras measured it. \
                     The band is one standard deviation of the measurement."
                }
                false => {
                    "Stage minus target as the cameras measured it, which is not the true error. \
                     The band is one standard deviation of the measurement."
                }
            };
            page = under(page, "Error in micrometres", text.to_owned()).plots(self.errors());
            let enlarged = self.small_errors();
            if !enlarged.is_empty() {
                page = page.plots(enlarged);
            }
            if !self.measured.is_empty() {
                page = under(page, "Measurements", String::new()).plots(self.measurements());
            }
            page = under(page, "Path in space", String::new()).plot(self.path());
        }
        if !self.moments.is_empty() {
            let text = "Cyan dots are points that were used, yellow lines their way since the \
                        keyframe.";
            let text = text.to_owned();
            page = under(page, "What the cameras saw", text).moments(self.moments.clone());
        }
        if !self.marks.is_empty() {
            let text = match self.marks.len() > MOST_EVENTS {
                true => format!("The first {MOST_EVENTS} of {} events.", self.marks.len()),
                false => "Each event is marked in the plots by its letter.".to_owned(),
            };
            page = under(page, "Events", text).table(self.events());
        }
        page
    }
}

fn axis(points: &[Point], i: usize, scale: f64) -> impl Iterator<Item = [f64; 2]> + '_ {
    points.iter().map(move |(at_s, mm)| [*at_s, scale * mm[i]])
}

/// Adds a CSV table to copy. Of a table that is too large for a page, every n-th row is left.
/// `whole` says where the whole table is.
pub fn add_table(page: Page, name: &str, csv: &str, whole: &str) -> Page {
    let rows = csv.lines().count().saturating_sub(1);
    let every = csv.len().div_ceil(LARGEST_TABLE).max(1);
    if every == 1 {
        return page.text(format!("{name}: {rows} rows (CSV)"), "", csv);
    }
    let is_kept = |index: &usize| *index == 0 || (index - 1).is_multiple_of(every);
    let lines = csv.lines().enumerate().filter(|(index, _)| is_kept(index));
    let mut text = String::new();
    for (_, line) in lines {
        text.push_str(line);
        text.push('\n');
    }
    let kept = text.lines().count().saturating_sub(1);
    let summary = format!("{name}: {kept} of {rows} rows (CSV)");
    let note = format!("One row in {every}, because the table is large. {whole}");
    page.text(summary, note, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(time_s: f64, x_mm: f64) -> Measured {
        Measured {
            time_s,
            reference_s: 0.0,
            displacement_mm: [x_mm, 0.0, 0.0],
            sigma_mm: [0.001; 3],
            points: 100,
            rejected: 3,
            latency_ms: 20.0,
            is_used: true,
        }
    }

    #[test]
    fn measured_error_depends_on_mounting() {
        let stage = vec![(0.0, [0.0; 3]), (1.0, [10.0, 0.0, 0.0])];
        // The stage stands 2 mm from zero at the later keyframe.
        let later = |mounting| RunCurves {
            mounting,
            stage: stage.clone(),
            measured: vec![Measured {
                reference_s: 0.2,
                ..measured(0.5, 3.25)
            }],
            ..RunCurves::default()
        };
        let curves = |mounting| RunCurves {
            mounting,
            stage: stage.clone(),
            measured: vec![measured(0.5, 5.25)],
            ..RunCurves::default()
        };
        let x = |curves: RunCurves| curves.measured_error()[0].0.1[0];
        // On the stage the cameras see the difference itself.
        assert!((x(curves(Mounting::OnStage)) + 5.25).abs() < 1e-12);
        assert!((x(curves(Mounting::Fixed)) + 0.25).abs() < 1e-12);
        assert!((x(later(Mounting::Fixed)) + 0.25).abs() < 1e-12);
        let target = |curves: RunCurves| curves.measured_target()[0].1[0];
        assert!((target(later(Mounting::Fixed)) - 5.25).abs() < 1e-12);
        assert!((target(curves(Mounting::OnStage)) - 10.25).abs() < 1e-12);
        assert!((target(curves(Mounting::Fixed)) - 5.25).abs() < 1e-12);
    }

    #[test]
    fn jumps_do_not_hide_small_errors() {
        let jump = |i: i32| if i % 50 == 0 { 4.0 } else { 0.001 };
        let seen = (0..200).map(|i| measured(f64::from(i), jump(i)));
        let curves = RunCurves {
            measured: seen.collect(),
            ..RunCurves::default()
        };
        assert_eq!(curves.small_errors().len(), 3);
        let even = RunCurves {
            measured: (0..200).map(|i| measured(f64::from(i), 0.002)).collect(),
            ..RunCurves::default()
        };
        assert!(even.small_errors().is_empty());
    }

    #[test]
    fn large_table_keeps_every_nth_row() {
        let mut csv = "n,text\n".to_owned();
        (0..20_000).for_each(|n| csv.push_str(&format!("{n},{}\n", "x".repeat(80))));
        let page = add_table(Page::new("t", ""), "Rows", &csv, "Elsewhere.");
        let html = page.to_html();
        assert!(html.len() < LARGEST_TABLE + 50_000, "{}", html.len());
        assert!(
            html.contains("6667 of 20000 rows"),
            "{}",
            &html[html.len() - 300..]
        );
        assert!(html.contains("n,text\n0,x") && html.contains("\n3,x") && !html.contains("\n1,x"));
    }
}
