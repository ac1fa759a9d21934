//! The state of a run as a Foxglove websocket, for Foxglove, Lichtblick and PlotJuggler.
//!
//! | topic | message |
//! |---|---|
//! | `/camera/NAME` | `foxglove.CompressedImage`, JPEG |
//! | `/stage`, `/target` | `foxglove.PoseInFrame`, m, in the frame `stage` |
//! | `/measurement` | JSON: displacement, sigma, error, stage, latency, points |
//! | `/station` | JSON: state, fault, trust, rates, counts |
//!
//! The stream only shows; nothing can be sent to the run.

use crate::hub::Hub;
use crate::images::Encoded;
use crate::server::LiveError;
use crate::telemetry::Sample;
use foxglove::messages::{CompressedImage, Pose, PoseInFrame, Quaternion, Timestamp, Vector3};
use foxglove::{Channel, Context, PartialMetadata, RawChannel, Schema, WebSocketServerHandle};
use serde_json::json;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Period of the stream: 60 looks at the hub a second.
const PERIOD: Duration = Duration::from_millis(16);

/// Messages per client that wait; a slower client loses the oldest.
const BACKLOG: usize = 256;

const MEASUREMENT: &str = include_str!("foxglove/measurement.json");
const STATION: &str = include_str!("foxglove/station.json");

/// Running stream. Dropping it disconnects its clients.
pub struct Stream {
    address: SocketAddr,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    handle: Option<WebSocketServerHandle>,
    /// Server and channels refer to it weakly.
    _context: Arc<Context>,
}

impl std::fmt::Debug for Stream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stream")
            .field("address", &self.address)
            .finish_non_exhaustive()
    }
}

impl Stream {
    /// Serves the state of `hub` on `address`.
    ///
    /// # Errors
    /// [`LiveError::Reachable`] if other computers reach the address, because the stream has no
    /// key; [`LiveError::Listen`] if the port is in use.
    pub fn start(address: SocketAddr, hub: Arc<Hub>) -> Result<Self, LiveError> {
        if !address.ip().is_loopback() {
            return Err(LiveError::Reachable(address));
        }
        let context = Context::new();
        let server = context
            .websocket_server()
            .name("trinocular")
            .bind(address.ip().to_string(), address.port())
            .message_backlog_size(BACKLOG)
            .start_blocking();
        let handle = server.map_err(|cause| LiveError::Listen {
            address,
            reason: format!("{cause}; choose another port with --foxglove=ADDR:PORT"),
        })?;
        let failed = |cause: std::io::Error| LiveError::System(cause.to_string());
        let channels = FoxgloveChannels::new(&context, hub.cameras())
            .map_err(|cause| LiveError::System(cause.to_string()))?;
        let is_over = Arc::new(AtomicBool::new(false));
        let theirs = Arc::clone(&is_over);
        let thread = std::thread::Builder::new()
            .name("foxglove".to_owned())
            .spawn(move || channels.run(&hub, &theirs));
        let mut place = address;
        place.set_port(handle.port());
        Ok(Self {
            address: place,
            is_over,
            thread: Some(thread.map_err(failed)?),
            handle: Some(handle),
            _context: context,
        })
    }

    /// Returns the address of the stream.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        if let Some(handle) = self.handle.take() {
            let _ = handle.stop();
        }
    }
}

/// Channels of a stream.
struct FoxgloveChannels {
    cameras: Vec<(String, Channel<CompressedImage>)>,
    stage: Channel<PoseInFrame>,
    target: Channel<PoseInFrame>,
    measurement: Arc<RawChannel>,
    station: Arc<RawChannel>,
}

impl FoxgloveChannels {
    fn new(context: &Arc<Context>, cameras: &[String]) -> Result<Self, foxglove::FoxgloveError> {
        let raw = |topic: &str, name: &str, schema: &'static str| {
            let schema = Schema::new(name, "jsonschema", schema.as_bytes());
            context
                .channel_builder(topic)
                .message_encoding("json")
                .schema(schema)
                .build_raw()
        };
        let image = |name: &String| {
            let channel = context.channel_builder(format!("/camera/{name}")).build();
            (name.clone(), channel)
        };
        Ok(Self {
            cameras: cameras.iter().map(image).collect(),
            stage: context.channel_builder("/stage").build(),
            target: context.channel_builder("/target").build(),
            measurement: raw("/measurement", "trinocular.Measurement", MEASUREMENT)?,
            station: raw("/station", "trinocular.Station", STATION)?,
        })
    }

    fn has_listeners(&self) -> bool {
        self.stage.has_sinks()
            || self.target.has_sinks()
            || self.measurement.has_sinks()
            || self.station.has_sinks()
            || self.wants_images()
    }

    fn wants_images(&self) -> bool {
        self.cameras.iter().any(|(_, channel)| channel.has_sinks())
    }

    /// Sends what is new until the end.
    fn run(&self, hub: &Hub, is_over: &AtomicBool) {
        let (mut seen, mut shown, mut counts_as_page) = (0, 0, false);
        // Capture times are relative; the stream wants dates.
        let mut zero = None;
        while !is_over.load(Ordering::Relaxed) {
            std::thread::sleep(PERIOD);
            // Images are encoded only while a page is open.
            let wants = self.wants_images();
            if wants && !counts_as_page {
                hub.client_came();
            } else if !wants && counts_as_page {
                hub.client_left();
            }
            counts_as_page = wants;
            let (samples, last) = hub.samples_since(seen);
            let is_new = last > seen;
            seen = last;
            if !is_new || !self.has_listeners() {
                continue;
            }
            let now_s = since_epoch_s();
            if let Some(latest) = samples.last() {
                let latest_s = latest.at_s;
                let zero_s = *zero.get_or_insert(now_s - latest_s);
                for sample in &samples {
                    self.send(sample, zero_s + sample.at_s);
                }
                let (state, _, _) = hub.state_since(u64::MAX, u64::MAX);
                let text = state.to_string();
                self.station
                    .log_with_meta(text.as_bytes(), at(zero_s + latest_s));
                if let Some(encoded) = hub.encoded()
                    && encoded.number > shown
                {
                    shown = encoded.number;
                    self.send_images(&encoded, zero_s + encoded.at_s);
                }
            }
        }
        if counts_as_page {
            hub.client_left();
        }
    }

    fn send(&self, sample: &Sample, time_s: f64) {
        let xyz = |v: Option<[f64; 3]>| v.map(|[x, y, z]| json!({"x": x, "y": y, "z": z}));
        let message = json!({
            "time_s": sample.at_s,
            "displacement_mm": xyz(sample.displacement_mm),
            "sigma_mm": xyz(sample.sigma_mm),
            "error_um": xyz(sample.error_um),
            "stage_mm": xyz(Some(sample.stage_mm)),
            "latency_ms": sample.latency_ms,
            "points": sample.points,
        });
        self.measurement
            .log_with_meta(message.to_string().as_bytes(), at(time_s));
        self.stage
            .log_with_meta(&pose(sample.stage_mm, time_s), at(time_s));
        if let Some(target_mm) = sample.target_mm {
            self.target
                .log_with_meta(&pose(target_mm, time_s), at(time_s));
        }
    }

    fn send_images(&self, encoded: &Encoded, time_s: f64) {
        for ((name, channel), image) in self.cameras.iter().zip(&encoded.images) {
            if !image.is_empty() {
                let message = CompressedImage {
                    timestamp: Some(stamp(time_s)),
                    frame_id: name.clone(),
                    data: image.clone(),
                    format: "jpeg".to_owned(),
                };
                channel.log_with_meta(&message, at(time_s));
            }
        }
    }
}

fn since_epoch_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |since| since.as_secs_f64())
}

fn at(time_s: f64) -> PartialMetadata {
    PartialMetadata {
        log_time: Some((time_s * 1e9) as u64),
    }
}

fn stamp(time_s: f64) -> Timestamp {
    Timestamp::new(time_s as u32, (time_s.fract() * 1e9) as u32)
}

fn pose(position_mm: [f64; 3], time_s: f64) -> PoseInFrame {
    let [x, y, z] = position_mm.map(|mm| mm * 1e-3);
    PoseInFrame {
        timestamp: Some(stamp(time_s)),
        frame_id: "stage".to_owned(),
        pose: Some(Pose {
            position: Some(Vector3 { x, y, z }),
            orientation: Some(Quaternion {
                x: 0.0,
                y: 0.0,
                z: 0.0,
                w: 1.0,
            }),
        }),
    }
}
