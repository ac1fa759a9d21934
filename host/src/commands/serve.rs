//! `trinocular serve`: owns a station and shows it on a page in the browser.

mod cameras;
mod recordings;
mod simulated;
mod station;

use super::live_page::LivePage;
use super::port::PortOption;
use super::range;
use super::record::{Origin, RecordOption};
use super::scene::SceneOptions;
use super::zenoh::ZenohOption;
use crate::commands::by_hand::on_interrupt;
use crate::commands::failure::Failure;
use clap::Args;
use recordings::FolderRecordings;
use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use trinocular::servo::page_recording::PageRecording;
use trinocular::servo::path::TargetPath;
use trinocular::servo::workbench::{Bench, Workbench};
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_live::{
    Controls, DEFAULT_ADDRESS, DEFAULT_FOXGLOVE_ADDRESS, DropSource, Server, Setup,
};
use trinocular_recording::queue::Pace;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::flow::region::Regions;
use trinocular_vision::sums::Estimator;
use trinocular_vision::targets;

/// The station's estimator.
const ESTIMATOR: Estimator = Estimator::Midpoint;

/// Name of the nodes of ROS 2 in messages.
const NODES: &str = "a node of ROS 2";

/// Refusal to configure a station with a stage that the user has not named: steps per mm and directions of
/// another one would move it otherwise than asked.
const STAGE_NEEDED: &str = "--port with --control or --follow configures the station: give --rig \
                            RIG.toml with its [stage] (`trinocular init` writes one to fill in); \
                            without them the page only shows the station";

const CAMERAS: &str = "With --cameras";
const SCENE: &str = "Without --cameras: the simulated target";

/// Help of `--port`, where it differs from that of other commands.
const PORT: &str = "Show the station on this port instead of the built-in twin, in real time; \
                    `auto` is the only one on USB, `twin` the one that `trinocular twin` simulates";
const PORT_CHANGES: &str = "Without --control and --follow nothing at the station is changed: no \
                            configuration, no reset, no zero; it only triggers --cameras with \
                            [trigger] in the rig file. With one of them it is configured; \
                            a known position, a stop and faults stay as they are, and a position \
                            that was never known becomes zero.";
const HEARTBEAT: &str = "Heartbeat timeout, ms: the station on --port stops without a ping for \
                         this time. Raise it on a loaded computer. A page that only shows does \
                         not set it";

/// Show a station on a page in the browser, and control it from there
///
/// Without a port the station is a simulated one in real time, whose cameras watch a moving poster:
/// everything can be tried without hardware. The page shows the images with their points,
/// displacement, error, stage and state. It only shows, and changes nothing at the station, unless
/// --control prints a link that opens it with STOP, jog, zero, home and following.
///
/// Runs until Ctrl-C, which stops the stage.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("port", |port| port.help(PORT).long_help(format!("{PORT}\n\n{PORT_CHANGES}"))))]
#[command(mut_arg("heartbeat", |heartbeat| heartbeat.help(HEARTBEAT)))]
pub struct ServeOptions {
    /// Address of the page. One that other computers reach needs --control, and then opens only by
    /// the control link
    #[arg(long, value_name = "ADDR:PORT", default_value = DEFAULT_ADDRESS)]
    listen: SocketAddr,

    /// Print a link that opens the page with its controls; it works once, then the next is printed
    #[arg(long)]
    control: bool,

    /// Serve the same as a Foxglove websocket, for Foxglove, Lichtblick and PlotJuggler. Needs a
    /// program that was built with `--features trinocular/foxglove`
    #[arg(
        long,
        value_name = "ADDR:PORT",
        num_args = 0..=1,
        default_missing_value = DEFAULT_FOXGLOVE_ADDRESS,
        require_equals = true
    )]
    foxglove: Option<SocketAddr>,

    #[command(flatten)]
    station: PortOption,

    /// The rig file (TOML): its cameras, and its stage
    ///
    /// Without it the cameras are the paper's, and the stage is one of 80 steps/mm and 100 mm/s; but
    /// --port with --control or --follow needs it with a [stage], because the station is configured
    /// with that.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    /// Follow the target from the start, not only on request. The twin does so always
    #[arg(long)]
    follow: bool,

    /// End after this time, s [default: Ctrl-C ends]
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,

    /// Frame sets per second
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    fps: f64,

    /// Live cameras, in the order of the rig file's, as for `track`, or `twin` for those of
    /// `trinocular twin --with-target` on --port; without it they are rendered. With [trigger] in
    /// the rig file the station on --port triggers them
    #[arg(
        long,
        value_name = "DEVICE,...",
        requires = "rig",
        value_delimiter = ',',
        help_heading = CAMERAS
    )]
    cameras: Option<Vec<PathBuf>>,

    /// Largest difference of capture times within a frame set, ms; at most half the time between
    /// two images of a camera [default: 5, or that half if it is less]
    #[arg(long, value_name = "MS", requires = "cameras", help_heading = CAMERAS)]
    window: Option<f64>,

    /// Delay from the middle of the exposure to the image's time stamp, ms, of all cameras, as for
    /// `track` [default: the rig file's `delay_ms`, or 0]
    #[arg(
        long,
        value_name = "MS",
        allow_negative_numbers = true,
        requires = "cameras",
        help_heading = CAMERAS
    )]
    delay: Option<f64>,

    /// The cameras stand beside the stage, which copies the target's motion
    #[arg(long, requires = "cameras", help_heading = CAMERAS)]
    fixed: bool,

    /// Motion of the target: steps, line, circle, lissajous or still
    #[arg(long, default_value_t = TargetPath::Lissajous, help_heading = SCENE)]
    path: TargetPath,

    #[command(flatten, next_help_heading = SCENE)]
    scene: SceneOptions,

    #[command(flatten)]
    record: RecordOption,

    /// Folder of the recordings that the page starts. Each is a new file,
    /// trinocular-YYYYMMDD-HHMMSS.mcap (UTC)
    #[arg(
        long,
        value_name = "DIR",
        default_value = ".",
        requires = "control",
        conflicts_with = "record",
        help_heading = "Recording"
    )]
    recordings: PathBuf,

    /// Replace the file of --record even if it is no recording of this program
    #[arg(long, requires = "record")]
    force: bool,

    #[command(flatten)]
    zenoh: ZenohOption,
}

const EXAMPLES: &str = "\
Examples:
  trinocular serve                                    # simulated; open http://127.0.0.1:7411/
  trinocular serve --control                          # with STOP, jog and following
  trinocular serve --control --record run.mcap        # what is followed, for `replay`
  trinocular serve --control --port auto --rig rig.toml
  trinocular serve --cameras /dev/video0,/dev/video2,/dev/video4 --rig rig.toml --port auto";

impl ServeOptions {
    /// Returns true if the page only shows its station.
    fn only_shows(&self) -> bool {
        !self.control && !self.follow
    }

    /// Returns the regions of the target that the stage follows; the simulated scene is one target.
    fn regions(&self, rig: &RigFile) -> Regions {
        match self.cameras {
            Some(_) => targets::driving(rig, Regions::default()),
            None => Regions::default(),
        }
    }

    /// Returns the largest difference of capture times within a frame set, ms.
    fn window_ms(&self) -> f64 {
        self.window.unwrap_or((500.0 / self.fps).min(5.0))
    }
}

/// Runs the command.
pub fn run(options: &ServeOptions, _: &mut impl Write) -> Result<(), Failure> {
    range::check("fps", options.fps, 1.0, 200.0)?;
    range::check("seconds", options.seconds.unwrap_or(1.0), 0.1, 1e6)?;
    let (window_ms, widest_ms) = (options.window_ms(), 500.0 / options.fps);
    range::check("window", window_ms, 0.0, widest_ms)?;
    range::check_delay("delay", options.delay.unwrap_or(0.0))?;
    // The page's port first, so that nothing moves if it is in use.
    let listener = Server::listen(options.listen, options.control).map_err(Failure::of_page)?;
    let rig = match &options.rig {
        Some(path) => {
            let rig = RigFile::read(path)?;
            super::warnings::rig_and_stage(path, &rig);
            rig
        }
        None => RigFile::paper(),
    };
    if rig.stage.is_none() && options.station.is_given() && !options.only_shows() {
        return Err(Failure::Usage(STAGE_NEEDED.to_owned()));
    }
    let read = |path: &PathBuf| RigFile::read_with_text(path).map(|(_, text)| text);
    let origin = Origin {
        rig: RigFile {
            stage: Some(rig.stage.clone().unwrap_or_else(default_stage)),
            ..rig.clone()
        },
        rig_text: options.rig.as_ref().map(read).transpose()?,
        estimator: ESTIMATOR,
        // The simulated station is on a pseudo-terminal, in real time.
        twin: None,
        is_real: true,
        seed: options.cameras.is_none().then_some(options.scene.seed),
        regions: options.regions(&rig),
    };
    let recording = options.record.open(options.force)?.start(&origin)?;
    let on_page = match options.record.is_given() {
        true => PageRecording::whole(recording.tap()),
        false => {
            let folder = options.recordings.clone();
            PageRecording::on_request(Box::new(FolderRecordings::new(folder, origin)?))
        }
    };
    let outcome = match &options.cameras {
        None => simulated::run(options, listener, &rig, on_page),
        Some(devices) => cameras::run(options, listener, &rig, devices, on_page),
    };
    recording.close(outcome)
}

/// Serves the page of a bench until Ctrl-C.
fn serve<B: Bench>(
    options: &ServeOptions,
    listener: TcpListener,
    (rig, stage, mounting): (&RigFile, &Stage, Mounting),
    mut bench: B,
    port: Option<&str>,
    recording: PageRecording,
    drops: Option<DropSource>,
) -> Result<(), Failure> {
    let source = station::source(options.rig.as_deref(), rig);
    let setup = Setup {
        station: match port {
            Some(_) => bench.station().name(),
            None => "simulated station".to_owned(),
        },
        cameras: rig.names.clone(),
        rig: rig.rig.clone(),
        stage: stage.clone(),
        mounting,
        scale: port.and_then(|_| station::scale(options, &source)),
    };
    let scale = setup.scale.clone();
    let mut page = LivePage::open(listener, setup)?;
    if let Some(address) = options.foxglove {
        page.stream(address)?;
    }
    let hub = Arc::clone(page.hub());
    if port.is_some() {
        let arrival = station::arrival(bench.station(), options, &source);
        notice!("{arrival}");
        hub.note(arrival);
        if let Some(scale) = scale {
            notice!("{scale}");
        }
    } else if let Some(serial) = bench.station().serial_mut() {
        serial.set_ends_with_station();
    }
    if let Some(drops) = drops {
        hub.set_drop_source(drops);
    }
    let (mut bench, desk) = Workbench::new(bench, &rig.rig, stage, ESTIMATOR, hub, recording);
    bench.set_pivot(rig.estimated_pivot());
    bench.set_regions(options.regions(rig));
    let zenoh = &options.zenoh;
    let nodes = || Arc::new(desk.named(NODES)) as Arc<dyn Controls>;
    zenoh.begin(&rig.names, Pace::Real, options.control.then(nodes))?;
    if let Some(taker) = zenoh.taker() {
        bench.pass_to(taker);
    }
    if options.control {
        page.control(Arc::new(desk))?;
    }
    if options.follow || port.is_none() {
        bench.follow_at_once();
    }
    let stop = on_interrupt()?;
    let end = options
        .seconds
        .map(|seconds| std::time::Instant::now() + std::time::Duration::from_secs_f64(seconds));
    let is_over =
        || stop.load(Ordering::Relaxed) || end.is_some_and(|end| std::time::Instant::now() >= end);
    let outcome = bench.run(is_over);
    // Stops a stage that still moves, before the page and its STOP are gone.
    drop(bench);
    if let Err(error) = &outcome {
        page.hub().warn(error.to_string());
    }
    drop(page);
    zenoh.close(outcome.map_err(|error| Failure::of_servo(port, error)))?;
    notice!("the page is closed");
    Ok(())
}
