//! Displacement of a target from the images of a multi-camera rig.
//!
//! ```text
//! frame set -> pyramids -> corners -> stereo matching ----------------.    once per keyframe
//! frame set -> pyramids -> displacement search -> tracking -> consensus -> Measurement
//! ```
//!
//! [`Flow`] does all steps. [`Flow::set_keyframe`] chooses Shi-Tomasi corners in the reference
//! camera and matches them in the other cameras; [`Flow::measure`] tracks them into a later
//! [`FrameSet`] with the inverse compositional Lucas-Kanade method and keeps those that move as
//! one. The result is a [`Measurement`]: correspondences, their common displacement in mm, and its
//! variance inflation factor.
//!
//! A monocular tracker (OpenCV's `calcOpticalFlowPyrLK`) needs a good start for every point. Here
//! the depth of every point is known from the stereo match, so one displacement with three
//! components predicts the motion of all points in all cameras, and that displacement is searched
//! first.
//!
//! | step | module |
//! |---|---|
//! | smooth and halve the images | [`filter`], [`pyramid`](crate::matching::pyramid) |
//! | choose and match points at the keyframe | `keyframe`, [`stereo`](crate::matching::stereo) |
//! | search the displacement without a prior | [`displacement_search`] |
//! | refine it, then track every point in every camera | [`temporal`] |
//! | keep the inliers | [`consensus`], `accept` |
//! | refuse inliers of several objects | `rigidity` |
//! | decide between the depths of ambiguous corners | `depth_profile` |
//! | match soft images at half the resolution | `reduced` |
//! | inflate the variance for correlated errors | [`variance_inflation`] |
//! | measure displacement and rotation instead | `turned` |
//! | refuse a rotating target, leave out a skewed camera | [`rotation`], [`sync`] |
//! | refuse inliers that are not most of the image | `coverage` |
//! | restrict points to a region of interest | [`region`] |
//! | leave out missing, blank and frozen cameras | [`active_cameras`], [`frozen`] |
//!
//! *Invariant:* a measurement is never based on a choice between explanations that fit alike; such
//! frame sets are refused ([`FlowRefusal`]).
//!
//! # Example
//!
//! A rendered poster moves by 4 mm to the right of the paper's three cameras:
//!
//! ```
//! use trinocular_core::rig::Rig;
//! use trinocular_vision::flow::{Flow, FlowSettings};
//! use trinocular_vision::images::{Scene, SceneSettings, Texture};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let rig = Rig::paper();
//! let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
//! let mut flow = Flow::new(&rig, FlowSettings::default())?;
//! flow.set_keyframe(&scene.render([0.0, 0.0, 0.0], 0, 1))?;
//! let measurement = flow.measure(&scene.render([4.0, 0.0, 0.0], 33_333, 2))?;
//! assert!((measurement.displacement_mm[0] - 4.0).abs() < 0.05);
//! # Ok(())
//! # }
//! ```

use crate::images::FrameSet;
use crate::matching::geometry::RigGeometry;
use crate::thread_pool::ThreadPool;
use trinocular_core::rig::Rig;
use trinocular_rig::pivot::Pivot;

mod accept;
pub mod active_cameras;
mod camera_refusal;
pub mod camera_shift;
#[cfg(test)]
mod cloud;
pub mod consensus;
mod corner_motion;
mod coverage;
mod depth_profile;
pub mod displacement_search;

pub mod filter;
pub mod frozen;
mod keyframe;
mod last_pose;
mod linear_motion;
mod matched_corners;
mod measure;
mod measurement;
pub mod mistake;
mod pyramid_pool;
mod reduced;
mod refusal;
pub mod region;
mod rigidity;
pub mod rotation;
mod settings;
mod stage;
pub mod sync;
pub mod temporal;
mod tracks;
mod turned;
pub mod variance_inflation;

pub use camera_refusal::{CameraRefusal, remarks};
pub use filter::FilteredFrameSet;
use frozen::FrozenCameras;
use keyframe::Keyframe;
pub use last_pose::LastPose;
pub use measurement::{Correspondence, Measurement, RejectedPoint, TargetTurn};
use pyramid_pool::PyramidPool;
pub use refusal::FlowRefusal;
use region::Regions;
pub use settings::FlowSettings;
pub use stage::{PipelineStage, StageObserver};
pub use turned::PoseMeasurement;
pub(crate) use turned::offered;
pub use turned::offered::Offered;

/// Tracker of one target: a keyframe, and the measurements against it.
///
/// All state is in these fields: the keyframe, the last images (a camera that repeats one is
/// frozen), buffers for reuse and the threads that share the work. A clone has its own state and
/// shares the threads.
#[derive(Clone, Debug)]
pub struct Flow {
    geometry: RigGeometry,
    settings: FlowSettings,
    regions: Regions,
    pivot: Option<Pivot>,
    keyframe: Option<Keyframe>,
    /// Last pose that was measured against the keyframe.
    last_pose: Option<LastPose>,
    /// Tracker at half the resolution, which has the keyframe if its images are soft.
    reduced: Option<Box<Flow>>,
    frozen_cameras: FrozenCameras,
    pyramid_pool: PyramidPool,
    thread_pool: ThreadPool,
}

impl Flow {
    /// Creates a tracker without a keyframe.
    ///
    /// # Errors
    /// [`FlowRefusal::WrongRig`] unless two cameras of `rig` are in different places.
    pub fn new(rig: &Rig, settings: FlowSettings) -> Result<Self, FlowRefusal> {
        Ok(Self {
            geometry: RigGeometry::new(rig).ok_or(FlowRefusal::WrongRig)?,
            thread_pool: ThreadPool::new(settings.threads),
            settings,
            regions: Regions::default(),
            pivot: None,
            keyframe: None,
            last_pose: None,
            reduced: None,
            frozen_cameras: FrozenCameras::default(),
            pyramid_pool: PyramidPool::default(),
        })
    }

    /// Returns the threads that share the work of this tracker.
    pub fn thread_pool(&self) -> &ThreadPool {
        &self.thread_pool
    }

    /// Restricts the points to regions of the cameras' images. Rectangles take effect at the next
    /// keyframe, masks at the next measurement.
    pub fn set_regions(&mut self, regions: Regions) {
        if let Some(reduced) = &mut self.reduced {
            reduced.set_regions(regions.halved());
        }
        self.regions = regions;
    }

    /// Lets [`Flow::measure_target`] estimate the rotation of the target and the displacement of
    /// this point; with `None`, a target that turns is refused. About the centroid, a target whose
    /// points do not determine a rotation is measured without one.
    pub fn set_pivot(&mut self, pivot: Option<Pivot>) {
        self.pivot = pivot;
    }

    /// Makes `frame_set` the keyframe of all later measurements.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the points of the frame set cannot be matched; there is no keyframe then.
    pub fn set_keyframe(&mut self, frame_set: &FrameSet) -> Result<(), FlowRefusal> {
        match self.filter(frame_set) {
            Ok(filtered) => self.set_filtered_keyframe(filtered, &mut ()),
            Err(refusal) => {
                self.keyframe = None;
                self.last_pose = None;
                self.reduced = None;
                Err(refusal)
            }
        }
    }

    /// Measures the displacement of the target from the keyframe to `frame_set`.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the displacement cannot be measured; the keyframe stays.
    ///
    /// # Example
    /// ```
    /// use trinocular_core::rig::Rig;
    /// use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings};
    /// use trinocular_vision::images::{Scene, SceneSettings, Texture};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let rig = Rig::paper();
    /// let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
    /// let [before, now] = [[0.0; 3], [1.0, -2.0, 3.0]].map(|mm| scene.render(mm, 0, 1));
    ///
    /// let mut flow = Flow::new(&rig, FlowSettings::default())?;
    /// assert_eq!(flow.measure(&now).err(), Some(FlowRefusal::NoKeyframe));
    /// flow.set_keyframe(&before)?;
    /// let [x, y, z] = flow.measure(&now)?.displacement_mm;
    /// assert!((x - 1.0).abs() < 0.05 && (y + 2.0).abs() < 0.05 && (z - 3.0).abs() < 0.1);
    /// # Ok(())
    /// # }
    /// ```
    pub fn measure(&mut self, frame_set: &FrameSet) -> Result<Measurement, FlowRefusal> {
        self.measure_observed(frame_set, &mut ())
    }

    /// Measures the displacement of the target, or of the pivot of a target that may turn, as
    /// [`Flow::set_pivot`] decides.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the displacement cannot be measured; the keyframe stays.
    pub fn measure_target(&mut self, frame_set: &FrameSet) -> Result<Measurement, FlowRefusal> {
        let Some(pivot) = self.pivot else {
            return self.measure(frame_set);
        };
        let pivot_mm = self.keyframe_pivot_mm(pivot)?;
        self.measure_with(frame_set, &mut (), |flow, filtered, _| match pivot {
            Pivot::Centroid => flow
                .measure_filtered_offered(filtered)
                .map(|seen| match seen {
                    Offered::Pose(seen) => seen.of_pivot(pivot_mm),
                    Offered::Displacement(seen) => *seen,
                }),
            Pivot::Place(_) | Pivot::Spot(_) => {
                let seen = flow.measure_filtered_pose(filtered)?;
                Ok(seen.of_pivot(pivot_mm))
            }
        })
    }

    /// Does the same as [`Flow::measure`], with an observer of the pipeline's stages.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the displacement cannot be measured; the keyframe stays.
    pub fn measure_observed(
        &mut self,
        frame_set: &FrameSet,
        observer: &mut dyn StageObserver,
    ) -> Result<Measurement, FlowRefusal> {
        self.measure_with(frame_set, observer, |flow, filtered, observer| {
            flow.measure_filtered(filtered, observer)
        })
    }

    /// Filters a frame set and measures it, with the threads of this tracker.
    ///
    /// # Errors
    /// [`FlowRefusal::NoKeyframe`], those of [`Flow::filter`], and those of `measure`.
    pub fn measure_with<T: Send>(
        &mut self,
        frame_set: &FrameSet,
        observer: &mut dyn StageObserver,
        measure: impl FnOnce(
            &mut Self,
            &FilteredFrameSet,
            &mut dyn StageObserver,
        ) -> Result<T, FlowRefusal>
        + Send,
    ) -> Result<T, FlowRefusal> {
        // Without a keyframe, filtering would be wasted.
        self.check_keyframe()?;
        let thread_pool = self.thread_pool.clone();
        // Inside the pool, no stage has to wake its threads again.
        let (measured, filtered) = thread_pool.run(|| {
            let filtered = self.filter_observed(frame_set, observer)?;
            let measured = measure(self, &filtered, observer);
            Ok((measured, filtered))
        })?;
        self.pyramid_pool.put(filtered);
        measured
    }

    /// Takes back the memory of a filtered frame set, for the next one.
    pub fn reuse(&mut self, filtered: FilteredFrameSet) {
        self.pyramid_pool.put(filtered);
    }

    /// Refuses a measurement without a keyframe.
    fn check_keyframe(&self) -> Result<(), FlowRefusal> {
        match self.keyframe.is_some() || self.reduced.is_some() {
            true => Ok(()),
            false => Err(FlowRefusal::NoKeyframe),
        }
    }

    /// Returns the number of pyramid levels that the searches need.
    fn levels(&self) -> usize {
        1 + self.temporal_level().max(self.spatial_level())
    }

    /// Returns the pyramid level of the stereo search: the first at most 240 px wide.
    fn spatial_level(&self) -> usize {
        level_at_most(self.geometry.rig.image_size_px[0] as usize, 240).max(1)
    }

    /// Returns the pyramid level of the displacement search: the first at most 120 px wide.
    fn temporal_level(&self) -> usize {
        level_at_most(self.geometry.rig.image_size_px[0] as usize, 120).max(1)
    }

    /// Returns the level on which the displacement of the search is refined first.
    fn refined_level(&self) -> usize {
        (self.temporal_level() - 1).max(1)
    }
}

/// Returns the first level on which an image `width_px` wide is at most `most_px` wide.
fn level_at_most(width_px: usize, most_px: usize) -> usize {
    (0..)
        .find(|level| width_px >> level <= most_px)
        .unwrap_or(0)
}

#[cfg(test)]
mod tests;
