//! Points followed in time, in every camera on its own, from where one rough displacement puts
//! them.

use shared::sums::View;

use super::consensus::{self, Sighting};
use super::{Reason, Settings};
use crate::matching::geometry::Geometry;
use crate::matching::lucas_kanade::{Found, Large, Small};
use crate::matching::pyramid::Pyramid;
use crate::matching::stereo::{self, Match};
use crate::thread_pool::Workers;

/// Steps of the iteration.
const STEPS: usize = 12;

/// Two instants, and the rig.
#[derive(Debug)]
pub struct Follow<'a> {
    /// The rig.
    pub geometry: &'a Geometry,
    /// Thresholds.
    pub settings: &'a Settings,
    /// Per camera, at the reference instant.
    pub before: &'a [&'a Pyramid],
    /// Per camera, now.
    pub now: &'a [&'a Pyramid],
    /// Who does it.
    pub workers: &'a Workers,
}

/// A displacement, better known than its guess.
#[derive(Clone, Copy, Debug)]
pub struct Refined {
    /// mm.
    pub displacement_mm: [f64; 3],
    /// Mean likeness over the points in view; those that could not be found or disagree count as 0.
    pub likeness: f32,
}

impl Follow<'_> {
    /// Improves a guess in the reference camera, from the level below `level` down to level 1.
    pub fn refine(&self, matches: &[Match], guess_mm: [f64; 3], level: usize) -> Option<Refined> {
        let mut refined = Refined {
            displacement_mm: guess_mm,
            likeness: 0.0,
        };
        for level in (1..level.max(2)).rev() {
            refined = self.refine_at(matches, refined.displacement_mm, level)?;
        }
        Some(refined)
    }

    fn refine_at(&self, matches: &[Match], guess_mm: [f64; 3], level: usize) -> Option<Refined> {
        let k = self.geometry.reference;
        let [before, now] = [self.before, self.now].map(|p| p[k].levels.get(level));
        let (before, now) = (before?, now?);
        let scale = (1 << level) as f64;
        // Of those in view: what is seen now, if it is found.
        let sight = |matched: &Match| {
            let rho = matched.ray.inverse_depth;
            let from = matched.pixels[k].map(|p| (p / scale) as f32);
            let expected = Sighting::predicted(matched.views[k], rho, guess_mm);
            let to = self.geometry.pixel(k, expected).map(|p| (p / scale) as f32);
            if !Small::fits(before, from) || !Small::fits(now, to) {
                return None;
            }
            let template = Small::new(before, from)?;
            let found = template.find(now, to, shrink(rho, guess_mm), STEPS);
            Some(found.map(|found| {
                let pixel = found.at.map(|p| f64::from(p) * scale);
                let sighting = Sighting {
                    before: matched.views[k],
                    now: self.geometry.normalise(k, pixel),
                    inverse_depth: rho,
                };
                (sighting, found.likeness)
            }))
        };
        let seen = self.workers.map(matches.iter().collect(), sight);
        let in_view = seen.iter().flatten().count();
        let (sightings, likenesses): (Vec<Sighting>, Vec<f32>) =
            seen.into_iter().flatten().flatten().unzip();
        if sightings.len() < self.settings.least_points {
            return None;
        }
        let least = 0.5 * scale / self.geometry.focal_px;
        let displacement_mm = consensus::fit(&sightings, guess_mm, least)?;
        let mut sum = 0.0;
        for (sighting, likeness) in sightings.iter().zip(&likenesses) {
            if sighting.residual(displacement_mm) < 2.0 * least {
                sum += likeness.max(0.0);
            }
        }
        Some(Refined {
            displacement_mm,
            likeness: sum / in_view as f32,
        })
    }

    /// One point in all cameras at full resolution: pixels now, and normalised views at both
    /// instants.
    ///
    /// # Errors
    /// Why it could not be followed.
    pub fn point(&self, matched: &Match, displacement_mm: [f64; 3]) -> Result<Followed, Reason> {
        let followed = self.apart(matched, displacement_mm)?;
        let ends: Vec<[f64; 2]> = followed.views.iter().map(|v| v.end).collect();
        stereo::check(self.geometry, self.settings, &ends)?;
        Ok(followed)
    }

    /// The same by each camera on its own: what they see now need not be one point.
    ///
    /// # Errors
    /// Why it could not be followed.
    pub fn apart(&self, matched: &Match, displacement_mm: [f64; 3]) -> Result<Followed, Reason> {
        let cameras = self.geometry.cameras();
        let mut pixels = Vec::with_capacity(cameras);
        let mut views = Vec::with_capacity(cameras);
        for k in 0..cameras {
            let found = self.view(k, matched, displacement_mm)?;
            let pixel = found.at.map(f64::from);
            pixels.push([matched.pixels[k], pixel]);
            views.push(View {
                start: matched.views[k],
                end: self.geometry.normalise(k, pixel),
            });
        }
        Ok(Followed { pixels, views })
    }

    /// Where the reference camera sees now what it saw at `at`, px, looked for at `level` from
    /// `start` on, and the likeness there; `None` if nothing is found.
    pub(super) fn corner(
        &self,
        level: usize,
        at: [f64; 2],
        start: [f64; 2],
        inverse_depth: f64,
        displacement_mm: [f64; 3],
    ) -> Option<([f64; 2], f32)> {
        let k = self.geometry.reference;
        let scale = (1 << level) as f64;
        let on_level = |place: [f64; 2]| place.map(|c| (c / scale) as f32);
        let [before, now] = [self.before, self.now].map(|p| p[k].levels.get(level));
        let template = Small::new(before?, on_level(at))?;
        let warp = shrink(inverse_depth, displacement_mm);
        let found = template.find(now?, on_level(start), warp, STEPS)?;
        Some((found.at.map(|c| f64::from(c) * scale), found.likeness))
    }

    fn view(&self, k: usize, matched: &Match, displacement_mm: [f64; 3]) -> Result<Found, Reason> {
        let now = &self.now[k].levels[0];
        let rho = matched.ray.inverse_depth;
        let expected = Sighting::predicted(matched.views[k], rho, displacement_mm);
        let start = self.geometry.pixel(k, expected).map(|p| p as f32);
        if !Large::fits(now, start) {
            return Err(Reason::OutOfView);
        }
        let warp = shrink(rho, displacement_mm);
        let found = matched.templates[k].find(now, start, warp, STEPS);
        let found = found.ok_or(Reason::Unlike)?;
        if found.likeness < self.settings.least_likeness {
            return Err(Reason::Unlike);
        }
        if !(f64::from(found.miss) <= self.settings.return_px) {
            return Err(Reason::NoReturn);
        }
        Ok(found)
    }
}

/// A point at both instants.
#[derive(Clone, Debug)]
pub struct Followed {
    /// Per camera: px at the reference instant and now.
    pub pixels: Vec<[[f64; 2]; 2]>,
    /// Per camera: normalised.
    pub views: Vec<View>,
}

/// A point that comes nearer by `Tz` (negative) is seen larger: the template's offsets shrink by
/// depth now over depth before.
fn shrink(inverse_depth: f64, displacement_mm: [f64; 3]) -> [[f32; 2]; 2] {
    let factor = (1.0 + inverse_depth * displacement_mm[2]) as f32;
    [[factor, 0.0], [0.0, factor]]
}
