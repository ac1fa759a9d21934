//! The far end of a pseudo-terminal: stations and other devices, each in a thread that ends with
//! its handle.
//!
//! The port is a symbolic link to the pseudo-terminal, so that a line can be unplugged and plugged
//! in again under the same name.

use std::io::{Read as _, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use trinocular_client::plant::Plant;
use trinocular_client::stage::{configuration, default_stage};
use trinocular_client::twin::far_end::{FarEnd as _, Terminal};
use trinocular_client::twin::{PORT, RING_WORDS};
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Config, LastRun, Mounting, Packet, Report, ResetCause};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::Board;
use trinocular_core::replay::{Event, Station};
use trinocular_core::safety::Inputs;
use trinocular_core::steps::WordRate;
use trinocular_core::time::Instant as StationInstant;

/// A device at the far end of a line.
pub struct FarEnd {
    /// Path of the port that leads to the device.
    pub path: String,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    _folder: TempDir,
}

#[derive(Default)]
struct Shared {
    received: Mutex<Vec<u8>>,
    /// Steps made at the pins.
    steps: Mutex<[i64; 3]>,
    unplugged: AtomicBool,
    /// Number of times that the station was power-cycled.
    restarts: AtomicU32,
    over: AtomicBool,
}

impl Drop for FarEnd {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl FarEnd {
    /// Returns all bytes received over the line.
    pub fn received(&self) -> Vec<u8> {
        self.shared
            .received
            .lock()
            .expect("no thread panics")
            .clone()
    }

    /// Returns the edges at a station's step pins since power-on, with backward ones subtracted.
    pub fn steps(&self) -> [i64; 3] {
        *self.shared.steps.lock().expect("no thread panics")
    }

    /// Waits until no more edges come and returns the position.
    ///
    /// # Panics
    /// Panics if edges still come after a minute.
    pub fn standing(&self) -> [i64; 3] {
        let patience = Instant::now() + Duration::from_secs(60);
        loop {
            let steps = self.steps();
            std::thread::sleep(Duration::from_millis(300));
            if self.steps() == steps {
                return steps;
            }
            assert!(Instant::now() < patience, "still moving: {steps:?}");
        }
    }

    /// Unplugs the line. The device keeps running.
    pub fn unplug(&self) {
        self.shared.unplugged.store(true, Ordering::Relaxed);
        while Path::new(&self.path).exists() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Plugs the line in again.
    pub fn plug(&self) {
        self.shared.unplugged.store(false, Ordering::Relaxed);
    }

    /// Power-cycles the station.
    pub fn restart(&self) {
        self.shared.restarts.fetch_add(1, Ordering::Relaxed);
    }
}

/// Opens a pseudo-terminal under a link's name.
fn line(path: &Path) -> Terminal {
    let terminal = Terminal::open().expect("a pseudo-terminal");
    std::os::unix::fs::symlink(terminal.name(), path).expect("a link");
    terminal
}

/// Calls `live` every millisecond with the bytes received, and sends back the bytes it returns.
fn far_end(mut live: impl FnMut(&Shared, &[u8]) -> Vec<u8> + Send + 'static) -> FarEnd {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("port");
    let shared = Arc::new(Shared::default());
    let mut end = Some(line(&path));
    let (theirs, link) = (Arc::clone(&shared), path.clone());
    let thread = std::thread::spawn(move || {
        let mut buffer = [0; 256];
        while !theirs.over.load(Ordering::Relaxed) {
            let unplugged = theirs.unplugged.load(Ordering::Relaxed);
            if unplugged && end.take().is_some() {
                std::fs::remove_file(&link).expect("the link was there");
            }
            if !unplugged && end.is_none() {
                end = Some(line(&link));
            }
            let count = match &mut end {
                Some(end) => end.read(&mut buffer).unwrap_or(0),
                None => {
                    std::thread::sleep(Duration::from_millis(1));
                    0
                }
            };
            theirs
                .received
                .lock()
                .expect("no thread panics")
                .extend_from_slice(&buffer[..count]);
            let answer = live(&theirs, &buffer[..count]);
            if let Some(end) = &mut end {
                end.write(&answer);
            }
        }
    });
    FarEnd {
        path: path.to_str().expect("UTF-8").to_owned(),
        shared,
        thread: Some(thread),
        _folder: folder,
    }
}

fn switched_on(session: u32, reset_cause: ResetCause, last_run: LastRun) -> Station {
    let board = Board {
        name: "far end",
        version: [0, 1, 0],
        word_rate: WordRate::MHZ_1,
        delay_us: RING_WORDS as u32,
        session,
        reset_cause,
        last_run,
        camera_pin: None,
    };
    Station::new(board, PORT, RING_WORDS as u32).expect("possible pins")
}

/// Distance from the stage's starting point to the rails' limit switches, steps: 70 mm.
const RAIL_STEPS: i64 = 5_600;

/// Starts the station on this computer's clock, with a stage on rails with limit switches at their
/// ends.
pub fn station() -> FarEnd {
    station_after(ResetCause::PowerOn, LastRun::UNKNOWN)
}

/// Starts a [`station`] that remembers a reset cause and its last run.
pub fn station_after(reset_cause: ResetCause, last_run: LastRun) -> FarEnd {
    far_end(machine(reset_cause, last_run))
}

/// Starts a [`station`] behind a line that loses the host's packets for which `lost` returns true,
/// and passes its reports through `told`, which may change or lose them.
pub fn station_behind(
    mut lost: impl FnMut(&Packet) -> bool + Send + 'static,
    mut told: impl FnMut(Report) -> Option<Report> + Send + 'static,
) -> FarEnd {
    let mut station = machine(ResetCause::PowerOn, LastRun::UNKNOWN);
    let mut commands = Receiver::<Packet>::default();
    let mut reports = Receiver::<Report>::default();
    far_end(move |shared, bytes| {
        let passed = without_lost(&mut commands, bytes, &mut lost);
        let answer = station(shared, &passed);
        let (mut answer, mut heard) = (&answer[..], Vec::new());
        while let Some(report) = reports.next(&mut answer) {
            let report = report.expect("a station speaks clearly");
            if let Some(report) = told(report) {
                heard.extend_from_slice(&encode(&report).expect("it fits"));
            }
        }
        heard
    })
}

/// Connects to the station on the port `path` through a line that loses the host's packets for
/// which `lost` returns true.
pub fn bridge(path: &str, mut lost: impl FnMut(&Packet) -> bool + Send + 'static) -> FarEnd {
    let port = serialport::new(path, 921_600).timeout(Duration::from_secs(1));
    let mut port = port.open().expect("the station's port opens");
    let mut commands = Receiver::<Packet>::default();
    far_end(move |_, bytes| {
        let passed = without_lost(&mut commands, bytes, &mut lost);
        port.write_all(&passed).expect("the station takes it");
        let waiting = port.bytes_to_read().expect("it is open") as usize;
        let mut answer = vec![0; waiting];
        port.read_exact(&mut answer).expect("they are there");
        answer
    })
}

/// Returns the host's bytes without the packets for which `lost` returns true.
fn without_lost(
    commands: &mut Receiver<Packet>,
    mut bytes: &[u8],
    lost: &mut impl FnMut(&Packet) -> bool,
) -> Vec<u8> {
    let mut passed = Vec::new();
    while let Some(packet) = commands.next(&mut bytes) {
        if let Ok(packet) = packet
            && !lost(&packet)
        {
            passed.extend_from_slice(&encode(&packet).expect("it fitted before"));
        }
    }
    passed
}

fn machine(
    reset_cause: ResetCause,
    last_run: LastRun,
) -> impl FnMut(&Shared, &[u8]) -> Vec<u8> + Send + 'static {
    let mut station = switched_on(1, reset_cause, last_run);
    let mut plant = Plant::new(PORT, default_stage().steps_per_mm);
    let mut words = [0; 2 * WordRate::MHZ_1.slots_per_segment() as usize];
    let mut last = Instant::now();
    let mut restarts = 0;
    move |shared, bytes| {
        let wanted = shared.restarts.load(Ordering::Relaxed);
        if restarts != wanted {
            restarts = wanted;
            station = switched_on(1 + restarts, ResetCause::PowerOn, LastRun::UNKNOWN);
        }
        station.receive(bytes);
        station.set_switches(Inputs {
            limits: plant
                .steps()
                .map(|steps| [steps <= -RAIL_STEPS, steps >= RAIL_STEPS]),
            ..Inputs::default()
        });
        // A busy computer delays the station's clock as well, because no real board would miss a
        // heartbeat then.
        // Whole microseconds pass, and the rest counts in the next turn: the clock keeps its rate.
        let longest = Duration::from_millis(10);
        let (now, late) = (Instant::now(), last.elapsed());
        let passed_us = late.min(longest).as_micros() as u64;
        last = match late > longest {
            true => now,
            false => last + Duration::from_micros(passed_us),
        };
        let until = station.now().micros() + passed_us;
        let mut answer = Vec::new();
        loop {
            match station.run(StationInstant::from_micros(until), &mut words) {
                Event::Sent(packet) => answer.extend_from_slice(&packet),
                Event::Segment(_, filled) => plant.feed(&words[..filled]),
                Event::Refused(fault) => panic!("{fault}"),
                Event::Idle(_) => {
                    *shared.steps.lock().expect("no thread panics") = plant.steps();
                    return answer;
                }
            }
        }
    }
}

/// Starts a device that answers everything with the same bytes.
pub fn saying(bytes: Vec<u8>) -> FarEnd {
    far_end(move |_, received| {
        if received.is_empty() {
            Vec::new()
        } else {
            bytes.clone()
        }
    })
}

/// Starts a device that never answers.
pub fn mute() -> FarEnd {
    far_end(|_, _| Vec::new())
}

/// Returns a configuration that every station refuses.
pub fn impossible() -> Config {
    let mut config = configuration(&default_stage(), Mounting::OnStage).expect("it fits");
    config.slow_speed_um_s = 0;
    config
}
