//! All targets of the rig file, beside the one that the stage follows.

use crate::commands::csv_rows::Column;
use crate::commands::failure::Failure;
use serde_json::{Value, json};
use std::path::Path;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{Choice, Measured, Method, Rule};
use trinocular_vision::flow::region::Regions;
use trinocular_vision::flow::{FlowRefusal, FlowSettings};
use trinocular_vision::images::FrameSet;
use trinocular_vision::targets::TargetFlows;

/// Measurement of all targets, after the frame of the one that the stage follows is on its way.
pub(super) struct Targets {
    flows: TargetFlows,
    rule: Rule,
}

/// Column of `--csv` with the objects of all targets.
pub const COLUMNS: [Column; 1] = [("targets", "/targets")];

/// Returns the line of a target below a row of text.
pub fn line(target: &Value) -> String {
    let text = |key: &str| target[key].as_str().unwrap_or_default();
    let against = match text("against") {
        "" => String::new(),
        against => format!(" against {against}"),
    };
    let name = text("target");
    let numbers = |key: &str| {
        let list = target[key].as_array().into_iter().flatten();
        // Adding zero to what is left after rounding turns -0 into 0.
        let list = list.filter_map(Value::as_f64);
        let list = list.map(|number| (number * 1e4).round() / 1e4 + 0.0);
        list.map(|number| format!("{number:.4}"))
            .collect::<Vec<_>>()
            .join(" ")
    };
    match target["refused"].as_str() {
        Some(reason) => format!("       {name}{against} refused: {reason}"),
        None => {
            let turned = match numbers("rotation_deg") {
                degrees if degrees.is_empty() => degrees,
                degrees => format!(", turned by {degrees} deg"),
            };
            format!(
                "       {name}{against}: {} mm, sigma {} mm{turned}",
                numbers("displacement_mm"),
                numbers("sigma_mm")
            )
        }
    }
}

impl Targets {
    /// Makes the measurement of a rig with several targets; `None` for others. Errors name `source`.
    pub fn of(rig: &RigFile, regions: &Regions, source: &Path) -> Result<Option<Self>, Failure> {
        if rig.targets.len() < 2 {
            return Ok(None);
        }
        let refused = |refusal: FlowRefusal| InputError::file(source, refusal.to_string());
        let settings = FlowSettings::default();
        let flows = TargetFlows::new(&rig.rig, settings, &rig.targets, regions).map_err(refused)?;
        let rule = Choice::default().rule(rig);
        let rule = rule.map_err(|contradiction| Failure::Usage(contradiction.to_string()))?;
        Ok(Some(Self { flows, rule }))
    }

    /// Lets displacements count from this frame set.
    pub fn refer_to(&mut self, frame_set: &FrameSet) {
        // The refusals are in the rows.
        self.flows.set_keyframe(frame_set);
    }

    /// Returns the list of all targets for a row.
    pub fn measure(&mut self, rig: &RigFile, frame_set: &FrameSet) -> Value {
        let measured = self.flows.measure(&self.rule, &rig.rig, frame_set);
        let names = self.flows.names().iter().zip(measured).enumerate();
        let target = |(index, (name, seen)): (usize, (&String, Result<_, String>))| {
            let counted = seen.and_then(|seen: Measured| seen.counted());
            let mut target = match counted {
                Ok((solution, rejected)) => json!({
                    "displacement_mm": solution.displacement_mm,
                    "sigma_mm": solution.sigma_mm,
                    "covariance_mm2": solution.covariance_mm2,
                    "points": solution.points,
                    "rejected": rejected,
                    "method": Method::Midpoint.name(),
                    "turn": solution.turn,
                }),
                Err(reason) => json!({"refused": reason}),
            };
            // As the rows of `estimate` have it.
            if let Some(Value::Object(turn)) = target.get_mut("turn").map(Value::take)
                && let Some(keys) = target.as_object_mut()
            {
                keys.extend(turn);
            }
            if let Some(keys) = target.as_object_mut() {
                keys.remove("turn");
            }
            target["target"] = json!(name);
            if let Some(against) = self.flows.against(index) {
                target["against"] = json!(against);
            }
            target
        };
        names.map(target).collect()
    }
}
