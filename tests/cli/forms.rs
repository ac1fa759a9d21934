//! The same scene in every form of images gives the same displacement.

use std::fs;
use std::path::{Path, PathBuf};

use trinocular_core::rig::Rig;
use trinocular_rig::random::Random;

use super::folder::{AT_REST, desk_with_views, grey_levels};
use super::{Desk, Outcome, run};

const CAMERAS: [&str; 3] = ["left", "middle", "right"];
const MOVES_MM: [[f64; 3]; 3] = [[0.0; 3], [4.0, 4.0, 1.0], [-3.0, 5.0, -2.0]];

/// Grey levels of every camera and move, 0 to 255, with noise of 1 grey level.
struct Shots {
    size_px: [u32; 2],
    levels: Vec<Vec<Vec<f64>>>,
}

impl Shots {
    fn new() -> Self {
        let rig = Rig::paper();
        let mut random = Random::seeded(15);
        let mut noisy = |camera, moved| {
            let levels = grey_levels(camera, rig.image_size_px, moved);
            let levels = levels.into_iter();
            let levels = levels.map(|grey| {
                let noise: f64 = (0..3).map(|_| random.between(-1.0, 1.0)).sum();
                (grey + noise).clamp(0.0, 255.0)
            });
            levels.collect()
        };
        let cameras = rig.cameras.iter();
        let levels = cameras.map(|camera| MOVES_MM.map(|moved| noisy(camera, moved)).to_vec());
        Self {
            size_px: rig.image_size_px,
            levels: levels.collect(),
        }
    }

    /// Returns the values of an image at a depth, as bytes: one per value up to 8 bits, otherwise
    /// two. The values of fewer bits are the upper bits of those of 16.
    fn bytes(&self, (camera, shot): (usize, usize), bits: u32, is_little: bool) -> Vec<u8> {
        let levels = self.levels[camera][shot].iter();
        let values = levels.map(|grey| (grey * 256.0) as u16 >> (16 - bits));
        match (bits, is_little) {
            (8, _) => values.map(|value| value as u8).collect(),
            (_, true) => values.flat_map(u16::to_le_bytes).collect(),
            (_, false) => values.flat_map(u16::to_be_bytes).collect(),
        }
    }

    fn pgm(&self, image: (usize, usize), bits: u32) -> Vec<u8> {
        let [width, height] = self.size_px;
        let most = if bits == 8 { 255 } else { 65_535 };
        let mut pgm = format!("P5\n{width} {height}\n{most}\n").into_bytes();
        pgm.extend(self.bytes(image, bits, false));
        pgm
    }

    fn video(&self, camera: usize, bits: u32) -> Vec<u8> {
        let [width, height] = self.size_px;
        let colours = if bits == 8 {
            "420jpeg".to_owned()
        } else {
            format!("mono{bits}")
        };
        let mut video = format!("YUV4MPEG2 W{width} H{height} F25:1 Ip C{colours}\n").into_bytes();
        for shot in 0..MOVES_MM.len() {
            video.extend(b"FRAME\n");
            video.extend(self.bytes((camera, shot), bits, true));
            if bits == 8 {
                video.extend(vec![128; (width * height / 2) as usize]);
            }
        }
        video
    }

    /// Returns a little-endian TIFF stack of 16-bit pages.
    fn stack(&self, camera: usize, bits: u32) -> Vec<u8> {
        let [width, height] = self.size_px;
        let strip = 2 * width * height;
        let directory = 2 + 7 * 12 + 4;
        let mut file = b"II\x2a\0".to_vec();
        let mut at = 8 + strip;
        file.extend(at.to_le_bytes());
        for shot in 0..MOVES_MM.len() {
            file.extend(self.bytes((camera, shot), bits, true));
            file.extend(7_u16.to_le_bytes());
            let start = at - strip;
            let sizes = [(256, width), (257, height), (258, 16), (259, 1), (262, 1)];
            for (tag, value) in sizes.into_iter().chain([(273, start), (279, strip)]) {
                file.extend(u16::to_le_bytes(tag));
                file.extend(4_u16.to_le_bytes());
                file.extend(1_u32.to_le_bytes());
                file.extend(value.to_le_bytes());
            }
            at += directory + strip;
            let next = if shot + 1 < MOVES_MM.len() { at } else { 0 };
            file.extend(next.to_le_bytes());
        }
        file
    }
}

/// Numbers of a line's vector.
fn vector(line: &serde_json::Value, key: &str) -> [f64; 3] {
    std::array::from_fn(|i| line[key][i].as_f64().expect("a number"))
}

#[track_caller]
fn assert_same(outcome: &Outcome, reference: &Outcome, form: &str) {
    assert_eq!(outcome.code, Some(0), "{form}: {}", outcome.stderr);
    let (lines, expected) = (outcome.json(), reference.json());
    assert_eq!(lines.len(), MOVES_MM.len() - 1, "{form}");
    for (line, expected) in lines.iter().zip(&expected) {
        let sigma = vector(expected, "sigma_mm");
        let [found, expected] = [line, expected].map(|line| vector(line, "displacement_mm"));
        for i in 0..3 {
            let off = (found[i] - expected[i]).abs();
            assert!(
                off <= sigma[i] / 10.0,
                "{form}: {found:?}, not {expected:?}"
            );
        }
    }
}

#[test]
fn every_form_gives_the_same_displacement() {
    let shots = Shots::new();
    let desk = Desk::new();
    let images = || (0..3).flat_map(|camera| (0..MOVES_MM.len()).map(move |shot| (camera, shot)));
    let make = |form: &str| fs::create_dir_all(desk.path(form)).expect("ours");
    for bits in [8, 10, 12, 16] {
        for (camera, shot) in images() {
            let name = CAMERAS[camera];
            make(&format!("pgm{bits}/{name}"));
            let pgm = shots.pgm((camera, shot), bits);
            desk.write(&format!("pgm{bits}/{name}/{shot}.pgm"), pgm);
        }
    }
    make("flat");
    for (camera, shot) in images() {
        let name = CAMERAS[camera];
        desk.write(
            &format!("flat/{name}_{shot:03}.pgm"),
            shots.pgm((camera, shot), 12),
        );
    }
    for (camera, name) in CAMERAS.iter().enumerate() {
        for bits in [12, 16] {
            make(&format!("stack{bits}"));
            desk.write(
                &format!("stack{bits}/{name}.tif"),
                shots.stack(camera, bits),
            );
        }
        for bits in [8, 12] {
            make(&format!("video{bits}"));
            desk.write(
                &format!("video{bits}/{name}.y4m"),
                shots.video(camera, bits),
            );
        }
    }
    let estimate = |form: &str| {
        let arguments = ["estimate", form, "--rig", "rig.toml", "--json"];
        run(desk.folder.path(), &arguments)
    };
    let reference = estimate("pgm8");
    for (line, moved) in reference.json().iter().zip(&MOVES_MM[1..]) {
        let found = vector(line, "displacement_mm");
        assert!((found[0] - moved[0]).abs() < 0.05, "{line}");
    }
    let forms = [
        "pgm10", "pgm12", "pgm16", "flat", "stack12", "stack16", "video8", "video12",
    ];
    for form in forms {
        assert_same(&estimate(form), &reference, form);
    }
    // All commands read all forms.
    let desk = desk.folder.path();
    for form in ["flat", "stack12", "video12"] {
        read_by_all(desk, form);
    }
}

#[test]
fn rows_say_what_they_know() {
    let desk = desk_with_views(&[AT_REST, Some([4.0, 4.0, 1.0]), None, Some([2.0, 0.0, 0.0])]);
    let all = |command: &[&str], form: &str| {
        let arguments = [command, &["views", "--rig", "rig.toml", form]].concat();
        run(desk.folder.path(), &arguments)
    };
    for command in [&["estimate"][..], &["track", "--images"]] {
        let rows = all(command, "--json").json();
        let table = all(command, "--csv").stdout;
        let mut lines = table.lines();
        let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
        let cells = |line: &'_ str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
        let cells: Vec<Vec<String>> = lines.map(cells).collect();
        assert_eq!((rows.len(), cells.len()), (3, 3));
        let cell = |row: usize, name: &str| {
            let column = header.iter().position(|column| *column == name);
            cells[row][column.expect("a column")].clone()
        };
        for row in [0, 2] {
            let known = &rows[row];
            let [sigma, moved] = ["sigma_mm", "displacement_mm"].map(|key| vector(known, key));
            let variance = known["covariance_mm2"][2][2].as_f64().expect("a variance");
            assert!((variance.sqrt() / sigma[2] - 1.0).abs() < 0.02, "{known}");
            for (key, number) in [("x_mm", moved[0]), ("sigma_z_mm", sigma[2])] {
                assert_eq!(cell(row, key), number.to_string(), "{table}");
            }
            for key in ["points", "rejected"] {
                assert_eq!(cell(row, key), known[key].to_string(), "{table}");
            }
        }
        // The dark frame set has a reason in place of the numbers.
        let refused = rows[1]["refused"].as_str().expect("a reason");
        assert!(
            cells[1].join(",").contains(refused) && cell(1, "x_mm").is_empty(),
            "{table}"
        );
    }
    let track = all(&["track", "--images"], "--json").json();
    assert!(track[0]["latency_ms"].as_f64().is_some_and(|ms| ms > 0.0));
    let text = run(
        desk.folder.path(),
        &["track", "--images", "views", "--rig", "rig.toml"],
    );
    assert!(text.stdout.contains("used, sigma 0.00") && text.stdout.contains(" points, "));
}

/// Makes five lines of an image white.
fn saturate(path: &Path) {
    let mut pgm = fs::read(path).expect("ours");
    let end = pgm.len();
    pgm[end - 1600..].fill(255);
    fs::write(path, pgm).expect("ours");
}

#[test]
fn saturated_images_are_named_in_rows() {
    // The keyframe, which has no row of its own, and the frame set that is measured against it.
    for saturated in ["views/left/0000.pgm", "views/left/0001.pgm"] {
        let desk = desk_with_views(&[AT_REST, Some([1.0, 0.0, 0.0])]);
        saturate(&desk.path(saturated));
        for command in [&["estimate"][..], &["track", "--images"]] {
            let arguments = [command, &["views", "--rig", "rig.toml", "--json"]].concat();
            let outcome = run(desk.folder.path(), &arguments);
            let row = &outcome.json()[0];
            let warning = row["warnings"][0].as_str().expect("a warning");
            assert!(
                warning.starts_with("camera left has ") && warning.contains("saturated"),
                "{row}"
            );
            let count = outcome.stderr.matches("saturated").count();
            assert_eq!(count, 1, "{}", outcome.stderr);
        }
    }
}

#[test]
fn regions_restrict_points() {
    let desk = desk_with_views(&[AT_REST, Some([4.0, 4.0, 1.0])]);
    let [width, height] = Rig::paper().image_size_px;
    let mask: Vec<u8> = (0..width * height)
        .map(|pixel| if pixel / width < height / 2 { 255 } else { 0 })
        .collect();
    let head = format!("P5\n{width} {height}\n255\n").into_bytes();
    desk.write("mask.pgm", [head, mask].concat());
    let estimate = |more: &[&str]| {
        let arguments = ["estimate", "views", "--rig", "rig.toml", "--json"];
        run(desk.folder.path(), &[&arguments[..], more].concat())
    };
    let points = |more: &[&str]| {
        let outcome = estimate(more);
        assert_eq!(outcome.code, Some(0), "{more:?}: {}", outcome.stderr);
        let row = &outcome.json()[0];
        assert!(
            (vector(row, "displacement_mm")[0] - 4.0).abs() < 0.05,
            "{row}"
        );
        row["points"].as_u64().expect("a number")
    };
    let all = points(&[]);
    let half = format!("0,0,{},{height}", width / 2);
    let restricted = [
        points(&["--roi", &half]),
        points(&["--roi", &format!("middle={half}")]),
        points(&["--mask", "mask.pgm"]),
        points(&["--mask", "right=mask.pgm"]),
    ];
    for count in restricted {
        assert!(count < all * 4 / 5, "{restricted:?} of {all}");
    }
    estimate(&["--roi", "0,0,9999,10"]).failed(2, &["0,0,9999,10", "beyond the image"]);
    estimate(&["--roi", "rear=0,0,99,99"]).failed(2, &["rear", "left, middle, right"]);
    let wrong = estimate(&["--roi", "0,0,99"]);
    assert!(wrong.code == Some(2) && wrong.stderr.contains("X,Y,WIDTH,HEIGHT"));
    estimate(&["--mask", "none.pgm"]).failed(1, &["none.pgm"]);
    // Ones and zeros, as numerical programs write a mask.
    let head = format!("P5\n{width} {height}\n255\n").into_bytes();
    desk.write(
        "ones.pgm",
        [head, vec![1; (width * height) as usize]].concat(),
    );
    estimate(&["--mask", "ones.pgm"]).failed(1, &["ones.pgm", "is 1 of 255", "write 255"]);
    let commands: [&[&str]; 3] = [
        &["track", "--images", "views"],
        &["align", "views"],
        &["bench", "flow", "views", "--repeat", "1"],
    ];
    for command in commands {
        let region = ["--rig", "rig.toml", "--roi", &half];
        let outcome = run(desk.folder.path(), &[command, &region].concat());
        assert_eq!(outcome.code, Some(0), "{command:?}: {}", outcome.stderr);
        let rear = ["--rig", "rig.toml", "--mask", "rear=mask.pgm"];
        run(desk.folder.path(), &[command, &rear].concat()).failed(2, &["rear", "left, middle"]);
    }
}

fn read_by_all(desk: &Path, form: &str) {
    let rig = ["--rig", "rig.toml"];
    let commands: [&[&str]; 3] = [
        &["track", "--images", form],
        &["align", form],
        &["bench", "flow", form, "--repeat", "1"],
    ];
    for command in commands {
        let outcome = run(desk, &[command, &rig].concat());
        assert_eq!(outcome.code, Some(0), "{command:?}: {}", outcome.stderr);
    }
}

/// Makes a pipe for the video of each camera.
#[cfg(unix)]
fn pipes(desk: &Desk) -> Vec<PathBuf> {
    fs::create_dir(desk.path("pipes")).expect("ours");
    let paths = CAMERAS.map(|name| desk.path("pipes").join(format!("{name}.y4m")));
    for path in &paths {
        let made = std::process::Command::new("mkfifo").arg(path).status();
        assert!(made.expect("mkfifo runs").success());
    }
    paths.into()
}

#[cfg(unix)]
#[test]
fn pipes_of_different_rates_are_refused() {
    let shots = Shots::new();
    let desk = Desk::new();
    for (camera, path) in pipes(&desk).into_iter().enumerate() {
        let mut video = shots.video(camera, 8);
        if camera == 1 {
            let at = video
                .windows(2)
                .position(|pair| pair == b" F")
                .expect("a rate");
            video[at + 2] += 1;
        }
        // The program leaves the pipes when it has seen the rates.
        std::thread::spawn(move || fs::write(path, video));
    }
    let outcome = run(
        desk.folder.path(),
        &["estimate", "pipes", "--rig", "rig.toml"],
    );
    assert_eq!(outcome.code, Some(1), "{}", outcome.stderr);
    for part in ["frames per second", "--pair order"] {
        assert!(outcome.stderr.contains(part), "{}", outcome.stderr);
    }
}

#[cfg(unix)]
#[test]
fn videos_come_through_pipes() {
    let shots = Shots::new();
    let desk = Desk::new();
    let paths = pipes(&desk);
    let writer = std::thread::spawn(move || {
        // One after the other, the last camera first.
        for (camera, path) in paths.iter().enumerate().rev() {
            fs::write(path, shots.video(camera, 12)).expect("a pipe");
        }
    });
    let arguments = ["estimate", "pipes", "--rig", "rig.toml", "--json"];
    let outcome = run(desk.folder.path(), &arguments);
    writer.join().expect("the pipes were read");
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert_eq!(outcome.json().len(), MOVES_MM.len() - 1);
    for (line, moved) in outcome.json().iter().zip(&MOVES_MM[1..]) {
        let found = vector(line, "displacement_mm");
        assert!((found[0] - moved[0]).abs() < 0.05, "{line}");
    }
}
