//! Expectations of a scenario file; [`judge`](super::judge) compares them with a run.

use trinocular_core::safety::{Fault, State};
use trinocular_core::track::pursuit::Sight;

/// The `[expect]` section. Figures are those of [`Figures`](super::figures::Figures), over the
/// scenario's measured time; each is an upper bound.
///
/// Every run must also fulfil four conditions. No step is lost; speed and acceleration of the stage
/// are within its limits (abrupt stops left out); the stage stops within the stated bound after a
/// silence of the host; and no command of the scenario is refused.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expect {
    /// Bound on [`rms_mm`](super::figures::Figures::rms_mm).
    pub rms_mm: Option<[f64; 3]>,
    /// Bound on [`max_mm`](super::figures::Figures::max_mm).
    pub max_mm: Option<[f64; 3]>,
    /// Bound on [`lag_mm`](super::figures::Figures::lag_mm).
    pub lag_mm: Option<f64>,
    /// Bound on [`settle_ms`](super::figures::Figures::settle_ms); the target must jump, and every
    /// jump must settle.
    pub settle_ms: Option<f64>,
    /// Bound on [`overshoot`](super::figures::Figures::overshoot).
    pub overshoot: Option<f64>,
    /// Bound on [`jitter_mm`](super::figures::Figures::jitter_mm).
    pub jitter_mm: Option<[f64; 3]>,
    /// Bound on [`reversals_per_s`](super::figures::Figures::reversals_per_s) of every axis.
    pub reversals_per_s: Option<f64>,
    /// Bound on the 99th percentile of [`latency_ms`](super::figures::Figures::latency_ms).
    pub latency_ms: Option<f64>,
    /// Least factor by which [`rms_3d_mm`](super::figures::Figures::rms_3d_mm) is larger without
    /// prediction. The scenario is run a second time for this.
    pub prediction_gain: Option<f64>,
    /// Expected [`steps`](super::figures::Figures::steps) per axis.
    pub steps: Option<[i64; 3]>,
    /// Largest difference from the expected steps, per axis.
    pub steps_within: [i64; 3],
    /// Expected faults in their order; none without this field.
    pub faults: Vec<Fault>,
    /// Expected states in their order.
    pub states: Option<Vec<State>>,
    /// Expected knowledge of the target in its order, as the station reports it.
    pub sights: Option<Vec<Sight>>,
    /// Expectations at single instants.
    pub at: Vec<Checkpoint>,
}

/// Expectations at one instant: an `[[expect.at]]` table.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Instant, s.
    pub time_s: f64,
    /// Bound on the error per axis, mm.
    pub error_mm: Option<[f64; 3]>,
    /// Expected state of the station.
    pub state: Option<State>,
    /// Expected standstill: true if the stage makes no step in the 20 ms before.
    pub standing: Option<bool>,
}
