//! The rest of the simulated bench: station A, which moves a poster, and rendered cameras on the
//! simulated stage, which other programs read as `--cameras twin`.

use super::console::Disturbance;
use crate::commands::failure::Failure;
use rustix::time::{ClockId, clock_gettime};
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};
use trinocular::servo::path::TargetPath;
use trinocular_client::stage::{default_stage, setpoint};
use trinocular_client::twin::Twin;
use trinocular_client::twin::real_time::{RealTimeTwin, TimedExposure};
use trinocular_core::frame::message::Mounting;
use trinocular_core::time::Instant as StationInstant;
use trinocular_rig::error::InputError;
use trinocular_vision::images::cameras::stamp::quickest;
use trinocular_vision::images::cameras::stream::StreamHeader;
use trinocular_vision::images::{FrameSet, Scene};

/// Longest line with which a program names its camera, bytes.
const LONGEST_NAME: u64 = 64;

/// Setup of the simulated bench.
#[derive(Debug)]
pub struct LabSetup {
    /// Poster before the cameras on the stage.
    pub scene: Scene,
    /// Delay from an exposure to its time stamp, camera by camera, ms.
    pub delays_ms: Vec<f64>,
    /// Seed of the noise.
    pub seed: u64,
    /// Motion of the poster.
    pub path: TargetPath,
    /// Frame sets per second.
    pub fps: f64,
}

/// Time after which a doubled image is stamped: less than an eighth of a period up to 125 images
/// per second.
const DOUBLED_AFTER: Duration = Duration::from_millis(1);

/// Time without triggers after which the cameras run freely again.
const FREE_AFTER: Duration = Duration::from_secs(2);

/// Instant at which all cameras take an image.
struct Shot {
    number: u32,
    /// Time that has passed for the station, and so for the target.
    since: Duration,
    /// Capture time on the monotonic clock.
    captured: Duration,
    cameras_mm: [f64; 3],
    /// Fault of the first camera.
    disturbance: Option<Disturbance>,
}

/// The simulated bench: renders in a thread of its own, so that the station keeps its time.
pub struct Lab {
    shots: SyncSender<Shot>,
    started: Instant,
    /// The start on the monotonic clock.
    started_monotonic: Duration,
    period: Duration,
    /// Time at which the next image is due, while the cameras run freely.
    due: Duration,
    /// Time at which the station last gave triggers.
    triggered: Option<Duration>,
    taken: u32,
    disturbance: Option<Disturbance>,
    /// Socket of the cameras, removed at the end.
    path: PathBuf,
}

impl Lab {
    /// Starts the cameras, with their socket beside the station's `link`.
    pub fn start(setup: LabSetup, link: &Path) -> Result<Self, Failure> {
        let target = Twin::start(&default_stage(), "twin A", Mounting::OnStage)
            .map_err(|error| Failure::of_station(None, error))?;
        let path = cameras_of(link);
        let failed = |cause| InputError::io(&path, "listen there", &cause);
        // Whoever has the link has the cameras, so a socket that lies there is left over.
        let _ = std::fs::remove_file(&path);
        let listener = UnixListener::bind(&path).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        // One that is being rendered and one that waits: a slow computer skips shots.
        let (shots, orders) = sync_channel(1);
        let renderer = Renderer {
            scene: setup.scene,
            seed: setup.seed,
            path: setup.path,
            period_s: 1.0 / setup.fps,
            delays_ms: setup.delays_ms,
            target,
            listener,
            readers: Vec::new(),
        };
        std::thread::Builder::new()
            .name("cameras".to_owned())
            .spawn(move || renderer.run(&orders))
            .map_err(failed)?;
        let (started, started_monotonic) = quickest(|| {
            let (before, at, started) = (Instant::now(), monotonic(), Instant::now());
            (started - before, (started, at))
        });
        Ok(Self {
            shots,
            started,
            started_monotonic,
            period: Duration::from_secs_f64(1.0 / setup.fps),
            due: Duration::ZERO,
            triggered: None,
            taken: 0,
            disturbance: None,
            path,
        })
    }

    /// Disturbs the first camera at its next image.
    pub fn disturb(&mut self, disturbance: Disturbance) {
        self.disturbance = Some(disturbance);
    }

    /// Takes images at the station's triggers, or if they are due where it has given none for a
    /// while.
    pub fn turn(&mut self, twin: &mut RealTimeTwin) {
        for exposure in twin.exposures() {
            self.shoot(exposure);
        }
        let at = twin.now();
        let since = at.saturating_duration_since(self.started);
        if twin.is_triggering() {
            self.triggered = Some(since);
        }
        let is_waiting = |last: Duration| since < last + FREE_AFTER;
        if self.triggered.is_some_and(is_waiting) {
            self.due = since;
        } else if since >= self.due {
            // A busy computer leaves images out.
            let late = (since - self.due).as_nanos() % self.period.as_nanos();
            self.due = since + self.period - Duration::from_nanos(late as u64);
            self.shoot(TimedExposure {
                at,
                passed: twin.passed(),
                stage_mm: twin.position_mm(),
            });
        }
    }

    /// Takes images.
    fn shoot(&mut self, exposure: TimedExposure) {
        self.taken = self.taken.saturating_add(1);
        let shot = Shot {
            number: self.taken,
            since: exposure.passed,
            captured: self.started_monotonic + exposure.at.saturating_duration_since(self.started),
            cameras_mm: exposure.stage_mm,
            disturbance: self.disturbance.take(),
        };
        // A full queue is a lost image, which the readers see by its number. Without a renderer the
        // images end.
        let _ = self.shots.try_send(shot);
    }
}

impl Drop for Lab {
    fn drop(&mut self) {
        // What stays behind is replaced by the next twin.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Returns the socket of the cameras of the simulated station on `link`.
pub fn cameras_of(link: &Path) -> PathBuf {
    let mut path = link.as_os_str().to_owned();
    path.push(".cameras");
    path.into()
}

/// Reads the monotonic clock, on which the images' capture times are.
pub fn monotonic() -> Duration {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec as u32)
}

/// Images of one shot.
struct Pictures {
    shot: Shot,
    images: FrameSet,
}

/// Way to the thread that writes one camera's images to a program. A thread that still writes gets
/// no further images than those that wait: a slow or suspended program loses images, which it
/// counts by their numbers, and keeps its connection.
type Reader = SyncSender<Arc<Pictures>>;

struct Renderer {
    scene: Scene,
    seed: u64,
    path: TargetPath,
    period_s: f64,
    delays_ms: Vec<f64>,
    target: Twin,
    listener: UnixListener,
    readers: Vec<Reader>,
}

impl Renderer {
    fn run(mut self, shots: &Receiver<Shot>) {
        while let Ok(shot) = shots.recv() {
            self.receive_readers();
            // The setpoint comes one image ahead, as in `track --sim`.
            let since_s = shot.since.as_secs_f64();
            let next_mm = self.path.at(since_s + self.period_s);
            let since_us = shot.since.as_micros() as u64;
            self.target.advance(StationInstant::from_micros(since_us));
            self.target.send(setpoint(next_mm));
            if self.readers.is_empty() {
                continue;
            }
            let target_mm = self.target.position_mm();
            let relative_mm = std::array::from_fn(|i| target_mm[i] - shot.cameras_mm[i]);
            let seed = self.seed.wrapping_mul(1_000_003);
            let seed = seed.wrapping_add(u64::from(shot.number));
            let images = self.scene.render(relative_mm, since_us, seed);
            let pictures = Arc::new(Pictures { shot, images });
            self.readers.retain(|reader| {
                let sent = reader.try_send(Arc::clone(&pictures));
                !matches!(sent, Err(TrySendError::Disconnected(_)))
            });
        }
    }

    fn receive_readers(&mut self) {
        let longest_ms = self.delays_ms.iter().copied().fold(0.0, f64::max);
        // Images wait for their stamps, and one more for its turn.
        let waiting = 1 + (longest_ms * 1e-3 / self.period_s).ceil() as usize;
        while let Ok((stream, _)) = self.listener.accept() {
            let (reader, pictures) = sync_channel(waiting);
            let delays_ms = self.delays_ms.clone();
            let serve = move || {
                // A program that has gone has its own error to report.
                let _ = serve(stream, &delays_ms, &pictures);
            };
            let thread = std::thread::Builder::new().name("reader".to_owned());
            if thread.spawn(serve).is_ok() {
                self.readers.push(reader);
            }
        }
    }
}

/// Writes the images of the camera that a program names, until the program or the twin ends.
fn serve(
    mut stream: UnixStream,
    delays_ms: &[f64],
    pictures: &Receiver<Arc<Pictures>>,
) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    let named = camera(&stream);
    let named = named.and_then(|camera| Some((camera, *delays_ms.get(camera)?)));
    let Some((camera, delay_ms)) = named else {
        return Ok(());
    };
    let delay = Duration::from_secs_f64(delay_ms.abs() * 1e-3);
    while let Ok(pictures) = pictures.recv() {
        let Some(image) = pictures.images.images.get(camera) else {
            return Ok(());
        };
        let stamp = match delay_ms < 0.0 {
            true => pictures.shot.captured.saturating_sub(delay),
            false => pictures.shot.captured + delay,
        };
        // No image arrives before its stamp.
        std::thread::sleep(stamp.saturating_sub(monotonic()));
        let header = StreamHeader {
            number: pictures.shot.number,
            captured: stamp,
            size_px: [image.width, image.height].map(|side| side as u16),
        };
        for header in headers(header, pictures.shot.disturbance.filter(|_| camera == 0)) {
            stream.write_all(&header.bytes())?;
            stream.write_all(&image.grey)?;
        }
    }
    Ok(())
}

/// Returns the headers with which an image comes: one, or none or two if it is disturbed.
fn headers(header: StreamHeader, disturbance: Option<Disturbance>) -> Vec<StreamHeader> {
    match disturbance {
        None => vec![header],
        Some(Disturbance::Miss) => Vec::new(),
        Some(Disturbance::Double) => {
            let captured = header.captured + DOUBLED_AFTER;
            vec![header, StreamHeader { captured, ..header }]
        }
    }
}

/// Reads the line with which a program names its camera, counted from 0.
fn camera(stream: &UnixStream) -> Option<usize> {
    let mut line = String::new();
    BufReader::new(stream.take(LONGEST_NAME))
        .read_line(&mut line)
        .ok()?;
    line.strip_prefix("camera ")?.trim().parse().ok()
}
