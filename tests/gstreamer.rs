//! Cameras behind GStreamer pipelines, on a computer without cameras: GStreamer's test source, and
//! files of raw images.
#![cfg(feature = "gstreamer")]

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, trinocular};
use trinocular_vision::images::Image;
use trinocular_vision::images::cameras::gstreamer::Gstreamer;
use trinocular_vision::images::cameras::live::{Camera as _, CameraEvent};
use trinocular_vision::images::folder;

/// Time limit of every wait. It is long enough for any machine; a test that reaches it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Width and height that the pipelines of these tests have, px.
const SIZE: [u32; 2] = [322, 240];

fn open(pipeline: &str) -> Gstreamer {
    let name = PathBuf::from(format!("gstreamer:{pipeline}"));
    Gstreamer::open(&name, SIZE, Box::new(|_| ())).expect("it starts")
}

fn refusal(pipeline: &str) -> String {
    let name = PathBuf::from(format!("gstreamer:{pipeline}"));
    match Gstreamer::open(&name, SIZE, Box::new(|_| ())) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("{pipeline} starts"),
    }
}

/// Returns the next image with its time.
fn next(camera: &mut Gstreamer) -> (Instant, Image) {
    let patience = Instant::now() + PATIENCE;
    loop {
        assert!(Instant::now() < patience, "no image comes");
        match camera.next_image().expect("the pipeline runs") {
            CameraEvent::Nothing => {}
            CameraEvent::Image(at, image) => return (at, image),
            other => panic!("{other:?}"),
        }
    }
}

/// Writes images as GStreamer has raw ones: rows begin at multiples of four bytes.
fn write_raw<'a>(path: &Path, images: impl Iterator<Item = &'a Image>) {
    let mut bytes = Vec::new();
    for image in images {
        for row in image.grey.chunks(image.width) {
            bytes.extend_from_slice(row);
            bytes.resize(bytes.len().next_multiple_of(4), 0xEE);
        }
    }
    fs::write(path, bytes).expect("a file of ours");
}

fn raw_source(path: &Path, [width, height]: [u32; 2]) -> String {
    let path = path.display();
    format!(
        "filesrc location=\"{path}\" ! rawvideoparse format=gray8 width={width} height={height} \
         framerate=30/1"
    )
}

#[test]
#[ignore = "needs Debian's gstreamer1.0-plugins-base; tests/run includes it"]
fn images_of_a_file_come_unchanged() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("some images.raw");
    let [width, height] = SIZE.map(|side| side as usize);
    let images: Vec<Image> = (0..12_u32)
        .map(|number| Image {
            width,
            height,
            grey: (0..(width * height) as u32)
                .map(|pixel| (pixel.wrapping_mul(2_654_435_761) >> 24) as u8 ^ number as u8)
                .collect(),
        })
        .collect();
    write_raw(&path, images.iter());
    let mut camera = open(&raw_source(&path, SIZE));
    let mut first = None;
    for (number, wanted) in (0..).zip(&images) {
        let (at, image) = next(&mut camera);
        assert!(image == *wanted, "image {number} differs");
        let since = at.duration_since(*first.get_or_insert(at));
        let wanted = Duration::from_secs(1) * number / 30;
        assert!(
            since.abs_diff(wanted) < Duration::from_micros(1),
            "{since:?}"
        );
    }
    let patience = Instant::now() + PATIENCE;
    let end = loop {
        assert!(Instant::now() < patience, "it does not end");
        if let Err(error) = camera.next_image() {
            break error.to_string();
        }
    };
    assert!(end.contains("the pipeline has ended"), "{end}");
    assert_eq!(camera.lost(), 0);
}

/// The sink keeps four images of a program that does not come for them.
#[test]
#[ignore = "needs Debian's gstreamer1.0-plugins-base; tests/run includes it"]
fn images_not_taken_in_time_are_counted() {
    let source = "videotestsrc is-live=true ! video/x-raw,framerate=100/1";
    let mut camera = open(source);
    let (before, _) = next(&mut camera);
    std::thread::sleep(Duration::from_millis(500));
    let (mut after, mut taken) = (before, 1);
    while camera.lost() == 0 {
        (after, _) = next(&mut camera);
        taken += 1;
    }
    let passed = after.duration_since(before).as_secs_f64() * 100.0;
    let counted = camera.lost() + taken - 1;
    assert_eq!(passed.round() as u64, counted, "{taken} taken");
    assert!(counted >= 40, "{counted}");
}

#[test]
#[ignore = "needs Debian's gstreamer1.0-plugins-base; tests/run includes it"]
fn wrong_pipelines_are_named() {
    for (pipeline, parts) in [
        ("", &["no pipeline follows"][..]),
        (
            "videotestsrc !",
            &["cannot make the pipeline", "gst-launch-1.0"],
        ),
        ("nosuchsource", &["nosuchsource"]),
        ("videotestsrc nosuch=1", &["nosuch"]),
        ("filesrc location=/no/file ! rawvideoparse", &["/no/file"]),
        (
            "videotestsrc ! video/x-raw,width=100,height=100",
            &["322 x 240", "videoscale"],
        ),
    ] {
        let text = refusal(pipeline);
        for part in parts {
            assert!(text.contains(part), "`{part}` is not in: {text}");
        }
        assert!(!text.contains('\n'), "{text}");
    }
}

/// Two frame sets of the Teddy scene, each shown for a second by three pipelines.
#[test]
#[ignore = "needs Debian's gstreamer1.0-plugins-base; tests/run includes it"]
fn pipelines_of_the_rig_file_are_measured() {
    let teddy = Path::new("images/teddy");
    let estimate = trinocular()
        .args(["estimate", "images/teddy", "--json", "--rig"])
        .arg(teddy.join("rig.toml"))
        .output()
        .expect("it runs");
    let measured = String::from_utf8(estimate.stdout).expect("text");
    let measured: serde_json::Value =
        serde_json::from_str(measured.lines().next().expect("a row")).expect("JSON");
    let (rig, mut text) = RigFile::read_with_text(&teddy.join("rig.toml")).expect("a rig");
    let folder = tempfile::tempdir().expect("a folder");
    let size = rig.rig.image_size_px;
    for name in &rig.names {
        let mut files: Vec<PathBuf> = fs::read_dir(teddy.join(name))
            .expect("a folder")
            .map(|entry| entry.expect("an entry").path())
            .collect();
        files.sort();
        let [before, after] = [0, 1].map(|n| folder::read(&files[n], size).expect("an image"));
        let path = folder.path().join(format!("{name}.raw"));
        let shown = std::iter::repeat_n(&before, 30).chain(std::iter::repeat_n(&after, 60));
        write_raw(&path, shown);
        let line = format!("name = \"{name}\"\n");
        let source = raw_source(&path, size).replace('"', "");
        text = text.replace(&line, &format!("{line}device = \"gstreamer:{source}\"\n"));
    }
    let path = folder.path().join("rig.toml");
    fs::write(&path, text).expect("a file of ours");
    let mut track = trinocular();
    track
        .args([
            "track",
            "--cameras",
            "rig",
            "--window",
            "16",
            "--json",
            "--rig",
        ])
        .arg(&path);
    let done = Outcome::of(&mut track);
    assert_eq!(done.code, Some(1), "{}", done.stderr);
    assert!(
        done.stderr.contains("the pipeline has ended"),
        "{}",
        done.stderr
    );
    let last = done
        .stdout
        .lines()
        .rfind(|row| row.contains("displacement_mm"));
    let row: serde_json::Value = serde_json::from_str(last.expect("a row")).expect("JSON");
    for axis in 0..3 {
        let [is, wanted] = [&row, &measured].map(|row| row["displacement_mm"][axis].as_f64());
        let (is, wanted) = (is.expect("a number"), wanted.expect("a number"));
        assert!((is - wanted).abs() < 2e-6, "axis {axis}: {is} for {wanted}");
    }
}
