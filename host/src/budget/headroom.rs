//! Headroom: distance of this rig's numbers from the limits of their fixed-point formats.
//!
//! Every sum is a mean over the points, so it is largest if all points lie at the one place that
//! makes it largest. The search covers the corners of the view common to all cameras, the depths of
//! the range, and displacements of up to the rated 100 mm in each direction along every axis, as
//! long as the depth stays in the range. The sums are the station's own ([`CentredSums`],
//! [`PairSums`]).
//!
//! Some numbers must not become too *small*: spread and determinant shrink with depth. For these,
//! the search finds the depth at which the station's own estimators refuse.

use serde::Serialize;
use trinocular_core::estimate::{Gate, closed_form, midpoint};
use trinocular_core::frame::message::MATRIX_BITS;
use trinocular_core::rig::Rig;
use trinocular_core::sums::View as PointView;
use trinocular_core::sums::centred::{CentredSums, FixedCentredSums};
use trinocular_core::sums::pair::{FixedPairSums, PairSums};

use trinocular_rig::rig_file::Stage;
use trinocular_vision::field_of_view::FieldOfView;

/// Rated displacement of the station along each axis, mm.
pub const RATED_MOVE_MM: f64 = 100.0;

/// Rated number of points of the station.
pub const RATED_POINTS: u32 = 4_000;

/// Headroom of one number on the wire or in the station.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Room {
    /// Name of the number in the code.
    pub name: &'static str,
    /// Fixed-point format of the number.
    pub format: &'static str,
    /// Largest magnitude over the rated range.
    pub worst: f64,
    /// Largest magnitude the format holds.
    pub limit: f64,
    /// Headroom in bits, `log2(limit/worst)`: negative if the number overflows.
    pub bits_left: f64,
}

impl Room {
    fn new(name: &'static str, format: &'static str, worst: f64, limit: f64) -> Self {
        Self {
            name,
            format,
            worst,
            limit,
            bits_left: (limit / worst).log2(),
        }
    }
}

/// Headroom of every number that could overflow or vanish.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Headroom {
    /// Numbers that must not become too large.
    pub rooms: Vec<Room>,
    /// Depth beyond which the station's midpoint refuses points that all lie in one place, mm.
    pub midpoint_to_mm: f64,
    /// The depth limit of the closed form, mm; `None` if the rig does not suit the closed form.
    pub closed_form_to_mm: Option<f64>,
}

/// Largest magnitudes found so far.
#[derive(Default)]
struct Worst {
    mean_mm: f64,
    shift_mm: f64,
    centroid: f64,
    first: f64,
    second: f64,
    flow_mm: f64,
}

impl Headroom {
    /// Computes the headroom of a rig whose targets stay between two depths, mm. Returns `None` if
    /// the cameras have no common view there.
    pub fn of(
        rig: &Rig,
        stage: Option<&Stage>,
        view: &FieldOfView,
        depth_range_mm: [f64; 2],
    ) -> Option<Self> {
        let worst = search(rig, view, depth_range_mm)?;
        let points = f64::from(RATED_POINTS);
        let freedom = 2.0 * points * rig.cameras.len() as f64 - 3.0;
        let nm = |mm: f64| mm * 1e6;
        let (i32_end, u16_end, u32_end) = (2f64.powi(31), 2f64.powi(16), 2f64.powi(32));
        let q = |bits: i32| 2f64.powi(31 - bits);
        let is_pairs = PairSums::new(rig).is_ok();
        let mut rooms = vec![
            Room::new("points", "u16", points, u16_end),
            Room::new("freedom", "u16, saturating", freedom, u16_end),
            Room::new("mean_nm", "i32, nm", nm(worst.mean_mm), i32_end),
            Room::new(
                "centroid",
                "Q2.29",
                worst.centroid,
                q(FixedCentredSums::CENTROID_BITS),
            ),
            // T_z times the spread's mantissa, which is below 1.
            Room::new(
                "coupling",
                "Q28.3, nm",
                nm(RATED_MOVE_MM),
                q(FixedCentredSums::COUPLING_BITS),
            ),
            Room::new("residual_nm", "u32, nm", nm(worst.shift_mm), u32_end),
            Room::new("displacement_nm", "i32, nm", nm(RATED_MOVE_MM), i32_end),
        ];
        if is_pairs {
            rooms.extend([
                Room::new("a1 b1", "Q1.30", worst.first, q(FixedPairSums::FIRST_BITS)),
                Room::new(
                    "a2 a3 b2 b3",
                    "Q2.29",
                    worst.second,
                    q(FixedPairSums::SECOND_BITS),
                ),
                Room::new(
                    "d1 d2 d3 d4",
                    "Q7.24, mm",
                    worst.flow_mm,
                    q(FixedPairSums::FLOW_BITS),
                ),
                Room::new(
                    "displacement of the closed form",
                    "Q7.24, mm",
                    RATED_MOVE_MM,
                    q(24),
                ),
            ]);
        }
        if let Some(stage) = stage {
            let largest = |values: &mut dyn Iterator<Item = f64>| {
                values.map(f64::abs).fold(f64::MIN_POSITIVE, f64::max)
            };
            let matrix = largest(&mut stage.matrix.into_iter().flatten());
            let travel = largest(
                &mut (0..3).flat_map(|i| stage.travel_mm[i].map(|end| end * stage.steps_per_mm[i])),
            );
            rooms.push(Room::new("matrix", "Q2.29", matrix, q(MATRIX_BITS as i32)));
            rooms.push(Room::new("travel", "±2^29 steps", travel, 2f64.powi(29)));
            rooms.extend(distances(stage));
        }
        Some(Self {
            rooms,
            midpoint_to_mm: farthest(|depth| midpoint_works(rig, view, depth)),
            closed_form_to_mm: is_pairs
                .then(|| farthest(|depth| closed_form_works(rig, view, depth))),
        })
    }
}

/// Returns the headroom of the stage's distances in steps, for all distances that the station
/// checks.
fn distances(stage: &Stage) -> impl Iterator<Item = Room> {
    let finest = stage.steps_per_mm.into_iter().fold(0.0, f64::max);
    let gate_mm = f64::from(Gate::DEFAULT.max_displacement_nm) * 1e-6;
    let seen = (0..3).map(|i| {
        let gain: f64 = stage.matrix[i].iter().map(|m| m.abs()).sum();
        gain * gate_mm * stage.steps_per_mm[i]
    });
    let care = &stage.care;
    let watched = [care.largest_error_mm, care.largest_unseen_mm];
    let watched = watched.into_iter().flatten().fold(0.0, f64::max);
    let homes = (0..3).filter_map(|i| Some((i, care.home[i]?)));
    let search = homes.clone().map(|(i, _)| {
        let [low, high] = stage.travel_mm[i];
        ((high - low) * 1.25 + care.back_off_mm) * stage.steps_per_mm[i]
    });
    let place = homes.map(|(i, home)| home.position_mm.abs() * stage.steps_per_mm[i]);
    let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let end = 2f64.powi(29);
    let window = care.unknown_window_mm * finest;
    [
        (
            "displacement in steps",
            "±2^29 steps",
            largest(&mut seen.into_iter()),
            end,
        ),
        ("window of an unknown position", "±2^29 steps", window, end),
        ("watched distances", "±2^29 steps", watched * finest, end),
        (
            "search for a home switch",
            "±2^29 steps",
            largest(&mut search.into_iter()),
            end,
        ),
        (
            "home position",
            "±2^28 steps",
            largest(&mut place.into_iter()),
            end / 2.0,
        ),
    ]
    .into_iter()
    .filter(|(_, _, worst, _)| *worst > 0.0)
    .map(|(name, format, worst, limit)| Room::new(name, format, worst, limit))
}

fn search(rig: &Rig, view: &FieldOfView, [near, far]: [f64; 2]) -> Option<Worst> {
    const DEPTHS: i32 = 24;
    let mut worst = Worst::default();
    let mut seen = false;
    let least = near.max(view.nearest_common().0 * (1.0 + 1e-9));
    let far = far.min(view.farthest_common().0 * (1.0 - 1e-9));
    if least >= far {
        return None;
    }
    for step in 0..=DEPTHS {
        let depth = least * (far / least).powf(f64::from(step) / f64::from(DEPTHS));
        let Some(common) = view.common(depth) else {
            continue;
        };
        seen = true;
        for [x, y] in common.corners_and_middle() {
            for move_mm in moves() {
                let after = [x + move_mm[0], y + move_mm[1], depth + move_mm[2]];
                if (near..=far).contains(&after[2]) {
                    worst.meet(rig, [x, y, depth], after);
                }
            }
        }
    }
    seen.then_some(worst)
}

fn moves() -> impl Iterator<Item = [f64; 3]> {
    let ends = [-RATED_MOVE_MM, 0.0, RATED_MOVE_MM];
    ends.into_iter()
        .flat_map(move |x| ends.map(|y| [x, y]))
        .flat_map(move |[x, y]| ends.map(|z| [x, y, z]))
}

fn views(rig: &Rig, from: [f64; 3], to: [f64; 3]) -> Vec<PointView> {
    let seen = |camera: &trinocular_core::rig::Camera, at: [f64; 3]| {
        [0, 1].map(|i| (at[i] - camera.offset_mm[i]) / at[2])
    };
    rig.cameras
        .iter()
        .map(|camera| PointView {
            start: seen(camera, from),
            end: seen(camera, to),
        })
        .collect()
}

fn grow(worst: &mut f64, values: impl IntoIterator<Item = f64>) {
    for value in values {
        *worst = worst.max(value.abs());
    }
}

impl Worst {
    /// Takes in a frame whose points are all in one place.
    fn meet(&mut self, rig: &Rig, from: [f64; 3], to: [f64; 3]) {
        let views = views(rig, from, to);
        if let Some(sums) = centred(rig, &views) {
            grow(&mut self.mean_mm, sums.mean_mm);
            grow(&mut self.centroid, sums.centroid);
            // No residual is larger than the largest shift itself.
            let shift = |view: &PointView| {
                let [x, y] = view.flow();
                x.hypot(y) * 0.5 * (from[2] + to[2])
            };
            grow(&mut self.shift_mm, views.iter().map(shift));
        }
        if let Some(pair) = pair(rig, &views) {
            grow(&mut self.first, [pair.a1, pair.b1]);
            grow(&mut self.second, [pair.a2, pair.a3, pair.b2, pair.b3]);
            grow(&mut self.flow_mm, [pair.d1, pair.d2, pair.d3, pair.d4]);
        }
    }
}

fn centred(rig: &Rig, views: &[PointView]) -> Option<CentredSums> {
    let mut sums = CentredSums::new(rig).ok()?;
    sums.add(views).then_some(sums)
}

fn pair(rig: &Rig, views: &[PointView]) -> Option<PairSums> {
    let mut sums = PairSums::new(rig).ok()?;
    let [left, middle, right] = views else {
        return None;
    };
    sums.add([*left, *middle, *right]);
    Some(sums)
}

/// Returns a point in the middle of the common view that does not move, so that only depth affects
/// its sums.
fn at_rest(rig: &Rig, view: &FieldOfView, depth: f64) -> Option<Vec<PointView>> {
    let [.., [x, y]] = view.common(depth)?.corners_and_middle();
    let at = [x, y, depth];
    Some(views(rig, at, at))
}

fn midpoint_works(rig: &Rig, view: &FieldOfView, depth: f64) -> bool {
    let sums = at_rest(rig, view, depth).and_then(|views| centred(rig, &views));
    let fixed = sums.and_then(|sums| sums.quantise().ok());
    fixed.is_some_and(|fixed| midpoint::solve_fixed(&fixed).is_ok())
}

fn closed_form_works(rig: &Rig, view: &FieldOfView, depth: f64) -> bool {
    let sums = at_rest(rig, view, depth).and_then(|views| pair(rig, &views));
    let fixed = sums.and_then(|sums| sums.quantise().ok());
    fixed.is_some_and(|fixed| closed_form::solve_fixed(&fixed).is_ok())
}

/// Returns the largest depth that works, mm, between 10 mm and 1,000 m: scans from the far end for
/// the first depth that works, then bisects.
fn farthest(works: impl Fn(f64) -> bool) -> f64 {
    let (nearest, farthest) = (10.0, 1e6);
    let (mut low, mut high) = (farthest, farthest);
    while !works(low) {
        high = low;
        low /= 1.2;
        if low < nearest {
            return 0.0;
        }
    }
    while high - low > 0.5 {
        let middle = 0.5 * (low + high);
        if works(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

#[cfg(test)]
mod tests;
