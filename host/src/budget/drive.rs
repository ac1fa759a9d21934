//! Step rates of the stage at the station's word rate, and its stopping distances.
//!
//! With the limits `v`, `a`, `j` of an axis, a ramp from full speed takes `(v/2)(v/a + a/j)`. The
//! worst moment for a stop is the one in which the axis still accelerates at `a` and will be at
//! full speed once the acceleration has ended: that adds `v a/j - a³/6j²`. The planner's grid adds
//! `(v + a·1 ms)·1 ms`. These are the terms of the stop bound of [`trinocular_core::motion::Planner`] at
//! its largest.
//!
//! When the host falls silent, the axis goes on for a time `T`: the heartbeat time and the ticks
//! until the station acts on it. One of two cases has the longest distance. An axis that cruises
//! travels `v T` and the ramp. An axis that still accelerates at `a` at the stop was slower before:
//! if `D(u)` is the difference to full speed at a time `u` before it would be reached, the distance
//! is `v (T + a/j) - ∫ D` over `T + a/j`, and the ramp. Both are below the bound of any speed and
//! acceleration, `v T + v a/j + a³/3j² + (v/2)(v/a + a/j)`.

use serde::Serialize;
use trinocular_core::frame::message::{Config, ConfigField, Mounting};
use trinocular_core::machine::{check, limit_field};
use trinocular_core::motion::{AxisConfig, AxisLimits, ConfigFault, Limits};
use trinocular_core::steps::{DriverTiming, WordRate};

use trinocular_client::bound::{Refused, refused};
use trinocular_client::stage::{HEARTBEAT_MS, configuration, timing};
use trinocular_rig::rig_file::Stage;

/// Word rate of the firmware and the twin.
pub const WORD_RATE: WordRate = WordRate::MHZ_1;

/// Time from the end of the heartbeat time to the stop, s: the tick that detects the timeout, the
/// tick already planned, and the tick of the last ping.
const NOTICE_S: f64 = 3e-3;

/// Period of the planner's control ticks, s.
const TICK_S: f64 = 1e-3;

/// Names of the stage's axes.
pub const AXES: [&str; 3] = ["X", "Y", "Z"];

/// Step rate and distances of one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisDrive {
    /// Length of one step, mm.
    pub step_mm: f64,
    /// Steps per second at full speed.
    pub steps_per_s: f64,
    /// Largest number of steps per second at the word rate.
    pub most_steps_per_s: u32,
    /// Largest distance from the stop command to rest, mm.
    pub stop_mm: f64,
    /// Largest distance from the host's last heartbeat to rest, mm.
    pub silence_mm: f64,
    /// Length of the shortest move that reaches full speed, mm.
    pub full_speed_mm: f64,
    /// Length of the travel, mm.
    pub travel_mm: f64,
}

/// Step drivers at the station's word rate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drivers {
    /// Name of the drivers.
    pub name: &'static str,
    /// Port words per second.
    pub word_rate_hz: u32,
    /// Highest word rate the drivers allow, Hz; `None` if they are too slow for any.
    pub highest_word_rate_hz: Option<u32>,
}

/// Predictions for the stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drive {
    /// Predictions per axis.
    pub axes: [AxisDrive; 3],
    /// Predictions for the step drivers.
    pub drivers: Drivers,
    /// Heartbeat timeout of the station, ms.
    pub heartbeat_ms: u16,
    /// Reasons for the station to refuse this stage, each with the field of the rig file. Empty if
    /// the station accepts it.
    pub faults: Vec<(String, String)>,
}

impl Drive {
    /// Predicts `stage` behind the station's ports.
    pub fn of(stage: &Stage) -> Self {
        let mut faults = Vec::new();
        let config = configuration(stage, Mounting::OnStage);
        let heartbeat_ms = match &config {
            Ok(config) => {
                faults.extend(refusals(config));
                config.heartbeat_ms
            }
            Err(error) => {
                faults.push(("stage".to_owned(), error.to_string()));
                HEARTBEAT_MS
            }
        };
        let paces = match &config {
            Ok(config) => paces(stage, &config.axes),
            Err(_) => wanted(stage),
        };
        let driver = timing(stage.driver);
        if let Err(fault) = driver.check(WORD_RATE) {
            faults.push((
                "stage.driver".to_owned(),
                format!("{} {fault}", stage.driver.name()),
            ));
        }
        Self {
            axes: [0, 1, 2].map(|i| axis(stage, i, &paces, heartbeat_ms)),
            drivers: Drivers {
                name: stage.driver.name(),
                word_rate_hz: WORD_RATE.hz(),
                highest_word_rate_hz: highest_word_rate(&driver),
            },
            heartbeat_ms,
            faults,
        }
    }
}

/// Returns the fields that the station would refuse: all limits of the axes or, if these are valid,
/// the first field that the station's own check refuses.
fn refusals(config: &Config) -> Vec<(String, String)> {
    let axes = config.axes.iter().enumerate();
    let limits = axes.filter_map(|(axis, config)| {
        let fault = AxisLimits::new(config, WORD_RATE).err()?;
        Some(limit_field(ConfigFault { axis, fault }))
    });
    let limits: Vec<ConfigField> = limits.collect();
    let first = match limits.is_empty() {
        true => check(config, WORD_RATE).err(),
        false => None,
    };
    let fields = limits.into_iter().chain(first);
    // The driver's fault is reported separately.
    let fields = fields.filter(|field| *field != ConfigField::Driver);
    fields
        .map(|field| {
            let Refused { field, reason } = refused(&field);
            (format!("stage.{field}"), reason)
        })
        .collect()
}

/// Speed, acceleration and jerk of the three axes, in mm/s, mm/s² and mm/s³.
type Paces = [[f64; 3]; 3];

fn wanted(stage: &Stage) -> Paces {
    [0, 1, 2].map(|i| {
        [
            stage.max_speed_mm_s[i],
            stage.max_acceleration_mm_s2[i],
            stage.max_jerk_mm_s3[i],
        ]
    })
}

/// Returns the limits on the planner's grid: a lower jerk makes a longer ramp. Returns the
/// requested limits if the planner refuses the stage.
fn paces(stage: &Stage, axes: &[AxisConfig; 3]) -> Paces {
    let Ok(limits) = Limits::new(axes, WORD_RATE) else {
        return wanted(stage);
    };
    // From fine units per slot to mm/s, then per tick.
    let (speeds, accelerations, jerks) = (limits.speeds(), limits.accelerations(), limits.jerks());
    [0, 1, 2].map(|i| {
        let per_s = f64::from(WORD_RATE.slots_per_s()) / 2f64.powi(32) / stage.steps_per_mm[i];
        [
            f64::from(speeds[i]) * per_s,
            f64::from(accelerations[i]) * per_s / TICK_S,
            f64::from(jerks[i]) * per_s / (TICK_S * TICK_S),
        ]
    })
}

fn axis(stage: &Stage, i: usize, paces: &Paces, heartbeat_ms: u16) -> AxisDrive {
    let [v, a, j] = paces[i];
    // Largest acceleration that is reached before it must be reduced again.
    let up = a.min((2.0 * v * j).sqrt());
    let down = up.min((v * j).sqrt());
    let ramp_mm = 0.5 * v * (v / down + down / j);
    let easing_mm = v * up / j - up.powi(3) / (6.0 * j * j);
    let grid_mm = (v + up * TICK_S) * TICK_S;
    let silence_s = 1e-3 * f64::from(heartbeat_ms) + NOTICE_S;
    // Before the stop the axis accelerated at `up`, from rest or during the whole silence.
    let lacking = up * up / (2.0 * j);
    let speeding_s = silence_s.min((v - lacking) / up);
    let lacking_mm = speeding_s * (lacking + 0.5 * up * speeding_s) + v * (silence_s - speeding_s);
    let unslowed_mm = v * silence_s + (easing_mm - lacking_mm).max(0.0);
    let [low, high] = stage.travel_mm[i];
    AxisDrive {
        step_mm: 1.0 / stage.steps_per_mm[i],
        steps_per_s: stage.max_speed_mm_s[i] * stage.steps_per_mm[i],
        most_steps_per_s: WORD_RATE.slots_per_s(),
        stop_mm: ramp_mm + easing_mm + grid_mm,
        silence_mm: unslowed_mm + ramp_mm + grid_mm,
        full_speed_mm: 2.0 * ramp_mm,
        travel_mm: high - low,
    }
}

/// Returns the highest word rate whose words are long enough for the driver.
fn highest_word_rate(driver: &DriverTiming) -> Option<u32> {
    const STEP_HZ: u32 = 8_000;
    // Scan down from 16 MHz; there are 2,000 rates.
    let rates = (4..=2_000).rev().map(|n| WordRate::from_hz(n * STEP_HZ));
    rates
        .flatten()
        .find(|rate| driver.check(*rate).is_ok())
        .map(WordRate::hz)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_client::stage::default_stage;
    use trinocular_client::twin::Twin;
    use trinocular_core::frame::message::Command;
    use trinocular_core::motion::Planner;
    use trinocular_core::steps::Position;
    use trinocular_rig::rig_file::Driver;

    fn stages() -> [Stage; 3] {
        let quick = Stage {
            max_speed_mm_s: [300.0, 40.0, 150.0],
            max_acceleration_mm_s2: [1_000.0, 9_000.0, 3_000.0],
            max_jerk_mm_s3: [20_000.0, 90_000.0, 40_000.0],
            ..default_stage()
        };
        let soft = Stage {
            max_jerk_mm_s3: [3_000.0; 3],
            ..default_stage()
        };
        [default_stage(), quick, soft]
    }

    /// Drives the planner along a long move and stops it in every tick: the longest distance is
    /// within the bound and near it.
    #[test]
    fn planner_stop_bound_is_tight() {
        for stage in stages() {
            let far = Stage {
                travel_mm: [[-2_000.0, 2_000.0]; 3],
                ..stage
            };
            let drive = Drive::of(&far);
            assert_eq!(drive.faults, []);
            let config = configuration(&far, Mounting::OnStage).unwrap();
            let limits = Limits::new(&config.axes, WORD_RATE).unwrap();
            let mut planner = Planner::new(limits, [Position::centre(0); 3]);
            planner.set_target([Position::centre(120_000); 3]);
            let mut farthest = [0.0; 3];
            for _ in 0..4_000 {
                planner.plan_tick();
                for (farthest, way) in farthest.iter_mut().zip(planner.stopping_distances()) {
                    let mm = way as f64 / 4_294_967_296.0 / 80.0;
                    *farthest = mm.max(*farthest);
                }
            }
            for (axis, farthest) in drive.axes.iter().zip(farthest) {
                let ratio = farthest / axis.stop_mm;
                assert!((0.9..=1.0).contains(&ratio), "{ratio}: {axis:?}");
            }
        }
    }

    /// The twin's host falls silent at full speed: the pins stop within the bound.
    #[test]
    fn silent_host_stays_within_bound() {
        let stage = Stage {
            travel_mm: [[-1_000.0, 1_000.0]; 3],
            ..default_stage()
        };
        let slow = Stage {
            max_acceleration_mm_s2: [300.0; 3],
            max_jerk_mm_s3: [4_000.0; 3],
            ..stage.clone()
        };
        for stage in [stage, slow] {
            let predicted = Drive::of(&stage).axes[0].silence_mm;
            let mut farthest: f64 = 0.0;
            // In mid-acceleration, at full speed, and shortly or long after a ping.
            for after_ms in [
                60, 150, 220, 250, 280, 300, 1_001, 1_005, 1_008, 1_013, 1_019,
            ] {
                let mut twin = Twin::start(&stage, "twin", Mounting::OnStage).unwrap();
                let position_um = [900_000; 3];
                twin.command("setpoint", Command::Setpoint { position_um })
                    .unwrap();
                twin.advance(twin.now().plus_micros(1_000 * after_ms));
                twin.set_pings(false);
                let last = twin.position_mm()[0];
                twin.advance(twin.now().plus_micros(2_000_000));
                farthest = farthest.max(twin.position_mm()[0] - last);
            }
            // Pings are 20 ms apart: the last one may be some ms older than the last inspection.
            assert!(
                farthest <= predicted && farthest > 0.8 * predicted,
                "{farthest} of {predicted} mm"
            );
        }
    }

    #[test]
    fn general_bound_covers_both() {
        for stage in stages() {
            for (i, axis) in Drive::of(&stage).axes.iter().enumerate() {
                // Of the limits on the planner's grid, none of which is lower by more than a sixth
                // here.
                let [v, a, j] = [
                    stage.max_speed_mm_s[i],
                    stage.max_acceleration_mm_s2[i],
                    stage.max_jerk_mm_s3[i] * 5.0 / 6.0,
                ];
                let bound = v * 0.103
                    + v * a / j
                    + a.powi(3) / (3.0 * j * j)
                    + 0.5 * v * (v / a * 1.02 + a / j)
                    + (v + a * TICK_S) * TICK_S;
                assert!(axis.silence_mm <= bound, "{axis:?}: {bound}");
                assert!(axis.stop_mm <= axis.silence_mm);
            }
        }
    }

    #[test]
    fn every_refusal_is_named() {
        let stage = Stage {
            max_speed_mm_s: [100.0, 7_000.0, 100.0],
            driver: Driver::Drv8825,
            ..default_stage()
        };
        let drive = Drive::of(&stage);
        let named: Vec<&str> = drive
            .faults
            .iter()
            .map(|(field, _)| field.as_str())
            .collect();
        assert_eq!(named, ["stage.max_speed_mm_s[1]", "stage.driver"]);
        assert_eq!(drive.faults[0].1, "must be at most 6250");
        assert!(drive.faults[1].1.contains("step_high_ns"));
        let rate = drive.drivers.highest_word_rate_hz.unwrap();
        assert_eq!(rate, 520_000); // 1,900 ns are 526 kHz
    }

    /// `verify` and the station use one check, so that both accept the same stages.
    #[test]
    fn fields_match_station_check() {
        let mut stage = default_stage();
        stage.care.slow_speed_mm_s = 0.001;
        let drive = Drive::of(&stage);
        let named = ("stage.slow_speed_mm_s", "must be at least 0.002");
        assert_eq!(drive.faults.len(), 1);
        assert_eq!((&*drive.faults[0].0, &*drive.faults[0].1), named);
    }

    #[test]
    fn short_travel_limits_speed() {
        let axis = &Drive::of(&default_stage()).axes[0];
        // v²/a + v a/j = 5 + 4 mm, and 2 % more on the planner's grid.
        assert!((9.0..9.2).contains(&axis.full_speed_mm), "{axis:?}");
        assert_eq!(axis.travel_mm, 120.0);
        assert_eq!(axis.steps_per_s, 8_000.0);
    }
}
