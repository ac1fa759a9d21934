//! `--reference FILE`: a view of the target that was saved earlier, from which displacements count.

use crate::commands::failure::Failure;
use crate::commands::frames::{RecordingInput, Rigged};
use std::path::{Path, PathBuf};
use trinocular_recording::read::is_recording;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::mistake::explain_keyframe;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::flow::{Flow, FlowSettings};
use trinocular_vision::images::FrameSet;
use trinocular_vision::targets;

/// View of the target that was saved earlier: the first frame set of a recording, with its rig.
pub struct ReferenceView {
    path: PathBuf,
    /// The frame set.
    pub frame_set: FrameSet,
    /// The rig that took it.
    pub rig: RigFile,
    /// Regions of interest with which it was saved.
    regions: Regions,
}

impl ReferenceView {
    /// Reads the view from a recording.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        if path.exists() && !is_recording(path) {
            let reason = "is no recording: `trinocular reference INPUT --rig RIG.toml --out \
                          FILE.mcap` saves a reference view";
            return Err(InputError::file(path, reason).into());
        }
        let (Rigged { frames, rig }, regions) = RecordingInput::default().open_view(path)?;
        let first = frames.frame_sets().next();
        let empty = || InputError::file(path, "holds no images");
        let frame_set = first.ok_or_else(empty)??;
        Ok(Self {
            path: path.to_owned(),
            frame_set,
            rig,
            regions,
        })
    }

    /// Returns the regions of the view, unless others are given.
    pub fn regions_or(&self, given: Regions) -> Regions {
        match given.0.is_empty() {
            true => self.regions.clone(),
            false => given,
        }
    }

    /// Refuses a rig that measures otherwise than the rig of the view, and a view that cannot be
    /// the keyframe.
    pub fn check(&self, rig: &RigFile, rig_path: &Path, regions: &Regions) -> Result<(), Failure> {
        if let Some(difference) = difference(rig, &self.rig) {
            let view = self.path.display();
            let reason = format!(
                "is not the rig of the reference view {view}: {difference}; measure with the rig \
                 of the view, or save a new view"
            );
            return Err(InputError::file(rig_path, reason).into());
        }
        let mut points = points(rig, &self.frame_set, regions);
        if points.iter().any(|(_, points)| points.is_ok()) {
            for (name, refused) in points.extract_if(.., |(_, points)| points.is_err()) {
                if let (Some(name), Err(reason)) = (name, refused) {
                    let view = self.path.display();
                    notice!("warning: {view}: the target {name} cannot be measured: {reason}");
                }
            }
        }
        let points = counted(&points).map_err(|reason| InputError::file(&self.path, reason))?;
        let view = self.path.display();
        notice!("displacements count from {view}, {points}");
        Ok(())
    }
}

/// Puts the view before the first frame set that can be read, as if it had been taken `period_us`
/// earlier. The frame sets keep their capture times.
pub fn put_before(
    view: Option<ReferenceView>,
    frame_sets: impl Iterator<Item = Result<FrameSet, InputError>>,
    period_us: u64,
) -> impl Iterator<Item = Result<FrameSet, InputError>> {
    let mut frame_sets = frame_sets.peekable();
    let mut view = view.map(|view| view.frame_set);
    std::iter::from_fn(move || {
        if let Some(Ok(first)) = frame_sets.peek()
            && let Some(view) = view.take()
        {
            let time_us = first.time_us.saturating_sub(period_us);
            return Some(Ok(FrameSet { time_us, ..view }));
        }
        frame_sets.next()
    })
}

/// Points that a frame set has as a keyframe, of one target: its name, if the view is not one
/// target, and their number or the reason why there are none.
pub type KeyframePoints = (Option<String>, Result<usize, String>);

/// Counts the points that `frame_set` has as a keyframe, per target.
pub fn points(rig: &RigFile, frame_set: &FrameSet, regions: &Regions) -> Vec<KeyframePoints> {
    let count = |regions: Regions| {
        let mut flow = Flow::new(&rig.rig, FlowSettings::default()).map_err(|e| e.to_string())?;
        flow.set_regions(regions);
        flow.set_keyframe(frame_set)
            .map_err(|refusal| explain_keyframe(&rig.rig, &rig.names, frame_set, &refusal))?;
        let measured = flow.measure(frame_set).map_err(|e| e.to_string())?;
        Ok(measured.correspondences.len())
    };
    if rig.targets.is_empty() {
        return vec![(None, count(regions.clone()))];
    }
    let targets = rig.targets.iter();
    let points = targets.map(|target| {
        let points = count(targets::within(target, &rig.rig, regions));
        (Some(target.name.clone()), points)
    });
    points.collect()
}

/// Returns the number of points of each target in words.
///
/// # Errors
/// The first target without points, with the reason.
pub fn counted(points: &[KeyframePoints]) -> Result<String, String> {
    let counts = points.iter().map(|(name, points)| match (name, points) {
        (None, Ok(points)) => Ok(format!("{points} points")),
        (Some(name), Ok(points)) => Ok(format!("{name}: {points} points")),
        (None, Err(reason)) => Err(reason.clone()),
        (Some(name), Err(reason)) => Err(format!("the target {name}: {reason}")),
    });
    Ok(counts.collect::<Result<Vec<_>, String>>()?.join(", "))
}

/// Describes the first difference of the cameras of a rig from those of the view's.
fn difference(rig: &RigFile, of_view: &RigFile) -> Option<String> {
    if rig.names != of_view.names {
        let [ours, theirs] = [rig, of_view].map(|rig| rig.names.join(", "));
        return Some(format!(
            "its cameras are {ours}, those of the view {theirs}"
        ));
    }
    let [ours, theirs] = [rig, of_view].map(|rig| rig.rig.image_size_px);
    if ours != theirs {
        let [ours, theirs] = [ours, theirs].map(|[width, height]| format!("{width} x {height} px"));
        return Some(format!(
            "its images have {ours}, those of the view {theirs}"
        ));
    }
    let cameras = rig.rig.cameras.iter().zip(&of_view.rig.cameras);
    cameras.zip(&rig.names).find_map(|((ours, theirs), name)| {
        let values: [(&str, Vec<f64>, Vec<f64>); 5] = [
            ("focal_px", ours.focal_px.into(), theirs.focal_px.into()),
            (
                "principal_px",
                ours.principal_px.into(),
                theirs.principal_px.into(),
            ),
            ("offset_mm", ours.offset_mm.into(), theirs.offset_mm.into()),
            (
                "distortion",
                ours.coefficients().to_vec(),
                theirs.coefficients().to_vec(),
            ),
            (
                "rotation_deg",
                ours.rotation.degrees().to_vec(),
                theirs.rotation.degrees().to_vec(),
            ),
        ];
        let differs = |(_, ours, theirs): &(&str, Vec<f64>, Vec<f64>)| ours != theirs;
        let (field, ours, theirs) = values.into_iter().find(differs)?;
        Some(format!(
            "{field} of camera {name} is {ours:?}, in the view {theirs:?}"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_difference_is_named() {
        let paper = RigFile::paper();
        assert_eq!(difference(&paper, &paper), None);
        let mut other = RigFile::paper();
        other.names.swap(0, 2);
        let named = difference(&other, &paper).expect("a difference");
        assert!(named.contains("right, middle, left"), "{named}");
        let mut other = RigFile::paper();
        other.rig.cameras[1].distortion[4] = 1e-9;
        let named = difference(&other, &paper).expect("a difference");
        assert!(named.starts_with("distortion of camera middle"), "{named}");
    }
}
