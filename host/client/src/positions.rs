//! Positions of the stage at instants that have passed, from the station's reports.
//!
//! Reports come after every frame and ten times a second. Between two of them the position is on a
//! straight line; at an acceleration `a` and reports `t` apart it is off by `a t²/8` at most, which
//! is 7 µm at 50 mm/s² and 30 reports per second.

use std::collections::VecDeque;
use trinocular_core::frame::message::Status;

/// Number of reports that are kept: a second at 60 frames per second.
const REPORTS: usize = 64;

/// Latest positions.
#[derive(Debug, Default)]
pub(crate) struct Positions(VecDeque<(u64, [i32; 3])>);

impl Positions {
    /// Takes in a report. One from before the last report is from another life of the station, which
    /// forgets the earlier ones.
    pub(crate) fn add(&mut self, status: &Status) {
        let at_us = status.time.micros();
        if self.0.back().is_some_and(|(last_us, _)| *last_us > at_us) {
            self.0.clear();
        }
        if self.0.len() == REPORTS {
            self.0.pop_front();
        }
        self.0.push_back((at_us, status.position_steps));
    }

    /// Forgets all reports.
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    /// Returns the position at an instant of the station's clock, steps: between two reports, or that
    /// of the first or last one. `None` without a report.
    pub(crate) fn at(&self, at_us: u64) -> Option<[f64; 3]> {
        let after = self.0.partition_point(|(time_us, _)| *time_us <= at_us);
        let (later, earlier) = (self.0.get(after), after.checked_sub(1));
        let earlier = earlier.and_then(|before| self.0.get(before));
        let (Some((from_us, from)), Some((to_us, to))) = (earlier, later) else {
            let (_, steps) = earlier.or(later)?;
            return Some(steps.map(f64::from));
        };
        let share = (at_us - from_us) as f64 / (to_us - from_us) as f64;
        Some(std::array::from_fn(|axis| {
            let [from, to] = [from[axis], to[axis]].map(f64::from);
            from + share * (to - from)
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::default_stage;
    use crate::twin::Twin;
    use trinocular_core::frame::message::Mounting;
    use trinocular_core::time::Instant;

    fn positions(reports: &[(u64, i32)]) -> Positions {
        let twin = Twin::start(&default_stage(), "twin", Mounting::OnStage).unwrap();
        let status = *twin.status().unwrap();
        let mut positions = Positions::default();
        for (at_us, steps) in reports {
            positions.add(&Status {
                time: Instant::from_micros(*at_us),
                position_steps: [*steps, 0, -steps],
                ..status
            });
        }
        positions
    }

    #[test]
    fn position_between_reports_is_on_their_line() {
        let positions = positions(&[(1_000, 10), (3_000, 50), (5_000, 50)]);
        for (at_us, steps) in [
            (0, 10.0),
            (1_000, 10.0),
            (1_500, 20.0),
            (4_000, 50.0),
            (9_000, 50.0),
        ] {
            assert_eq!(positions.at(at_us), Some([steps, 0.0, -steps]), "{at_us}");
        }
        assert_eq!(Positions::default().at(0), None);
    }

    #[test]
    fn restarted_station_has_no_earlier_positions() {
        assert_eq!(
            positions(&[(9_000, 80), (100, 0)]).at(5_000),
            Some([0.0; 3])
        );
    }

    #[test]
    fn old_reports_are_forgotten() {
        let many: Vec<(u64, i32)> = (0..200).map(|i| (1_000 * i, i as i32)).collect();
        let positions = positions(&many);
        assert_eq!(positions.0.len(), REPORTS);
        assert_eq!(positions.at(0), Some([136.0, 0.0, -136.0]));
    }
}
