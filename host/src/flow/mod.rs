//! From captures to matched, tracked points.
//!
//! ```text
//! capture -> pyramid -> corners -> stereo ----.                        (reference instant, once per keyframe)
//! capture -> pyramid -> search -> follow -> consensus -> tracks        (now)
//! ```
//!
//! * [`pyramid`] filters and halves the images; [`corner`] picks points in the reference camera,
//!   the one nearest the middle of the rig;
//! * [`stereo`] matches them in all cameras without knowing their depth; [`geometry`] has the tests
//!   a match must pass;
//! * [`search`] finds the rough displacement, without knowing it either, and what else would
//!   explain the images;
//! * [`follow`] takes every point to a hundredth of a pixel in every camera by [`lucas_kanade`];
//! * [`consensus`] keeps the points that move as one; [`scatter`] says how well they know it,
//!   [`turn`] whether the target turns instead, `extent` whether most of the picture moves with
//!   them;
//! * [`team`] leaves out cameras whose pictures are of no use, [`step`] those that take them at
//!   another time.
//!
//! *Invariant:* a measurement is never based on a choice between explanations that fit alike: those
//! are refused.

use crate::images::{Capture, Image};
use shared::rig::Rig;

mod accept;
pub mod active_cameras;
pub mod alignment;
#[cfg(test)]
mod cloud;
pub mod consensus;
mod coverage;
pub mod displacement_search;
pub mod frame_set;
mod keyframe;
mod measure;
pub mod measurement;
mod pyramid_pool;
pub mod refusal;
pub mod rotation;
pub mod sync;
pub mod temporal;
pub mod variance_inflation;

use crate::matching::geometry::Geometry;
use crate::matching::pyramid::{Plane, Pyramid};
use crate::stage_timings::{Laps, Stage};
use crate::thread_pool::Workers;
use accept::Settled;
use active_cameras::{Absence, Last};
use keyframe::Keyframe;
pub use measurement::{Measurement, Track};
use pyramid_pool::Spare;
pub use refusal::{Reason, Refusal, Rejected};

/// What the matching is to be content with.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Corners that are tried, at most.
    pub corners: usize,
    /// Points that are followed, at most.
    pub points: usize,
    /// Least distance between corners, px.
    pub apart_px: f64,
    /// Least normalised cross-correlation of a match, -1 to 1.
    pub least_likeness: f32,
    /// Two explanations whose likenesses differ by less than this are alike.
    pub rival_likeness: f32,
    /// A point followed forth and back must return this near, px.
    pub return_px: f64,
    /// Largest residual of the vertical test and of constraint (3), px. Raise it for rigs that are
    /// not aligned.
    pub view_residual_px: f64,
    /// How far points may move between the two instants, in widths of the image.
    pub reach: f64,
    /// Points within this of the consensus agree with it even when most are nearer, px.
    pub agree_px: f64,
    /// Largest median residual of a consensus, px.
    pub scatter_px: f64,
    /// The least number of points of any use.
    pub least_points: usize,
    /// By how much the target may turn, degrees. Below, sigma grows with what the turn may spoil.
    pub most_turn_deg: f64,
    /// Threads that share the work, at least 1; they wait for it as long as there is a [`Flow`].
    /// Results do not depend on it.
    pub threads: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            corners: 400,
            points: 220,
            apart_px: 8.0,
            least_likeness: 0.8,
            rival_likeness: 0.08,
            return_px: 0.3,
            view_residual_px: 0.5,
            reach: 0.2,
            agree_px: 0.1,
            scatter_px: 0.5,
            least_points: 8,
            most_turn_deg: 0.15,
            threads: 1,
        }
    }
}

/// A capture's images at all scales, one per camera: what needs no other capture.
#[derive(Clone, Debug)]
pub struct Filtered {
    pyramids: Vec<Pyramid>,
    /// Per camera: why its picture is of no use.
    absences: Vec<Option<Absence>>,
    prints: Vec<u64>,
}

/// Matches captures with a reference capture.
#[derive(Clone, Debug)]
pub struct Flow {
    geometry: Geometry,
    settings: Settings,
    keyframe: Option<Keyframe>,
    last: Last,
    spare: Spare,
    workers: Workers,
}

/// The level on which an image `width` px wide is at most `most` px wide.
fn level_of(width: usize, most: usize) -> usize {
    (0..).find(|level| width >> level <= most).unwrap_or(0)
}

impl Flow {
    /// Matching for this rig.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`].
    pub fn new(rig: &Rig, settings: Settings) -> Result<Self, Refusal> {
        Ok(Self {
            geometry: Geometry::new(rig).ok_or(Refusal::WrongRig)?,
            workers: Workers::new(settings.threads),
            settings,
            keyframe: None,
            last: Last::default(),
            spare: Spare::default(),
        })
    }

    /// Level of the spatial search.
    fn spatial_level(&self) -> usize {
        level_of(self.geometry.rig.image_size_px[0] as usize, 240).max(1)
    }

    /// Level of the temporal search.
    fn temporal_level(&self) -> usize {
        level_of(self.geometry.rig.image_size_px[0] as usize, 120).max(1)
    }

    /// Filters the images of a capture.
    ///
    /// # Errors
    /// [`Refusal::WrongViews`] or [`Refusal::WrongSize`] if they are not this rig's.
    pub fn filter(&self, capture: &Capture, laps: &mut Laps) -> Result<Filtered, Refusal> {
        let cameras = self.geometry.cameras();
        if capture.views.len() != cameras {
            return Err(Refusal::WrongViews {
                found: capture.views.len(),
                cameras,
            });
        }
        let rig = self.geometry.rig.image_size_px.map(|side| side as usize);
        for (camera, view) in capture.views.iter().enumerate() {
            let found = [view.width, view.height];
            if view.is_missing() {
                continue;
            }
            if found != rig || view.grey.len() != rig[0] * rig[1] || rig.contains(&0) {
                return Err(Refusal::WrongSize { camera, found, rig });
            }
        }
        let levels = 1 + self.temporal_level().max(self.spatial_level());
        let memory = self.spare.take().map_or_else(Vec::new, |s| s.pyramids);
        let memory = memory
            .into_iter()
            .chain(std::iter::repeat_with(Pyramid::default));
        let jobs = capture.views.iter().zip(memory).collect();
        let seen = (self.workers).map(jobs, |(view, mut pyramid): (&Image, Pyramid)| {
            if view.is_missing() {
                return (Pyramid::default(), 0.0, 0);
            }
            pyramid.refill(view, levels);
            let contrast = pyramid.levels.last().map_or(0.0, Plane::contrast);
            (pyramid, contrast, active_cameras::fingerprint(view))
        });
        let contrasts: Vec<f64> = seen.iter().map(|(_, contrast, _)| *contrast).collect();
        let (pyramids, prints): (Vec<Pyramid>, Vec<u64>) = seen
            .into_iter()
            .map(|(pyramid, _, print)| (pyramid, print))
            .unzip();
        let mut absences = active_cameras::absences(&capture.views, &contrasts);
        self.last.judge(&mut absences, &prints);
        laps.lap(Stage::Filter);
        Ok(Filtered {
            pyramids,
            absences,
            prints,
        })
    }

    /// Makes `capture` the reference of all later measurements. After a refusal there is none.
    ///
    /// # Errors
    /// [`Refusal`], with what was found.
    pub fn set_reference(&mut self, capture: &Capture) -> Result<(), Refusal> {
        let mut laps = Laps::start();
        match self.filter(capture, &mut laps) {
            Ok(filtered) => self.refer_to(filtered, &mut laps),
            Err(refusal) => {
                self.keyframe = None;
                Err(refusal)
            }
        }
    }

    /// Follows the reference's points into `capture`.
    ///
    /// # Errors
    /// [`Refusal`], with what was found. The reference stays.
    pub fn measure(&self, capture: &Capture) -> Result<Measurement, Refusal> {
        // Before anything is computed in vain.
        self.keyframe.as_ref().ok_or(Refusal::NoReference)?;
        frame_set::keyframe(self, capture).map(|(measurement, _)| measurement)
    }

    /// [`Flow::measure`] with a capture that was filtered before.
    ///
    /// # Errors
    /// [`Refusal`], with what was found. The reference stays.
    pub fn measure_in(&self, now: &Filtered, laps: &mut Laps) -> Result<Measurement, Refusal> {
        let keyframe = self.keyframe.as_ref().ok_or(Refusal::NoReference)?;
        let mut absences = now.absences.clone();
        active_cameras::mark_frozen(&mut absences, &now.prints, &keyframe.filtered.prints);
        for (absence, before) in absences.iter_mut().zip(&keyframe.filtered.absences) {
            *absence = absence.or(*before);
        }
        let Settled { mut outcome, late } = self.measure_by(keyframe, &absences, now, laps)?;
        if let Some((camera, share)) = late
            && let Some(absence) = absences.get_mut(camera)
        {
            *absence = Some(Absence::OutOfStep { share });
            let without = self.measure_by(keyframe, &absences, now, laps);
            // What is refused with that camera and without it is refused for the first reason.
            outcome = (without.and_then(|settled| settled.outcome))
                .map_err(|refusal| outcome.err().unwrap_or(refusal));
        }
        let mut measurement = outcome?;
        let absent = absences.into_iter().enumerate();
        measurement.absent = absent
            .filter_map(|(k, absence)| Some((k, absence?)))
            .collect();
        Ok(measurement)
    }
}

#[cfg(test)]
mod tests;
