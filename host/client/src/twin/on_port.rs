//! A [real-time twin](super::real_time) on a thread of this process, behind a pseudo-terminal.

use super::far_end::{FarEnd as _, Terminal};
use super::real_time::RealTimeTwin;
use crate::StationError;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use trinocular_rig::rig_file::Stage;

/// Station in real time on a thread of this process. It ends with this value.
#[derive(Debug)]
pub struct TwinOnPort {
    path: String,
    started: Instant,
    pins: Arc<Pins>,
    thread: Option<JoinHandle<()>>,
}

/// Edges at the step pins.
#[derive(Debug, Default)]
struct Pins {
    steps: Mutex<[i64; 3]>,
    /// Instant of the last edge, µs of host time since the start.
    last_edge_us: AtomicU64,
    is_over: AtomicBool,
}

impl TwinOnPort {
    /// Switches a station on whose pins drive `stage`. It has no configuration yet.
    ///
    /// # Errors
    /// [`StationError::Port`] if the system gives no pseudo-terminal or no thread.
    pub fn start(stage: &Stage) -> Result<Self, StationError> {
        let failed = |reason: String| StationError::Port {
            path: "the built-in twin".to_owned(),
            reason,
        };
        let terminal =
            Terminal::open().map_err(|cause| failed(format!("no pseudo-terminal: {cause}")))?;
        let path = terminal.name().to_owned();
        let pins = Arc::new(Pins::default());
        let twin = RealTimeTwin::power_on(stage);
        let theirs = Arc::clone(&pins);
        let started = Instant::now();
        let thread = std::thread::Builder::new()
            .name("twin".to_owned())
            .spawn(move || live(twin, terminal, started, &theirs));
        Ok(Self {
            path,
            started,
            pins,
            thread: Some(thread.map_err(|cause| failed(format!("no thread: {cause}")))?),
        })
    }

    /// Returns the path of the port that leads to the station.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Returns the steps that the pins made since the start, backward ones subtracted.
    pub fn steps(&self) -> [i64; 3] {
        let steps = self.pins.steps.lock();
        *steps.unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the time of the last edge at the step pins, to a millisecond or two. It is the start
    /// of the station before the first edge.
    pub fn last_edge(&self) -> Instant {
        self.started + Duration::from_micros(self.pins.last_edge_us.load(Ordering::Relaxed))
    }
}

impl Drop for TwinOnPort {
    fn drop(&mut self) {
        self.pins.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Runs the station until the end.
fn live(mut twin: RealTimeTwin, mut line: Terminal, started: Instant, pins: &Pins) {
    let mut buffer = [0; 512];
    while !pins.is_over.load(Ordering::Relaxed) {
        let count = line.read(&mut buffer).unwrap_or(0);
        let answer = twin.turn(&buffer[..count]);
        let steps = twin.steps();
        let mut known = pins.steps.lock().unwrap_or_else(PoisonError::into_inner);
        if *known != steps {
            *known = steps;
            let since_us = twin.now().saturating_duration_since(started).as_micros();
            pins.last_edge_us.store(since_us as u64, Ordering::Relaxed);
        }
        drop(known);
        line.write(&answer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serial::Serial;
    use crate::stage::default_stage;
    use trinocular_core::frame::message::{Command, Mounting};

    #[test]
    fn station_on_pseudo_terminal_moves() {
        let stage = default_stage();
        let twin = TwinOnPort::start(&stage).unwrap();
        let mut serial = Serial::start(twin.path(), &stage, Mounting::OnStage).unwrap();
        let distance_um = [500, 0, -250];
        serial.command("jog", Command::Jog { distance_um }).unwrap();
        let patience = Instant::now() + Duration::from_secs(60);
        while twin.steps() != [40, 0, -20] && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(twin.steps(), [40, 0, -20]);
        assert!(twin.last_edge() > twin.started);
    }
}
