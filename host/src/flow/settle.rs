//! From points that were followed to a measurement, or to the reason why there is none.

use super::follow::Followed;
use super::geometry::Geometry;
use super::scatter::Scatter;
use super::step::Odd;
use super::team::Team;
use super::turn::Turn;
use super::{Flow, Measurement, Reason, Refusal, Rejected, Track, consensus, step};
use shared::estimate::midpoint;
use shared::sums::View;
use shared::sums::centred::CentredSums;

/// A turn is refused when `ω' C^-1 ω` is beyond this: three degrees of freedom reach it once in 65,000 cases.
const BEYOND_DOUBT: f64 = 25.0;

/// A measurement, and which camera of the rig saw what share more of the motion, if one did.
pub(super) type Settled = (Measurement, Option<(usize, f64)>);

impl Flow {
    /// Keeps the points that agree, which must be most of those `expected` in view: else nobody knows what the target is. Also tells the
    /// camera that is out of step, if any is.
    pub(super) fn settle(
        &self,
        team: &Team,
        followed: Vec<Followed>,
        expected: usize,
        rough_mm: [f64; 3],
        mut rejected: Rejected,
    ) -> Result<Settled, Refusal> {
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
            return Err(refused);
        };
        let displacement_mm = consensus.displacement_mm;
        if agree < settings.least_points || 2 * agree < expected || median_px > settings.scatter_px
        {
            let turn = Turn::of(geometry, &views, displacement_mm, 1.0);
            let turn = turn.filter(|t| t.left < 0.5 && self.is_too_much(t));
            return Err(turn.map_or(refused, |t| Refusal::Turned { degrees: t.degrees }));
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
        let odd = step::odd(geometry, &views, displacement_mm, scatter.widening);
        let late = odd.filter(Odd::is_out_of_step);
        // What a late camera spoils is no turn, and is measured again without it.
        if late.is_none() {
            let turn = Turn::of(geometry, &views, displacement_mm, scatter.widening);
            let turn = turn.filter(Turn::is_significant);
            if let Some(turn) = turn.filter(|turn| self.is_too_much(turn)) {
                let degrees = turn.degrees;
                return Err(Refusal::Turned { degrees });
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
        let late = late.and_then(|odd| Some((*team.cameras.get(odd.place)?, odd.share)));
        Ok((measurement, late))
    }

    /// Whether the target turns beyond doubt, and too much.
    fn is_too_much(&self, turn: &Turn) -> bool {
        turn.chi_squared > BEYOND_DOUBT && turn.angle_deg() > self.settings.most_turn_deg
    }
}

/// By how much the variance, already widened, must grow to contain a bias, in the axis where that is most.
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
