//! Commands that nodes of ROS 2 send, and the reader of their messages.

use crate::message_type::{BOOL, EMPTY, MessageType, POINT};
use std::fmt;
use trinocular_recording::cdr::{CdrFault, Reader};

/// Frame of a goal: the axes of the stage, with the station's zero as origin.
pub const FRAME: &str = "stage";

/// Largest component of a goal, m.
pub const FARTHEST_M: f64 = 2.0;

/// Command of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Stops the stage at once; it stays stopped until a reset.
    Stop,
    /// Clears a stop or a fault whose cause is gone.
    Reset,
    /// Starts to follow the target (true), or ends it with the stage at rest (false).
    Follow(bool),
    /// Moves the stage to a place.
    Goal(Goal),
}

/// Place to which the stage is to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Stamp of the message, µs since 1970; 0 if it has none.
    pub stamp_us: u64,
    /// Position along the stage's axes, µm from the station's zero.
    pub position_um: [i32; 3],
}

/// Topic on which a command comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandTopic {
    /// `std_msgs/Empty`.
    Stop,
    /// `std_msgs/Empty`.
    Reset,
    /// `std_msgs/Bool`.
    Follow,
    /// `geometry_msgs/PointStamped`, m, in the frame [`FRAME`].
    Goal,
}

/// Reason for which a message is no command.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CommandFault {
    /// The message cannot be read.
    #[error("the message cannot be read: {0}")]
    Message(#[from] CdrFault),
    /// A goal is in another frame.
    #[error("its frame_id is {0:?}; must be \"{FRAME}\", along the axes of the stage")]
    Frame(String),
    /// A component of a goal is NaN or too large.
    #[error("its {axis} is {value}; must be a number of metres from -{FARTHEST_M} to {FARTHEST_M}")]
    Position {
        /// Name of the component.
        axis: char,
        /// Value as sent.
        value: f64,
    },
}

impl CommandTopic {
    /// All topics.
    pub const ALL: [Self; 4] = [Self::Stop, Self::Reset, Self::Follow, Self::Goal];

    /// Returns the last part of the topic's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Reset => "reset",
            Self::Follow => "follow",
            Self::Goal => "goal",
        }
    }

    /// Returns the type of the messages.
    pub fn message_type(self) -> MessageType {
        match self {
            Self::Stop | Self::Reset => EMPTY,
            Self::Follow => BOOL,
            Self::Goal => POINT,
        }
    }

    /// Returns true if a message of any type is this command: a stop must not fail for its type.
    pub fn takes_any_type(self) -> bool {
        matches!(self, Self::Stop)
    }

    /// Reads a message of this topic: plain CDR of either byte order.
    ///
    /// A message on the topic of stops is a stop, whatever it holds.
    ///
    /// # Errors
    /// [`CommandFault`] if the message ends early, is in another frame, or has values out of range.
    ///
    /// ```
    /// use trinocular_ros::command::{Command, CommandTopic};
    ///
    /// let on = [0, 1, 0, 0, 1];
    /// assert_eq!(CommandTopic::Follow.read(&on), Ok(Command::Follow(true)));
    /// assert!(CommandTopic::Follow.read(&on[..4]).is_err());
    /// ```
    pub fn read(self, bytes: &[u8]) -> Result<Command, CommandFault> {
        match self {
            Self::Stop => Ok(Command::Stop),
            Self::Reset => Ok(Reader::new(bytes).map(|_| Command::Reset)?),
            Self::Follow => Ok(Command::Follow(Reader::new(bytes)?.u8()? != 0)),
            Self::Goal => goal(bytes).map(Command::Goal),
        }
    }
}

impl fmt::Display for CommandTopic {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// Reads a `geometry_msgs/PointStamped`.
fn goal(bytes: &[u8]) -> Result<Goal, CommandFault> {
    let mut reader = Reader::new(bytes)?;
    // A stamp before 1970 is as good as none.
    let seconds = u64::try_from(reader.i32()?).unwrap_or(0);
    let stamp_us = seconds * 1_000_000 + u64::from(reader.u32()?) / 1_000;
    let frame = reader.text()?;
    if frame != FRAME {
        return Err(CommandFault::Frame(frame.to_owned()));
    }
    let mut position_um = [0; 3];
    for (um, axis) in position_um.iter_mut().zip(['x', 'y', 'z']) {
        let value = reader.f64()?;
        if !(value.abs() <= FARTHEST_M) {
            return Err(CommandFault::Position { axis, value });
        }
        *um = (value * 1e6).round() as i32;
    }
    Ok(Goal {
        stamp_us,
        position_um,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use trinocular_recording::cdr::Writer;

    fn point(seconds: i32, frame: &str, metres: [f64; 3]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes);
        writer.i32(seconds);
        writer.u32(5_000);
        writer.text(frame);
        writer.f64_array(&metres);
        bytes
    }

    #[test]
    fn goal_is_read_in_micrometres() {
        let read = CommandTopic::Goal.read(&point(3, "stage", [0.001, -0.002_000_4, 2.0]));
        let goal = Goal {
            stamp_us: 3_000_005,
            position_um: [1_000, -2_000, 2_000_000],
        };
        assert_eq!(read, Ok(Command::Goal(goal)));
    }

    #[test]
    fn foreign_goals_are_refused_by_name() {
        let refused = |bytes: &[u8]| CommandTopic::Goal.read(bytes).unwrap_err().to_string();
        assert!(refused(&point(0, "map", [0.0; 3])).contains("\"map\""));
        assert!(refused(&point(0, "", [0.0; 3])).contains("\"stage\""));
        for value in [f64::NAN, f64::INFINITY, -2.000_001] {
            let text = refused(&point(0, "stage", [0.0, value, 0.0]));
            assert!(text.contains(&format!("its y is {value}")), "{text}");
        }
        let whole = point(0, "stage", [0.0; 3]);
        assert!(refused(&whole[..whole.len() - 1]).contains("ends within"));
    }

    #[test]
    fn any_message_on_stop_stops() {
        for bytes in [&[][..], &[9], &[0, 1, 0, 0, 0]] {
            assert_eq!(CommandTopic::Stop.read(bytes), Ok(Command::Stop));
        }
        assert!(CommandTopic::Reset.read(&[]).is_err());
        assert_eq!(
            CommandTopic::Reset.read(&[0, 1, 0, 0, 0]),
            Ok(Command::Reset)
        );
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes: Vec<u8>, topic in 0_usize..4) {
            if let Ok(Command::Goal(goal)) = CommandTopic::ALL[topic].read(&bytes) {
                prop_assert!(goal.position_um.iter().all(|um| um.abs() <= 2_000_000));
            }
        }
    }
}
