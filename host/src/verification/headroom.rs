//! How far the numbers of this rig stay from the ends of their fixed-point formats.
//!
//! Every sum is a mean over the points, so it is largest for points that all lie where one point would make it largest. That is searched for over the
//! corners of what all cameras see, the depths of the range, and displacements of up to the rated 100 mm each way along every axis, as long as the depth
//! stays in the range. The sums are the station's own ([`CentredSums`], [`PairSums`]).
//!
//! Some numbers must not become too *small*: spread and determinant shrink with depth. For these the depth is searched at which the station's
//! own estimators refuse.

use serde::Serialize;
use shared::estimate::{closed_form, midpoint};
use shared::frame::message::MATRIX_BITS;
use shared::rig::Rig;
use shared::sums::View as PointView;
use shared::sums::centred::{CentredSums, FixedCentredSums};
use shared::sums::pair::{FixedPairSums, PairSums};

use super::view::View;
use crate::rig_file::Stage;

/// Largest displacement along each axis that the station is rated for, mm.
pub const RATED_MOVE_MM: f64 = 100.0;

/// Most points it is rated for.
pub const RATED_POINTS: u32 = 4_000;

/// One number of the wire or the station.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Room {
    /// Its name in the code.
    pub name: &'static str,
    /// Its format.
    pub format: &'static str,
    /// Largest size over the rated range.
    pub worst: f64,
    /// Largest size the format holds.
    pub limit: f64,
    /// `log2(limit/worst)`: negative if it overflows.
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

/// Everything that could overflow or vanish.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Headroom {
    /// The numbers that must not become too large.
    pub rooms: Vec<Room>,
    /// Depth beyond which the station's midpoint finds no displacement in points that all lie in one place, mm.
    pub midpoint_to_mm: f64,
    /// The same of the closed form; `None` if it is not made for this rig.
    pub closed_form_to_mm: Option<f64>,
}

/// Largest sizes met so far.
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
    /// Of a rig whose targets stay between two depths, mm. `None` if the cameras have nothing in common there.
    pub fn of(
        rig: &Rig,
        stage: Option<&Stage>,
        view: &View,
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
        }
        Some(Self {
            rooms,
            midpoint_to_mm: farthest(|depth| midpoint_works(rig, view, depth)),
            closed_form_to_mm: is_pairs
                .then(|| farthest(|depth| closed_form_works(rig, view, depth))),
        })
    }
}

fn search(rig: &Rig, view: &View, [near, far]: [f64; 2]) -> Option<Worst> {
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
    let seen = |camera: &shared::rig::Camera, at: [f64; 3]| {
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
    /// A frame whose points are all at one place.
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

/// A point in the middle of the common view that does not move: what remains is what depth does.
fn at_rest(rig: &Rig, view: &View, depth: f64) -> Option<Vec<PointView>> {
    let [.., [x, y]] = view.common(depth)?.corners_and_middle();
    let at = [x, y, depth];
    Some(views(rig, at, at))
}

fn midpoint_works(rig: &Rig, view: &View, depth: f64) -> bool {
    let sums = at_rest(rig, view, depth).and_then(|views| centred(rig, &views));
    let fixed = sums.and_then(|sums| sums.quantise().ok());
    fixed.is_some_and(|fixed| midpoint::solve_fixed(&fixed).is_ok())
}

fn closed_form_works(rig: &Rig, view: &View, depth: f64) -> bool {
    let sums = at_rest(rig, view, depth).and_then(|views| pair(rig, &views));
    let fixed = sums.and_then(|sums| sums.quantise().ok());
    fixed.is_some_and(|fixed| closed_form::solve_fixed(&fixed).is_ok())
}

/// The largest depth that works, mm, between 10 mm and 1,000 m: from the far end down to the first that does, then halved.
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
mod tests {
    use super::*;
    use crate::random::Random;
    use shared::rig::Camera;

    const RANGE_MM: [f64; 2] = [300.0, 2000.0];

    fn room<'a>(headroom: &'a Headroom, name: &str) -> &'a Room {
        headroom.rooms.iter().find(|r| r.name == name).unwrap()
    }

    fn of(rig: &Rig) -> Headroom {
        Headroom::of(rig, None, &View::new(rig, 0.0), RANGE_MM).unwrap()
    }

    /// Random frames of the rated range, quantised: none comes nearer to the end of its format than stated, and some come near.
    #[test]
    fn no_frame_of_the_rated_range_is_worse_than_the_worst() {
        let rig = Rig::paper();
        let (headroom, view) = (of(&rig), View::new(&rig, 0.0));
        let mut random = Random::new(3, 0);
        let names = [
            "mean_nm",
            "centroid",
            "coupling",
            "a1 b1",
            "a2 a3 b2 b3",
            "d1 d2 d3 d4",
        ];
        let mut least = names.map(|_| f64::INFINITY);
        for _ in 0..3000 {
            let mut centred = CentredSums::new(&rig).unwrap();
            let mut pair = PairSums::new(&rig).unwrap();
            let moved = [0, 1, 2].map(|_| random.between(-100.0, 100.0));
            for _ in 0..random.below(8) + 1 {
                let depth = random.between(300.0, 2000.0);
                if !(300.0..=2000.0).contains(&(depth + moved[2])) {
                    continue;
                }
                let common = view.common(depth).unwrap();
                let [x, y] = [0, 1].map(|i| random.between(common.low[i], common.high[i]));
                let to = [x + moved[0], y + moved[1], depth + moved[2]];
                let views = views(&rig, [x, y, depth], to);
                assert!(centred.add(&views));
                pair.add([views[0], views[1], views[2]]);
            }
            let (Ok(c), Ok(p)) = (centred.quantise(), pair.quantise()) else {
                continue; // no point was left
            };
            let groups: [&[i32]; 6] = [
                &c.mean_nm,
                &c.centroid,
                &[c.coupling],
                &[p.a1, p.b1],
                &[p.a2, p.a3, p.b2, p.b3],
                &[p.d1, p.d2, p.d3, p.d4],
            ];
            for (least, words) in least.iter_mut().zip(groups) {
                let largest = words.iter().map(|w| w.unsigned_abs()).max().unwrap();
                *least = least.min((2f64.powi(31) / f64::from(largest)).log2());
            }
        }
        for (name, met) in names.into_iter().zip(least) {
            let stated = room(&headroom, name).bits_left;
            assert!(
                met >= stated - 1e-3 && met < stated + 1.5,
                "{name}: {met} bits left, stated {stated}"
            );
        }
    }

    #[test]
    fn the_papers_rig_has_room_everywhere() {
        let headroom = of(&Rig::paper());
        assert!(headroom.rooms.iter().all(|room| room.bits_left > 0.0));
        // As the closed form's own documentation says of 70 and 68 mm.
        let to = headroom.closed_form_to_mm.unwrap();
        assert!((2100.0..2300.0).contains(&to), "{to}");
        assert!(headroom.midpoint_to_mm > 10_000.0);
    }

    #[test]
    fn a_wide_rig_overflows_by_name_and_a_narrow_one_ends_early() {
        let camera = |x| Camera::ideal([400.0; 2], [960.0, 540.0], [x, 0.0]);
        let wide = Rig {
            image_size_px: [1920, 1080],
            cameras: [-500.0, 0.0, 500.0].into_iter().map(camera).collect(),
        };
        let headroom = of(&wide);
        assert!(room(&headroom, "d1 d2 d3 d4").bits_left < 0.0);
        let narrow = Rig {
            image_size_px: [1920, 1080],
            cameras: [-10.0, 0.0, 10.0].into_iter().map(camera).collect(),
        };
        assert!(of(&narrow).closed_form_to_mm.unwrap() < 400.0);
    }

    #[test]
    fn other_rigs_have_no_pair_sums() {
        let mut two = Rig::paper();
        two.cameras.pop();
        let headroom = of(&two);
        assert_eq!(headroom.closed_form_to_mm, None);
        assert!(headroom.rooms.iter().all(|room| room.name != "a1 b1"));
    }
}
