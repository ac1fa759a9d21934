//! `track --cameras` on a computer without cameras: the real program, with a [stand-in](../cameras)
//! for the kernel's side of V4L2.
//!
//! Three cameras with a common trigger see a poster that first stands and then moves. Their images
//! arrive late, each with another delay, so only the time stamps show which belong together. The
//! twin follows the poster.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use tempfile::TempDir;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, c_library, interrupt, trinocular};
use trinocular_vision::images::{Scene, SceneSettings, Texture};

const PERIOD_US: u64 = 33_333;

/// Number of images of one whole turn of the motion.
const MOVING: usize = 45;

const DEVICES: [&str; 3] = ["video90", "video91", "video92"];
const NAMES: [&str; 3] = ["left", "middle", "right"];

/// Returns the target's position in image `n` relative to the first, mm.
fn target_mm(n: usize) -> [f64; 3] {
    let angle = std::f64::consts::TAU * n.min(MOVING) as f64 / MOVING as f64;
    [3.0 * angle.sin(), 2.0 - 2.0 * angle.cos(), angle.sin()]
}

/// Returns the images of each camera in order.
fn pictures() -> &'static [Vec<u8>; 3] {
    static PICTURES: OnceLock<[Vec<u8>; 3]> = OnceLock::new();
    PICTURES.get_or_init(|| {
        let rig = RigFile::paper().rig;
        let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default());
        let scene = scene.expect("a scene");
        let mut pictures = [const { Vec::new() }; 3];
        for n in 0..=MOVING {
            let capture = scene.render(target_mm(n), 0, n as u64);
            for (pictures, view) in pictures.iter_mut().zip(capture.images) {
                pictures.extend(view.grey);
            }
        }
        pictures
    })
}

struct Bench {
    folder: TempDir,
}

impl Bench {
    /// Prepares the cameras; `plans` has the entries of each camera's plan besides the size.
    fn new(plans: [&str; 3]) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let write = |name: &str, bytes: &[u8]| {
            fs::write(folder.path().join(name), bytes).expect("a file of ours");
        };
        write("rig.toml", RigFile::paper().to_toml().as_bytes());
        for ((device, plan), pictures) in DEVICES.iter().zip(plans).zip(pictures()) {
            let plan = format!("size 320 240\nperiod_us {PERIOD_US}\n{plan}\n");
            write(device, plan.as_bytes());
            write(&format!("{device}.grey"), pictures);
        }
        Self { folder }
    }

    fn track(&self, more: &[&str]) -> Command {
        static STAND_IN: OnceLock<PathBuf> = OnceLock::new();
        let mut command = trinocular();
        command
            .args(["track", "--json", "--rig", "rig.toml", "--cameras"])
            .arg(DEVICES.map(|device| format!("/dev/{device}")).join(","))
            .args(more)
            .current_dir(self.folder.path())
            .env("TRINOCULAR_CAMERAS", self.folder.path())
            .env("LD_PRELOAD", STAND_IN.get_or_init(|| c_library("cameras")));
        command
    }

    /// Returns the number of each image that the camera handed over, and true if it was damaged.
    fn log(&self, camera: usize) -> Vec<(u64, bool)> {
        let file = self.folder.path().join(DEVICES[camera]);
        let text = fs::read_to_string(file.with_extension("log")).expect("a log");
        let lines = text.lines().filter_map(|line| line.split_once(' '));
        lines
            .map(|(number, spoilt)| (number.parse().expect("a number"), spoilt == "1"))
            .collect()
    }
}

/// Returns the number next to `what` in the line that counts a camera's images.
fn count(stderr: &str, camera: usize, what: &str) -> u64 {
    let start = format!("{} (/dev/{}): ", NAMES[camera], DEVICES[camera]);
    let mut lines = stderr.lines().filter_map(|line| line.strip_prefix(&start));
    let line = lines.next_back().expect("a line for every camera");
    let counts = line.split([',', ';']).map(str::trim);
    let number = counts.filter_map(|count| {
        let number = count.strip_suffix(what).or(count.strip_prefix(what))?;
        number.trim().parse().ok()
    });
    let found: Vec<u64> = number.collect();
    assert_eq!(found.len(), 1, "{what}: {line}");
    found[0]
}

/// Returns the times, s, and positions, mm, of a run.
fn seen(outcome: &Outcome) -> Vec<(f64, [f64; 3])> {
    let lines = outcome.json();
    let number = |value: &serde_json::Value| value.as_f64();
    lines
        .iter()
        .filter_map(|line| {
            let place = line["displacement_mm"].as_array()?;
            let place: Option<Vec<f64>> = place.iter().map(number).collect();
            Some((number(&line["time_s"])?, place?.try_into().ok()?))
        })
        .collect()
}

#[test]
#[cfg_attr(
    not(feature = "camera"),
    ignore = "needs live cameras, which take libclang to build; tests/run includes it"
)]
fn stamps_pair_images_and_losses_count() {
    let late = "readout_us 9000\njitter_us 15000";
    let bench = Bench::new([
        &format!("{late}\nlose 20 21 40"),
        &format!("{late}\nspoil 30"),
        &format!("{late}\nlose 25\nspoil 33\ncut 34\nat_start"),
    ]);
    let outcome = Outcome::of(&mut bench.track(&["--seconds", "2.5", "--window", "1"]));
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let seen = seen(&outcome);
    assert!(seen.len() >= 20, "{}", outcome.stderr);

    // The drivers' stamps are whole periods apart; arrivals are scattered over half of one.
    let periods = |time_s: f64| (time_s * 1e6 / PERIOD_US as f64).round();
    for (time_s, _) in &seen {
        let off_us = time_s * 1e6 - periods(*time_s) * PERIOD_US as f64;
        assert!(off_us.abs() <= 5.0, "{time_s} s: {off_us} us");
    }
    // The number of the first image is unknown: one of the standing target, or a later one on a
    // slow computer.
    let error_mm = |first: i64| {
        let at = |n: i64| target_mm(usize::try_from(n).unwrap_or(0));
        let origin = at(first);
        let errors = seen.iter().flat_map(|(time_s, place)| {
            let target = at(first + periods(*time_s) as i64);
            (0..3).map(move |axis| (place[axis] - (target[axis] - origin[axis])).abs())
        });
        errors.fold(0.0, f64::max)
    };
    let best = (-40..40).map(error_mm).fold(f64::INFINITY, f64::min);
    let farthest = seen.iter().map(|(_, [x, ..])| x.abs()).fold(0.0, f64::max);
    println!("{} frame sets, {best:.4} mm off at most", seen.len());
    assert!(best <= 0.05, "{best} mm");
    assert!(farthest >= 1.0, "{farthest} mm");

    for (camera, (lost, damaged)) in [(3, 0), (0, 1), (1, 2)].into_iter().enumerate() {
        // The program skips the first image, and more may have arrived after the last counted one.
        let counted = count(&outcome.stderr, camera, "images") as usize;
        let log = &bench.log(camera)[1..=counted];
        let gaps: u64 = log.windows(2).map(|pair| pair[1].0 - pair[0].0 - 1).sum();
        let spoilt = log.iter().filter(|(_, is_spoilt)| *is_spoilt).count() as u64;
        assert!(gaps >= lost && spoilt >= damaged, "{log:?}");
        let found = ["its driver lost", "damaged"].map(|what| count(&outcome.stderr, camera, what));
        assert_eq!(found, [gaps, spoilt], "{}", outcome.stderr);
        let point = ["end", "end", "start"][camera];
        let words = format!(
            "{} (/dev/{}): images have the driver's time, of their {point}\n",
            NAMES[camera], DEVICES[camera]
        );
        assert!(outcome.stderr.contains(&words), "{}", outcome.stderr);
    }
}

#[test]
#[cfg_attr(
    not(feature = "camera"),
    ignore = "needs live cameras, which take libclang to build; tests/run includes it"
)]
fn foreign_clock_is_reported_once() {
    let bench = Bench::new(["", "foreign_clock", ""]);
    let outcome = Outcome::of(&mut bench.track(&["--seconds", "1", "--window", "16"]));
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(!seen(&outcome).is_empty(), "{}", outcome.stderr);
    let warning = "warning: middle (/dev/video91): images have the time of their arrival";
    assert_eq!(
        outcome.stderr.matches(warning).count(),
        1,
        "{}",
        outcome.stderr
    );
    assert_eq!(
        outcome.stderr.matches("arrival").count(),
        1,
        "{}",
        outcome.stderr
    );
}

#[test]
#[cfg_attr(
    not(feature = "camera"),
    ignore = "needs live cameras, which take libclang to build; tests/run includes it"
)]
fn camera_faults_name_the_camera() {
    let bench = Bench::new(["", "unplug 25", "unplug 55"]);
    let outcome = Outcome::of(&mut bench.track(&[]));
    outcome.failed_after_notes(1, &["/dev/video92: was unplugged"]);
    // The run continues without one camera.
    let first = "warning: /dev/video91: was unplugged";
    assert!(outcome.stderr.contains(first), "{}", outcome.stderr);
    let mut rows = outcome.json().into_iter();
    let without = "camera middle gave no image; measured without it";
    assert!(
        rows.any(|row| row["warnings"][0] == without),
        "{}",
        outcome.stdout
    );
    assert!(!outcome.stderr.contains("panicked"), "{}", outcome.stderr);
    // The images that came before were used and are counted.
    assert!(count(&outcome.stderr, 0, "used") > 0);

    let bench = Bench::new(["", "", "silent"]);
    let outcome = Outcome::of(&mut bench.track(&[]));
    outcome.failed_after_notes(1, &["/dev/video92: no image for 3 s"]);

    let bench = Bench::new(["size 160 120", "", ""]);
    let outcome = Outcome::of(&mut bench.track(&[]));
    outcome.failed(
        1,
        &["/dev/video90: has no images of 320 x 240", "160 x 120"],
    );

    // One error is too many cameras for one USB line (ENOSPC), the other a camera that another
    // program has started (EBUSY).
    for (errno, words) in [(28, "its USB line is full"), (16, "in use")] {
        let bench = Bench::new(["", &format!("start_error {errno}"), ""]);
        let outcome = Outcome::of(&mut bench.track(&[]));
        outcome.failed(1, &["/dev/video91: ", words]);
    }
}

/// Many USB cameras offer their large images as JPEG only.
#[test]
#[cfg_attr(
    not(feature = "camera"),
    ignore = "needs live cameras, which take libclang to build; tests/run includes it"
)]
fn format_with_right_size_is_preferred() {
    let bench = Bench::new(["", "grey_of 160 120", ""]);
    let outcome = Outcome::of(&mut bench.track(&["--seconds", "1"]));
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let taken = "left is /dev/video90, Grey\nmiddle is /dev/video91, Yu12\n";
    assert!(outcome.stderr.contains(taken), "{}", outcome.stderr);
    assert!(!seen(&outcome).is_empty(), "{}", outcome.stderr);
}

#[test]
#[cfg_attr(
    not(feature = "camera"),
    ignore = "needs live cameras, which take libclang to build; tests/run includes it"
)]
fn dark_start_is_waited_out_with_limit() {
    let bench = Bench::new(["dark 20"; 3]);
    let outcome = Outcome::of(&mut bench.track(&["--seconds", "3"]));
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let said = "the first frame set cannot be the keyframe: ";
    let lines = outcome.stderr.lines().filter(|line| line.starts_with(said));
    let lines: Vec<&str> = lines.collect();
    assert_eq!(lines.len(), 1, "{}", outcome.stderr);
    assert!(
        lines[0].ends_with("; waiting for a better one"),
        "{lines:?}"
    );
    assert!(!seen(&outcome).is_empty(), "{}", outcome.stderr);

    let bench = Bench::new(["dark 100000"; 3]);
    for more in [&[][..], &["--seconds", "1"]] {
        let outcome = Outcome::of(&mut bench.track(more));
        let all = "/dev/video90,/dev/video91,/dev/video92: the first frame set cannot be";
        outcome.failed_after_notes(1, &[all]);
    }
}

/// The thread of a silent camera does not keep the program from ending.
#[test]
#[cfg_attr(
    not(feature = "camera"),
    ignore = "needs live cameras, which take libclang to build; tests/run includes it"
)]
fn ctrl_c_ends_run_with_silent_camera() {
    let bench = Bench::new(["", "", "silent"]);
    let mut track = bench
        .track(&[])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut notes = BufReader::new(track.stderr.take().expect("it was asked for")).lines();
    let streams = notes.any(|line| line.expect("UTF-8").contains("images have"));
    assert!(streams, "no camera has said what its stamps are");
    interrupt(&track);
    let rest: Vec<String> = notes.map_while(Result::ok).collect();
    assert_eq!(track.wait().expect("it ends").code(), Some(0), "{rest:?}");
}
