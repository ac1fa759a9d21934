//! Drawn boards in front of a known rig: calibration, rig file and displacement.

use std::fs;
use std::path::Path;

use serde_json::Value;
use trinocular_core::rig::Rig;
use trinocular_rig::rig_file::{RigFile, TRINOCULAR};
use trinocular_vision::calibration::board::Board;
use trinocular_vision::calibration::find::{NotFound, find};
use trinocular_vision::images::folder::{save, write};
use trinocular_vision::images::{Image, Scene, SceneSettings, Texture};

use super::boards::{CORNERS, Eye, Pose, SQUARE_MM, crooked_rig, photograph};
use super::{numbers, run};

const BOARD: Board = Board {
    corners: CORNERS,
    square_mm: SQUARE_MM,
};
const CALIBRATE: [&str; 6] = ["calibrate", "boards", "--board", "9x6", "--square", "18"];

#[test]
fn corners_are_within_hundredths_of_px() {
    let rig = crooked_rig();
    let camera = &rig.cameras[0];
    let eye = Eye::new(camera, rig.image_size_px);
    let (mut squares, mut count) = (0.0, 0.0);
    for number in 0..8 {
        let pose = Pose::number(number);
        let found =
            find(&eye.view(&pose, number), &BOARD, None).expect("the whole board is in view");
        for (index, seen) in found.corners.iter().enumerate() {
            let [u, v] = BOARD.point_mm(index);
            let (u, v) = (u - 4.0 * SQUARE_MM, v - 2.5 * SQUARE_MM);
            let rows = trinocular_core::rig::Rotation::from_degrees(pose.turn_deg).rows();
            let point = [0, 1, 2].map(|i| pose.middle_mm[i] + rows[i][0] * u + rows[i][1] * v);
            let expected = camera.project(point);
            let error = (seen[0] - expected[0]).hypot(seen[1] - expected[1]);
            assert!(
                error < 0.3,
                "{number}, corner {index}: {seen:?}, not {expected:?}"
            );
            squares += error * error;
            count += 1.0;
        }
    }
    let rms = f64::sqrt(squares / count);
    assert!(rms < 0.05, "{rms} px");
}

#[test]
fn partial_board_is_not_found() {
    let rig = crooked_rig();
    let eye = Eye::new(&rig.cameras[1], rig.image_size_px);
    let pose = Pose {
        middle_mm: [0.0, 0.0, 500.0],
        turn_deg: [10.0, -12.0, 5.0],
    };
    let whole = eye.view(&pose, 1);
    assert!(find(&whole, &BOARD, None).is_ok());
    let mut covered = whole.clone();
    // A dark patch covers a quarter of the board, like a hand.
    for row in 60..180 {
        covered.grey[row * whole.width + 100..][..140].fill(120);
    }
    assert!(matches!(
        find(&covered, &BOARD, None),
        Err(NotFound::Hidden(_) | NotFound::Other(_))
    ));
    let mut blank = whole.clone();
    blank.grey.fill(128);
    assert_eq!(find(&blank, &BOARD, None), Err(NotFound::Nothing));
    let half_out = Pose {
        middle_mm: [150.0, 0.0, 500.0],
        ..pose
    };
    assert!(find(&eye.view(&half_out, 1), &BOARD, None).is_err());
    let larger = Board {
        corners: [8, 5],
        square_mm: SQUARE_MM,
    };
    assert_eq!(find(&whole, &larger, None), Err(NotFound::Other([9, 6])));
    let tiny = trinocular_vision::images::Image {
        width: 9,
        height: 9,
        grey: vec![0; 81],
    };
    assert_eq!(find(&tiny, &BOARD, None), Err(NotFound::Nothing));
}

/// Checks that every figure is within 4.5 of its standard deviations of the truth.
#[track_caller]
fn assert_true(value: &Value, key: &str, sigma: &str, truth: &[f64]) {
    for ((got, sigma), truth) in numbers(value, key)
        .iter()
        .zip(numbers(value, sigma))
        .zip(truth)
    {
        assert!(
            (got - truth).abs() <= 4.5 * sigma + 1e-9,
            "{key}: {got} ± {sigma}, in truth {truth}"
        );
    }
}

/// Renders a moving poster with the true rig and checks its displacement measured with the
/// calibrated rig.
fn assert_measures(desk: &Path, rig: &Rig, rig_file: &str) {
    let moves: [[f64; 3]; 4] = [
        [0.0; 3],
        [4.0, 4.0, 1.0],
        [-6.0, 3.0, 4.0],
        [0.0, -8.0, -5.0],
    ];
    let names: Vec<String> = TRINOCULAR.map(String::from).to_vec();
    let scene = Scene::new(rig, &Texture::natural(4), SceneSettings::default()).expect("a scene");
    for (index, moved) in moves.into_iter().enumerate() {
        let capture = scene.render(moved, 0, index as u64);
        save(&desk.join("views"), &names, index, &capture).expect("written");
    }
    let outcome = run(desk, &["estimate", "views", "--rig", rig_file, "--json"]);
    let got = outcome.good_json();
    assert_eq!(got.len(), moves.len() - 1);
    for (line, truth) in got.iter().zip(&moves[1..]) {
        let got = numbers(line, "displacement_mm");
        // The bound is that of a parallel rig plus one per cent of the displacement: three times
        // the effect of the calibration's own sigma (a third of a degree about y).
        let way = truth.iter().map(|t| t * t).sum::<f64>().sqrt();
        for (i, tolerance) in [0.02, 0.02, 0.05].into_iter().enumerate() {
            let error = (got[i] - truth[i]).abs();
            assert!(error < tolerance + 0.01 * way, "{got:?}, not {truth:?} mm");
        }
    }
}

#[test]
fn crooked_rig_is_calibrated() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    let rig = crooked_rig();
    photograph(&desk.path().join("boards"), &rig, &TRINOCULAR, 14);
    // Add one image of a blank wall and one file that is no image.
    let wall = trinocular_vision::images::Image {
        width: 480,
        height: 360,
        grey: vec![120; 480 * 360],
    };
    write(&desk.path().join("boards/left/03.png"), &wall).expect("written");
    fs::write(desk.path().join("boards/right/05.png"), "no image").expect("written");

    let mut arguments = CALIBRATE.to_vec();
    arguments.extend([
        "--out", "rig.toml", "--opencv", "cv", "--ros", "ros", "--json",
    ]);
    let outcome = run(desk.path(), &arguments);
    let lines = outcome.good_json();
    assert!(
        outcome.stderr.contains("written: rig.toml"),
        "{}",
        outcome.stderr
    );
    for (line, camera) in lines.iter().zip(&rig.cameras) {
        assert_true(line, "focal_px", "focal_sigma_px", &camera.focal_px);
        assert_true(
            line,
            "principal_px",
            "principal_sigma_px",
            &camera.principal_px,
        );
        assert_true(line, "distortion", "distortion_sigma", &camera.distortion);
        assert!(
            numbers(line, "focal_sigma_px")
                .iter()
                .all(|sigma| *sigma < 1.0),
            "{line}"
        );
        assert!(
            line["rms_px"].as_f64().is_some_and(|rms| rms < 0.06),
            "{line}"
        );
    }
    assert_eq!(lines[0]["images"][3]["rejected"], "no board found");
    assert!(
        lines[2]["images"][5]["rejected"]
            .as_str()
            .is_some_and(|reason| reason.contains("cannot read the image"))
    );
    let found = &lines[3]["rig"];
    assert_eq!(found["origin"], "middle");
    for (stand, camera) in found["cameras"]
        .as_array()
        .expect("a list")
        .iter()
        .zip(&rig.cameras)
    {
        let [x, y] = camera.offset_mm;
        assert_true(stand, "offset_mm", "offset_sigma_mm", &[x, y, 0.0]);
        // The rig's own axes differ slightly about y, because they follow from the cameras'
        // positions, with the stated sigma.
        assert_true(
            stand,
            "rotation_deg",
            "rotation_sigma_deg",
            &camera.rotation.degrees(),
        );
        assert!(numbers(stand, "offset_sigma_mm")[0] < 0.1, "{stand}");
    }
    assert!(
        found["instants"][3]["rms_px"].is_f64(),
        "two cameras of three are enough: {found}"
    );

    assert_measures(desk.path(), &rig, "rig.toml");
    // The files for other programs describe the same rig.
    let own = RigFile::read(&desk.path().join("rig.toml")).expect("a rig file");
    for (folder, ending) in [("cv", "yml"), ("ros", "yaml")] {
        let files = TRINOCULAR.map(|name| format!("{folder}/{name}.{ending}"));
        let mut arguments = vec!["convert"];
        arguments.extend(files.iter().map(String::as_str));
        let back = RigFile::parse("back.toml".as_ref(), &run(desk.path(), &arguments).stdout)
            .expect("a rig file");
        assert_eq!(back.names, own.names);
        for (a, b) in back.rig.cameras.iter().zip(&own.rig.cameras) {
            assert_eq!(
                (a.focal_px, a.principal_px, a.distortion),
                (b.focal_px, b.principal_px, b.distortion)
            );
            assert!(
                (0..2).all(|i| (a.offset_mm[i] - b.offset_mm[i]).abs() < 1e-8),
                "{a:?} {b:?}"
            );
            let turns = a.rotation.degrees().into_iter().zip(b.rotation.degrees());
            assert!(
                turns.into_iter().all(|(a, b)| (a - b).abs() < 1e-8),
                "{a:?} {b:?}"
            );
        }
    }
}

#[test]
fn existing_rig_file_keeps_its_stage() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    photograph(
        &desk.path().join("boards"),
        &crooked_rig(),
        &["left", "right"],
        12,
    );
    let with = |more: &[&str]| {
        let mut arguments = CALIBRATE.to_vec();
        arguments.extend(more);
        run(desk.path(), &arguments)
    };
    let stage = "\n[stage]\nsteps_per_mm = [80, 80, 400]\nmax_speed_mm_s = [50, 50, 10]\n\
                 max_acceleration_mm_s2 = [500, 500, 100]\nmax_jerk_mm_s3 = [5e3, 5e3, 1e3]\n\
                 travel_mm = [[-50, 50], [-50, 50], [0, 30]]\ninvert = [false, true, false]\n\
                 matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\ndriver = \"TMC2209\"\n";
    let old = RigFile::paper().to_toml() + stage;
    let path = desk.path().join("rig.toml");
    fs::write(&path, &old).expect("written");
    with(&["--out", "rig.toml"]).failed_after_notes(1, &["rig.toml", "exists", "--force"]);
    assert_eq!(fs::read_to_string(&path).expect("it is there"), old);
    let kept = RigFile::read(&path).expect("a rig file").stage;
    assert!(kept.is_some());

    let outcome = with(&["--out", "rig.toml", "--force"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let new = RigFile::read(&path).expect("a rig file");
    assert_eq!(
        (new.names, new.stage),
        (vec!["left".to_owned(), "right".to_owned()], kept)
    );

    fs::write(&path, "[stage]\nhalf a file").expect("written");
    with(&["--out", "rig.toml", "--force"])
        .failed_after_notes(1, &["rig.toml:2", "not valid TOML"]);
    assert_eq!(
        fs::read_to_string(&path).expect("it is there"),
        "[stage]\nhalf a file"
    );

    fs::create_dir(desk.path().join("cv")).expect("made");
    fs::write(desk.path().join("cv/right.yml"), "mine").expect("written");
    with(&["--opencv", "cv"]).failed_after_notes(1, &["right.yml", "exists"]);
    assert!(!desk.path().join("cv/left.yml").exists());
    with(&["--out", "none/rig.toml"]).failed_after_notes(1, &["none", "no such folder"]);
}

/// Copies of an image would make every standard deviation too small. A single pose leaves the lens
/// parameters undetermined.
#[test]
fn repeated_images_are_rejected() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    let left = desk.path().join("boards/left");
    photograph(&desk.path().join("boards"), &crooked_rig(), &["left"], 3);
    for copy in 3..9 {
        fs::copy(left.join("00.png"), left.join(format!("{copy:02}.png"))).expect("copied");
    }
    let outcome = run(desk.path(), &[CALIBRATE.as_slice(), &["--json"]].concat());
    let camera = &outcome.good_json()[0];
    let images = camera["images"].as_array().expect("a list of images");
    for (index, image) in images.iter().enumerate() {
        match index < 3 {
            true => assert!(image["rms_px"].is_f64(), "{image}"),
            false => assert_eq!(image["rejected"], "the same image as 00.png"),
        }
    }
    assert!(
        outcome.stderr.contains("3 images are few"),
        "{}",
        outcome.stderr
    );

    let rig = crooked_rig();
    let eye = Eye::new(&rig.cameras[0], rig.image_size_px);
    for index in 0..9 {
        let pose = Pose {
            middle_mm: [3.0 * index as f64 - 13.0, 0.0, 540.0],
            turn_deg: [20.0 + 0.4 * index as f64, 22.0 - 0.4 * index as f64, 5.0],
        };
        let name = format!("{index:02}.png");
        write(&left.join(name), &eye.view(&pose, 70 + index)).expect("written");
    }
    let outcome = run(desk.path(), &CALIBRATE);
    assert!(
        outcome
            .stderr
            .contains("left: the focal lengths are known to"),
        "{}",
        outcome.stderr
    );
}

/// Writes images of the board in the lower right of larger ones; with `beside`, the upper left has
/// the board at another instant. Returns the rectangle of the first board.
fn photograph_two(dir: &Path, beside: bool) -> [usize; 4] {
    let rig = crooked_rig();
    let [w, h] = rig.image_size_px.map(|side| side as usize);
    let (left, top) = (w + 6, 4);
    fs::create_dir_all(dir).expect("made");
    for number in 0..9 {
        let view = |number: u64| {
            let eye = Eye::new(&rig.cameras[0], rig.image_size_px);
            eye.view(&Pose::number(number), number)
        };
        let other = beside.then(|| (view((number + 1) % 9), 0, 0));
        let (width, height) = (left + w, top + h);
        let mut grey = vec![128; width * height];
        for (image, x, y) in other.into_iter().chain([(view(number), left, top)]) {
            for (row, pixels) in image.grey.chunks(w).enumerate() {
                let from = (y + row) * width + x;
                grey[from..from + w].copy_from_slice(pixels);
            }
        }
        let image = Image {
            width,
            height,
            grey,
        };
        write(&dir.join(format!("{number:02}.png")), &image).expect("written");
    }
    [left, top, w, h]
}

#[test]
fn board_beyond_the_rectangle_is_ignored() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    let [x, y, w, h] = photograph_two(&desk.path().join("alone/left"), false);
    photograph_two(&desk.path().join("both/left"), true);
    let calibrate = |folder: &str, roi: &[&str]| {
        let words = [
            "calibrate",
            folder,
            "--board",
            "9x6",
            "--square",
            "18",
            "--json",
        ];
        run(desk.path(), &[&words[..], roi].concat())
    };
    let roi = format!("{x},{y},{w},{h}");
    let alone = calibrate("alone", &["--roi", &roi]);
    let both = calibrate("both", &["--roi", &roi]);
    assert_eq!(alone.good_json(), both.good_json());
    let whole = calibrate("alone", &[]);
    let [whole, part] = [&whole.good_json()[0], &alone.good_json()[0]];
    for (key, sigma) in [
        ("focal_px", "focal_sigma_px"),
        ("principal_px", "principal_sigma_px"),
    ] {
        let sigmas = numbers(whole, sigma);
        let pairs = numbers(whole, key).into_iter().zip(numbers(part, key));
        for ((one, other), sigma) in pairs.zip(sigmas) {
            assert!((one - other).abs() < 0.5 * sigma, "{key}: {one} {other}");
        }
    }
    let mixed = calibrate("both", &[]);
    assert_ne!(mixed.stdout, both.stdout, "the other board matters");
    let none = calibrate("both", &["--roi", "left=0,0,80,60"]);
    none.failed_after_notes(1, &["`left`", "--roi 0,0,80,60", "0 of 9 images"]);
    for roi in ["0,0,8000,60", "8000,0,10,10", "0,8000,10,10"] {
        let beyond = calibrate("both", &["--roi", roi]);
        let reason = format!("--roi {roi} reaches beyond the image");
        beyond.failed_after_notes(1, &["`left`", &reason]);
    }
    let absent = calibrate("both", &["--roi", "middle=0,0,80,60"]);
    absent.failed(2, &["--roi middle", "the cameras are left"]);
}

#[test]
fn images_of_different_times_make_no_rig() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    let boards = desk.path().join("boards");
    photograph(&boards, &crooked_rig(), &["left", "right"], 9);
    let right = boards.join("right");
    // Each camera alone is as good as before; only the names are those of the next instant.
    for index in 0..9 {
        let from = right.join(format!("{index:02}.png"));
        fs::rename(from, right.join(format!("{:02}.tmp", (index + 1) % 9))).expect("renamed");
    }
    for index in 0..9 {
        let from = right.join(format!("{index:02}.tmp"));
        fs::rename(from, right.join(format!("{index:02}.png"))).expect("renamed");
    }
    run(desk.path(), &CALIBRATE).failed_after_notes(1, &["boards", "contradict", "one instant"]);
}

#[test]
fn unusable_images_are_refused_by_name() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    let boards = desk.path().join("boards");
    photograph(&boards, &crooked_rig(), &["left", "right"], 4);
    let calibrate = |more: &[&str]| {
        let mut arguments = CALIBRATE.to_vec();
        arguments.extend(more);
        run(desk.path(), &arguments)
    };
    fs::rename(boards.join("left"), boards.join("away")).expect("renamed");
    fs::create_dir(boards.join("left")).expect("made");
    let one = calibrate(&["--json"]);
    assert_eq!(one.good_json().len(), 3, "an empty folder is no camera");
    fs::remove_dir_all(boards.join("away")).expect("removed");
    assert_eq!(calibrate(&["--json"]).good_json().len(), 1);
    calibrate(&["--out", "rig.toml"]).failed_after_notes(1, &["boards", "two cameras or more"]);
    run(
        desk.path(),
        &["calibrate", "nowhere", "--board", "9x6", "--square", "18"],
    )
    .failed_after_notes(1, &["nowhere", "no such folder"]);
}
