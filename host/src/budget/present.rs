//! The predictions as tables for the screen, and as a page.

use super::drive::AXES;
use super::{AtDepth, Verification};
use crate::report::{Cell, LinePlot, Page, Style, Table};

/// Returns all tables, in reading order.
pub fn tables(found: &Verification) -> Vec<Table> {
    let drive = found.drive.as_ref().map(|_| stage(found));
    let headroom = found.headroom.as_ref().map(|_| headroom(found));
    let vision = [sigma(found), rotation(found), pivots(found)];
    vision.into_iter().chain(drive).chain(headroom).collect()
}

/// Describes the target whose rotation is predicted.
fn target(found: &Verification) -> String {
    match found.settings.target_mm {
        Some([width, height]) => {
            format!("a flat target of {width} x {height} mm, or what all cameras see of it")
        }
        None => "a flat target that fills the view of all cameras".to_owned(),
    }
}

/// Returns sigma of the rotation over depth and number of points.
fn rotation(found: &Verification) -> Table {
    let caption = format!(
        "Predicted sigma of a rotation about x, y, z, degrees, of {}",
        target(found)
    );
    let mut table = Table::new(caption, ["depth, mm"]);
    let counts = found.settings.points.iter();
    table.columns.extend(counts.map(|n| format!("{n} points")));
    for at in found.table_depths() {
        let mut row = vec![Cell::number(at.depth_mm, 0)];
        let sigmas = at.rotation.iter().flat_map(|r| &r.rotation_sigma_deg);
        row.extend(sigmas.map(|sigma| vector(*sigma)));
        table.rows.push(row);
    }
    table
}

/// Returns sigma of the displacement of pivots over depth, for the largest number of points.
fn pivots(found: &Verification) -> Table {
    let points = found.settings.points.iter().enumerate();
    let (index, points) = points.max_by_key(|(_, n)| **n).unwrap_or((0, &0));
    let caption = format!(
        "Predicted sigma X Y Z of the displacement of a pivot, mm, with {points} points on {}",
        target(found)
    );
    let mut table = Table::new(caption, ["depth, mm", "without rotation"]);
    let named = found.depths.iter().find_map(|at| at.rotation.as_ref());
    let names = named.iter().flat_map(|rotation| &rotation.pivots);
    table.columns.extend(names.map(|pivot| pivot.name.clone()));
    for at in found.table_depths() {
        let mut row = vec![Cell::number(at.depth_mm, 0)];
        if let Some(rotation) = &at.rotation {
            let all = rotation.pivots.iter().map(|pivot| &pivot.sigma_mm);
            let all = [&rotation.without_rotation_sigma_mm].into_iter().chain(all);
            row.extend(all.map(|sigma| vector(sigma.get(index).copied().flatten())));
        }
        table.rows.push(row);
    }
    table
}

fn vector(sigma: Option<[f64; 3]>) -> Cell {
    sigma.map_or_else(|| Cell::right("-"), |sigma| Cell::vector(&sigma, 4, 7))
}

/// Returns sigma over depth and number of points.
fn sigma(found: &Verification) -> Table {
    let caption = format!(
        "Predicted sigma X Y Z of small displacements, mm, by number of points (flow noise {} px)",
        found.settings.noise_px
    );
    let mut table = Table::new(caption, ["depth, mm", "all see, mm"]);
    let counts = found.settings.points.iter();
    table.columns.extend(counts.map(|n| format!("{n} points")));
    for at in found.table_depths() {
        let view = match at.view_mm {
            Some(_) if at.sigma_mm.is_empty() => "not matched".to_owned(),
            Some([width, height]) => format!("{width:.0} x {height:.0}"),
            None => "nothing".to_owned(),
        };
        let mut row = vec![Cell::number(at.depth_mm, 0), Cell::right(view)];
        row.extend(at.sigma_mm.iter().map(|s| Cell::vector(s, 4, 7)));
        table.rows.push(row);
    }
    table
}

/// Returns step rates and stopping distances.
fn stage(found: &Verification) -> Table {
    let mut table = Table::new(
        "The stage",
        [
            "axis",
            "step, mm",
            "steps/s",
            "of",
            "stop, mm",
            "silent host, mm",
            "full speed from, mm",
            "travel, mm",
        ],
    );
    for (axis, name) in found.drive.iter().flat_map(|d| d.axes.iter().zip(AXES)) {
        table = table.row([
            Cell::text(name),
            Cell::number(axis.step_mm, 5),
            Cell::number(axis.steps_per_s, 0),
            Cell::right(axis.most_steps_per_s.to_string()),
            Cell::number(axis.stop_mm, 2),
            Cell::number(axis.silence_mm, 2),
            Cell::number(axis.full_speed_mm, 2),
            Cell::number(axis.travel_mm, 1),
        ]);
    }
    table
}

/// Returns the bits left in every format.
fn headroom(found: &Verification) -> Table {
    let [near, far] = found.settings.depth_range_mm;
    let caption =
        format!("Fixed point: largest size from {near} to {far} mm and up to 100 mm per axis");
    let columns = ["number", "format", "largest", "limit", "bits left"];
    let mut table = Table::new(caption, columns);
    for room in found.headroom.iter().flat_map(|headroom| &headroom.rooms) {
        let bits = Cell::number(room.bits_left, 2);
        table = table.row([
            Cell::text(room.name),
            Cell::text(room.format),
            Cell::right(significant(room.worst)),
            Cell::right(significant(room.limit)),
            if room.bits_left < 0.0 {
                bits.bad()
            } else {
                bits
            },
        ]);
    }
    table
}

/// Formats counts as whole numbers and fractions with four decimals.
fn significant(value: f64) -> String {
    if value >= 1000.0 {
        format!("{value:.0}")
    } else {
        format!("{value:.4}")
    }
}

/// Returns the names and values that belong to no table.
pub fn facts(found: &Verification) -> Vec<(&'static str, String)> {
    let [near, far] = found.settings.depth_range_mm;
    let volume = &found.volume;
    let mut facts = vec![
        (
            "working depth",
            match (volume.from_mm, volume.to_mm) {
                (Some(from), Some(to)) => format!("{from:.0} to {to:.0} mm"),
                _ => format!("none between {near:.0} and {far:.0} mm"),
            },
        ),
        (
            "working volume",
            format!(
                "{:.1} l in view of all cameras, {:.1} l of at least two",
                volume.all_see_l, volume.two_see_l
            ),
        ),
    ];
    if let Some(drive) = &found.drive {
        facts.push((
            "drivers",
            format!(
                "{} at {} words/s; the host may be silent for {} ms",
                drive.drivers.name, drive.drivers.word_rate_hz, drive.heartbeat_ms
            ),
        ));
    }
    if let Some(headroom) = &found.headroom {
        let mut text = format!("midpoint to {:.0} mm", headroom.midpoint_to_mm);
        if let Some(to) = headroom.closed_form_to_mm {
            text += &format!(", closed form to {to:.0} mm");
        }
        facts.push(("fixed point works", text));
    }
    facts
}

/// Returns the page: the tables, and sigma and view drawn over the depth.
pub fn page(rig: &str, found: &Verification) -> Page {
    let limits: Vec<(String, String)> = found
        .limitations
        .iter()
        .map(|limit| {
            let name = format!("{}: {}", limit.severity.name(), limit.name);
            (name, limit.text.clone())
        })
        .collect();
    let mut page = Page::new("Trinocular: what this rig can do", rig)
        .facts(&facts(found))
        .section("What limits it", "")
        .facts(&limits)
        .section(
            "Certainty",
            "Points spread evenly over what all cameras see, at one depth; small displacements.",
        )
        .plots(
            AXES.iter()
                .enumerate()
                .map(|(i, name)| over_depth(found, i, name).sized(516, 320).into()),
        )
        .plot(views(found));
    for table in tables(found) {
        page = page.table(table);
    }
    page
}

fn over_depth(found: &Verification, axis: usize, name: &str) -> LinePlot {
    let title = format!("Sigma {name}");
    let mut plot = LinePlot::new(title, "depth, mm", "sigma, mm").including(0.0);
    for (index, points) in found.settings.points.iter().enumerate() {
        let value = |at: &AtDepth| at.sigma_mm.get(index).map_or(f64::NAN, |s| s[axis]);
        let line = found.depths.iter().map(|at| [at.depth_mm, value(at)]);
        plot = plot.series(&format!("{points} points"), Style::Line, line);
    }
    plot
}

fn views(found: &Verification) -> LinePlot {
    let side = |i: usize| {
        (found.depths.iter()).map(move |at| [at.depth_mm, at.view_mm.map_or(0.0, |view| view[i])])
    };
    LinePlot::new("What all cameras see", "depth, mm", "mm")
        .series("width", Style::Line, side(0))
        .series("height", Style::Line, side(1))
        .including(0.0)
}
