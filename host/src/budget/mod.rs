//! Error budget: predicts accuracy and limits of a rig from its description alone.
//!
//! - [`field_of_view`](trinocular_vision::field_of_view): common view of all cameras and of two;
//! - [`sigma`]: standard deviation of a displacement per axis, over depth and number of points;
//! - [`rotation`]: standard deviation of a rotation, and of the displacement of a pivot with it;
//! - [`drive`]: step rates and stopping distances of the stage;
//! - [`headroom`]: distance of all numbers from the limits of their fixed-point formats;
//! - [`limitation`]: the limits of the rig, by name;
//! - [`present`]: all predictions as tables, figures and page.
//!
//! Nothing here is measured. The tests compare every prediction with a simulation.

pub mod drive;
pub mod headroom;
pub mod limitation;
pub mod present;
pub mod rotation;
pub mod sigma;

use serde::Serialize;

use drive::Drive;
use headroom::Headroom;
use limitation::Limitation;
use rotation::RotationBudget;
use sigma::{MARGIN_PX, Predictor};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::field_of_view::{FieldOfView, Rectangle};
use trinocular_vision::matching::geometry::RigGeometry;
use trinocular_vision::matching::stereo::matched_depths_mm;

/// Conditions of the prediction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Standard deviation of each component of a point's flow in one camera, px.
    pub noise_px: f64,
    /// Numbers of points, each at least 1.
    pub points: Vec<u32>,
    /// Nearest and farthest depth of the target, mm.
    pub depth_range_mm: [f64; 2],
    /// Width and height of the flat target whose rotation is predicted, mm; `None` for one that
    /// fills the common view.
    pub target_mm: Option<[f64; 2]>,
}

impl Default for Settings {
    /// Returns the settings for the rated depths. With noise of 2 grey levels, sharp images have
    /// 0.011 to 0.012 px of flow noise and soft ones 0.03 to 0.054 px (`tests/verify.rs` prints
    /// it).
    fn default() -> Self {
        Self {
            noise_px: 0.03,
            points: vec![25, 50, 100, 200],
            depth_range_mm: [300.0, 2000.0],
            target_mm: None,
        }
    }
}

impl Settings {
    /// Returns the target's rectangle in the middle of the view, and not beyond it.
    fn target(&self, view: &Rectangle) -> Rectangle {
        let sides = view.sides();
        let wanted = self.target_mm.unwrap_or(sides);
        let half = [0, 1].map(|i| 0.5 * wanted[i].min(sides[i]));
        let middle = [0, 1].map(|i| 0.5 * (view.low[i] + view.high[i]));
        Rectangle {
            low: [0, 1].map(|i| middle[i] - half[i]),
            high: [0, 1].map(|i| middle[i] + half[i]),
        }
    }
}

/// Predictions for one depth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtDepth {
    /// Depth, mm.
    pub depth_mm: f64,
    /// True if the depth is round enough for a row of the table.
    #[serde(skip)]
    pub is_row: bool,
    /// Width and height of the view common to all cameras, mm; `None` if they have none.
    pub view_mm: Option<[f64; 2]>,
    /// Area that at least two cameras see, mm².
    pub two_see_mm2: f64,
    /// Standard deviation per axis, mm, for each of [`Settings::points`]. Empty without a common
    /// view, and at depths where no points are matched.
    pub sigma_mm: Vec<[f64; 3]>,
    /// Largest number of points that fit into the common view; more points gain nothing.
    pub room_for: u32,
    /// Variance inflation factor for each of [`Settings::points`], at least 1.
    pub widening: Vec<f64>,
    /// Predictions for a flat target whose rotation is estimated; `None` where `sigma_mm` is empty.
    pub rotation: Option<RotationBudget>,
}

/// Space in which targets can be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Volume {
    /// Smallest depth within the range, mm, with a common view and matched points; `None` if there
    /// is none.
    pub from_mm: Option<f64>,
    /// Largest depth within the range, mm, with a common view and matched points; `None` with
    /// `from_mm`.
    pub to_mm: Option<f64>,
    /// Volume in the view of all cameras, litres.
    pub all_see_l: f64,
    /// Volume in the view of at least two cameras, litres.
    pub two_see_l: f64,
}

/// All predictions.
///
/// ```
/// use trinocular::budget::{Settings, Verification};
/// use trinocular_rig::rig_file::RigFile;
///
/// let predicted = Verification::of(&RigFile::paper(), Settings::default());
/// let at = |mm: f64| predicted.depths.iter().find(|row| row.depth_mm >= mm).unwrap();
/// // The farther the target, the less certain its distance.
/// let sigma_z = |mm: f64| at(mm).sigma_mm[0][2];
/// assert!(sigma_z(1_500.0) > sigma_z(800.0) && sigma_z(800.0) > 0.0);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verification {
    /// Conditions of the predictions.
    pub settings: Settings,
    /// Predictions over the range of depths, near to far.
    pub depths: Vec<AtDepth>,
    /// Volume in view.
    pub volume: Volume,
    /// Predictions for the stage; `None` if the rig has none.
    pub drive: Option<Drive>,
    /// Headroom of the fixed-point formats; `None` if the cameras have no common view.
    pub headroom: Option<Headroom>,
    /// Limits of the rig, the worst first.
    pub limitations: Vec<Limitation>,
}

/// Number of depths between two rows of the table, for the plots.
const BETWEEN_ROWS: u32 = 6;

impl Verification {
    /// Predicts the accuracy and the limits of `rig`.
    pub fn of(rig: &RigFile, settings: Settings) -> Self {
        let view = FieldOfView::new(&rig.rig, MARGIN_PX);
        let [near, far] = settings.depth_range_mm;
        // Cameras in one place give no matches.
        let matched = RigGeometry::new(&rig.rig).map_or([far, near], |g| matched_depths_mm(&g));
        let depths = depths(near, far)
            .into_iter()
            .map(|(depth, is_row)| at_depth(rig, &view, &settings, matched, (depth, is_row)))
            .collect();
        let (nearest, _) = view.nearest_common();
        let (farthest, _) = view.farthest_common();
        let [from, to] = [near.max(matched[0]), far.min(matched[1]).min(farthest)];
        let volume_l = |count| match from < to {
            true => 1e-6 * view.volume_seen_by(count, [from, to]),
            false => 0.0,
        };
        let from = from.max(nearest);
        let mut verification = Self {
            depths,
            volume: Volume {
                from_mm: (from < to).then_some(from),
                to_mm: (from < to).then_some(to),
                all_see_l: volume_l(rig.rig.cameras.len()),
                two_see_l: volume_l(2),
            },
            drive: rig.stage.as_ref().map(Drive::of),
            headroom: Headroom::of(&rig.rig, rig.stage.as_ref(), &view, [near, far]),
            limitations: Vec::new(),
            settings,
        };
        verification.limitations = limitation::find(rig, &view, &verification);
        verification
    }

    /// Returns the rows of the table.
    pub fn table_depths(&self) -> impl Iterator<Item = &AtDepth> {
        self.depths.iter().filter(|at| at.is_row)
    }
}

/// Returns depths from near to far, each with true if it is a row of the table: the ends, and
/// multiples of 1, 2 or 5 times a power of ten.
fn depths(near: f64, far: f64) -> Vec<(f64, bool)> {
    let rough = (far - near) / 10.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|digit| digit * power)
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(far - near);
    let fine = step / f64::from(BETWEEN_ROWS);
    let inner = (1..)
        .map(|n| (f64::from(n) * fine, n % BETWEEN_ROWS == 0))
        .skip_while(|(depth, _)| *depth <= near + 0.3 * fine)
        .take_while(|(depth, _)| *depth < far - 0.3 * fine);
    [(near, true)]
        .into_iter()
        .chain(inner)
        .chain([(far, true)])
        .collect()
}

fn at_depth(
    rig: &RigFile,
    view: &FieldOfView,
    settings: &Settings,
    matched_mm: [f64; 2],
    (depth_mm, is_row): (f64, bool),
) -> AtDepth {
    let is_matched = (matched_mm[0]..=matched_mm[1]).contains(&depth_mm);
    let predictor =
        Predictor::new(&rig.rig, view, depth_mm, settings.noise_px).filter(|_| is_matched);
    let common = view.common(depth_mm).filter(|_| predictor.is_some());
    let rotation = common.and_then(|common| {
        let target = settings.target(&common);
        let noise = (settings.noise_px, settings.points.as_slice());
        RotationBudget::of(&rig.rig, (&target, depth_mm), noise, rig.estimated_pivot())
    });
    let predictions: Vec<_> = predictor
        .iter()
        .flat_map(|predictor| settings.points.iter().map(|n| predictor.predict(*n)))
        .collect();
    AtDepth {
        depth_mm,
        is_row,
        view_mm: view.common(depth_mm).map(|common| common.sides()),
        two_see_mm2: view.area_seen_by(2, depth_mm),
        room_for: predictor.as_ref().map_or(0, Predictor::room_for),
        sigma_mm: predictions.iter().map(|p| p.sigma_mm).collect(),
        widening: predictions.iter().map(|p| p.widening).collect(),
        rotation,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The range of depths is that of the table, whichever limit ends it.
    #[test]
    fn crossing_views_end_prediction() {
        let mut rig = RigFile::paper();
        rig.rig.cameras[0].principal_px[0] = 0.0;
        rig.rig.cameras[2].principal_px[0] = 319.0;
        for depth_range_mm in [[300.0, 2000.0], [300.0, 9000.0]] {
            let settings = Settings {
                depth_range_mm,
                ..Settings::default()
            };
            let found = Verification::of(&rig, settings);
            let [from, to] = [found.volume.from_mm, found.volume.to_mm].map(Option::unwrap);
            assert!(found.volume.all_see_l > 0.0 && found.headroom.is_some());
            for at in &found.depths {
                let is_within = (from..to).contains(&at.depth_mm);
                assert_eq!(!at.sigma_mm.is_empty(), is_within || at.depth_mm == to);
            }
            let parts =
                |l: &Limitation| l.text.contains("left and right have no common view beyond");
            let is_said = found.limitations.iter().any(parts);
            assert_eq!(is_said, to < depth_range_mm[1], "{:?}", found.limitations);
            assert_eq!(to < depth_range_mm[1], depth_range_mm[1] > 3000.0);
        }
    }

    #[test]
    fn image_below_window_is_named() {
        let mut rig = RigFile::paper();
        rig.rig.image_size_px = [16, 12];
        for camera in &mut rig.rig.cameras {
            camera.principal_px = [8.0, 6.0];
        }
        let found = Verification::of(&rig, Settings::default());
        let [worst, ..] = found.limitations.as_slice() else {
            panic!("nothing limits it");
        };
        assert_eq!(worst.name, "image_size_px");
        assert!(worst.text.contains("no room for a window"), "{worst:?}");
    }

    #[test]
    fn table_depths_are_round() {
        for (near, far, count) in [(300.0, 2000.0, 9), (812.0, 813.0, 11), (1.0, 1e6, 11)] {
            let depths = depths(near, far);
            assert!(depths.windows(2).all(|pair| pair[0].0 < pair[1].0));
            let rows: Vec<f64> = depths.iter().filter(|d| d.1).map(|d| d.0).collect();
            assert_eq!((rows[0], rows[rows.len() - 1]), (near, far));
            assert!(rows.len() >= count, "{rows:?}");
        }
        let rows: Vec<f64> = depths(300.0, 2000.0)
            .into_iter()
            .filter_map(|(depth, is_row)| is_row.then_some(depth))
            .collect();
        assert_eq!(rows[1..4], [400.0, 600.0, 800.0]);
    }
}
