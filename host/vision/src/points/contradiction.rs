//! Points that contradict the rig: the rays of one point miss each other, in height or in the
//! ratio of their disparities (the paper's test (2) and constraint (3)), as in images.
//!
//! Pixels that were set by hand have more noise than matched windows. The noise shows in the change
//! of a point's miss from the keyframe to now, while a wrong rig or exchanged cameras change
//! nothing. The limit follows it.

use crate::flow::Correspondence;
use crate::matching::MatchSettings;
use crate::matching::geometry::RigGeometry;
use crate::median::median;
use trinocular_core::rig::Rig;

/// Limit of a point's miss, in multiples of the noise, beside that of images.
const TIMES_NOISE: f64 = 6.0;
/// Least noise, px: that of well tracked points.
const LEAST_NOISE_PX: f64 = 0.05;
/// Miss in multiples of the noise that noise alone explains.
const BY_NOISE: f64 = 4.0;

/// Least number of points: fewer do not show their noise.
const LEAST_POINTS: usize = 4;

/// Points that fit the rig.
#[derive(Clone, Debug)]
pub(super) struct Judged {
    /// Points whose rays meet.
    pub kept: Vec<Correspondence>,
    /// Inflation of the displacement's variance by the misses of the points that are kept.
    pub variance_inflation: f64,
    /// Description of the points that were rejected.
    pub remark: Option<String>,
}

/// Rejects the points that contradict the rig.
pub(super) fn judge(rig: &Rig, points: Vec<Correspondence>) -> Judged {
    let geometry = RigGeometry::new(rig).filter(|_| points.len() >= LEAST_POINTS);
    let Some(geometry) = geometry else {
        return Judged {
            kept: points,
            variance_inflation: 1.0,
            remark: None,
        };
    };
    let count = points.len();
    let miss_px = |views: Vec<[f64; 2]>| {
        let height = geometry.vertical_offset_px(&views);
        height.max(geometry.disparity_disagreement_px(&views))
    };
    let misses = points.iter().map(|point| {
        let start = miss_px(point.views.iter().map(|view| view.start).collect());
        let end = miss_px(point.views.iter().map(|view| view.end).collect());
        (start.max(end), (end - start).abs())
    });
    let (misses, changes): (Vec<f64>, Vec<f64>) = misses.unzip();
    let noise_px = median(changes).max(LEAST_NOISE_PX);
    let limit_px = MatchSettings::default().max_view_residual_px + TIMES_NOISE * noise_px;
    let largest_px = misses.iter().copied().fold(0.0, f64::max);
    let fits: Vec<bool> = misses.iter().map(|miss| *miss <= limit_px).collect();
    let fitting = misses.iter().copied().filter(|miss| *miss <= limit_px);
    let excess = median(fitting.collect()) / (BY_NOISE * noise_px);
    let kept = points.into_iter().zip(fits).filter(|(_, fits)| *fits);
    let kept: Vec<Correspondence> = kept.map(|(point, _)| point).collect();
    let rejected = count - kept.len();
    let remark = (rejected > 0).then(|| {
        format!(
            "{rejected} of {count} points contradict the rig and are rejected: their rays miss \
             each other by up to {largest_px:.2} px (limit {limit_px:.2} px); are cameras exchanged \
             in the file, or is the rig file another rig's?"
        )
    });
    Judged {
        kept,
        variance_inflation: excess.powi(2).max(1.0),
        remark,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_rig::random::Random;

    /// Returns twelve points that moved by 3, -2 and 4 mm, with noise; those of the last camera
    /// are lower by `off_px` at both instants.
    fn points(noise_px: f64, off_px: f64) -> Vec<Correspondence> {
        let rig = Rig::paper();
        let mut random = Random::seeded(3);
        let last = rig.cameras.len() - 1;
        let point = |_| {
            let at =
                [-60.0, -40.0, 800.0].map(|start: f64| start + 100.0 * random.between(0.0, 1.0));
            let moved = [at[0] + 3.0, at[1] - 2.0, at[2] + 4.0];
            let pixels = rig.cameras.iter().enumerate().map(|(index, camera)| {
                [at, moved].map(|at| {
                    let [x, y] = camera.project(at);
                    let low = if index == last { off_px } else { 0.0 };
                    let mut noisy = |value: f64| value + noise_px * random.between(-1.7, 1.7);
                    [noisy(x), noisy(y) + low]
                })
            });
            Correspondence::from_pixels(&rig, pixels.collect())
        };
        (0..12).map(point).collect()
    }

    #[test]
    fn points_off_the_rig_are_rejected() {
        let judged = judge(&Rig::paper(), points(0.05, 13.0));
        assert_eq!(judged.kept.len(), 0);
        let remark = judged.remark.expect("a remark");
        assert!(
            remark.starts_with("12 of 12 points contradict the rig"),
            "{remark}"
        );
    }

    #[test]
    fn noise_alone_contradicts_nothing() {
        for noise_px in [0.0, 0.05, 0.5] {
            let judged = judge(&Rig::paper(), points(noise_px, 0.0));
            assert_eq!(
                (judged.kept.len(), judged.remark),
                (12, None),
                "{noise_px} px"
            );
            assert!(
                judged.variance_inflation < 1.5,
                "{}",
                judged.variance_inflation
            );
        }
    }

    #[test]
    fn small_misses_widen_sigma() {
        let judged = judge(&Rig::paper(), points(0.05, 0.8));
        assert_eq!(judged.kept.len(), 12);
        assert!(
            judged.variance_inflation > 4.0,
            "{}",
            judged.variance_inflation
        );
    }
}
