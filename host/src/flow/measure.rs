//! The way from a reference and a capture to a measurement, by the cameras that both have.

use super::accept::Settled;
use super::active_cameras::{Absence, Team};
use super::coverage::Extent;
use super::displacement_search::Search;
use super::keyframe::{Keyframe, Reference};
use super::temporal::{Follow, Followed, Refined};
use super::{Filtered, Flow, Reason, Refusal};
use crate::matching::stereo::Match;
use crate::matching::zncc::Field;
use crate::stage_timings::{Laps, Stage};

impl Flow {
    /// By the cameras that are not absent.
    pub(super) fn measure_by(
        &self,
        keyframe: &Keyframe,
        absences: &[Option<Absence>],
        now: &Filtered,
        laps: &mut Laps,
    ) -> Result<Settled, Refusal> {
        let team = self.team(absences)?;
        if team.cameras == keyframe.team.cameras {
            return self.measure_with(&keyframe.view(), now, laps);
        }
        let (matches, coarse) = keyframe.part(&team, self.temporal_level());
        let eye = |team: &Team| team.cameras.get(team.geometry.reference).copied();
        // Those of another camera are nowhere in this one's image.
        let unmatched: &[[f64; 2]] = match eye(&team) == eye(&keyframe.team) {
            true => &keyframe.unmatched,
            false => &[],
        };
        let reference = Reference {
            team: &team,
            coarse: &coarse,
            matches: &matches,
            unmatched,
            ..keyframe.view()
        };
        self.measure_with(&reference, now, laps)
    }

    /// The cameras that are not absent.
    pub(super) fn team(&self, absences: &[Option<Absence>]) -> Result<Team, Refusal> {
        let takes_part = |k: usize| matches!(absences.get(k), Some(None));
        let rig = &self.geometry.rig;
        let left = (0..rig.cameras.len()).filter(|k| takes_part(*k)).count();
        Team::of(rig, takes_part).ok_or(Refusal::FewCameras { left })
    }

    /// Also the camera that is out of step, if any is.
    ///
    /// # Errors
    /// [`Refusal`] of what no camera could have spoiled alone.
    fn measure_with(
        &self,
        reference: &Reference<'_>,
        now: &Filtered,
        laps: &mut Laps,
    ) -> Result<Settled, Refusal> {
        let [before, now] = [reference.pyramids, &now.pyramids].map(|p| reference.team.select(p));
        let follow = Follow {
            geometry: &reference.team.geometry,
            settings: &self.settings,
            before: &before,
            now: &now,
            workers: &self.workers,
        };
        let level = self.temporal_level();
        let coarse = Field::new(&now[follow.geometry.reference].levels[level]);
        let [width, _] = coarse.size();
        let search = Search {
            geometry: follow.geometry,
            before: reference.coarse,
            now: &coarse,
            scale: (1 << level) as f64,
            reach: (self.settings.reach * width as f64).ceil() as usize,
            workers: &self.workers,
        };
        let rough_mm = self.rough(reference, &follow, &search)?;
        laps.lap(Stage::Search);
        let mut rejected = reference.rejected;
        let mut followed: Vec<Followed> = Vec::with_capacity(reference.matches.len());
        let matches: Vec<&Match> = reference.matches.iter().collect();
        for point in self.workers.map(matches, |m| follow.point(m, rough_mm)) {
            match point {
                Ok(point) => followed.push(point),
                Err(reason) => rejected.add(reason),
            }
        }
        laps.lap(Stage::Temporal);
        let least = self.settings.least_points;
        let left_view = rejected.of(Reason::OutOfView) - reference.rejected.of(Reason::OutOfView);
        let expected = reference.matches.len() - left_view;
        let mut settled = if followed.len() < least {
            Settled::refused(Refusal::FewTracks {
                followed: followed.len(),
                matched: reference.matches.len(),
                least,
            })
        } else {
            self.settle(reference.team, followed, expected, rough_mm, rejected)
        };
        match &settled.outcome {
            Ok(measurement) => {
                let extent = Extent::of(reference, &follow, &search, measurement);
                if let Err(refusal) = extent.judge() {
                    settled.outcome = Err(refusal);
                }
            }
            Err(Refusal::FewTracks { .. } | Refusal::NoAgreement { .. }) => {
                settled.late = self.out_of_step(reference, &follow, expected, rough_mm);
            }
            Err(_) => {}
        }
        laps.lap(Stage::Consensus);
        Ok(settled)
    }

    /// The displacement to a fraction of a pixel, or why there is none or more than one.
    fn rough(
        &self,
        keyframe: &Reference<'_>,
        follow: &Follow<'_>,
        search: &Search<'_>,
    ) -> Result<[f64; 3], Refusal> {
        let geometry = follow.geometry;
        let level = self.temporal_level();
        let guesses = search.guesses(keyframe.matches);
        let best_score = guesses.first().map_or(0.0, |g| g.score);
        let mut refined: Vec<Refined> = guesses
            .iter()
            .filter_map(|g| follow.refine(keyframe.matches, g.displacement_mm, level))
            .collect();
        refined.sort_by(|a, b| b.likeness.total_cmp(&a.likeness));
        let Some(first) = refined.first() else {
            return Err(Refusal::Lost {
                likeness: best_score,
            });
        };
        if first.likeness < 0.4 {
            return Err(Refusal::Lost {
                likeness: first.likeness,
            });
        }
        let mean_depth = keyframe
            .matches
            .iter()
            .map(|m| m.ray.inverse_depth)
            .sum::<f64>()
            / keyframe.matches.len() as f64;
        for other in &refined[1..] {
            let [dx, dy] = [0, 1].map(|i| other.displacement_mm[i] - first.displacement_mm[i]);
            let apart_px = dx.hypot(dy) * mean_depth * geometry.focal_px;
            if apart_px > 2.0
                && other.likeness > first.likeness - 2.0 * self.settings.rival_likeness
            {
                return Err(Refusal::AmbiguousMotion {
                    first: first.displacement_mm,
                    second: other.displacement_mm,
                });
            }
        }
        Ok(first.displacement_mm)
    }
}
