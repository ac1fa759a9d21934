//! The closed loop: frame sets of Python's, and a station that follows the target in them.

use crate::choice::{PyPivot, rule};
use crate::errors::{station, value};
use crate::flow::{PyRegion, copied, exposure};
use crate::pictures::{pictures, scaled};
use crate::result::Outcome;
use crate::rig::Rig;
use crate::station::Station;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, MutexGuard, PoisonError};
use trinocular::servo::serial_station::{FrameRefusal, offer, station_time};
use trinocular::servo::visual_servo::{Measured, ServoEstimate, VisualServo};
use trinocular_client::StationError;
use trinocular_client::diagnosis::remedy;
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{Solution, Turn};
use trinocular_vision::flow::TargetTurn;
use trinocular_vision::flow::mistake::explain_keyframe;
use trinocular_vision::flow::remarks;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::decode::Picture;
use trinocular_vision::sums::Estimator;

struct State {
    servo: VisualServo,
    /// Bits in use so far in images of 16 bits.
    depth_bits: u32,
    /// Sentences about the keyframe's exposure for the next turn.
    of_keyframe: Vec<String>,
}

/// Native loop around a station. Turns of several threads take turns.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Follower {
    rig: RigFile,
    state: Mutex<State>,
}

/// Images of one instant, measured, with warnings.
struct Seen {
    /// Measurement, or the refusal in words.
    measured: Result<Measured, String>,
    warnings: Vec<String>,
}

impl Follower {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn refer_to(&self, images: Vec<Option<Picture>>) -> Result<(), String> {
        let mut state = self.state();
        let (images, bits) = scaled(images, 8);
        let frame_set = FrameSet { time_us: 0, images };
        state.depth_bits = bits;
        state.of_keyframe = exposure(&frame_set, &self.rig.names);
        let outcome = state.servo.set_keyframe(&frame_set);
        outcome.map_err(|refusal| {
            explain_keyframe(&self.rig.rig, &self.rig.names, &frame_set, &refusal)
        })
    }

    fn seen(&self, images: Vec<Option<Picture>>) -> Seen {
        let mut state = self.state();
        let (images, bits) = scaled(images, state.depth_bits);
        state.depth_bits = bits;
        let frame_set = FrameSet { time_us: 0, images };
        let mut warnings = std::mem::take(&mut state.of_keyframe);
        warnings.extend(exposure(&frame_set, &self.rig.names));
        let measured = state.servo.measure(&frame_set);
        if let Ok(measured) = &measured {
            warnings.extend(remarks(&measured.absent, &self.rig.names));
        }
        Seen {
            measured: measured.map_err(|refusal| refusal.to_string()),
            warnings,
        }
    }

    /// Sends the flow sums of images that were taken at `taken_us` of the line's clock; returns the
    /// station's estimate, or the reason why it gave none.
    fn offered(
        &self,
        py: Python<'_>,
        to: &Station,
        taken_us: u64,
        measured: &Measured,
    ) -> PyResult<Result<ServoEstimate, String>> {
        let sent = to.call(py, |serial| {
            let taken = station_time(serial, Instant::from_micros(taken_us))?;
            let frame = self.state().servo.frame(taken, measured.sums);
            offer(serial, frame)
        })?;
        match sent {
            Ok(report) => Ok(Ok(ServoEstimate::new(&report, measured))),
            // It passes not by itself.
            Err(FrameRefusal::Denied(denial)) if remedy(denial).is_some() => {
                let command = "the frame";
                Err(station(&StationError::Denied { command, denial }))
            }
            Err(refusal) => Ok(Err(refusal.to_string())),
        }
    }
}

/// Returns the numbers of the station's estimate.
fn solution(estimate: &ServoEstimate) -> Solution {
    let turn = estimate.turn.map(|turn: TargetTurn| Turn {
        rotation_deg: Some(turn.rotation_deg),
        rotation_sigma_deg: Some(turn.rotation_sigma_deg),
        pivot_mm: Some(turn.pivot_mm),
        is_significant: turn.is_significant,
    });
    Solution {
        displacement_mm: estimate.displacement_mm,
        sigma_mm: estimate.sigma_mm,
        covariance_mm2: estimate.covariance_mm2,
        points: estimate.points,
        turn,
    }
}

#[pymethods]
impl Follower {
    #[new]
    fn new(
        rig: &Rig,
        regions: Vec<PyRegion<'_>>,
        rotation: Option<&str>,
        pivot_mm: Option<PyPivot>,
    ) -> PyResult<Self> {
        let rig = rig.file.clone();
        let rule = rule(&rig, None, rotation, pivot_mm)?;
        let mut servo = VisualServo::new(&rig.rig, Estimator::Midpoint).map_err(value)?;
        servo.set_regions(copied(&regions)?);
        servo.set_pivot(rule.estimated_pivot());
        Ok(Self {
            rig,
            state: Mutex::new(State {
                servo,
                depth_bits: 8,
                of_keyframe: Vec::new(),
            }),
        })
    }

    /// Makes images, taken at `taken_us` of the line's clock, the view to be kept; returns the
    /// refusal in words.
    fn keyframe(
        &self,
        py: Python<'_>,
        station: &Station,
        images: Vec<Option<Bound<'_, PyAny>>>,
        taken_us: u64,
    ) -> PyResult<Option<String>> {
        let images = pictures(&images)?;
        let taken = station.call(py, |serial| {
            station_time(serial, Instant::from_micros(taken_us))
        })?;
        py.detach(|| self.state().servo.set_keyframe_time(taken));
        Ok(py.detach(|| self.refer_to(images)).err())
    }

    /// Measures images that were taken at `taken_us` of the line's clock, and lets the station
    /// follow. The keys `stage_mm` and `latency_us` go with those of a measurement.
    fn turn<'py>(
        &self,
        py: Python<'py>,
        station: &Station,
        images: Vec<Option<Bound<'py, PyAny>>>,
        taken_us: u64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let images = pictures(&images)?;
        let Seen { measured, warnings } = py.detach(|| self.seen(images));
        let estimate = match &measured {
            Ok(measured) => self.offered(py, station, taken_us, measured)?,
            Err(reason) => Err(reason.clone()),
        };
        let status = station.call(py, |serial| serial.fresh_status(false))?;
        station.check_end(py, &status)?;
        let seen = measured.ok().and_then(|measured| measured.measurement);
        let (points, cameras) = match (&estimate, seen) {
            (Ok(_), Some(seen)) => (seen.correspondences, seen.cameras),
            _ => (Vec::new(), Vec::new()),
        };
        let outcome = Outcome {
            solution: Some(match &estimate {
                Ok(estimate) => Ok((solution(estimate), estimate.rejected)),
                Err(reason) => Err(reason.clone()),
            }),
            points,
            cameras,
            warnings,
        };
        let dict = outcome.to_dict(py, &self.rig.rig)?;
        dict.set_item("stage_mm", station.in_mm(status.position_steps))?;
        let latency_us = estimate.ok().map(|estimate| estimate.latency_us);
        dict.set_item("latency_us", latency_us)?;
        Ok(dict)
    }
}
