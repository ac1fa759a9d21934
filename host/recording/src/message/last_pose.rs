//! The last pose of a run that was recorded from the middle on, in the message of its keyframe.

use super::{Measurement, Outcome, Turn};
use trinocular_vision::flow::LastPose;

impl Measurement {
    /// States the last pose before the recording began, in the message of a keyframe.
    pub fn set_last_pose(&mut self, last_pose: Option<LastPose>) {
        self.displacement_mm = last_pose.map_or([0.0; 3], |last| last.displacement_mm);
        self.turn = last_pose.map(|last| Turn {
            rotation_deg: last.rotation_deg,
            rotation_sigma_deg: [0.0; 3],
            pivot_mm: last.pivot_mm,
        });
    }

    /// Returns the last pose that the message of a keyframe states.
    pub fn last_pose(&self) -> Option<LastPose> {
        let turn = self.turn.filter(|_| self.outcome == Outcome::Keyframe)?;
        Some(LastPose {
            rotation_deg: turn.rotation_deg,
            pivot_mm: turn.pivot_mm,
            displacement_mm: self.displacement_mm,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_pose_is_read_from_the_keyframe() {
        let last_pose = LastPose {
            rotation_deg: [1.5, -20.25, 170.1],
            pivot_mm: [3.0, -4.5, 851.0],
            displacement_mm: [0.1, 12.7, -8.0],
        };
        for last_pose in [None, Some(last_pose)] {
            let mut message = Measurement {
                outcome: Outcome::Keyframe,
                ..Measurement::default()
            };
            message.set_last_pose(last_pose);
            let mut bytes = Vec::new();
            message.encode(&mut bytes);
            let read = Measurement::decode(&bytes).unwrap();
            assert_eq!(read.last_pose(), last_pose);
        }
    }
}
