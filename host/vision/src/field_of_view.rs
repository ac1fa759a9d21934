//! Fields of view of a rig's cameras: at one depth, and the space between two depths.
//!
//! A camera without lens distortion sees the rectangle `c + Z [ξ_low, ξ_high]` at depth `Z`. With
//! distortion the border is bent; the largest rectangle within it is used, which understates the
//! field of view a little. All cameras are parallel, so the common fields of view are intersections
//! of rectangles with parallel sides.

use trinocular_core::rig::{Camera, Rig};

/// Upright rectangle at one depth, in mm right and down of the rig's origin, or of dimensionless
/// directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Left and upper edge.
    pub low: [f64; 2],
    /// Right and lower edge.
    pub high: [f64; 2],
}

impl Rectangle {
    /// Returns width and height.
    pub fn sides(&self) -> [f64; 2] {
        [0, 1].map(|i| self.high[i] - self.low[i])
    }

    /// Returns the area.
    pub fn area(&self) -> f64 {
        let [width, height] = self.sides();
        width * height
    }

    /// Returns the four corners and the middle.
    pub fn corners_and_middle(&self) -> [[f64; 2]; 5] {
        let Self { low, high } = *self;
        let middle = [0, 1].map(|i| 0.5 * (low[i] + high[i]));
        [low, high, [low[0], high[1]], [high[0], low[1]], middle]
    }

    fn contains(&self, at: [f64; 2]) -> bool {
        (0..2).all(|i| (self.low[i]..=self.high[i]).contains(&at[i]))
    }
}

/// Fields of view of a rig's cameras.
///
/// ```
/// use trinocular_core::rig::Rig;
/// use trinocular_vision::field_of_view::FieldOfView;
///
/// let view = FieldOfView::new(&Rig::paper(), 0.0);
/// let common = view.common(850.0).expect("all cameras see a part of the plane at 850 mm");
/// // One camera sees 505 mm of it; the outer cameras are 138 mm apart.
/// assert!((300.0..400.0).contains(&common.sides()[0]));
/// assert!(view.common(100.0).is_none());
/// ```
#[derive(Clone, Debug)]
pub struct FieldOfView {
    /// Position in mm and directions in view, per camera.
    cameras: Vec<([f64; 2], Rectangle)>,
}

impl FieldOfView {
    /// Creates the fields of view of all cameras of `rig`, without `margin_px` along the border of
    /// each image, because tracking needs a window around each point.
    pub fn new(rig: &Rig, margin_px: f64) -> Self {
        let cameras = rig.cameras.iter();
        Self {
            cameras: cameras
                .map(|camera| {
                    let directions = directions(camera, rig.image_size_px, margin_px);
                    (camera.offset_mm, directions)
                })
                .collect(),
        }
    }

    fn at(&self, depth_mm: f64) -> impl Iterator<Item = Rectangle> + '_ {
        self.cameras.iter().map(move |(offset, view)| Rectangle {
            low: [0, 1].map(|i| offset[i] + depth_mm * view.low[i]),
            high: [0, 1].map(|i| offset[i] + depth_mm * view.high[i]),
        })
    }

    /// Returns the common field of view of all cameras at `depth_mm`, mm; `None` if there is none.
    pub fn common(&self, depth_mm: f64) -> Option<Rectangle> {
        let everything = Rectangle {
            low: [f64::NEG_INFINITY; 2],
            high: [f64::INFINITY; 2],
        };
        let common = self
            .at(depth_mm)
            .fold(everything, |common, view| Rectangle {
                low: [0, 1].map(|i| common.low[i].max(view.low[i])),
                high: [0, 1].map(|i| common.high[i].min(view.high[i])),
            });
        let is_open = common.sides().iter().all(|side| *side > 0.0);
        is_open.then_some(common)
    }

    /// Computes the area at `depth_mm` that at least `count` cameras see, mm².
    pub fn area_seen_by(&self, count: usize, depth_mm: f64) -> f64 {
        let views: Vec<Rectangle> = self.at(depth_mm).collect();
        // Between neighbouring edges, each camera sees all or nothing.
        let edges = [0, 1].map(|i| {
            let mut edges: Vec<f64> = views.iter().flat_map(|v| [v.low[i], v.high[i]]).collect();
            edges.sort_by(f64::total_cmp);
            edges
        });
        let mut area = 0.0;
        for x in edges[0].windows(2) {
            for y in edges[1].windows(2) {
                let middle = [0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])];
                let seen_by = views.iter().filter(|view| view.contains(middle)).count();
                if seen_by >= count {
                    area += (x[1] - x[0]) * (y[1] - y[0]);
                }
            }
        }
        area
    }

    /// Computes the volume between two depths that at least `count` cameras see, mm³.
    pub fn volume_seen_by(&self, count: usize, [near, far]: [f64; 2]) -> f64 {
        // Simpson's rule is exact except for strips in which two edges change places.
        const STRIPS: u32 = 500;
        let strip = (far - near) / f64::from(STRIPS);
        let area = |at: f64| self.area_seen_by(count, near + at * strip);
        (0..STRIPS)
            .map(f64::from)
            .map(|at| strip / 6.0 * (area(at) + 4.0 * area(at + 0.5) + area(at + 1.0)))
            .sum()
    }

    /// Returns the depth from which on all cameras have a common field of view, mm (infinite if
    /// they never have one), and the two cameras that determine it.
    pub fn nearest_common(&self) -> (f64, [usize; 2]) {
        let mut nearest = (0.0, [0, 0]);
        for (a, (from, view)) in self.cameras.iter().enumerate() {
            for (b, (to, other)) in self.cameras.iter().enumerate() {
                for i in 0..2 {
                    // from + Z low < to + Z high
                    let (gap, opening) = (from[i] - to[i], other.high[i] - view.low[i]);
                    let depth = match (gap, opening) {
                        (gap, opening) if gap >= 0.0 && opening <= 0.0 => f64::INFINITY,
                        (gap, opening) if gap > 0.0 => gap / opening,
                        _ => 0.0,
                    };
                    if depth > nearest.0 {
                        nearest = (depth, [a.min(b), a.max(b)]);
                    }
                }
            }
        }
        nearest
    }

    /// Returns the depth up to which all cameras have a common field of view, mm, and the two
    /// cameras that determine it: those whose fields of view cross and part again. Infinite if none
    /// do.
    pub fn farthest_common(&self) -> (f64, [usize; 2]) {
        let mut farthest = (f64::INFINITY, [0, 0]);
        for (a, (from, view)) in self.cameras.iter().enumerate() {
            for (b, (to, other)) in self.cameras.iter().enumerate() {
                for i in 0..2 {
                    let (gap, opening) = (from[i] - to[i], other.high[i] - view.low[i]);
                    if gap < 0.0 && opening < 0.0 && gap / opening < farthest.0 {
                        farthest = (gap / opening, [a.min(b), a.max(b)]);
                    }
                }
            }
        }
        farthest
    }
}

/// Returns the largest rectangle of directions within a camera's image.
fn directions(camera: &Camera, size_px: [u32; 2], margin_px: f64) -> Rectangle {
    const STEPS: u32 = 32;
    let [right, bottom] = size_px.map(|side| f64::from(side) - 1.0 - margin_px);
    let mut within = Rectangle {
        low: [f64::NEG_INFINITY; 2],
        high: [f64::INFINITY; 2],
    };
    for step in 0..=STEPS {
        let share = f64::from(step) / f64::from(STEPS);
        let along = |end: f64| margin_px + share * (end - margin_px);
        let (x, y) = (along(right), along(bottom));
        let direction = |pixel: [f64; 2], i: usize| camera.normalise(pixel)[i];
        within.low[0] = within.low[0].max(direction([margin_px, y], 0));
        within.low[1] = within.low[1].max(direction([x, margin_px], 1));
        within.high[0] = within.high[0].min(direction([right, y], 0));
        within.high[1] = within.high[1].min(direction([x, bottom], 1));
    }
    within
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_rig::random::Random;

    fn sees(rig: &Rig, margin_px: f64, point_mm: [f64; 3]) -> usize {
        let inside = |camera: &&Camera| {
            let pixel = camera.project(point_mm);
            let within = |i: usize| {
                let last = f64::from(rig.image_size_px[i]) - 1.0 - margin_px;
                (margin_px..=last).contains(&pixel[i])
            };
            within(0) && within(1)
        };
        rig.cameras.iter().filter(inside).count()
    }

    /// Tests against random points in a box, each projected into every camera.
    #[test]
    fn areas_match_random_projections() {
        let rig = Rig::paper();
        let view = FieldOfView::new(&rig, 12.0);
        let mut random = Random::new(5, 0);
        let (count, depths) = (200_000, [400.0, 1600.0]);
        let (mut all, mut two) = (0, 0);
        for _ in 0..count {
            let point = [
                random.between(-700.0, 700.0),
                random.between(-500.0, 500.0),
                random.between(depths[0], depths[1]),
            ];
            let seen = sees(&rig, 12.0, point);
            all += usize::from(seen == 3);
            two += usize::from(seen >= 2);
            let common = view.common(point[2]).unwrap();
            assert_eq!(common.contains([point[0], point[1]]), seen == 3);
        }
        let thrown = 1400.0 * 1000.0 * 1200.0 / f64::from(count);
        for (hits, of) in [(all, 3), (two, 2)] {
            let ratio = view.volume_seen_by(of, depths) / (thrown * hits as f64);
            assert!((ratio - 1.0).abs() < 0.015, "{of} cameras: {ratio}");
        }
        assert!(two > all);
    }

    #[test]
    fn nothing_common_before_nearest() {
        let view = FieldOfView::new(&Rig::paper(), 0.0);
        let (nearest, pair) = view.nearest_common();
        assert_eq!(pair, [0, 2]);
        assert!(view.common(nearest - 0.01).is_none());
        assert!(view.common(nearest + 0.01).is_some());
        // 138 mm between the outer cameras, 0.60 of the depth in view of each.
        assert!((200.0..260.0).contains(&nearest), "{nearest}");
    }

    #[test]
    fn diverging_cameras_share_nothing() {
        let mut rig = Rig::paper();
        rig.image_size_px = [320, 30];
        rig.cameras[2].principal_px[1] = -1000.0;
        let view = FieldOfView::new(&rig, 0.0);
        assert_eq!(view.nearest_common().0, f64::INFINITY);
        assert!(view.common(1e6).is_none());
        assert!(view.area_seen_by(2, 1000.0) > 0.0);
        assert_eq!(view.area_seen_by(3, 1000.0), 0.0);
    }

    /// Tests outer cameras turned inwards so far that their fields of view cross before the middle
    /// camera's and part behind it.
    #[test]
    fn crossing_views_part_again() {
        let mut rig = Rig::paper();
        rig.cameras[0].principal_px[0] = -40.0;
        rig.cameras[2].principal_px[0] = 359.0;
        let view = FieldOfView::new(&rig, 12.0);
        let (farthest, pair) = view.farthest_common();
        assert_eq!(pair, [0, 2]);
        // 138 mm between them, closed by 52 px of 533.16 and of 534.55 px.
        let expected = 138.0 / (52.0 / 533.16 + 52.0 / 534.55);
        assert!((farthest - expected).abs() < 1e-6, "{farthest}");
        let (nearest, _) = view.nearest_common();
        assert!(nearest < 250.0, "{nearest}");
        for (depth, is_common) in [
            (nearest - 0.01, false),
            (nearest + 0.01, true),
            (farthest - 0.01, true),
            (farthest + 0.01, false),
        ] {
            assert_eq!(view.common(depth).is_some(), is_common, "{depth}");
        }
        let parallel = FieldOfView::new(&Rig::paper(), 12.0);
        assert_eq!(parallel.farthest_common().0, f64::INFINITY);
    }

    #[test]
    fn distortion_never_overstates_view() {
        let mut rig = Rig::paper();
        for camera in &mut rig.cameras {
            camera.distortion = [-0.3, 0.1, 0.001, -0.001, 0.0];
        }
        let common = FieldOfView::new(&rig, 5.0).common(900.0).unwrap();
        for step in 0..=20 {
            let share = f64::from(step) / 20.0;
            let [x, y] = [0, 1].map(|i| common.low[i] + share * (common.high[i] - common.low[i]));
            let [low, high] = [common.low, common.high];
            for [x, y] in [[x, low[1]], [x, high[1]], [low[0], y], [high[0], y]] {
                // Slightly inwards, because the border itself depends on rounding.
                let inwards = |at: f64, i: usize| at + 1e-3 * (0.5 * (low[i] + high[i]) - at);
                assert_eq!(sees(&rig, 5.0, [inwards(x, 0), inwards(y, 1), 900.0]), 3);
            }
        }
    }
}
