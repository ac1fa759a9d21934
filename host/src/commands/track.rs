//! `trinocular track`: runs the servo with the simulator, recorded images, a folder that grows, or
//! live cameras.

mod absences;
pub mod captures;
pub mod live;
mod others;
pub mod page;
mod recorded;
mod report;
mod row;
mod shift;
mod simulated;

use super::folder_input::PairOption;
use super::frames::{RecordingInput, rig_missing};
use super::port::PortOption;
use super::range;
use super::record::{Origin, RecordOption, Recording};
use super::reference_view::ReferenceView;
use super::region::RegionOption;
use super::scene::SceneOptions;
use super::turning::TurningOptions;
use super::zenoh::ZenohOption;
use crate::commands::failure::Failure;
use clap::{Args, ValueEnum};
use std::cell::{Cell, RefCell};
use std::io::Write;
use std::path::{Path, PathBuf};
use trinocular::servo::path::TargetPath;
use trinocular::servo::station_link::{StationLink, TWIN_B};
use trinocular_client::diagnosis::explain;
use trinocular_recording::queue::Pace;
use trinocular_recording::read::is_recording;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::pivot::Rotation;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::{sums, targets};

const SOURCE: &str = "Where the images come from (one of these)";
const CAMERAS: &str = "With --cameras";
const SCENE: &str = "With --sim: the simulated target";

/// Source of the images.
#[derive(Debug, Args)]
#[group(id = "source", required = true, multiple = false)]
pub struct Source {
    /// Rendered cameras on the stage, in closed loop
    #[arg(long, help_heading = SOURCE)]
    sim: bool,

    /// A folder of frame sets: one subfolder per camera, named as in the rig file, equal file names
    /// for one instant
    ///
    /// PNG, JPEG, PNM, TIFF, BMP or WebP, in the order of their names, in which numbers count as
    /// numbers. Or one folder with each camera's name first (left1.png), or a TIFF stack (left.tif)
    /// or a Y4M video (left.y4m, also a named pipe) per camera; the rate of videos is used. If a
    /// camera's file is missing, the others carry on, and the row names that camera. Unreadable
    /// frame sets are skipped with a warning; the exit code is then 1. Or a recording (MCAP, ROS 2
    /// bag), which may hold the rig, and whose frame rate is used.
    #[arg(long, value_name = "DIR", help_heading = SOURCE)]
    images: Option<PathBuf>,

    /// A folder of frame sets as for --images that another program still writes: waits for new
    /// frame sets, until Ctrl-C (exit code 130, or 143 after SIGTERM) or for --idle seconds
    ///
    /// A file counts as written when it has not changed for 0.2 s. The program waits for a camera's
    /// file at most 2 s if there is a later frame set or the camera has fallen silent; then the
    /// other cameras carry on, if they are two. A file that cannot be read is tried for 2 s. Files
    /// may be removed when their row has been printed.
    #[arg(long, value_name = "DIR", requires = "rig", help_heading = SOURCE)]
    watch: Option<PathBuf>,

    /// Live cameras, in the order of the rig file's: /dev/video0,/dev/video2,/dev/video4, or
    /// genicam:SERIAL,...; `rig`, those that the rig file names; or `twin`, those of `trinocular twin
    /// --with-target`
    ///
    /// Until Ctrl-C, or for --seconds. V4L2 cameras need Linux and a program that was built with
    /// `--features trinocular/camera`, GenICam cameras (GigE Vision, USB3 Vision) one with `--features
    /// trinocular/genicam`. `trinocular cameras` lists both. A GenICam camera is named by its serial
    /// number or IP address; `genicam:first` takes any. `gstreamer:PIPELINE` is a camera behind a
    /// pipeline of GStreamer, if the program was built with `--features trinocular/gstreamer`; one
    /// with commas stands in the rig file as `device`. `twin` means the twin on --port if that one
    /// has cameras; `twin:LINK` names the link of another.
    /// At the end a line per camera counts its images: used, overtaken, damaged, incomplete (with
    /// missing packets), lost by its driver.
    /// If a camera is unplugged or falls silent, the others carry on, as long as two are left.
    #[arg(
        long,
        value_name = "DEVICE,...",
        requires = "rig",
        value_delimiter = ',',
        help_heading = SOURCE
    )]
    cameras: Option<Vec<PathBuf>>,
}

/// Follow a target: simulated cameras in closed loop, recorded images, a folder that grows, or live
/// cameras
///
/// The station is the built-in twin: the controller board's own code on virtual time; or, for --sim
/// and --cameras, one on a serial --port, in real time. One line per frame set goes to standard
/// output: the displacement of the target, and the position of the stage.
///
/// With --sim the cameras are on the stage and see a poster that moves along --path. With --cameras
/// and --port they are on the stage too, unless they are --fixed. Otherwise the images cannot show
/// the stage's motion: the cameras count as fixed, and the stage copies the target's motion.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct TrackOptions {
    #[command(flatten)]
    source: Source,

    /// The rig file (TOML): its cameras, and its stage
    ///
    /// Without a `stage` section the stage is one of 80 steps/mm and 100 mm/s, but never with
    /// --cameras and --port. Without a rig file, --sim has the paper's cameras and that stage.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    #[command(flatten)]
    station: PortOption,

    #[command(flatten)]
    page: page::PageOptions,

    /// Duration of the run, s [default: 8 with --sim, 16 for the whole Lissajous figure, until
    /// Ctrl-C with --cameras]
    #[arg(long, value_name = "S", conflicts_with_all = ["images", "watch"])]
    seconds: Option<f64>,

    /// Frame sets per second [default: 60 with --sim on the twin, otherwise 30]
    #[arg(long, value_name = "HZ")]
    fps: Option<f64>,

    /// The station's estimator
    #[arg(long, value_enum, default_value_t = Estimator::Midpoint)]
    method: Estimator,

    #[command(flatten)]
    turning: TurningOptions,

    /// Print one JSON object per frame set and line
    ///
    /// time_s, displacement_mm (the target's since the keyframe, as seen from the cameras),
    /// sigma_mm, covariance_mm2, points, rejected, latency_ms (the images' age when they act),
    /// trust (in the station's position); stage_mm, frame and drops (of live cameras, so far), or
    /// with --sim target_mm and camera_mm. `warnings`, a list of sentences, is there only if a
    /// camera was left out or an image is badly exposed; `refused` is the reason why a frame set
    /// was not used. If a rotation was estimated also rotation_deg (about the cameras' x, y, z),
    /// rotation_sigma_deg and pivot_mm; displacement_mm is then the pivot's. With two or more
    /// `[[target]]` tables in the rig file, `targets` lists all of them; the row itself is of the
    /// one that the stage follows.
    #[arg(long)]
    json: bool,

    /// Print a CSV table: a header, then one row per frame set with all that --json prints
    #[arg(long, conflicts_with = "json")]
    csv: bool,

    /// With the twin: latency from images to frame at the station, ms of virtual time; at most the
    /// period of the frame sets minus 3 [default: 20, or that if it is less]
    #[arg(long, value_name = "MS")]
    latency: Option<u64>,

    /// With --watch: end after this time without a new image, s; without it only Ctrl-C ends
    #[arg(long, value_name = "S")]
    idle: Option<f64>,

    /// Largest difference of capture times within a frame set, ms; at most half the time between
    /// two images of a camera [default: 5, or that half if it is less]
    #[arg(long, value_name = "MS", help_heading = CAMERAS)]
    window: Option<f64>,

    /// Delay from the middle of the exposure to the image's time stamp, ms, of all cameras; negative
    /// if the stamp comes first [default: the rig file's `delay_ms`, or 0]
    ///
    /// `trinocular latency` measures it for each camera and writes it into the rig file. It follows
    /// from the kind of the camera's stamp, which the program prints with its first image. For the
    /// end of the image: half the exposure and the read-out. For its start: minus half the exposure;
    /// but cameras on USB are stamped when their data begin to come, so half the exposure and the
    /// time in between. For its arrival: half the exposure, read-out and transfer, 20 to 60 ms on
    /// USB.
    /// While the stage moves, an error of the delay times the stage's speed is an error of
    /// position; at rest there is none.
    #[arg(
        long,
        value_name = "MS",
        allow_negative_numbers = true,
        help_heading = CAMERAS
    )]
    delay: Option<f64>,

    /// With --port: the cameras stand beside the stage, which copies the target's motion
    #[arg(long, help_heading = CAMERAS)]
    fixed: bool,

    /// Motion of the target: steps, line, circle, lissajous or still
    ///
    /// Steps are of (4, 4, 1) mm, every second; the line is along them, 5 mm/s; the circle has a
    /// radius of 10 mm, in 8 s; the Lissajous figure 20, 20 and 5 mm, once, twice and three times
    /// in 16 s.
    #[arg(long, default_value_t = TargetPath::Circle, help_heading = SCENE)]
    path: TargetPath,

    #[command(flatten, next_help_heading = SCENE)]
    scene: SceneOptions,

    /// With --images, --watch and --cameras: displacements count from this view, a file of
    /// `trinocular reference` or of --record, instead of from the first frame set
    ///
    /// Cameras on the stage are moved back to where the view was taken.
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,

    #[command(flatten)]
    record: RecordOption,

    #[command(flatten)]
    report: report::TrackReport,

    #[command(flatten)]
    zenoh: ZenohOption,

    #[command(flatten, next_help_heading = "With --images, --watch and --cameras")]
    region: RegionOption,

    #[command(flatten, next_help_heading = "With --images")]
    pair: PairOption,

    #[command(flatten)]
    recording: RecordingInput,

    /// Time between two frame sets of a recording, µs, which --fps does not change.
    #[arg(skip)]
    recorded_period_us: Cell<Option<u64>>,

    /// Regions with which the view of --reference was saved.
    #[arg(skip)]
    view_regions: RefCell<Regions>,

    /// Replace the files of --record and --report even if this program did not write them
    #[arg(long, help_heading = "Recording")]
    force: bool,
}

impl TrackOptions {
    /// Returns the number of frame sets per second.
    fn fps(&self) -> f64 {
        // In real time, rendering may take longer than the twin's virtual time.
        let is_simulated = self.source.sim && !self.station.is_given();
        self.fps.unwrap_or(if is_simulated { 60.0 } else { 30.0 })
    }

    /// Begins the recording of a run with this rig, its page and its topics, if they were requested.
    fn recording(&self, rig: &RigFile) -> Result<Recording, Failure> {
        let read = |path: &PathBuf| RigFile::read_with_text(path).map(|(_, text)| text);
        let source = &self.source;
        let opened = self.record.open(self.force)?;
        let is_real = self.station.is_given() || source.cameras.is_some() || source.watch.is_some();
        let origin = Origin {
            rig: rig.clone(),
            rig_text: self.rig.as_ref().map(read).transpose()?,
            estimator: self.method.into(),
            twin: (!self.station.is_given()).then_some(TWIN_B),
            is_real,
            seed: source.sim.then_some(self.scene.seed),
            regions: self.regions(rig)?,
        };
        self.report.begin(&origin, &opened, self.force)?;
        // Recorded images wait for the network, because nothing else waits for them.
        let pace = match is_real || source.sim {
            true => Pace::Real,
            false => Pace::Virtual,
        };
        self.zenoh.begin(&rig.names, pace, None)?;
        opened.start(&origin)
    }

    /// Returns the regions of the target that the stage follows.
    fn regions(&self, rig: &RigFile) -> Result<Regions, Failure> {
        match self.source.sim {
            true => Ok(Regions::default()),
            false => Ok(targets::driving(rig, self.given_regions(rig)?)),
        }
    }

    /// Returns the regions of the user, or else those of the view of --reference.
    fn given_regions(&self, rig: &RigFile) -> Result<Regions, Failure> {
        let given = self.region.regions(rig)?;
        Ok(match given.0.is_empty() {
            true => self.view_regions.borrow().clone(),
            false => given,
        })
    }

    /// Reads the view of --reference, which must be of this rig.
    fn view(&self, rig: &RigFile, rig_path: &Path) -> Result<Option<ReferenceView>, Failure> {
        let Some(path) = &self.reference else {
            return Ok(None);
        };
        let view = ReferenceView::open(path)?;
        self.view_regions
            .replace(view.regions_or(Regions::default()));
        let regions = self.given_regions(rig)?;
        view.check(rig, rig_path, &regions)?;
        Ok(Some(view))
    }

    /// Reads the rig file, and applies the options about a target that turns.
    fn read_rig(&self, path: &Path) -> Result<RigFile, Failure> {
        let mut rig = self.method.read_rig(path)?;
        self.turn(&mut rig)?;
        Ok(rig)
    }

    /// Applies the options about a target that turns.
    fn turn(&self, rig: &mut RigFile) -> Result<(), Failure> {
        self.turning.apply(rig)?;
        if self.method != Estimator::ClosedForm || rig.estimated_pivot().is_none() {
            return Ok(());
        }
        if !self.turning.are_silent(rig) {
            return Err(Failure::Usage(
                "the estimator closed-form knows no rotation; use --method midpoint, or \
                 --rotation refuse"
                    .to_owned(),
            ));
        }
        rig.rotation = Some(Rotation::Refuse);
        Ok(())
    }

    /// Returns the time between two frame sets, µs.
    fn period_us(&self) -> u64 {
        let recorded = self.recorded_period_us.get();
        recorded.unwrap_or_else(|| (1e6 / self.fps()).round() as u64)
    }

    /// Returns the latency from images to frame, µs.
    fn latency_us(&self) -> u64 {
        let default = (self.longest_latency_ms() as u64).min(20);
        self.latency.unwrap_or(default) * 1000
    }

    /// Returns the longest latency with which a frame is answered before the next frame set, ms.
    fn longest_latency_ms(&self) -> f64 {
        (self.period_us() as f64 * 1e-3 - 3.0).max(1.0).floor()
    }

    /// Returns the widest window within which the order of arrival makes no difference, ms.
    fn widest_window_ms(&self) -> f64 {
        500.0 / self.fps()
    }

    /// Returns the window, ms.
    fn window_ms(&self) -> f64 {
        let default = self.widest_window_ms().min(5.0);
        self.window.unwrap_or(default)
    }

    /// Refuses values out of range and options that do not go together.
    fn check(&self) -> Result<(), Failure> {
        range::check("fps", self.fps(), 1.0, 200.0)?;
        range::check("seconds", self.seconds.unwrap_or(1.0), 0.1, 3600.0)?;
        range::check("idle", self.idle.unwrap_or(1.0), 0.1, 1e6)?;
        range::check("window", self.window_ms(), 0.0, self.widest_window_ms())?;
        range::check_delay("delay", self.delay.unwrap_or(0.0))?;
        range::check(
            "latency",
            self.latency.unwrap_or(0) as f64,
            0.0,
            self.longest_latency_ms(),
        )?;
        let source = &self.source;
        // The parser does not check the requirements of options that exclude one another.
        let goes_with =
            |option: &str, given: bool, with: &str, is_there: bool| match given && !is_there {
                true => Err(Failure::Usage(format!("--{option} goes with {with}"))),
                false => Ok(()),
            };
        let is_live = source.cameras.is_some();
        let is_folder = source
            .images
            .as_deref()
            .is_some_and(|path| !is_recording(path));
        let regions_with = "--images, --watch and --cameras";
        self.region.goes_with(!source.sim, regions_with)?;
        goes_with(
            "reference",
            self.reference.is_some(),
            regions_with,
            !source.sim,
        )?;
        self.pair.goes_with(is_folder, "--images and a folder")?;
        goes_with(
            "idle",
            self.idle.is_some(),
            "--watch",
            source.watch.is_some(),
        )?;
        let is_written = self.record.is_given() || self.report.is_given();
        goes_with("force", self.force, "--record and --report", is_written)?;
        goes_with("window", self.window.is_some(), "--cameras", is_live)?;
        goes_with("delay", self.delay.is_some(), "--cameras", is_live)?;
        let is_real = is_live && self.station.is_given();
        goes_with("fixed", self.fixed, "--cameras and --port", is_real)?;
        let is_from_files = source.images.is_some() || source.watch.is_some();
        if is_from_files && self.station.is_given() {
            let reason =
                "--port goes with --sim and --cameras: images from files are followed by the twin";
            return Err(Failure::Usage(reason.to_owned()));
        }
        self.page.check()
    }
}

/// The station's estimators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Estimator {
    /// The paper's eq. 9
    ClosedForm,
    /// Exact for finite displacements
    Midpoint,
}

impl From<Estimator> for sums::Estimator {
    fn from(estimator: Estimator) -> Self {
        match estimator {
            Estimator::ClosedForm => Self::ClosedForm,
            Estimator::Midpoint => Self::Midpoint,
        }
    }
}

impl Estimator {
    /// Reads the rig; refuses one that does not suit the estimator.
    fn read_rig(self, path: &Path) -> Result<RigFile, InputError> {
        let rig = match self {
            Self::ClosedForm => RigFile::read_in_line(path),
            Self::Midpoint => RigFile::read(path),
        }?;
        super::warnings::rig_and_stage(path, &rig);
        Ok(rig)
    }
}

/// Prints the name of the station on the line, and the fault that its start has cleared.
fn introduce(station: &StationLink) {
    let Some(serial) = station.serial() else {
        return;
    };
    notice!("station B is {}", station.name());
    if let Some(fault) = serial.cleared() {
        let number = fault.number();
        notice!("its fault {number} was cleared: {}", explain(fault));
    }
}

const EXAMPLES: &str = "\
Examples:
  trinocular track --sim
  trinocular track --sim --path lissajous --json > run.jsonl
  trinocular track --sim --record run.mcap --report run.html
  trinocular track --sim --rig rig.toml --port /dev/ttyACM0 --path still
  trinocular track --images captures/ --rig rig.toml
  trinocular track --images run.mcap
  trinocular track --watch captures/ --rig rig.toml --idle 60
  trinocular track --images today/ --rig rig.toml --reference bridge.mcap
  trinocular track --cameras /dev/video0,/dev/video2,/dev/video4 --rig rig.toml --port auto
  trinocular track --cameras rig --rig rig.toml --port auto
  trinocular track --sim --zenoh";

/// Runs the command.
pub fn run(options: &TrackOptions, out: &mut impl Write) -> Result<(), Failure> {
    options.check()?;
    let outcome = options.report.close(follow(options, out));
    let outcome = options.zenoh.close(outcome);
    if options.station.is_given()
        && let Err(Failure::Output(cause)) = &outcome
        && cause.kind() == std::io::ErrorKind::BrokenPipe
    {
        // Elsewhere a reader who has seen enough is no failure; here the stage was stopped for it.
        let reason = "the run ended early: standard output was closed";
        return Err(Failure::Station(reason.to_owned().into()));
    }
    outcome
}

fn follow(options: &TrackOptions, out: &mut impl Write) -> Result<(), Failure> {
    match (&options.source, &options.rig) {
        (
            Source {
                images: Some(folder),
                ..
            },
            rig,
        ) if is_recording(folder) => recorded::replay(options, folder, rig.as_deref(), out),
        (
            Source {
                images: Some(folder),
                ..
            },
            Some(rig),
        ) => recorded::run(options, folder, rig, out),
        (
            Source {
                images: Some(folder),
                ..
            },
            None,
        ) => match &options.reference {
            Some(view) => recorded::of_view(options, folder, view, out),
            None => Err(rig_missing("track --images DIR --rig <RIG.toml>")),
        },
        (
            Source {
                watch: Some(folder),
                ..
            },
            Some(rig),
        ) => recorded::watch(options, folder, rig, out),
        (
            Source {
                cameras: Some(devices),
                ..
            },
            Some(rig),
        ) => live::run(options, devices, rig, out),
        _ => simulated::run(options, out),
    }
}
