//! Time limits for a stage in motion.
//!
//! A station that reports "moving" for ever must not keep a run alive for ever. The host gives a
//! motion up when it takes longer than its profile can take, or when its position no longer
//! changes.

use std::time::{Duration, Instant};
use trinocular_core::frame::message::Status;
use trinocular_rig::rig_file::Stage;

/// Longest motion of a stage whose rig file the host does not have.
const LONGEST: Duration = Duration::from_secs(3600);

/// Longest ramp after a stop.
const LONGEST_RAMP: Duration = Duration::from_secs(120);

/// Longest time that a moving stage may stay on one step. Slower stages need their rig file.
const STILL: Duration = Duration::from_secs(30);

/// Longest time on one step after a stop; see [`STILL`].
const STILL_ON_RAMP: Duration = Duration::from_secs(10);

/// Factor on the time of the profile; with [`GRACE_S`] it covers a loaded computer, backlash, and
/// reports on their way.
const FACTOR: f64 = 3.0;

/// Time beyond the profile, s.
const GRACE_S: f64 = 5.0;

/// Time limits of one motion.
#[derive(Clone, Copy, Debug)]
pub struct Allowance {
    limit: Duration,
    still: Duration,
}

impl Allowance {
    /// Limits of a motion whose stage is unknown.
    pub const UNKNOWN: Self = Self {
        limit: LONGEST,
        still: STILL,
    };

    /// Limits of the ramp after a stop.
    pub const RAMP: Self = Self {
        limit: LONGEST_RAMP,
        still: STILL_ON_RAMP,
    };

    /// Computes the limits of a motion over these distances, mm, of all axes at once. Takes the
    /// slow speed, so that the limits hold for an unknown position too.
    pub fn of_distance(stage: &Stage, distance_mm: [f64; 3]) -> Self {
        let slow_mm_s = stage.care.slow_speed_mm_s;
        let axes = (0..3).filter(|axis| distance_mm[*axis] != 0.0);
        let time_s = axes.map(|axis| duration_s(stage, axis, distance_mm[axis], slow_mm_s));
        Self::of_profile(time_s.fold(0.0, f64::max))
    }

    /// Computes the limits of a homing of these axes, one after the other.
    pub fn of_homing(stage: &Stage, axes: [bool; 3]) -> Self {
        let [fast, slow] = stage.care.home_speed_mm_s;
        let back_off_mm = stage.care.back_off_mm;
        let axes = (0..3).filter(|axis| axes[*axis]);
        let time_s = axes.map(|axis| {
            let [least, greatest] = stage.travel_mm[axis];
            // The search covers five quarters of the travel.
            [
                (1.25 * (greatest - least), fast),
                (back_off_mm, slow),
                (back_off_mm, slow),
                (back_off_mm, slow),
            ]
            .map(|(distance_mm, speed)| duration_s(stage, axis, distance_mm, speed))
            .iter()
            .sum::<f64>()
        });
        Self::of_profile(time_s.sum())
    }

    fn of_profile(time_s: f64) -> Self {
        let limit = Duration::try_from_secs_f64(FACTOR * time_s + GRACE_S);
        let limit = limit.unwrap_or(Duration::MAX);
        Self {
            limit,
            still: limit,
        }
    }

    /// Starts the time of a motion.
    pub fn start(self, now: Instant) -> Running {
        Running {
            allowance: self,
            began: now,
            changed: now,
            position: None,
        }
    }
}

/// Computes the time of one axis at no more than `speed_mm_s`, s: cruise and two full ramps.
fn duration_s(stage: &Stage, axis: usize, distance_mm: f64, speed_mm_s: f64) -> f64 {
    let speed = speed_mm_s.min(stage.max_speed_mm_s[axis]);
    let acceleration = stage.max_acceleration_mm_s2[axis];
    let ramp_s = speed / acceleration + acceleration / stage.max_jerk_mm_s3[axis];
    distance_mm.abs() / speed + 2.0 * ramp_s
}

/// Clock of one motion against its [`Allowance`].
#[derive(Clone, Copy, Debug)]
pub struct Running {
    allowance: Allowance,
    began: Instant,
    changed: Instant,
    position: Option<[i32; 3]>,
}

impl Running {
    /// Records the status; returns the duration of the motion if it exceeds a limit.
    pub fn spent(&mut self, now: Instant, status: Option<&Status>) -> Option<Duration> {
        let position = status.map(|status| status.position_steps);
        if position.is_some() && self.position != position {
            self.position = position;
            self.changed = now;
        }
        let Allowance { limit, still } = self.allowance;
        let (waited, stood) = (
            now.duration_since(self.began),
            now.duration_since(self.changed),
        );
        (waited > limit || stood > still).then_some(waited)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::default_stage;

    fn seconds(allowance: Allowance) -> f64 {
        allowance.limit.as_secs_f64()
    }

    #[test]
    fn allowance_grows_with_distance() {
        let stage = default_stage();
        let short = seconds(Allowance::of_distance(&stage, [1.0, 0.0, 0.0]));
        let long = seconds(Allowance::of_distance(&stage, [1.0, -100.0, 0.0]));
        assert!((5.0..10.0).contains(&short), "{short}");
        // 100 mm at the 5 mm/s of an unknown position.
        assert!((65.0..80.0).contains(&long), "{long}");
        let homing = seconds(Allowance::of_homing(&stage, [true; 3]));
        assert!(
            homing > seconds(Allowance::of_homing(&stage, [true, false, false])),
            "{homing}"
        );
    }

    #[test]
    fn slowest_stage_has_no_overflow() {
        let mut stage = default_stage();
        stage.care.slow_speed_mm_s = f64::MIN_POSITIVE;
        let allowance = Allowance::of_distance(&stage, [1e3; 3]);
        assert_eq!(allowance.limit, Duration::MAX);
        assert_eq!(
            allowance.start(Instant::now()).spent(Instant::now(), None),
            None
        );
    }

    #[test]
    fn still_position_spends_allowance() {
        let start = Instant::now();
        let mut running = Allowance::RAMP.start(start);
        let at = |seconds| start + Duration::from_secs(seconds);
        assert_eq!(running.spent(at(9), None), None);
        assert_eq!(running.spent(at(11), None), Some(Duration::from_secs(11)));
    }
}
