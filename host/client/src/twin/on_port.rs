//! A [real-time twin](super::real_time) on a thread of this process, behind a pseudo-terminal.

use super::far_end::{FarEnd as _, Terminal};
use super::real_time::{RealTimeTwin, Switches};
use crate::StationError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;
use trinocular_rig::rig_file::Stage;

/// Station in real time on a thread of this process. It ends with this value.
#[derive(Debug)]
pub struct TwinOnPort {
    path: String,
    pins: Arc<Pins>,
    thread: Option<JoinHandle<()>>,
}

/// Pins of the board, outputs and inputs.
#[derive(Debug)]
struct Pins {
    edges: Mutex<Edges>,
    switches: Mutex<Switches>,
    is_over: AtomicBool,
}

#[derive(Clone, Copy, Debug)]
struct Edges {
    /// Steps since the start, backward ones subtracted.
    steps: [i64; 3],
    /// Time of the last edge.
    last: Instant,
    /// Time up to which the station has run.
    now: Instant,
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
        let now = Instant::now();
        let pins = Arc::new(Pins {
            edges: Mutex::new(Edges {
                steps: [0; 3],
                last: now,
                now,
            }),
            switches: Mutex::new(Switches::default()),
            is_over: AtomicBool::new(false),
        });
        let twin = RealTimeTwin::power_on(stage);
        let theirs = Arc::clone(&pins);
        let thread = std::thread::Builder::new()
            .name("twin".to_owned())
            .spawn(move || live(twin, terminal, &theirs));
        Ok(Self {
            path,
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
        self.pins.edges().steps
    }

    /// Returns the steps as [`TwinOnPort::steps`] does, and the instant at which the pins had made
    /// them. It is a few milliseconds ago, more on a loaded computer.
    pub fn steps_at(&self) -> ([i64; 3], Instant) {
        let edges = self.pins.edges();
        (edges.steps, edges.now)
    }

    /// Returns the time of the last edge at the step pins, to a millisecond or two. It is the start
    /// of the station before the first edge.
    pub fn last_edge(&self) -> Instant {
        self.pins.edges().last
    }

    /// Opens and closes the switches at the board.
    pub fn set_switches(&self, switches: Switches) {
        *self.pins.switches() = switches;
    }
}

impl Pins {
    fn edges(&self) -> MutexGuard<'_, Edges> {
        self.edges.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn switches(&self) -> MutexGuard<'_, Switches> {
        self.switches.lock().unwrap_or_else(PoisonError::into_inner)
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
fn live(mut twin: RealTimeTwin, mut line: Terminal, pins: &Pins) {
    let mut buffer = [0; 512];
    while !pins.is_over.load(Ordering::Relaxed) {
        let count = line.read(&mut buffer).unwrap_or(0);
        twin.set_switches(*pins.switches());
        let answer = twin.turn(&buffer[..count]);
        let steps = twin.steps();
        let mut edges = pins.edges();
        edges.now = twin.now();
        if edges.steps != steps {
            edges.steps = steps;
            edges.last = edges.now;
        }
        drop(edges);
        line.write(&answer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serial::Serial;
    use crate::stage::default_stage;
    use std::time::Duration;
    use trinocular_core::frame::message::{Command, Mounting};

    #[test]
    fn station_on_pseudo_terminal_moves() {
        let stage = default_stage();
        let twin = TwinOnPort::start(&stage).unwrap();
        let started = twin.last_edge();
        let mut serial = Serial::start(twin.path(), &stage, Mounting::OnStage).unwrap();
        let distance_um = [500, 0, -250];
        serial.command("jog", Command::Jog { distance_um }).unwrap();
        let patience = Instant::now() + Duration::from_secs(60);
        while twin.steps() != [40, 0, -20] && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(twin.steps(), [40, 0, -20]);
        assert!(twin.last_edge() > started);
        let (steps, at) = twin.steps_at();
        assert!(steps == [40, 0, -20] && at >= twin.last_edge());
    }
}
