//! Whether all cameras take their pictures at once.
//!
//! A camera whose shutter opens later sees a moving target further on, at all points alike: its
//! mean residual `m_k` lies along the mean flow `u`. Fitted to all `K` cameras, the displacement
//! takes `1/K` of it, so
//!
//! ```text
//! share_k = K/(K-1) m_k·u / |u|²         of the motion between the two instants
//! ```
//!
//! A wrong focal length or a camera that is not quite where the rig file says does the same, by a
//! percent or two; photographs taken from a rail show it. So a camera is only left out for more
//! than 2.5 %; below, sigma grows by what it may have spoiled, `share |u|/K`.
//!
//! A camera that is out by more than half a pixel makes points fail the tests of one instant's
//! views, or scatter too much to agree. Then they are followed by each camera on its own, and the
//! same share is looked for before they are refused.

use super::active_cameras::Team;
use crate::matching::geometry::Geometry;
use shared::sums::View;

/// The least deviation that counts, px.
const LEAST_PX: f64 = 0.03;
/// How many standard deviations it must be.
const SIGMAS: f64 = 6.0;

/// A camera is out of step when it saw this share more or less of the motion than the others.
const LEAST_SHARE: f64 = 0.025;

/// The camera that saw most more or less of the motion than the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odd {
    /// Its place in the team.
    pub place: usize,
    /// The share of the motion that it saw more.
    pub share: f64,
    /// By how much the variance of the displacement must grow to contain what it has spoiled.
    pub excess: f64,
}

impl Odd {
    /// Whether that can only be another time.
    pub fn is_out_of_step(&self) -> bool {
        self.share.abs() > LEAST_SHARE
    }

    /// Which camera of the rig it is, and its share.
    pub(super) fn of(&self, team: &Team) -> Option<(usize, f64)> {
        Some((*team.cameras.get(self.place)?, self.share))
    }
}

/// That camera, if it is one beyond doubt. At least three cameras, since of two nobody knows which
/// is wrong.
pub fn odd(
    geometry: &Geometry,
    views: &[Vec<View>],
    displacement_mm: [f64; 3],
    widening: f64,
) -> Option<Odd> {
    let cameras = geometry.cameras();
    let count = views.len() as f64;
    if cameras < 3 || views.is_empty() {
        return None;
    }
    let mut means = vec![[0.0; 2]; cameras];
    let mut flow = [0.0; 2];
    let mut squares = 0.0;
    for views in views {
        let fit = geometry.arms.point(views)?;
        for (k, view) in views.iter().enumerate() {
            let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
            for axis in 0..2 {
                let residual = seen[axis] - expected[axis];
                means[k][axis] += residual / count;
                flow[axis] += seen[axis] / (count * cameras as f64);
                squares += residual * residual;
            }
        }
    }
    let size = flow[0].hypot(flow[1]);
    let all = cameras as f64 / (cameras as f64 - 1.0);
    let excess = |mean: &[f64; 2]| all * (mean[0] * flow[0] + mean[1] * flow[1]) / size;
    let deviations: Vec<f64> = means.iter().map(excess).collect();
    let (worst, deviation) =
        (deviations.iter().copied().enumerate()).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    // What is left when every camera's own mean is taken out.
    let explained: f64 = means
        .iter()
        .map(|m| count * (m[0] * m[0] + m[1] * m[1]))
        .sum();
    let scatter = (squares - explained).max(0.0) / (2.0 * count * cameras as f64);
    let sigma = (widening * scatter * all / count).sqrt();
    let sure = deviation.abs() > SIGMAS * sigma && geometry.focal_px * deviation.abs() > LEAST_PX;
    let observations = count * cameras as f64;
    let of_mean = widening * squares / (2.0 * observations) / observations;
    (sure && size > 0.0).then_some(Odd {
        place: worst,
        share: deviation / size,
        excess: 1.0 + (deviation / cameras as f64).powi(2) / of_mean,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use shared::estimate::midpoint;
    use shared::sums::centred::CentredSums;

    const MOVED: [f64; 3] = [9.0, -6.0, 2.0];

    fn judged(late: Option<(usize, f64)>, seed: u64) -> Option<Odd> {
        let cloud = Cloud::new();
        let motion = |k: usize, place: [f64; 3]| {
            let share = late
                .filter(|(camera, _)| *camera == k)
                .map_or(0.0, |(_, share)| share);
            core::array::from_fn(|i| place[i] + (1.0 + share) * MOVED[i])
        };
        let views = cloud.views(motion, independent(0.02, seed));
        let mut sums = CentredSums::new(&cloud.geometry.rig).unwrap();
        for views in &views {
            assert!(sums.add(views));
        }
        let measured = midpoint::solve(&sums).unwrap().displacement_mm;
        odd(&cloud.geometry, &views, measured, 3.0)
    }

    #[test]
    fn a_camera_that_takes_its_picture_at_another_time_is_known_by_its_number() {
        for camera in 0..3 {
            for share in [0.06, -0.06] {
                let odd = judged(Some((camera, share)), 5).unwrap();
                assert!(odd.place == camera && odd.is_out_of_step());
                assert!((odd.share - share).abs() < 0.02, "{odd:?}, not {share}");
            }
        }
    }

    #[test]
    fn a_percent_makes_sigma_grow_and_no_more() {
        let odd = judged(Some((0, 0.012)), 6).unwrap();
        assert!(!odd.is_out_of_step() && odd.excess > 2.0, "{odd:?}");
    }

    #[test]
    fn cameras_in_step_are_not_suspected() {
        assert!((0..40).all(|seed| judged(None, seed).is_none()));
    }
}
