//! Measurement of frame sets: of one target that fills the view, or of several.

use crate::commands::failure::Failure;
use serde::Serialize;
use std::path::Path;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{Measured, Rule};
use trinocular_vision::flow::mistake::explain_keyframe;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings};
use trinocular_vision::images::FrameSet;
use trinocular_vision::targets::TargetFlows;

/// Measurement of the targets of a rig.
pub(super) struct Measurer<'a> {
    rig: &'a RigFile,
    rule: Rule,
    flows: Flows,
    /// Reason why there is no frame set to measure against.
    missing: Option<String>,
    /// The search for a mistake takes many times a measurement, and one mistake explains all.
    is_explained: bool,
}

enum Flows {
    One(Box<Flow>),
    Several(TargetFlows),
}

/// Names of a target, and of the one that it is measured against.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Label {
    /// Name of the target; `None` if the view is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<String>,
}

impl<'a> Measurer<'a> {
    /// Makes the measurement without a keyframe; errors name `rig_path`.
    pub fn new(
        (rig, rig_path): (&'a RigFile, &Path),
        rule: Rule,
        regions: Regions,
    ) -> Result<Self, Failure> {
        let settings = FlowSettings::default();
        let flows = match rig.targets.as_slice() {
            [] => Flow::new(&rig.rig, settings).map(|mut flow| {
                flow.set_regions(regions);
                Flows::One(Box::new(flow))
            }),
            targets => TargetFlows::new(&rig.rig, settings, targets, &regions).map(Flows::Several),
        };
        let refused = |refusal: FlowRefusal| InputError::file(rig_path, refusal.to_string());
        Ok(Self {
            rig,
            rule,
            flows: flows.map_err(refused)?,
            missing: None,
            is_explained: false,
        })
    }

    /// Returns the names of the targets; one without a name if the view is one target.
    pub fn labels(&self) -> Vec<Label> {
        match &self.flows {
            Flows::One(_) => vec![Label::default()],
            Flows::Several(flows) => {
                let names = flows.names().iter().enumerate();
                let label = |(index, name): (usize, &String)| Label {
                    target: Some(name.clone()),
                    against: flows.against(index).map(str::to_owned),
                };
                names.map(label).collect()
            }
        }
    }

    /// Lets displacements count from this frame set.
    pub fn refer_to(&mut self, frame_set: &FrameSet) {
        self.missing = None;
        let refusal = match &mut self.flows {
            Flows::One(flow) => flow.set_keyframe(frame_set).err(),
            Flows::Several(flows) => {
                let outcomes = flows.set_keyframe(frame_set);
                // One target that is hidden leaves the others.
                let are_all_refused = outcomes.iter().all(Result::is_err);
                let refusal = outcomes.into_iter().find_map(Result::err);
                refusal.filter(|_| are_all_refused)
            }
        };
        if let Some(refusal) = refusal {
            let RigFile { rig, names, .. } = self.rig;
            self.missing = Some(match std::mem::replace(&mut self.is_explained, true) {
                false => explain_keyframe(rig, names, frame_set, &refusal),
                true => refusal.to_string(),
            });
        }
    }

    /// Notes that the frame set to measure against cannot be read.
    pub fn refer_to_nothing(&mut self) {
        self.missing = Some("the frame set before cannot be read".to_owned());
    }

    /// Measures the targets in a frame set. A bad keyframe spoils every frame set measured against
    /// it; they share its reason.
    pub fn measure(&mut self, frame_set: &FrameSet) -> Vec<Result<Measured, String>> {
        match (&self.missing, &mut self.flows) {
            (Some(reason), _) => vec![Err(reason.clone()); self.labels().len()],
            (None, Flows::One(flow)) => {
                vec![self.rule.of_images(flow, &self.rig.rig, frame_set)]
            }
            (None, Flows::Several(flows)) => flows.measure(&self.rule, &self.rig.rig, frame_set),
        }
    }
}
