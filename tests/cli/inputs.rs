//! No output replaces an input of the same command, under any name of the file.

use std::fs;

use super::folder::{AT_REST, desk_with_views};
use super::verify::STAGE;
use super::{Desk, run};

const LOST: &str = "is an input of this command";

#[test]
fn report_over_input_is_refused() {
    let desk = Desk::new();
    std::os::unix::fs::symlink("rig.toml", desk.path("link")).expect("ours");
    fs::hard_link(desk.path("rig.toml"), desk.path("second")).expect("ours");
    desk.write("rig.toml", desk.read("rig.toml") + STAGE);
    let before = desk.read("rig.toml");
    for file in ["rig.toml", "./rig.toml", "link", "second"] {
        for more in [&[][..], &["--force"]] {
            let arguments = ["verify", "rig.toml", "--report", file];
            let outcome = run(desk.folder.path(), &[&arguments[..], more].concat());
            outcome.failed(1, &[file, LOST]);
            assert_eq!(desk.read("rig.toml"), before);
        }
    }
    let points = desk.read("points.csv");
    let experiment = [
        "--rig", "rig.toml", "--report", "a.html", "--figure", "rig.toml", "--force",
    ];
    run(desk.folder.path(), &experiment).failed(1, &["rig.toml", LOST]);
    assert!(!desk.path("a.html").exists());
    assert_eq!(desk.read("points.csv"), points);
}

#[test]
fn scenario_is_not_replaced_by_report() {
    let desk = Desk::new();
    let scenario = include_str!("../scenarios/still.toml");
    desk.write("still.toml", scenario);
    let arguments = [
        "simulate",
        "still.toml",
        "--report",
        "still.toml",
        "--force",
    ];
    run(desk.folder.path(), &arguments).failed(1, &["still.toml", LOST]);
    assert_eq!(desk.read("still.toml"), scenario);
}

#[test]
fn converted_files_keep_their_inputs() {
    let desk = Desk::new();
    let folder = desk.folder.path();
    let convert = run(folder, &["convert", "rig.toml", "--opencv", "cv"]);
    assert_eq!(convert.code, Some(0), "{}", convert.stderr);
    let files = ["cv/left.yml", "cv/middle.yml", "cv/right.yml"];
    let before = files.map(|file| desk.read(file));
    let back = [&["convert"][..], &files, &["--opencv", "cv", "--force"]].concat();
    run(folder, &back).failed(1, &["cv/left.yml", LOST]);
    run(
        folder,
        &["convert", "rig.toml", "--out", "rig.toml", "--force"],
    )
    .failed(1, &["rig.toml", LOST]);
    assert_eq!(files.map(|file| desk.read(file)), before);
}

#[test]
fn corrected_rig_replaces_no_image() {
    let desk = desk_with_views(&[AT_REST, Some([2.0, -1.0, 0.0])]);
    let picture = fs::read_dir(desk.path("views/left")).expect("ours").next();
    let picture = picture.expect("a picture").expect("ours").path();
    let before = fs::read(&picture).expect("ours");
    let file = picture.to_str().expect("UTF-8");
    let arguments = [
        "align", "views", "--rig", "rig.toml", "--out", file, "--force",
    ];
    run(desk.folder.path(), &arguments).failed(1, &[file, LOST]);
    assert_eq!(fs::read(&picture).expect("ours"), before);
}
