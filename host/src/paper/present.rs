//! The experiment as tables and figures for the screen and for the page.

use super::moves::{self, Row};
use super::tracking::{self, BOUND_MM, MOVE_MM, Pulses, Run, Settings, Stop};
use crate::report::{Cell, Mark, MarkKind, Page, Path3d, Scatter, Style, Table};
use crate::run_report::curves::add_table;
use crate::run_report::{Provenance, RunCurves, Story};
use crate::servo::simulated::SimulatedStep;

/// Returns Table 6: the paper's station B, and this program's with this estimator.
pub fn stops(estimator: &str, stops: &[Stop]) -> Table {
    let columns = [
        "stop",
        "true, mm",
        "paper, mm",
        "paper's error, mm",
        "tracked, mm",
        "error, mm",
    ];
    let caption = format!("Table 6: where station B stood after each move of A ({estimator})");
    let table = Table::new(caption, columns);
    stops
        .iter()
        .enumerate()
        .fold(table, |table, (index, stop)| {
            let paper_error: [f64; 3] = std::array::from_fn(|i| stop.paper_mm[i] - stop.true_mm[i]);
            let error = stop.error_mm();
            let within = error
                .iter()
                .zip(BOUND_MM)
                .all(|(e, bound)| e.abs() <= bound);
            let ours = Cell::vector(&error, 4, 8);
            table.row([
                Cell::number((index + 1) as f64, 0),
                Cell::vector(&stop.true_mm, 0, 3),
                Cell::vector(&stop.paper_mm, 4, 8).muted(),
                Cell::vector(&paper_error, 4, 8).muted(),
                Cell::vector(&stop.tracked_mm, 4, 8).strong(),
                if within { ours.good() } else { ours.bad() },
            ])
        })
}

/// Returns Table 5: the paper's estimates and this program's.
pub fn moves(rows: &[Row]) -> Table {
    let columns = [
        "true, mm",
        "paper, mm",
        "closed form, mm",
        "least squares, mm",
        "midpoint, mm",
        "midpoint's error, mm",
        "sigma, mm",
    ];
    let table = Table::new("Table 5: single moves, rendered cameras at rest", columns);
    let or_dash =
        |v: &Option<[f64; 3]>| v.map_or_else(|| Cell::right("refused"), |v| Cell::vector(&v, 4, 8));
    rows.iter().fold(table, |table, row| {
        let error = row
            .midpoint
            .map(|m| std::array::from_fn::<f64, 3, _>(|i| m[i] - row.true_mm[i]));
        let within = error.is_some_and(|e| {
            e.iter()
                .zip(moves::BOUND_MM)
                .all(|(e, bound)| e.abs() <= bound)
        });
        let cell = or_dash(&error);
        table.row([
            Cell::vector(&row.true_mm, 0, 3),
            Cell::vector(&row.paper_mm, 4, 8).muted(),
            or_dash(&row.closed_form),
            or_dash(&row.least_squares),
            or_dash(&row.midpoint).strong(),
            if within { cell.good() } else { cell.bad() },
            or_dash(&row.sigma_mm).muted(),
        ])
    })
}

/// Returns Fig. 7: both paths in space, and the closed form's if there is one.
pub fn path(run: &Run, closed_form: Option<&Run>) -> Path3d {
    let truth = (0..=tracking::MOVES).map(|n| MOVE_MM.map(|d| d * n as f64));
    let paper = std::iter::once([0.0; 3]).chain(run.stops.iter().map(|stop| stop.paper_mm));
    let cameras = |run: &Run| -> Vec<[f64; 3]> {
        let positions = run.samples.iter().map(|sample| sample.camera_mm);
        positions.collect()
    };
    let figure = Path3d::new("Tracking path (Fig. 7)", ["X, mm", "Y, mm", "Z, mm"])
        .series("target (A)", Style::Marked, truth)
        .series("paper's B", Style::Dashed, paper)
        .series("our B", Style::Line, cameras(run));
    match closed_form {
        Some(run) => figure.series("our B, closed form", Style::Line, cameras(run)),
        None => figure,
    }
}

/// Returns Fig. 8: the marks of a laser on B on the poster on A.
pub fn laser(run: &Run) -> Scatter {
    let spot = |target: [f64; 3], camera: [f64; 3]| [camera[0] - target[0], camera[1] - target[1]];
    let at_rest = |step: &&SimulatedStep| !is_moving(run, step.time_s);
    let under_way = run
        .samples
        .iter()
        .map(|sample| spot(sample.target_mm, sample.camera_mm));
    let resting = run
        .steps
        .iter()
        .filter(at_rest)
        .map(|step| spot(step.target_mm, step.camera_mm));
    Scatter::new("Laser spot on the poster (Fig. 8)", "x, mm", "y, mm")
        .y_down()
        .series("while A moves", Style::Line, under_way)
        .series("while A rests (after 0.4 s)", Style::Points, resting)
}

/// Returns true if A moved within the last 0.4 s.
fn is_moving(run: &Run, time_s: f64) -> bool {
    let now = run
        .samples
        .iter()
        .rev()
        .find(|sample| sample.time_s <= time_s);
    let before = run
        .samples
        .iter()
        .rev()
        .find(|sample| sample.time_s <= time_s - 0.4);
    now.map(|sample| sample.target_mm) != before.map(|sample| sample.target_mm)
}

/// Returns the plain values of a run: true positions, measurements and marks.
fn curves(run: &Run, story: &Story) -> RunCurves {
    let points = |get: fn(&tracking::Sample) -> [f64; 3]| {
        let samples = run.samples.iter();
        samples
            .map(move |sample| (sample.time_s, get(sample)))
            .collect()
    };
    let mut marks = story.marks();
    // A rests a while after each move, so that a motion after rest is the start of a move.
    let moves = run.samples.windows(3).filter_map(|three| match three {
        [first, second, third] => {
            let is_start =
                first.target_mm == second.target_mm && second.target_mm != third.target_mm;
            is_start.then_some(second.time_s)
        }
        _ => None,
    });
    marks.extend(moves.map(|at_s| Mark::at(MarkKind::Note, at_s, "A begins a move")));
    marks.sort_by(|a, b| a.from.total_cmp(&b.from));
    RunCurves {
        target: points(|sample| sample.target_mm),
        stage: points(|sample| sample.camera_mm),
        measured: story.measured(),
        moments: story.moments(),
        marks,
        ..RunCurves::default()
    }
}

/// Returns settings and counts as name and value.
pub fn facts(settings: &Settings, run: &Run) -> Vec<(String, String)> {
    let latency: Vec<u32> = run
        .steps
        .iter()
        .filter_map(|step| Some(step.turn.outcome.estimate()?.latency_us))
        .collect();
    let worst = latency.iter().max().copied().unwrap_or(0);
    let pulses = |station: usize| {
        let pulses = run.pulses[station];
        let Pulses { commanded, counted } = pulses;
        let verdict = if pulses.agree() { "equal" } else { "NOT EQUAL" };
        match counted {
            Some(counted) => {
                format!("{commanded:?} commanded, {counted:?} counted at the pins: {verdict}")
            }
            None => format!("{commanded:?} commanded"),
        }
    };
    let sync = run
        .sync_bound_us
        .map(|bound_us| format!(", its clock known to {bound_us} us"));
    let cleared = run
        .cleared
        .map(|fault| format!("; its fault {} was cleared", fault.number()));
    let scene = settings.scene;
    let steps = list(run.steps_per_mm);
    let step = list(run.steps_per_mm.map(f64::recip));
    [
        (
            "frame sets",
            format!(
                "{} taken, {} used by the station",
                run.steps.len(),
                run.used()
            ),
        ),
        (
            "rate",
            format!(
                "{} per second, frame at the station {} ms after the image",
                settings.timing.frames_per_s,
                settings.timing.latency_us / 1000
            ),
        ),
        (
            "image to first step",
            format!("at most {:.1} ms", f64::from(worst) * 1e-3),
        ),
        (
            "poster",
            format!(
                "{} (seed {}), {} mm away, which the program is not told",
                settings.texture, settings.seed, scene.depth_mm
            ),
        ),
        (
            "cameras",
            format!(
                "the paper's Table 3, 320 x 240 px, blur {} px, noise {} grey levels",
                scene.blur_px, scene.noise_grey
            ),
        ),
        (
            "station B",
            [Some(run.station.clone()), sync, cleared]
                .into_iter()
                .flatten()
                .collect(),
        ),
        ("stage", format!("{steps} steps/mm: one step is {step} mm")),
        ("pulses of A", pulses(0)),
        ("pulses of B", pulses(1)),
    ]
    .into_iter()
    .map(|(name, value)| (name.to_owned(), value))
    .collect()
}

/// Returns a single number if all three are equal, otherwise the three.
fn list(axes: [f64; 3]) -> String {
    match axes {
        [x, y, z] if x == y && y == z => format!("{x}"),
        [x, y, z] => format!("{x} {y} {z}"),
    }
}

/// Returns the page of the closed-loop experiment.
pub fn page(settings: &Settings, run: &Run, story: &Story, provenance: &Provenance) -> Page {
    let page = Page::new(
        "Trinocular: tracking in closed loop",
        format!("the paper's section 4.3 on {}", run.station),
    )
    .section(
        "Five moves",
        "Station A carries a poster and moves it five times by (4, 4, 1) mm. Station B carries \
         three cameras, sees the poster only through them, and keeps its view of it constant. \
         Images are rendered through the paper's cameras; everything from the images to the \
         step pulses is the code that also runs with real hardware. Positions are counted from \
         edges at the step pins, or reported by the station if it is on a serial line.",
    )
    .table(stops("midpoint", &run.stops))
    .facts(&facts(settings, run))
    .plots([path(run, None).into(), laser(run).into()]);
    let page = curves(run, story).add_to(page, false);
    let whole = "`--record RUN.mcap` and `trinocular export` write all rows.";
    let page = page.section("Data", "");
    let page = add_table(page, "Measurements", &story.table(), whole);
    provenance.add_to(page)
}
