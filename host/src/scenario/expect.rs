//! Expectations of a scenario file; [`judge`](super::judge) compares them with a run.

use shared::safety::{Fault, State};
use shared::track::pursuit::Sight;

/// The `[expect]` section. Figures are those of [`Figures`](super::figures::Figures), over the
/// scenario's measured time; each is an upper bound.
///
/// Three things are always expected: no step is lost, speed and acceleration of the stage are
/// within its limits (abrupt stops left out), and a host that falls silent leaves a stage that
/// stands within the bound of its way. So is that no command of the scenario is refused.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expect {
    /// [`rms_mm`](super::figures::Figures::rms_mm).
    pub rms_mm: Option<[f64; 3]>,
    /// [`max_mm`](super::figures::Figures::max_mm).
    pub max_mm: Option<[f64; 3]>,
    /// [`lag_mm`](super::figures::Figures::lag_mm).
    pub lag_mm: Option<f64>,
    /// [`settle_ms`](super::figures::Figures::settle_ms); there must be a jump, and it must settle.
    pub settle_ms: Option<f64>,
    /// [`overshoot`](super::figures::Figures::overshoot).
    pub overshoot: Option<f64>,
    /// [`jitter_mm`](super::figures::Figures::jitter_mm).
    pub jitter_mm: Option<[f64; 3]>,
    /// [`reversals_per_s`](super::figures::Figures::reversals_per_s), every axis.
    pub reversals_per_s: Option<f64>,
    /// The 99th percentile of [`latency_ms`](super::figures::Figures::latency_ms).
    pub latency_ms: Option<f64>,
    /// Without prediction, [`rms_3d_mm`](super::figures::Figures::rms_3d_mm) must be larger by at
    /// least this factor. The scenario is run a second time for this.
    pub prediction_gain: Option<f64>,
    /// [`steps`](super::figures::Figures::steps), exactly ...
    pub steps: Option<[i64; 3]>,
    /// ... or so near.
    pub steps_within: [i64; 3],
    /// The faults in their order; none without this field.
    pub faults: Vec<Fault>,
    /// The states in their order.
    pub states: Option<Vec<State>>,
    /// What the station knew of the target, in order.
    pub sights: Option<Vec<Sight>>,
    /// Points of the expected trace.
    pub at: Vec<Checkpoint>,
}

/// What must be so at one instant: a `[[expect.at]]` table.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// When, s.
    pub time_s: f64,
    /// The error is within.
    pub error_mm: Option<[f64; 3]>,
    /// The station's state.
    pub state: Option<State>,
    /// Whether the stage stands: no step in the 20 ms before.
    pub standing: Option<bool>,
}
