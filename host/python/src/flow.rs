//! `Flow`: the keyframe and the measurements against it.

use crate::choice::{PyPivot, rule};
use crate::errors::value;
use crate::pictures::{picture, pictures, scaled};
use crate::result::Outcome;
use crate::rig::Rig;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::Rule;
use trinocular_vision::flow::mistake::explain_keyframe;
use trinocular_vision::flow::region::{Region, Regions};
use trinocular_vision::flow::{self, FlowSettings, remarks};
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::decode::Picture;
use trinocular_vision::images::exposure::faults;

struct State {
    flow: flow::Flow,
    /// Bits in use so far in images of 16 bits.
    depth_bits: u32,
    /// Reason why there is no keyframe.
    without: Option<String>,
    /// Sentences about the keyframe's exposure for the next measurement.
    of_keyframe: Vec<String>,
}

/// Native tracker. Calls from several threads take turns.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Flow {
    rig: RigFile,
    rule: Rule,
    state: Mutex<State>,
}

/// Rectangle and mask of one camera.
pub type PyRegion<'py> = (Option<[u32; 4]>, Option<Bound<'py, PyAny>>);

/// Copies the regions of all cameras.
///
/// # Errors
/// As [`picture`].
pub fn copied(regions: &[PyRegion<'_>]) -> PyResult<Regions> {
    let region = |(rectangle_px, mask): &PyRegion<'_>| {
        let mask = mask.as_ref().map(picture).transpose()?;
        Ok(Region {
            rectangle_px: *rectangle_px,
            mask: mask.map(|mask| Arc::new(mask.scaled(8))),
        })
    };
    let regions = regions.iter().map(region);
    regions.collect::<PyResult<_>>().map(Regions)
}

/// Returns a sentence for each badly exposed image.
pub fn exposure(frame_set: &FrameSet, names: &[String]) -> Vec<String> {
    let faults = faults(frame_set).into_iter();
    faults
        .map(|(camera, fault)| fault.sentence(names, camera))
        .collect()
}

impl Flow {
    fn state(&self) -> MutexGuard<'_, State> {
        // A panic leaves a tracker without a keyframe at worst.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn refer_to(&self, images: Vec<Option<Picture>>) -> Result<(), String> {
        let mut state = self.state();
        let (images, bits) = scaled(images, 8);
        let frame_set = FrameSet { time_us: 0, images };
        state.depth_bits = bits;
        state.of_keyframe = exposure(&frame_set, &self.rig.names);
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
        // A badly exposed keyframe spoils every measurement; the first one names it.
        let mut warnings = std::mem::take(&mut state.of_keyframe);
        warnings.extend(exposure(&frame_set, &self.rig.names));
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
        pivot_mm: Option<PyPivot>,
        threads: usize,
    ) -> PyResult<Self> {
        let rig = rig.file.clone();
        let rule = rule(&rig, method, rotation, pivot_mm)?;
        let settings = FlowSettings {
            threads,
            ..FlowSettings::default()
        };
        let mut flow = flow::Flow::new(&rig.rig, settings).map_err(value)?;
        flow.set_regions(copied(&regions)?);
        Ok(Self {
            rig,
            rule,
            state: Mutex::new(State {
                flow,
                depth_bits: 8,
                without: None,
                of_keyframe: Vec::new(),
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

    /// Gives the keyframe up: measurements are refused with this reason.
    fn drop_keyframe(&self, py: Python<'_>, reason: String) {
        py.detach(|| {
            let mut state = self.state();
            state.without = Some(reason);
            state.of_keyframe.clear();
        });
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
