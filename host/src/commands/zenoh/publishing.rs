//! The publisher of a run, as a taker of its frame sets, and the commands of nodes as actions of a
//! page.

use crate::commands::failure::Failure;
use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};
use trinocular::servo::recording::FrameSetTaker;
use trinocular_live::Controls;
use trinocular_live::controls::{Action, Reply};
use trinocular_recording::message::Measurement;
use trinocular_recording::queue::Pace;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_ros::command::{Command, Goal};
use trinocular_ros::publisher::{CommandSink, Feed, Publisher, PublisherError, Settings};
use trinocular_vision::images::FrameSet;

/// Age from which on a goal is not driven to any more, µs.
const OLDEST_US: u64 = 5_000_000;

/// Open publisher.
#[derive(Debug)]
pub struct Publishing(Publisher);

impl Publishing {
    /// Opens the session.
    pub fn open(
        endpoint: &str,
        domain: u32,
        cameras: &[String],
        pace: Pace,
        controls: Option<Arc<dyn Controls>>,
    ) -> Result<Self, Failure> {
        let is_controlled = controls.is_some();
        let publisher = Publisher::open(&Settings {
            endpoint: endpoint.to_owned(),
            domain,
            cameras: cameras.to_vec(),
            pace,
            commands: controls.map(sink),
        });
        let publisher = publisher.map_err(|error| match error {
            PublisherError::Endpoint { .. } | PublisherError::Name(_) => {
                Failure::Usage(error.to_string())
            }
            error => InputError::file(Path::new(endpoint), error.to_string()).into(),
        })?;
        notice!("publishing in ROS domain {domain} through {endpoint}");
        if is_controlled {
            notice!(
                "warning: every node that reaches {endpoint} can move the stage: topics \
                 /trinocular/stop, reset, follow and goal"
            );
        }
        Ok(Self(publisher))
    }

    /// Returns the taker of frame sets.
    pub fn taker(&self) -> Arc<dyn FrameSetTaker> {
        Arc::new(Taker(self.0.feed()))
    }

    /// Ends the session and prints the account.
    pub fn finish(self) {
        let account = self.0.finish();
        let mut text = format!("published {} messages", account.messages);
        if account.dropped > 0 {
            let dropped = account.dropped;
            text += &format!("; dropped because the network was too slow: {dropped}");
        }
        if account.failed > 0 {
            text += &format!("; not taken by Zenoh: {}", account.failed);
        }
        notice!("{text}");
    }
}

/// Makes the sink that passes commands to these controls.
fn sink(controls: Arc<dyn Controls>) -> CommandSink {
    Arc::new(move |topic, command| {
        let reply = Reply::new(move |outcome| {
            if let Err(reason) = outcome {
                notice!("ROS 2: {topic} was not done: {reason}");
            }
        });
        let command = command.map_err(|fault| fault.to_string());
        match command.and_then(|command| action(command, now_us())) {
            Ok(Action::Stop {}) => controls.stop(reply),
            Ok(action) => controls.request(action, reply),
            Err(reason) => reply.send(Err(reason)),
        }
    })
}

/// Returns the action of a command that comes now, µs since 1970.
fn action(command: Command, now_us: u64) -> Result<Action, String> {
    match command {
        Command::Stop => Ok(Action::Stop {}),
        Command::Reset => Ok(Action::Reset {}),
        Command::Follow(on) => Ok(Action::Follow { on }),
        Command::Goal(Goal {
            stamp_us,
            position_um,
        }) => {
            let age_us = now_us.saturating_sub(stamp_us);
            if stamp_us > 0 && age_us > OLDEST_US {
                return Err(format!(
                    "its stamp is {:.1} s old, and a goal is at most {} s old: compare the clocks \
                     of the two computers",
                    age_us as f64 * 1e-6,
                    OLDEST_US / 1_000_000
                ));
            }
            let action = Action::Go { position_um };
            action.check().map(|()| action)
        }
    }
}

fn now_us() -> u64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.map_or(0, |since| since.as_micros() as u64)
}

/// Taker that passes frame sets to the publisher.
#[derive(Debug)]
struct Taker(Arc<Feed>);

impl FrameSetTaker for Taker {
    fn take(&self, images: Option<&FrameSet>, measurement: Measurement) {
        self.0.take(images, measurement);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_goal_is_refused() {
        let goal = |stamp_us| {
            let position_um = [1, 2, 3];
            action(
                Command::Goal(Goal {
                    stamp_us,
                    position_um,
                }),
                60_000_000,
            )
        };
        let position_um = [1, 2, 3];
        // Without a stamp, of another clock that is ahead, and at the limit.
        for stamp_us in [0, 90_000_000, 55_000_000] {
            assert_eq!(goal(stamp_us), Ok(Action::Go { position_um }));
        }
        let refused = goal(54_900_000).unwrap_err();
        assert!(refused.contains("5.1 s old"), "{refused}");
    }
}
