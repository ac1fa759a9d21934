//! Figures of a run, computed from its trace alone.
//!
//! The *error* is the position of the cameras minus that of the target, each from its position at
//! the keyframe, at every millisecond. It uses the true positions from the step pins, not the
//! station's estimate. Speed and acceleration of the stage are differences of its position over 20
//! ms, which are means of the derivative. A position is known to one step, so a difference of order
//! `k` has an error of at most `2^(k-1)` steps over the window's `k`th power.

use super::file::{Measure, Scenario};
use super::motion::Way;
use super::trace::{Frames, SAMPLE_S, Sample, Trace};
use serde::Serialize;
use trinocular_client::diagnosis;
use trinocular_client::stage::HEARTBEAT_MS;
use trinocular_rig::rig_file::Stage;

/// Window of the means of speed and acceleration, s.
const WINDOW_S: f64 = 0.020;

/// Window in samples.
const WINDOW: usize = (WINDOW_S / SAMPLE_S) as usize;

/// Time from the end of the heartbeat time to the stop, s: the tick of the last ping, the tick that
/// detects the timeout, the tick already planned, and the words in the engine.
const NOTICE_S: f64 = 3.6e-3;

/// Time within which an abrupt stop is complete, s.
const ABRUPT_S: f64 = 0.005;

/// Figures of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Root mean square of the error per axis, mm.
    pub rms_mm: [f64; 3],
    /// Largest error per axis, mm.
    pub max_mm: [f64; 3],
    /// Settling time of the slowest jump, ms: from the arrival of the first frame that shows it
    /// until the error stays within the tolerance. `None` without a jump, or if a jump does not
    /// settle before the target moves on.
    pub settle_ms: Option<f64>,
    /// Time from a frame set to the first port word that its frame can change.
    pub latency_ms: Latency,
    /// Steps at the pins from start to end.
    pub steps: [i64; 3],
    /// Number of steps that were planned and not made, on all axes.
    pub lost: u64,
    /// Names of the latched faults, in their order.
    pub faults: Vec<&'static str>,
    /// Names of the station's states, in their order.
    pub states: Vec<&'static str>,
    /// Names of the station's knowledge of the target, in their order.
    pub sights: Vec<&'static str>,
    /// Root mean square of the error's length, mm.
    pub rms_3d_mm: f64,
    /// Length of the mean error, mm: the steady lag if the target moves on a straight line.
    pub lag_mm: f64,
    /// Distance of the stage beyond a jump's end, over the jump, on the worst axis. `None` without
    /// a jump.
    pub overshoot: Option<f64>,
    /// Root mean square of the stage's distance from its mean position, mm: the jitter if the
    /// target stands.
    pub jitter_mm: [f64; 3],
    /// Reversals of direction at the pins per second.
    pub reversals_per_s: [f64; 3],
    /// Greatest speed of the stage, mm/s.
    pub speed_mm_s: [f64; 3],
    /// Greatest acceleration of the stage, abrupt stops left out, mm/s².
    pub acceleration_mm_s2: [f64; 3],
    /// Counts of frame sets by result.
    pub frames: Frames,
    /// Motion of the stage during each silence of the host.
    pub silences: Vec<Silence>,
    /// Commands of the scenario that the station refused.
    pub refused_commands: Vec<String>,
}

/// Percentiles of the latency, ms. `None` if no frame was used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Latency {
    /// Median latency.
    pub p50: Option<f64>,
    /// 99th percentile of the latency.
    pub p99: Option<f64>,
}

/// Motion of the stage after the host's last ping.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Silence {
    /// Instant of the last ping, s.
    pub at_s: f64,
    /// Speed at that instant, mm/s.
    pub speed_mm_s: [f64; 3],
    /// Largest distance from the position at that instant, mm.
    pub way_mm: [f64; 3],
    /// Bound of that distance, by [`silence_bound_mm`] of that speed.
    pub bound_mm: [f64; 3],
    /// True if the stage stood before the host spoke again.
    pub stood: bool,
}

impl Figures {
    /// Computes the figures of one run of a scenario.
    pub fn of(scenario: &Scenario, trace: &Trace) -> Self {
        let Measure {
            from_s, until_s, ..
        } = scenario.measure;
        let samples = trace.within(from_s, until_s);
        let errors = || samples.iter().map(Sample::error_mm);
        let rms_mm = per_axis(|i| rms(errors().map(|e| e[i])));
        let mean_mm = per_axis(|i| mean(errors().map(|e| e[i])));
        let way = Way::new(&scenario.legs);
        Self {
            rms_mm,
            max_mm: per_axis(|i| largest(errors().map(|e| e[i].abs()))),
            settle_ms: settle_ms(scenario, trace, &way),
            latency_ms: latency(&trace.latencies_us),
            steps: trace.steps,
            lost: trace.missing_steps.iter().map(|n| n.unsigned_abs()).sum(),
            faults: (trace.faults.iter())
                .map(|fault| diagnosis::fault(*fault).name)
                .collect(),
            states: (trace.states.iter())
                .map(|state| diagnosis::state(*state).name)
                .collect(),
            sights: (trace.sights.iter())
                .map(|sight| diagnosis::sight(*sight))
                .collect(),
            rms_3d_mm: length(rms_mm),
            lag_mm: length(mean_mm),
            overshoot: overshoot(trace, &way),
            jitter_mm: per_axis(|i| {
                let position = || samples.iter().map(|sample| sample.camera_mm[i]);
                let middle = mean(position());
                rms(position().map(|mm| mm - middle))
            }),
            reversals_per_s: reversals_per_s(samples),
            speed_mm_s: per_axis(|i| largest_difference(&trace.samples, &[], i, 1)),
            acceleration_mm_s2: per_axis(|i| {
                largest_difference(&trace.samples, &trace.abrupt_s, i, 2)
            }),
            frames: trace.frames.clone(),
            silences: (trace.silences_s.iter())
                .map(|silence| silence_of(*silence, trace, &scenario.stage))
                .collect(),
            refused_commands: trace.refused_commands.clone(),
        }
    }
}

/// Returns the resolution of [`Figures::speed_mm_s`] and [`Figures::acceleration_mm_s2`] on an axis
/// with `steps_per_mm` steps per mm: they may exceed the true values by this much.
pub fn resolution(steps_per_mm: f64) -> [f64; 2] {
    let step_mm = steps_per_mm.recip();
    [step_mm / WINDOW_S, 2.0 * step_mm / WINDOW_S.powi(2)]
}

/// Returns the longest distance of an axis from the host's last ping to rest, mm. The axis starts
/// at speed `v` and any acceleration up to `a`, goes on for the heartbeat time and the reaction
/// time, together `T`, and then stops on the planner's ramp; it is never faster than `most`.
///
/// ```text
/// v' = v + aT    v'' = v' + a²/2j    d = vT + aT²/2 + v'a/j + a³/3j² + (v''/2)(v''/a + a/j)
/// ```
pub fn silence_bound_mm(v: f64, most: f64, a: f64, j: f64) -> f64 {
    let t = f64::from(HEARTBEAT_MS) * 1e-3 + NOTICE_S;
    let cruise = (v * t + a * t * t / 2.0).min(most.max(v) * t);
    let after = (v + a * t).min(most);
    let peak = (after + a * a / (2.0 * j)).min(most);
    cruise + after * a / j + a.powi(3) / (3.0 * j * j) + peak / 2.0 * (peak / a + a / j)
}

fn per_axis(get: impl FnMut(usize) -> f64) -> [f64; 3] {
    [0, 1, 2].map(get)
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), x| (sum + x, count + 1));
    sum / f64::from(count.max(1))
}

pub(crate) fn rms(values: impl Iterator<Item = f64>) -> f64 {
    mean(values.map(|x| x * x)).sqrt()
}

pub(crate) fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

fn settle_ms(scenario: &Scenario, trace: &Trace, way: &Way) -> Option<f64> {
    let tolerance = scenario.measure.settle_within_mm;
    let mut slowest = None;
    for jump in way.jumps() {
        let shown_s = trace.captures_s.iter().find(|at_s| **at_s >= jump.at_s)?;
        let arrival_s = shown_s + scenario.cameras.latency_ms * 1e-3;
        let samples = trace.within(jump.at_s, jump.until_s);
        let outside = |sample: &&Sample| {
            let error = sample.error_mm();
            (0..3).any(|i| error[i].abs() > tolerance[i])
        };
        let last = samples.iter().rev().find(outside).map(|s| s.time_s);
        if last == samples.last().map(|sample| sample.time_s) {
            return None;
        }
        let settled_s = last.map_or(jump.at_s, |last| last + SAMPLE_S);
        // Rounded to the microsecond, the unit of all instants.
        let settle_ms = ((settled_s - arrival_s) * 1e6).round().max(0.0) / 1e3;
        slowest = Some(settle_ms.max(slowest.unwrap_or(0.0)));
    }
    slowest
}

fn overshoot(trace: &Trace, way: &Way) -> Option<f64> {
    let mut worst = None;
    for jump in way.jumps() {
        for sample in trace.within(jump.at_s, jump.until_s) {
            for (error, by) in sample.error_mm().into_iter().zip(jump.by_mm) {
                if by != 0.0 {
                    // Adding zero turns -0 into 0.
                    worst = Some((error / by + 0.0).max(worst.unwrap_or(0.0)));
                }
            }
        }
    }
    worst
}

fn latency(latencies_us: &[u32]) -> Latency {
    let mut sorted: Vec<f64> = latencies_us.iter().map(|us| f64::from(*us) / 1e3).collect();
    sorted.sort_by(f64::total_cmp);
    Latency {
        p50: percentile(&sorted, 0.50),
        p99: percentile(&sorted, 0.99),
    }
}

/// Returns the smallest value with at least this share of the values at or below it (nearest rank).
pub(crate) fn percentile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied()
}

fn reversals_per_s(samples: &[Sample]) -> [f64; 3] {
    let [Some(first), Some(last)] = [samples.first(), samples.last()] else {
        return [0.0; 3];
    };
    let seconds = (last.time_s - first.time_s).max(SAMPLE_S);
    per_axis(|i| f64::from(last.reversals[i] - first.reversals[i]) / seconds)
}

/// Returns the largest first or second difference of an axis's position over the window, as a
/// derivative. Windows that touch an abrupt stop are left out.
fn largest_difference(samples: &[Sample], abrupt_s: &[f64], axis: usize, order: usize) -> f64 {
    let at = |index: usize| samples[index].camera_mm[axis];
    let differences = (0..samples.len().saturating_sub(order * WINDOW)).map(|first| {
        let (from_s, until_s) = (
            samples[first].time_s,
            samples[first + order * WINDOW].time_s,
        );
        let touches = |stop_s: &f64| *stop_s <= until_s && stop_s + ABRUPT_S >= from_s;
        if abrupt_s.iter().any(touches) {
            return 0.0;
        }
        match order {
            1 => (at(first + WINDOW) - at(first)).abs() / WINDOW_S,
            _ => {
                let second = at(first + 2 * WINDOW) - 2.0 * at(first + WINDOW) + at(first);
                second.abs() / WINDOW_S.powi(2)
            }
        }
    });
    largest(differences)
}

fn silence_of([at_s, until_s]: [f64; 2], trace: &Trace, stage: &Stage) -> Silence {
    let position = |time_s: f64| {
        let sample = trace.within(time_s, f64::INFINITY).first();
        sample
            .or(trace.samples.last())
            .map_or([0.0; 3], |s| s.camera_mm)
    };
    let half_s = WINDOW_S / 2.0;
    let (before, start, after) = (
        position((at_s - half_s).max(0.0)),
        position(at_s),
        position(at_s + half_s),
    );
    let seconds = half_s + half_s.min(at_s);
    let speed_mm_s = per_axis(|i| (after[i] - before[i]) / seconds);
    let during = trace.within(at_s, until_s);
    let end = trace.within(until_s - WINDOW_S, until_s);
    Silence {
        at_s,
        speed_mm_s,
        way_mm: per_axis(|i| largest(during.iter().map(|s| (s.camera_mm[i] - start[i]).abs()))),
        bound_mm: per_axis(|i| {
            silence_bound_mm(
                speed_mm_s[i].abs(),
                stage.max_speed_mm_s[i],
                stage.max_acceleration_mm_s2[i],
                stage.max_jerk_mm_s3[i],
            )
        }),
        stood: end
            .iter()
            .all(|sample| Some(sample.camera_mm) == end.last().map(|s| s.camera_mm)),
    }
}

#[cfg(test)]
mod tests;
