//! `--zenoh`: the run as topics of ROS 2.

#[cfg(not(feature = "zenoh"))]
mod missing;
#[cfg(feature = "zenoh")]
mod publishing;

#[cfg(not(feature = "zenoh"))]
use missing::Publishing;
#[cfg(feature = "zenoh")]
use publishing::Publishing;

use crate::commands::failure::Failure;
use clap::Args;
use std::cell::RefCell;
use std::sync::Arc;
use std::time::{Duration, Instant};
use trinocular::servo::observer::ServoObserver;
use trinocular::servo::recording::{FrameSetTaker, observers_of};
use trinocular_core::rig::Rig;
use trinocular_live::Controls;
use trinocular_recording::queue::Pace;

/// Environment variable with the ROS domain.
const DOMAIN: &str = "ROS_DOMAIN_ID";

/// Largest ROS domain.
const LARGEST_DOMAIN: u32 = 232;

/// Topics of the run.
#[derive(Debug, Args)]
pub struct ZenohOption {
    /// Publish displacement, frames and images as topics of ROS 2, through the Zenoh router at this
    /// endpoint [default: tcp/127.0.0.1:7447]
    ///
    /// Nodes of ROS 2 (Jazzy or later) on rmw_zenoh_cpp receive /trinocular/displacement,
    /// /trinocular/CAMERA/image_raw and /tf, in the domain of ROS_DOMAIN_ID. `serve --control` also
    /// takes /trinocular/stop, reset, follow and goal, from every node that reaches the router. Start
    /// the router first: `ros2 run rmw_zenoh_cpp rmw_zenohd`. `track --sim` on the twin then takes its
    /// real time. What the network is too slow for is dropped and counted. Needs a program that was
    /// built with `--features trinocular/zenoh`.
    #[arg(
        long,
        value_name = "ENDPOINT",
        num_args = 0..=1,
        default_missing_value = "tcp/127.0.0.1:7447",
        require_equals = true,
        help_heading = "ROS 2"
    )]
    zenoh: Option<String>,

    #[arg(skip)]
    run: RefCell<Option<Run>>,
}

/// Run that is published.
#[derive(Debug)]
struct Run {
    publishing: Publishing,
    started: Instant,
}

/// Returns the ROS domain of the environment, 0 by default.
fn domain(value: Option<&str>) -> Result<u32, Failure> {
    let Some(text) = value.filter(|text| !text.is_empty()) else {
        return Ok(0);
    };
    let domain = text.parse().ok().filter(|domain| *domain <= LARGEST_DOMAIN);
    domain.ok_or_else(|| {
        Failure::Usage(format!(
            "{DOMAIN} is {text:?}; must be a number from 0 to {LARGEST_DOMAIN}"
        ))
    })
}

impl ZenohOption {
    /// Opens the session of a run with these cameras, if one was requested, before anything moves.
    /// Nodes may then use the controls.
    pub fn begin(
        &self,
        cameras: &[String],
        pace: Pace,
        controls: Option<Arc<dyn Controls>>,
    ) -> Result<(), Failure> {
        let Some(endpoint) = &self.zenoh else {
            return Ok(());
        };
        let domain = domain(std::env::var(DOMAIN).ok().as_deref())?;
        self.run.replace(Some(Run {
            publishing: Publishing::open(endpoint, domain, cameras, pace, controls)?,
            started: Instant::now(),
        }));
        Ok(())
    }

    /// Returns the taker of the run's frame sets, if it is published.
    pub fn taker(&self) -> Option<Arc<dyn FrameSetTaker>> {
        let run = self.run.borrow();
        run.as_ref().map(|run| run.publishing.taker())
    }

    /// Returns the observers of the loop: one if the run is published.
    pub fn observers(&self, rig: &Rig) -> Vec<Box<dyn ServoObserver>> {
        observers_of(self.taker(), rig)
    }

    /// Waits until a published run has lasted `time_s`.
    pub fn pace(&self, time_s: f64) {
        if let Some(run) = &*self.run.borrow() {
            let end = run.started + Duration::from_secs_f64(time_s.max(0.0));
            std::thread::sleep(end.saturating_duration_since(Instant::now()));
        }
    }

    /// Sends what waits and prints the account, also after a failure.
    pub fn close<T>(&self, run: Result<T, Failure>) -> Result<T, Failure> {
        if let Some(run) = self.run.take() {
            run.publishing.finish();
        }
        run
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn domain_out_of_range_is_refused() {
        assert_eq!(domain(None).unwrap(), 0);
        assert_eq!(domain(Some("")).unwrap(), 0);
        assert_eq!(domain(Some("232")).unwrap(), 232);
        for text in ["233", "-1", "lab"] {
            let refusal = domain(Some(text)).unwrap_err();
            assert_eq!(refusal.exit_code(), 2);
            assert!(refusal.to_string().contains(text), "{refusal}");
        }
    }
}
