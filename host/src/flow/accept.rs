//! From points that were followed to a measurement, or to the reason why there is none.

use super::active_cameras::Team;
use super::keyframe::Reference;
use super::rotation::Turn;
use super::sync::Odd;
use super::temporal::{Follow, Followed};
use super::variance_inflation::Scatter;
use super::{Flow, Measurement, Reason, Refusal, Rejected, Track, consensus, sync};
use crate::matching::geometry::Geometry;
use crate::matching::stereo::Match;
use shared::estimate::midpoint;
use shared::sums::View;
use shared::sums::centred::CentredSums;

/// A turn is refused when `ω' C^-1 ω` is beyond this: three degrees of freedom reach it once in
/// 65,000 cases.
const BEYOND_DOUBT: f64 = 25.0;

/// What a team of cameras saw.
#[derive(Debug)]
pub(super) struct Settled {
    /// A measurement, or why there is none.
    pub(super) outcome: Result<Measurement, Refusal>,
    /// Which camera of the rig saw what share more of the motion, if one did.
    pub(super) late: Option<(usize, f64)>,
}

impl Settled {
    /// Without a measurement.
    pub(super) fn refused(refusal: Refusal) -> Self {
        Self {
            outcome: Err(refusal),
            late: None,
        }
    }
}

impl Flow {
    /// Keeps the points that agree, which must be most of those `expected` in view: else nobody
    /// knows what the target is. Also tells the camera that is out of step, if any is.
    pub(super) fn settle(
        &self,
        team: &Team,
        followed: Vec<Followed>,
        expected: usize,
        rough_mm: [f64; 3],
        mut rejected: Rejected,
    ) -> Settled {
        let (settings, geometry) = (&self.settings, &team.geometry);
        let count = followed.len();
        let (tracks, views): (Vec<Track>, Vec<Vec<View>>) = followed
            .into_iter()
            .map(|f| (Track { pixels: f.pixels }, f.views))
            .unzip();
        let consensus = consensus::agree(geometry, &views, rough_mm, settings.agree_px);
        let (agree, median_px) = consensus.as_ref().map_or((0, f64::NAN), |c| {
            (c.agrees.iter().filter(|a| **a).count(), c.median_px)
        });
        let refused = Refusal::NoAgreement {
            agree,
            expected,
            median_px,
        };
        let Some(consensus) = consensus else {
            return Settled::refused(refused);
        };
        let displacement_mm = consensus.displacement_mm;
        if agree < settings.least_points || 2 * agree < expected || median_px > settings.scatter_px
        {
            let turn = Turn::of(geometry, &views, displacement_mm, 1.0);
            let turn = turn.filter(|t| t.left < 0.5 && self.is_too_much(t));
            let turned = turn.map(|t| Refusal::Turned { degrees: t.degrees });
            return Settled::refused(turned.unwrap_or(refused));
        }
        for _ in agree..count {
            rejected.add(Reason::Disagrees);
        }
        let keep = |index: &usize| consensus.agrees[*index];
        let kept: Vec<usize> = (0..count).filter(keep).collect();
        let tracks: Vec<Track> = kept.iter().map(|i| tracks[*i].clone()).collect();
        let views: Vec<Vec<View>> = kept.iter().map(|i| views[*i].clone()).collect();
        let reference = geometry.reference;
        let centres_px: Vec<[f64; 2]> = tracks.iter().map(|t| t.pixels[reference][0]).collect();
        let mut scatter = Scatter::of(geometry, &views, &centres_px, displacement_mm);
        let odd = sync::odd(geometry, &views, displacement_mm, scatter.widening);
        let late = odd.filter(Odd::is_out_of_step);
        // What a late camera spoils is no turn, and is measured again without it.
        if late.is_none() {
            let turn = Turn::of(geometry, &views, displacement_mm, scatter.widening);
            let turn = turn.filter(Turn::is_significant);
            if let Some(turn) = turn.filter(|turn| self.is_too_much(turn)) {
                let degrees = turn.degrees;
                return Settled::refused(Refusal::Turned { degrees });
            }
            let turned = turn.map_or(1.0, |turn| {
                excess(geometry, &views, scatter.widening, turn.bias_mm)
            });
            scatter.widening *= odd.map_or(1.0, |odd| odd.excess).max(turned);
        }
        let measurement = Measurement {
            tracks,
            views,
            cameras: team.cameras.clone(),
            absent: Vec::new(),
            rejected,
            displacement_mm,
            scatter,
        };
        Settled {
            outcome: Ok(measurement),
            late: late.and_then(|odd| odd.of(team)),
        }
    }

    /// The camera that keeps points from agreeing: followed by each camera on its own, most of
    /// those `expected` in view do move as one, but for the share of the motion that this one saw
    /// more.
    pub(super) fn out_of_step(
        &self,
        reference: &Reference<'_>,
        follow: &Follow<'_>,
        expected: usize,
        rough_mm: [f64; 3],
    ) -> Option<(usize, f64)> {
        let (settings, geometry) = (&self.settings, follow.geometry);
        let matches = reference.matches.iter().collect();
        let apart = |matched: &Match| follow.apart(matched, rough_mm).ok();
        let followed = self.workers.map(matches, apart).into_iter().flatten();
        let (views, centres_px): (Vec<Vec<View>>, Vec<[f64; 2]>) = followed
            .map(|f| (f.views, f.pixels[geometry.reference][0]))
            .unzip();
        let consensus = consensus::agree(geometry, &views, rough_mm, settings.agree_px)?;
        let (views, centres_px): (Vec<Vec<View>>, Vec<[f64; 2]>) =
            (views.into_iter().zip(centres_px).zip(consensus.agrees))
                .filter_map(|(point, agrees)| agrees.then_some(point))
                .unzip();
        if views.len() < settings.least_points || 2 * views.len() < expected {
            return None;
        }
        let displacement_mm = consensus.displacement_mm;
        let scatter = Scatter::of(geometry, &views, &centres_px, displacement_mm);
        let odd = sync::odd(geometry, &views, displacement_mm, scatter.widening);
        odd.filter(Odd::is_out_of_step)?.of(reference.team)
    }

    /// Whether the target turns beyond doubt, and too much.
    fn is_too_much(&self, turn: &Turn) -> bool {
        turn.chi_squared > BEYOND_DOUBT && turn.angle_deg() > self.settings.most_turn_deg
    }
}

/// By how much the variance, already widened, must grow to contain a bias, in the axis where that
/// is most.
fn excess(geometry: &Geometry, views: &[Vec<View>], widening: f64, bias_mm: [f64; 3]) -> f64 {
    let estimate = CentredSums::new(&geometry.rig).and_then(|mut sums| {
        for views in views {
            sums.add(views);
        }
        midpoint::solve(&sums)
    });
    let Ok(estimate) = estimate else { return 1.0 };
    let of_axis = |i: usize| bias_mm[i].powi(2) / (widening * estimate.covariance_mm2[i][i]);
    1.0 + (0..3).map(of_axis).fold(0.0, f64::max)
}
