//! Compares a run with the expectations of its scenario.

use super::expect::Checkpoint;
use super::figures::{Figures, resolution};
use super::file::Scenario;
use super::trace::{SAMPLE_S, Trace};
use trinocular_client::diagnosis;
use trinocular_core::safety::{Fault, State};
use trinocular_core::track::pursuit::Sight;

/// Time without a step after which the stage counts as standing, s: 20 samples.
const STANDING: f64 = 20.0 * SAMPLE_S;

impl Scenario {
    /// Returns the missed expectations, in words. `unpredicted` are the figures of the run without
    /// prediction, if there was one.
    pub fn missed(
        &self,
        trace: &Trace,
        figures: &Figures,
        unpredicted: Option<&Figures>,
    ) -> Vec<String> {
        let mut missed = Missed(Vec::new());
        self.judge_laws(figures, &mut missed);
        let expect = &self.expect;
        missed.axes("rms_mm", figures.rms_mm, expect.rms_mm);
        missed.axes("max_mm", figures.max_mm, expect.max_mm);
        missed.figure("lag_mm", Some(figures.lag_mm), expect.lag_mm);
        missed.figure("settle_ms", figures.settle_ms, expect.settle_ms);
        missed.figure("overshoot", figures.overshoot, expect.overshoot);
        missed.axes("jitter_mm", figures.jitter_mm, expect.jitter_mm);
        let most = expect.reversals_per_s.map(|most| [most; 3]);
        missed.axes("reversals_per_s", figures.reversals_per_s, most);
        let p99 = figures.latency_ms.p99;
        missed.figure("latency_ms.p99", p99, expect.latency_ms);
        if let (Some(gain), Some(without)) = (expect.prediction_gain, unpredicted) {
            let found = without.rms_3d_mm / figures.rms_3d_mm;
            if !(found >= gain) {
                missed.say(format!("prediction_gain is {found:.2}, below {gain}"));
            }
        }
        self.judge_sequence(figures, &mut missed);
        for point in &expect.at {
            judge_checkpoint(point, trace, &mut missed);
        }
        missed.0
    }

    fn judge_laws(&self, figures: &Figures, missed: &mut Missed) {
        if figures.lost != 0 {
            missed.say(format!("lost is {}, must be 0", figures.lost));
        }
        let stage = &self.stage;
        for axis in 0..3 {
            let [speed, acceleration] = resolution(stage.steps_per_mm[axis]);
            for (name, found, most) in [
                (
                    "speed_mm_s",
                    figures.speed_mm_s,
                    stage.max_speed_mm_s[axis] + speed,
                ),
                (
                    "acceleration_mm_s2",
                    figures.acceleration_mm_s2,
                    stage.max_acceleration_mm_s2[axis] + acceleration,
                ),
            ] {
                missed.bound(&format!("{name}[{axis}]"), found[axis], most);
            }
        }
        for (index, silence) in figures.silences.iter().enumerate() {
            let name = format!("silences[{index}]");
            if !silence.stood {
                missed.say(format!("{name}: the stage did not stand at its end"));
            }
            for axis in 0..3 {
                let (way, bound) = (silence.way_mm[axis], silence.bound_mm[axis]);
                missed.bound(&format!("{name}.way_mm[{axis}]"), way, bound);
            }
        }
        for refused in &figures.refused_commands {
            missed.say(format!("the station refused {refused}"));
        }
    }

    fn judge_sequence(&self, figures: &Figures, missed: &mut Missed) {
        let expect = &self.expect;
        if let Some(steps) = expect.steps {
            for (axis, expected) in steps.into_iter().enumerate() {
                let (found, within) = (figures.steps[axis], expect.steps_within[axis]);
                if (found - expected).abs() > within {
                    missed.say(format!(
                        "steps[{axis}] is {found}, must be {expected} within {within}"
                    ));
                }
            }
        }
        let fault = |fault: &Fault| diagnosis::fault(*fault).name;
        missed.names("faults", &figures.faults, &expect.faults, fault);
        if let Some(states) = &expect.states {
            let state = |state: &State| diagnosis::state(*state).name;
            missed.names("states", &figures.states, states, state);
        }
        if let Some(sights) = &expect.sights {
            let sight = |sight: &Sight| diagnosis::sight(*sight);
            missed.names("sights", &figures.sights, sights, sight);
        }
    }
}

fn judge_checkpoint(point: &Checkpoint, trace: &Trace, missed: &mut Missed) {
    let time_s = point.time_s;
    let Some(sample) = trace.within(time_s, f64::INFINITY).first() else {
        missed.say(format!("at {time_s} s: the run was over"));
        return;
    };
    for (axis, error) in sample.error_mm().into_iter().enumerate() {
        if let Some(most) = point.error_mm {
            let name = format!("at {time_s} s: error_mm[{axis}]");
            missed.bound(&name, error.abs(), most[axis]);
        }
    }
    if let Some(state) = point.state
        && state != sample.state
    {
        let [found, must] = [sample.state, state].map(|state| diagnosis::state(state).name);
        missed.say(format!("at {time_s} s: state is {found}, must be {must}"));
    }
    if let Some(standing) = point.standing {
        let before = trace.within((time_s - STANDING).max(0.0), time_s);
        let stands = before.iter().all(|s| s.camera_mm == sample.camera_mm);
        if stands != standing {
            missed.say(format!(
                "at {time_s} s: standing is {stands}, must be {standing}"
            ));
        }
    }
}

/// List of missed expectations.
struct Missed(Vec<String>);

impl Missed {
    fn say(&mut self, what: String) {
        self.0.push(what);
    }

    /// Adds an entry unless `found` is a number up to `most`.
    fn bound(&mut self, name: &str, found: f64, most: f64) {
        if !(found <= most) {
            self.say(format!("{name} is {found:.4}, above {most:.4}"));
        }
    }

    fn axes(&mut self, name: &str, found: [f64; 3], most: Option<[f64; 3]>) {
        let Some(most) = most else { return };
        for (axis, (found, most)) in found.into_iter().zip(most).enumerate() {
            self.bound(&format!("{name}[{axis}]"), found, most);
        }
    }

    /// Adds an entry unless the names found are those of `must`, in its order.
    fn names<T>(
        &mut self,
        what: &str,
        found: &[&str],
        must: &[T],
        name: impl Fn(&T) -> &'static str,
    ) {
        let must: Vec<&str> = must.iter().map(name).collect();
        let list = |names: &[&str]| match names {
            [] => "none".to_owned(),
            names => names.join(", "),
        };
        if found != must {
            self.say(format!("{what}: {}; must be {}", list(found), list(&must)));
        }
    }

    fn figure(&mut self, name: &str, found: Option<f64>, most: Option<f64>) {
        match (found, most) {
            (_, None) => {}
            (Some(found), Some(most)) => self.bound(name, found, most),
            (None, Some(most)) => self.say(format!("{name} has no value, must be at most {most}")),
        }
    }
}
