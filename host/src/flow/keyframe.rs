//! The reference instant: points matched in all cameras, and what following them needs.

use super::active_cameras::Team;
use super::{Filtered, Flow, Reason, Refusal, Rejected};
use crate::matching::corner;
use crate::matching::lucas_kanade::Large;
use crate::matching::pyramid::Pyramid;
use crate::matching::stereo::{Match, Stereo};
use crate::matching::zncc::Field;
use crate::stage_timings::{Laps, Stage};

/// The texture repeats where more corners than so many times those that match at one depth match at
/// several. Below, those few decide, as those of walls, text and boards can; bricks and grids have
/// next to none.
const MOST_AMBIGUOUS: usize = 3;

/// Matched points and images of the reference instant.
#[derive(Clone, Debug)]
pub(super) struct Keyframe {
    pub(super) team: Team,
    /// Of all cameras.
    pub(super) filtered: Filtered,
    /// What follows is the team's.
    pub(super) coarse: Field,
    pub(super) matches: Vec<Match>,
    /// Corners without a match, the best of every part of the image first: pixels of the team's
    /// reference camera.
    pub(super) unmatched: Vec<[f64; 2]>,
    pub(super) rejected: Rejected,
}

/// What a measurement needs of it; fewer cameras may be left by then.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reference<'a> {
    pub(super) team: &'a Team,
    /// Of all cameras.
    pub(super) pyramids: &'a [Pyramid],
    pub(super) coarse: &'a Field,
    pub(super) matches: &'a [Match],
    /// Corners without a match.
    pub(super) unmatched: &'a [[f64; 2]],
    pub(super) rejected: Rejected,
}

impl Keyframe {
    /// With its whole team.
    pub(super) fn view(&self) -> Reference<'_> {
        Reference {
            team: &self.team,
            pyramids: &self.filtered.pyramids,
            coarse: &self.coarse,
            matches: &self.matches,
            unmatched: &self.unmatched,
            rejected: self.rejected,
        }
    }

    /// Its matches as `team`, some of its own cameras, has them, and what that team's reference
    /// camera saw at `level`.
    pub(super) fn part(&self, team: &Team, level: usize) -> (Vec<Match>, Field) {
        let places: Vec<usize> = (self.team.cameras.iter().enumerate())
            .filter(|(_, camera)| team.cameras.contains(camera))
            .map(|(place, _)| place)
            .collect();
        let pick = |matched: &Match| {
            let views: Vec<[f64; 2]> = places.iter().map(|p| matched.views[*p]).collect();
            Match {
                pixels: places.iter().map(|p| matched.pixels[*p]).collect(),
                ray: team.geometry.fit(&views),
                views,
                templates: places
                    .iter()
                    .map(|p| matched.templates[*p].clone())
                    .collect(),
            }
        };
        let reference = team.cameras[team.geometry.reference];
        let plane = &self.filtered.pyramids[reference].levels[level];
        let matches = self.matches.iter().map(pick).collect();
        (matches, Field::new(plane))
    }
}

impl Flow {
    /// [`Flow::set_reference`] with a capture that was filtered before, as that of the last
    /// measurement was.
    ///
    /// # Errors
    /// [`Refusal`], with what was found.
    pub fn refer_to(&mut self, filtered: Filtered, laps: &mut Laps) -> Result<(), Refusal> {
        // What the old keyframe occupies is given back only when the new one is complete: else the
        // allocator would return it to the system, to ask for it again at once.
        let old = self.keyframe.take();
        let (settings, workers) = (&self.settings, &self.workers);
        let team = self.team(&filtered.absences)?;
        let views = team.select(&filtered.pyramids);
        let reference = team.geometry.reference;
        let base = &views[reference].levels[0];
        let (margin, apart) = (Large::MARGIN + 1, settings.apart_px);
        let corners = corner::corners(base, margin, apart, settings.corners, workers);
        laps.lap(Stage::Corners);
        let least = settings.least_points;
        if corners.len() < least {
            let found = corners.len();
            return Err(Refusal::FewCorners { found, least });
        }
        let level = self.spatial_level();
        let planes = views.iter().map(|p| &p.levels[level]).collect();
        let fields = workers.map(planes, Field::new);
        let stereo = Stereo {
            geometry: &team.geometry,
            settings,
            pyramids: &views,
            fields: &fields,
            level,
        };
        let places: Vec<[f64; 2]> = (corners.iter().enumerate())
            .map(|(index, corner)| spread_phase(index, *corner))
            .collect();
        let mut rejected = Rejected::default();
        let mut matches = Vec::with_capacity(settings.points);
        let mut unmatched = Vec::new();
        let mut untried = places.as_slice();
        while matches.len() < settings.points && !untried.is_empty() {
            // No more than could be used, so none is tried in vain however many threads there are.
            let wanted = settings.points - matches.len();
            let (batch, rest) = untried.split_at(wanted.min(untried.len()));
            untried = rest;
            let found = workers.map(batch.to_vec(), |place| stereo.find(place));
            for (place, found) in batch.iter().zip(found) {
                match found {
                    Ok(matched) => matches.push(matched),
                    Err(reason) => {
                        unmatched.push(*place);
                        rejected.add(reason);
                    }
                }
            }
        }
        let tried = places.len() - untried.len();
        let (matched, ambiguous) = (matches.len(), rejected.of(Reason::Ambiguous));
        if ambiguous > MOST_AMBIGUOUS * matched && 4 * ambiguous > tried {
            return Err(Refusal::AmbiguousDepth { ambiguous, matched });
        }
        if matched < least {
            return Err(Refusal::FewMatches {
                matched,
                corners: tried,
                least,
            });
        }
        unmatched.extend_from_slice(untried);
        let coarse = Field::new(&views[reference].levels[self.temporal_level()]);
        self.keyframe = Some(Keyframe {
            team,
            filtered,
            coarse,
            matches,
            unmatched,
            rejected,
        });
        if let Some(old) = old {
            self.spare.keep(old.filtered);
        }
        laps.lap(Stage::Spatial);
        Ok(())
    }
}

/// A place within half a pixel of a corner, another one for every corner.
///
/// Reading between pixels errs by up to a thousandth of a pixel, depending on where between two
/// pixels a template was taken. Taken always in the middle of a pixel, all points would err alike:
/// in a flow field that grows from the middle outwards this looks like a motion along z. The places
/// are those of the R2 sequence (Roberts 2018), evenly spread at any count.
fn spread_phase(index: usize, corner: [usize; 2]) -> [f64; 2] {
    let turn = [0.754_877_666_246_693, 0.569_840_290_998_053];
    core::array::from_fn(|i| corner[i] as f64 + (index as f64 * turn[i]).fract() - 0.5)
}
