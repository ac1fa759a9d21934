//! Several targets in one view: each has its own region, keyframe, points and refusals.
//!
//! The images are filtered once for all targets, so that the cost of a further target is that of
//! its points. A target may be measured against another one, the reference: what moves both, such
//! as drift of a tripod or vibration of the rig, drops out.
//!
//! ```
//! use trinocular_rig::rig_file::{RigFile, Target};
//! use trinocular_vision::estimation::Rule;
//! use trinocular_vision::images::{Scene, SceneSettings, Texture};
//! use trinocular_vision::flow::FlowSettings;
//! use trinocular_vision::flow::region::Regions;
//! use trinocular_vision::targets::TargetFlows;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let RigFile { rig, .. } = RigFile::paper();
//! let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
//! let target = |name: &str, roi_px| Target {
//!     name: name.to_owned(), roi_px, camera: 1, is_reference: name == "wall", drives: false,
//! };
//! let targets = [target("door", [60, 20, 90, 200]), target("wall", [160, 20, 90, 200])];
//! let mut flows = TargetFlows::new(&rig, FlowSettings::default(), &targets, &Regions::default())?;
//! for keyframe in flows.set_keyframe(&scene.render([0.0; 3], 0, 1)) {
//!     keyframe?;
//! }
//! let seen = flows.measure(&Rule::default(), &rig, &scene.render([1.0, 0.0, 0.0], 0, 2));
//! let door = seen[0].clone()?.solution?;
//! // The wall moves as the door does: the rig has moved.
//! assert!(door.displacement_mm[0].abs() < 0.02);
//! # Ok(())
//! # }
//! ```

mod relative;

use crate::estimation::{Measured, Rule};
use crate::flow::region::{Region, Regions};
use crate::flow::{FilteredFrameSet, Flow, FlowRefusal, FlowSettings};
use crate::images::FrameSet;
use relative::relative;
use trinocular_core::rig::Rig;
use trinocular_rig::rig_file::{RigFile, Target};

/// Trackers of several targets.
#[derive(Clone, Debug)]
pub struct TargetFlows {
    flows: Vec<Flow>,
    names: Vec<String>,
    /// Refusals of the last keyframe.
    refusals: Vec<Option<FlowRefusal>>,
    /// Index of the reference.
    reference: Option<usize>,
}

impl TargetFlows {
    /// Creates a tracker for each target, without a keyframe. The points of all are within
    /// `regions`, too.
    ///
    /// # Errors
    /// [`FlowRefusal::WrongRig`] unless two cameras of `rig` are in different places.
    pub fn new(
        rig: &Rig,
        settings: FlowSettings,
        targets: &[Target],
        regions: &Regions,
    ) -> Result<Self, FlowRefusal> {
        // Clones share the threads.
        let empty = Flow::new(rig, settings)?;
        let flows = targets.iter().map(|target| {
            let mut flow = empty.clone();
            flow.set_regions(within(target, rig, regions));
            flow
        });
        Ok(Self {
            flows: flows.collect(),
            names: targets.iter().map(|target| target.name.clone()).collect(),
            refusals: vec![Some(FlowRefusal::NoKeyframe); targets.len()],
            reference: targets.iter().position(|target| target.is_reference),
        })
    }

    /// Makes `frame_set` the keyframe of all targets; returns the result of each.
    pub fn set_keyframe(&mut self, frame_set: &FrameSet) -> Vec<Result<(), FlowRefusal>> {
        let results = match self.filter(frame_set) {
            Ok(filtered) => {
                let flows = self.flows.iter_mut();
                flows
                    .map(|flow| flow.set_filtered_keyframe(filtered.clone(), &mut ()))
                    .collect()
            }
            Err(refusal) => vec![Err(refusal); self.flows.len()],
        };
        self.refusals = results.iter().map(|result| result.clone().err()).collect();
        results
    }

    /// Measures each target against its keyframe, and relative to the reference if there is one.
    /// A refused target has the reason in its place.
    pub fn measure(
        &mut self,
        rule: &Rule,
        rig: &Rig,
        frame_set: &FrameSet,
    ) -> Vec<Result<Measured, String>> {
        let filtered = match self.filter(frame_set) {
            Ok(filtered) => filtered,
            Err(refusal) => return vec![Err(refusal.to_string()); self.flows.len()],
        };
        let flows = self.flows.iter_mut().zip(&self.refusals);
        let measured = flows.map(|(flow, refusal)| match refusal {
            Some(refusal) => Err(format!("no keyframe: {refusal}")),
            None => rule.of_filtered(flow, rig, &filtered),
        });
        let mut measured: Vec<_> = measured.collect();
        if let Some(flow) = self.flows.first_mut() {
            flow.reuse(filtered);
        }
        let Some(reference) = self.reference else {
            return measured;
        };
        let name = &self.names[reference];
        let against = match &measured[reference] {
            Ok(Measured {
                solution: Ok(solution),
                pose,
                ..
            }) => Ok((*solution, *pose)),
            Ok(Measured {
                solution: Err(reason),
                ..
            })
            | Err(reason) => Err(format!("the reference {name} is refused: {reason}")),
        };
        for (index, seen) in measured.iter_mut().enumerate() {
            if index != reference
                && let Ok(seen) = seen
                && let Ok(solution) = &seen.solution
            {
                let centroid_mm = self.flows[index].keyframe_centroid_mm();
                let relative = |(other, pose)| relative(solution, &other, pose, centroid_mm);
                seen.solution = against.clone().map(relative);
            }
        }
        measured
    }

    /// Returns the name of the target that this one is measured against.
    pub fn against(&self, index: usize) -> Option<&str> {
        let reference = self.reference.filter(|reference| *reference != index)?;
        self.names.get(reference).map(String::as_str)
    }

    /// Returns the names of the targets.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    fn filter(&mut self, frame_set: &FrameSet) -> Result<FilteredFrameSet, FlowRefusal> {
        match self.flows.first_mut() {
            Some(flow) => flow.filter(frame_set),
            None => Err(FlowRefusal::NoKeyframe),
        }
    }
}

/// Returns the regions of the target that the stage follows; those given if the view is one target.
pub fn driving(rig: &RigFile, regions: Regions) -> Regions {
    let driving = rig.targets.iter().find(|target| target.drives);
    match driving {
        Some(target) => within(target, &rig.rig, &regions),
        None => regions,
    }
}

/// Returns the regions of all cameras with the target's rectangle.
pub fn within(target: &Target, rig: &Rig, regions: &Regions) -> Regions {
    let mut regions = regions.0.clone();
    regions.resize(rig.cameras.len(), Region::default());
    if let Some(region) = regions.get_mut(target.camera) {
        region.rectangle_px = Some(match region.rectangle_px {
            Some(other) => overlap(other, target.roi_px),
            None => target.roi_px,
        });
    }
    Regions(regions)
}

/// Returns the part that two rectangles share; one without pixels if they share none.
fn overlap(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    let side = |i: usize| {
        let start = a[i].max(b[i]);
        let end = (a[i].saturating_add(a[i + 2])).min(b[i].saturating_add(b[i + 2]));
        (start, end.saturating_sub(start))
    };
    let ((x, width), (y, height)) = (side(0), side(1));
    [x, y, width, height]
}

#[cfg(test)]
mod tests;
