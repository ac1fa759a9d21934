//! `Flow`: the keyframe and the measurements against it.

use crate::errors::value;
use crate::pictures::{picture, pictures, scaled};
use crate::result::Outcome;
use crate::rig::Rig;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{Method, Rotation, Rule};
use trinocular_vision::flow::mistake::explain_keyframe;
use trinocular_vision::flow::region::{Region, Regions};
use trinocular_vision::flow::{self, FlowSettings, remarks};
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::decode::Picture;
use trinocular_vision::images::exposure::faults;

/// Reads the choice of the estimate.
///
/// # Errors
/// `ValueError` with the choices.
pub fn rule(
    method: Option<&str>,
    rotation: Option<&str>,
    pivot_mm: Option<[f64; 3]>,
) -> PyResult<Rule> {
    let method = match method {
        None => None,
        Some("midpoint") => Some(Method::Midpoint),
        Some("closed-form") => Some(Method::ClosedForm),
        Some("least-squares") => Some(Method::LeastSquares),
        Some(other) => {
            return Err(value(format!(
                "method {other:?} is unknown; use \"midpoint\", \"closed-form\" or \
                 \"least-squares\""
            )));
        }
    };
    let rotation = match rotation {
        None => None,
        Some("refuse") => Some(Rotation::Refuse),
        Some("estimate") => Some(Rotation::Estimate),
        Some(other) => {
            return Err(value(format!(
                "rotation {other:?} is unknown; use \"refuse\" or \"estimate\""
            )));
        }
    };
    if rotation == Some(Rotation::Estimate) && !matches!(method, None | Some(Method::Midpoint)) {
        return Err(value(
            "rotation=\"estimate\" takes method=\"midpoint\": the others know no rotation",
        ));
    }
    if let Some(pivot) = pivot_mm {
        if !pivot.iter().all(|mm| mm.is_finite()) {
            return Err(value(format!(
                "pivot_mm {pivot:?} must be three finite numbers"
            )));
        }
        let is_estimated = matches!(
            (rotation, method),
            (Some(Rotation::Estimate), _) | (None, None)
        );
        if !is_estimated {
            return Err(value(
                "pivot_mm takes rotation=\"estimate\": without a rotation all points move alike",
            ));
        }
    }
    Ok(Rule {
        method,
        rotation,
        pivot_mm,
    })
}

/// Refuses a rig that does not suit the method.
///
/// # Errors
/// `ValueError` with field and reason.
pub fn check(rule: &Rule, rig: &RigFile) -> PyResult<()> {
    match rule.method {
        None | Some(Method::Midpoint) => Ok(()),
        Some(Method::ClosedForm | Method::LeastSquares) => {
            let parsed = RigFile::parse_in_line("rig".as_ref(), &rig.to_toml());
            parsed.map(drop).map_err(value)
        }
    }
}

struct State {
    flow: flow::Flow,
    /// Bits in use so far in images of 16 bits.
    depth_bits: u32,
    /// Reason why there is no keyframe.
    without: Option<String>,
}

/// Native tracker. Calls from several threads take turns.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Flow {
    rig: RigFile,
    rule: Rule,
    state: Mutex<State>,
}

/// Rectangle and mask of one camera.
type PyRegion<'py> = (Option<[u32; 4]>, Option<Bound<'py, PyAny>>);

impl Flow {
    fn state(&self) -> MutexGuard<'_, State> {
        // A panic leaves a tracker without a keyframe at worst.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn exposure(&self, frame_set: &FrameSet) -> Vec<String> {
        let faults = faults(frame_set).into_iter();
        let sentence = |(camera, fault): (usize, _)| {
            let name = self.rig.names.get(camera).map_or("?", String::as_str);
            format!("camera {name} {fault}")
        };
        faults.map(sentence).collect()
    }

    fn refer_to(&self, images: Vec<Option<Picture>>) -> Result<(), String> {
        let mut state = self.state();
        let (images, bits) = scaled(images, 8);
        let frame_set = FrameSet { time_us: 0, images };
        state.depth_bits = bits;
        let outcome = state.flow.set_keyframe(&frame_set);
        let outcome = outcome.map_err(|refusal| {
            explain_keyframe(&self.rig.rig, &self.rig.names, &frame_set, &refusal)
        });
        state.without = outcome.clone().err();
        outcome
    }

    fn seen(&self, time_us: u64, images: Vec<Option<Picture>>) -> Outcome {
        let mut state = self.state();
        let (images, bits) = scaled(images, state.depth_bits);
        state.depth_bits = bits;
        let frame_set = FrameSet { time_us, images };
        let mut warnings = self.exposure(&frame_set);
        if let Some(reason) = &state.without {
            return Outcome {
                warnings,
                ..Outcome::refused(reason.clone())
            };
        }
        let rig = &self.rig.rig;
        match self.rule.of_images(&mut state.flow, rig, &frame_set) {
            Ok(measured) => {
                warnings.extend(remarks(&measured.refused_cameras, &self.rig.names));
                Outcome {
                    solution: Some(measured.counted()),
                    points: measured.correspondences,
                    cameras: measured.cameras,
                    warnings,
                }
            }
            Err(reason) => Outcome {
                warnings,
                ..Outcome::refused(reason)
            },
        }
    }
}

#[pymethods]
impl Flow {
    #[new]
    fn new(
        rig: &Rig,
        regions: Vec<PyRegion<'_>>,
        method: Option<&str>,
        rotation: Option<&str>,
        pivot_mm: Option<[f64; 3]>,
        threads: usize,
    ) -> PyResult<Self> {
        let rig = rig.file.clone();
        let rule = rule(method, rotation, pivot_mm)?;
        check(&rule, &rig)?;
        let settings = FlowSettings {
            threads,
            ..FlowSettings::default()
        };
        let mut flow = flow::Flow::new(&rig.rig, settings).map_err(value)?;
        let mut all = Vec::new();
        for (rectangle_px, mask) in &regions {
            let mask = mask.as_ref().map(picture).transpose()?;
            all.push(Region {
                rectangle_px: *rectangle_px,
                mask: mask.map(|mask| Arc::new(mask.scaled(8))),
            });
        }
        flow.set_regions(Regions(all));
        Ok(Self {
            rig,
            rule,
            state: Mutex::new(State {
                flow,
                depth_bits: 8,
                without: None,
            }),
        })
    }

    /// Sets the keyframe; returns the refusal in words.
    fn keyframe(
        &self,
        py: Python<'_>,
        images: Vec<Option<Bound<'_, PyAny>>>,
    ) -> PyResult<Option<String>> {
        let images = pictures(&images)?;
        Ok(py.detach(|| self.refer_to(images)).err())
    }

    /// Measures a frame set.
    fn measure<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Option<Bound<'py, PyAny>>>,
        time_us: u64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let images = pictures(&images)?;
        let outcome = py.detach(|| self.seen(time_us, images));
        outcome.to_dict(py, &self.rig.rig)
    }
}
