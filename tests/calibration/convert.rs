//! `convert` between our rig file, OpenCV's files and ROS's.

use std::fs;

use tempfile::TempDir;
use trinocular_core::rig::Rotation;
use trinocular_rig::rig_file::RigFile;

use super::run;

fn desk() -> TempDir {
    let desk = tempfile::tempdir().expect("a temporary folder");
    let mut rig = RigFile::paper();
    rig.rig.cameras[0].rotation = Rotation::from_degrees([0.5, -1.0, 0.25]);
    rig.rig.cameras[2].distortion = [-0.2, 0.1, 1e-3, -1e-3, 0.05];
    rig.rig.cameras[2].offset_mm[1] = 0.5;
    rig.write(&desk.path().join("rig.toml")).expect("written");
    desk
}

#[test]
fn rig_file_survives_conversion() {
    let desk = desk();
    let own = RigFile::read(&desk.path().join("rig.toml")).expect("a rig file");
    let outcome = run(
        desk.path(),
        &["convert", "rig.toml", "--opencv", "cv", "--ros", "ros"],
    );
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert_eq!(outcome.stdout.lines().count(), 6);
    for (folder, ending) in [("cv", "yml"), ("ros", "yaml")] {
        let files = ["left", "middle", "right"].map(|name| format!("{folder}/{name}.{ending}"));
        let out = format!("{folder}.toml");
        let outcome = run(
            desk.path(),
            &["convert", &files[0], &files[1], &files[2], "--out", &out],
        );
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let back = RigFile::read(&desk.path().join(&out)).expect("a rig file");
        assert_eq!(back.names, own.names);
        assert_eq!(back.rig.image_size_px, own.rig.image_size_px);
        for (a, b) in back.rig.cameras.iter().zip(&own.rig.cameras) {
            assert_eq!(
                (a.focal_px, a.principal_px, a.distortion),
                (b.focal_px, b.principal_px, b.distortion)
            );
            assert!(
                (0..2).all(|i| (a.offset_mm[i] - b.offset_mm[i]).abs() < 1e-8),
                "{a:?} {b:?}"
            );
            let mut turns = a.rotation.degrees().into_iter().zip(b.rotation.degrees());
            assert!(turns.all(|(a, b)| (a - b).abs() < 1e-9), "{a:?} {b:?}");
        }
    }
    run(desk.path(), &["convert", "rig.toml", "--out", "cv.toml"])
        .failed_after_notes(1, &["cv.toml", "exists"]);
}

/// Returns a file as OpenCV's calibration sample writes it, without the position of the camera.
fn opencv(focal: f64) -> String {
    format!(
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n\
         camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
         data: [ {focal}, 0., 3.2e+02, 0.,\n       {focal}, 240., 0., 0., 1. ]\n\
         distortion_coefficients: !!opencv-matrix\n   rows: 5\n   \
         cols: 1\n   dt: d\n   data: [ -1.6e-01, 0., 0., 0., 0. ]\n\
         avg_reprojection_error: 3.9e-01\n"
    )
}

#[test]
fn opencv_files_and_offsets_make_rig() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    for (name, focal) in [("left", 530.0), ("right", 540.0)] {
        fs::write(desk.path().join(format!("{name}.yml")), opencv(focal)).expect("written");
    }
    let convert = |more: &[&str]| {
        let mut arguments = vec!["convert", "left.yml", "right.yml"];
        arguments.extend(more);
        run(desk.path(), &arguments)
    };
    convert(&[]).failed_after_notes(1, &["left.yml", "--offset left=X,Y"]);
    convert(&["--offset", "left=-40,0"])
        .failed_after_notes(1, &["right.yml", "--offset right=X,Y"]);
    convert(&["--offset", "middle=0,0"]).failed_after_notes(2, &["middle", "left, right"]);
    convert(&["--offset", "left=1"]).failed_after_notes(2, &["left=1"]);
    convert(&["--offset", "left=0,0", "--offset", "right=0,0"])
        .failed_after_notes(1, &["same place"]);
    let outcome = convert(&["--offset", "left=-40,0", "--offset", "right=40,0"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let rig = RigFile::parse("out.toml".as_ref(), &outcome.stdout).expect("a rig file");
    assert_eq!(rig.rig.cameras[1].offset_mm, [40.0, 0.0]);
    assert_eq!(rig.rig.cameras[1].focal_px, [540.0; 2]);
    assert_eq!(rig.rig.cameras[1].rotation, Rotation::NONE);

    fs::write(
        desk.path().join("right.yml"),
        opencv(540.0).replace("640", "660"),
    )
    .expect("written");
    convert(&["--offset", "left=0,0", "--offset", "right=9,0"])
        .failed_after_notes(1, &["right.yml", "660 x 480", "640 x 480"]);
    fs::write(
        desk.path().join("right.yml"),
        opencv(540.0).replace("rows: 3", "rows: x"),
    )
    .expect("written");
    convert(&["--offset", "left=0,0", "--offset", "right=9,0"])
        .failed_after_notes(1, &["right.yml:6", "camera_matrix.rows"]);
    run(desk.path(), &["convert", "left.yml"]).failed_after_notes(2, &["2 to 8"]);
    run(desk.path(), &["convert", "none.yml", "left.yml"])
        .failed_after_notes(1, &["none.yml", "cannot read"]);
}

/// Returns a matrix of OpenCV's YAML.
fn matrix(name: &str, rows: usize, data: &str) -> String {
    let cols = data.split(',').count() / rows;
    format!(
        "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n"
    )
}

#[test]
fn files_of_several_cameras_make_rigs() {
    let desk = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| fs::write(desk.path().join(name), text).expect("written");
    let lens = "533., 0., 320., 0., 533., 240., 0., 0., 1.";
    let rational = "0., 0., 0., 0., 0., 0., 0., 0.02";
    let lenses = [
        ("M1", 3, lens),
        ("D1", 1, rational),
        ("M2", 3, lens),
        ("D2", 1, rational),
    ];
    let lenses = lenses.map(|(name, rows, data)| matrix(name, rows, data));
    write(
        "intrinsics.yml",
        &format!("%YAML:1.0\n---\n{}", lenses.concat()),
    );
    let turn = matrix("R", 3, "1., 0., 0., 0., 1., 0., 0., 0., 1.");
    let shift = matrix("T", 3, "-83.25, 0., 0.");
    write("extrinsics.yml", &format!("%YAML:1.0\n---\n{turn}{shift}"));
    let camera = "  camera_model: pinhole\n  distortion_model: radtan\n  distortion_coeffs: [0, 0, \
                  0, 0]\n  intrinsics: [533, 533, 320, 240]\n  resolution: [640, 480]\n";
    let step = "  T_cn_cnm1:\n  - [1, 0, 0, -0.08325]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, \
                0, 0, 1]\n";
    write(
        "camchain.yaml",
        &format!("cam0:\n{camera}cam1:\n{camera}{step}"),
    );
    let pair = ["convert", "extrinsics.yml", "intrinsics.yml"];
    run(desk.path(), &pair).failed_after_notes(1, &["stereo_calib", "--image-size 640x480"]);
    let sized = [&pair[..], &["--image-size", "640x480"]].concat();
    let (both, chain) = (
        run(desk.path(), &sized),
        run(desk.path(), &["convert", "camchain.yaml"]),
    );
    for (outcome, names, distortion) in [
        (
            both,
            ["left", "right"],
            "distortion = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02]",
        ),
        (chain, ["cam0", "cam1"], ""),
    ] {
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let text = &outcome.stdout;
        assert!(
            names
                .iter()
                .all(|name| text.contains(&format!("name = \"{name}\""))),
            "{text}"
        );
        assert!(text.contains("offset_mm = [83.25, 0.0]"), "{text}");
        assert!(text.contains(distortion), "{text}");
        write("rig.toml", text);
        // The lens survives the way to other programs and back.
        let there = run(
            desk.path(),
            &["convert", "rig.toml", "--ros", "ros", "--force"],
        );
        assert_eq!(there.code, Some(0), "{}", there.stderr);
        let files = names.map(|name| format!("ros/{name}.yaml"));
        let back = run(desk.path(), &["convert", &files[0], &files[1]]);
        assert_eq!(&back.stdout, text, "{}", back.stderr);
    }
    for (arguments, reason) in [
        (
            &["convert", "camchain.yaml", "--image-size", "640x480"][..],
            "--image-size goes with",
        ),
        (
            &["convert", "camchain.yaml", "--image-size", "640"],
            "such as 640x480",
        ),
        (
            &["convert", "rig.toml", "--image-size", "640x480"],
            "leave --image-size out",
        ),
    ] {
        let outcome = run(desk.path(), arguments);
        assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
        assert!(outcome.stderr.contains(reason), "{}", outcome.stderr);
    }
}
