//! Mistakes that people make: each is named with its way out.

use std::fs;

use super::folder::{AT_REST, desk_with_views};
use super::{Desk, run};
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::Outcome;

/// Displacements of a target that stays where it was.
const STILL: [Option<[f64; 3]>; 3] = [AT_REST; 3];

/// Requires an exit code and parts of an error of several lines.
#[track_caller]
fn refused(outcome: &Outcome, code: i32, parts: &[&str]) {
    let said = &outcome.stderr;
    assert_eq!(outcome.code, Some(code), "{said}");
    assert!(parts.iter().all(|part| said.contains(part)), "{said}");
}

fn exchange(desk: &Desk, a: &str, b: &str) {
    let path = |name: &str| desk.path("views").join(name);
    fs::rename(path(a), path("away")).expect("ours");
    fs::rename(path(b), path(a)).expect("ours");
    fs::rename(path("away"), path(b)).expect("ours");
}

/// Copies the files of a folder into a new one.
fn copy_folder(from: &std::path::Path, to: &std::path::Path) {
    fs::create_dir_all(to).expect("a new folder");
    for file in fs::read_dir(from).expect("a folder") {
        let file = file.expect("a file");
        fs::copy(file.path(), to.join(file.file_name())).expect("a copy");
    }
}

#[test]
fn exchanged_folders_are_named() {
    for (a, b) in [("left", "right"), ("middle", "left")] {
        let desk = desk_with_views(&STILL);
        exchange(&desk, a, b);
        for command in [
            &["estimate", "views", "--rig", "rig.toml"][..],
            &["track", "--images", "views", "--rig", "rig.toml"],
            &["align", "views", "--rig", "rig.toml"],
        ] {
            let outcome = run(desk.folder.path(), command);
            assert_eq!(outcome.code, Some(1), "{command:?}: {}", outcome.stderr);
            let said = format!("{}{}", outcome.stdout, outcome.stderr);
            let named = [format!("`{a}` and `{b}`"), format!("`{b}` and `{a}`")];
            let is_named = named.iter().any(|pair| said.contains(pair));
            assert!(is_named && said.contains("exchange them"), "{said}");
        }
    }
}

#[test]
fn exchanged_folders_are_named_by_calibrate() {
    let desk = Desk::new();
    let boards = super::root().join("tests/images/chessboard");
    for (from, to) in [("left", "right"), ("right", "left")] {
        copy_folder(&boards.join(from), &desk.path("boards").join(to));
    }
    let calibrate = ["calibrate", "boards", "--board", "9x6", "--square", "25"];
    let outcome = run(desk.folder.path(), &[&calibrate[..], &["--json"]].concat());
    let rig = outcome.good_json().pop().expect("the rig");
    let warnings = rig["rig"]["warnings"].to_string();
    let said = "`left` is 83.2 mm to the right of `right`";
    assert!(warnings.contains(said), "{warnings}");
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
}

/// Changes the grey levels of the images of these cameras, row by row.
fn change_images(desk: &Desk, cameras: &[&str], change: impl Fn(&mut [u8])) {
    const HEADER: usize = "P5\n320 240\n255\n".len();
    for camera in cameras {
        for file in fs::read_dir(desk.path("views").join(camera)).expect("ours") {
            let path = file.expect("ours").path();
            let mut pgm = fs::read(&path).expect("ours");
            change(&mut pgm[HEADER..]);
            fs::write(path, pgm).expect("ours");
        }
    }
}

fn mirror(grey: &mut [u8]) {
    grey.chunks_mut(320).for_each(<[u8]>::reverse);
}

#[test]
fn turned_and_mirrored_images_are_named() {
    const ALL: [&str; 3] = ["left", "middle", "right"];
    for (cameras, change, said) in [
        (
            &ALL[..],
            <[u8]>::reverse as fn(&mut [u8]),
            "all images turned upside down",
        ),
        (
            &ALL[..1],
            <[u8]>::reverse,
            "the image of `left` turned upside down",
        ),
        (
            &ALL[2..],
            mirror,
            "the image of `right` mirrored left to right",
        ),
    ] {
        let desk = desk_with_views(&STILL);
        change_images(&desk, cameras, change);
        for command in [
            &["estimate", "views", "--rig", "rig.toml"][..],
            &["track", "--images", "views", "--rig", "rig.toml"],
            &["align", "views", "--rig", "rig.toml"],
        ] {
            let outcome = run(desk.folder.path(), command);
            assert_eq!(outcome.code, Some(1), "{command:?}: {}", outcome.stderr);
            let printed = format!("{}{}", outcome.stdout, outcome.stderr);
            assert!(printed.contains(said), "{command:?}: {printed}");
        }
    }
}

#[test]
fn images_of_one_camera_twice_are_refused() {
    let desk = desk_with_views(&STILL);
    fs::remove_dir_all(desk.path("views/right")).expect("ours");
    copy_folder(&desk.path("views/middle"), &desk.path("views/right"));
    for command in ["align", "estimate"] {
        let outcome = run(desk.folder.path(), &[command, "views", "--rig", "rig.toml"]);
        assert_eq!(outcome.code, Some(1), "{}", outcome.stderr);
        let printed = format!("{}{}", outcome.stdout, outcome.stderr);
        let said = "`middle` and `right` have the same image";
        assert!(
            printed.contains(said) && printed.contains("its own"),
            "{printed}"
        );
    }
    // The noise of two recordings differs, so that the images alone do not tell.
    change_images(&desk, &["right"], |grey| {
        for (index, level) in grey.iter_mut().enumerate() {
            *level = level.saturating_add((index % 3) as u8);
        }
    });
    let align = ["align", "views", "--rig", "rig.toml", "--json"];
    let found = run(desk.folder.path(), &align).good_json();
    let warnings = found[0]["warnings"].to_string();
    assert!(
        warnings.contains("`middle` and `right` see all points"),
        "{warnings}"
    );
}

#[test]
fn photographs_of_one_camera_twice_are_refused() {
    let desk = Desk::new();
    let from = super::root().join("tests/images/chessboard/left");
    for to in ["left", "right"] {
        copy_folder(&from, &desk.path("boards").join(to));
    }
    // The unit of the square makes no difference.
    for square in ["25", "0.025"] {
        let calibrate = ["calibrate", "boards", "--board", "9x6", "--square", square];
        let outcome = run(desk.folder.path(), &calibrate);
        refused(
            &outcome,
            1,
            &[
                "boards: `left` and `right` are at the same place",
                "its own",
            ],
        );
    }
}

#[test]
fn images_turned_by_90_degrees_are_named() {
    let desk = desk_with_views(&STILL);
    let turned = desk.path("views/left/0000.pgm");
    let pgm = fs::read(&turned).expect("ours");
    let header = b"P5\n240 320\n255\n";
    fs::write(&turned, [header, &pgm[header.len()..]].concat()).expect("ours");
    let estimate = ["estimate", "views", "--rig", "rig.toml"];
    let outcome = run(desk.folder.path(), &estimate);
    outcome.failed(
        1,
        &[
            "0000.pgm: 240 x 320 px",
            "turn the camera or its images by 90 degrees",
        ],
    );
}

#[test]
fn doubts_about_rig_are_in_json() {
    let desk = desk_with_views(&STILL);
    let rig = desk.read("rig.toml");
    for (factor, unit) in [(0.02, "centimetres"), (1e3, "micrometres")] {
        let mut scaled = RigFile::paper();
        for camera in &mut scaled.rig.cameras {
            camera.offset_mm = camera.offset_mm.map(|mm| mm * factor);
        }
        desk.write("rig.toml", scaled.to_toml());
        let said = format!("are the offsets in {unit}? offset_mm is in mm");
        for command in [
            &["estimate", "points.csv", "--rig", "rig.toml", "--json"][..],
            &["track", "--images", "views", "--rig", "rig.toml", "--json"],
            &["align", "views", "--rig", "rig.toml", "--json"],
            &["verify", "rig.toml", "--json"],
            &["convert", "rig.toml", "--json"],
        ] {
            let outcome = run(desk.folder.path(), command);
            assert!(outcome.stderr.contains(&said), "{}", outcome.stderr);
            // A rig in a wrong unit may be refused for another reason.
            let is_judged = ["verify", "convert"].contains(&command[0]);
            let Some(first) = outcome.json().into_iter().next() else {
                assert!(!is_judged, "{command:?}: {}", outcome.stderr);
                continue;
            };
            let warnings = first["warnings"].to_string();
            assert!(warnings.contains(&said), "{command:?}: {first}");
            assert_eq!(outcome.stdout.matches(&said).count(), 1, "{command:?}");
        }
    }
    desk.write("rig.toml", rig);
    let clean = run(desk.folder.path(), &["verify", "rig.toml", "--json"]);
    assert_eq!(clean.good_json()[0]["warnings"], serde_json::Value::Null);
}

#[test]
fn rig_without_prediction_is_warned_of() {
    let desk = Desk::new();
    let text = fs::read_to_string(super::root().join("examples/data/rig.toml")).expect("the rig");
    desk.write(
        "rig.toml",
        text.replace("driver =", "prediction = false\ndriver ="),
    );
    for command in [
        &["track", "--sim", "--seconds", "0.1", "--rig", "rig.toml"][..],
        &["zero", "--rig", "rig.toml", "--port", "nowhere"],
        &["--rig", "rig.toml", "--record", "no/such/folder/run.mcap"],
    ] {
        let said = "rig.toml: stage.prediction is false, which switches off the watch";
        let outcome = run(desk.folder.path(), command);
        assert!(
            outcome.stderr.contains(said),
            "{command:?}: {}",
            outcome.stderr
        );
    }
}

#[test]
fn unknown_words_get_their_neighbour() {
    let desk = Desk::new();
    let rig = fs::read_to_string(super::root().join("examples/data/rig.toml")).expect("the rig");
    for (word, parts) in [
        (
            "TMC2290",
            ["unknown driver `TMC2290`", "did you mean `TMC2209`?"],
        ),
        (
            "drv8825",
            ["unknown driver `drv8825`", "did you mean `DRV8825`?"],
        ),
        (
            "L298",
            [
                "unknown driver `L298`",
                "known here: A4988, DRV8825, TMC2209",
            ],
        ),
    ] {
        desk.write(
            "stage.toml",
            rig.replace("\"TMC2209\" ", &format!("\"{word}\" ")),
        );
        let outcome = run(desk.folder.path(), &["verify", "stage.toml"]);
        outcome.failed(
            1,
            &[&["stage.toml:36: field `stage.driver`"], &parts[..]].concat(),
        );
    }
    desk.write("stage.toml", rig.replace("travel_mm", "travel"));
    run(desk.folder.path(), &["verify", "stage.toml"])
        .failed(1, &["field `stage.travel`", "did you mean `travel_mm`?"]);
    desk.write(
        "points.csv",
        desk.read("points.csv").replace(",left,", ",Left,"),
    );
    desk.estimate(&[]).failed(
        1,
        &[
            "points.csv:2",
            "unknown camera `Left`",
            "did you mean `left`?",
        ],
    );
    for (arguments, said) in [
        (
            &["track", "--sim", "--path", "lisajous"][..],
            "did you mean `lissajous`?",
        ),
        (
            &["track", "--sim", "--texture", "brick"],
            "did you mean `bricks`?",
        ),
        (&["init", "--driver", "TMC2290"], "did you mean `TMC2209`?"),
        (&["jog", "u=1", "--port", "auto"], "known here: x, y, z"),
    ] {
        refused(&run(desk.folder.path(), arguments), 2, &[said]);
    }
}

#[test]
fn calibrate_stage_names_its_sources() {
    let calibrate = |more: &[&str]| {
        let words = ["calibrate-stage", "--rig", "rig.toml"];
        run(std::path::Path::new("."), &[&words[..], more].concat())
    };
    refused(&calibrate(&[]), 2, &["--sim|--port <PATH>"]);
    let eyes = "--cameras <DEVICE,...>|--images <DIR>";
    refused(&calibrate(&["--port", "auto"]), 2, &[eyes]);
    // Images of a stage are not used with a simulated one.
    for source in ["--images", "--cameras"] {
        let both = calibrate(&["--sim", source, "views"]);
        refused(&both, 2, &[source, "--sim"]);
    }
}

#[test]
fn other_names_are_named_with_way_out() {
    let desk = desk_with_views(&STILL);
    let right = desk.path("views/right");
    for file in fs::read_dir(&right).expect("ours") {
        let path = file.expect("ours").path();
        fs::rename(&path, path.with_extension("pnm")).expect("ours");
    }
    let estimate = ["estimate", "views", "--rig", "rig.toml"];
    let outcome = run(desk.folder.path(), &estimate);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(
        outcome.stderr.contains("endings aside"),
        "{}",
        outcome.stderr
    );
    for (number, file) in fs::read_dir(&right).expect("ours").enumerate() {
        let path = file.expect("ours").path();
        let letter = ["a", "b", "c", "d", "e"][number];
        fs::rename(&path, path.with_file_name(letter).with_extension("pnm")).expect("ours");
    }
    let outcome = run(desk.folder.path(), &estimate);
    let way_out = ["`left` end in .pgm", "`right` in .pnm", "--pair order"];
    outcome.failed(1, &way_out);
    let ordered = [&estimate[..], &["--pair", "order"]].concat();
    let outcome = run(desk.folder.path(), &ordered);
    assert!(
        outcome.stderr.contains("frame sets by their order"),
        "{}",
        outcome.stderr
    );
}

#[test]
fn other_csv_dialects_are_named() {
    let desk = Desk::new();
    let text = desk.read("points.csv");
    let commas = text.replace(',', ";").replace('.', ",");
    for (changed, parts) in [
        (
            text.replace(',', ";"),
            &["points.csv:1", "semicolons", "save the file"],
        ),
        (commas, &["points.csv:1", "semicolons", "decimal points"]),
        (
            text.replace(',', "\t"),
            &["points.csv:1", "tabs", "save the file"],
        ),
        (
            text.replace('.', ","),
            &["points.csv:2", "decimal commas", "193.2"],
        ),
    ] {
        desk.write("points.csv", changed);
        desk.estimate(&[]).failed(1, parts);
    }
    let (header, rows) = text.split_once('\n').expect("rows");
    let (first, rest) = rows.split_once('\n').expect("rows");
    let fields: Vec<String> = first.split(',').map(str::to_owned).collect();
    let quoted = format!("\"{}\"", fields[2].replace('.', ","));
    let row = first.replacen(&fields[2], &quoted, 1);
    desk.write("points.csv", format!("{header}\n{row}\n{rest}"));
    desk.estimate(&[]).failed(
        1,
        &["points.csv:2: field `x0`", "decimal comma", "decimal point"],
    );
}

#[test]
fn utf16_files_are_named() {
    let desk = Desk::new();
    let utf16 = |name: &str, mark: &str| {
        let text = format!("{mark}{}", desk.read(name));
        let bytes: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        desk.write(&format!("wide-{name}"), bytes);
    };
    for mark in ["\u{feff}", ""] {
        utf16("points.csv", mark);
        utf16("rig.toml", mark);
        let way_out = ["UTF-16", "save the file anew with the encoding UTF-8"];
        let files = ["estimate", "wide-points.csv", "--rig", "rig.toml"];
        let points = run(desk.folder.path(), &files);
        points.failed(1, &[&["wide-points.csv:1"], &way_out[..]].concat());
        let rig = run(desk.folder.path(), &["verify", "wide-rig.toml"]);
        rig.failed(1, &[&["wide-rig.toml:1"], &way_out[..]].concat());
    }
    // A byte order mark alone is no mistake.
    for name in ["points.csv", "rig.toml"] {
        desk.write(name, format!("\u{feff}{}", desk.read(name)));
    }
    assert_eq!(desk.estimate(&[]).code, Some(0));
}

#[test]
fn missing_comma_gets_a_hint() {
    let desk = Desk::new();
    let verify = ["verify", "rig.toml", "--points", "25", "50"];
    let outcome = run(desk.folder.path(), &verify);
    assert_eq!(outcome.code, Some(2));
    assert!(
        outcome.stderr.contains("--points 25,50"),
        "{}",
        outcome.stderr
    );
}

#[track_caller]
fn refused_dash(outcome: &Outcome) {
    outcome.failed(1, &["-: ", "standard output", "`./-`"]);
}

#[test]
fn dash_is_refused_as_output() {
    let desk = desk_with_views(&STILL);
    for command in [
        &["verify", "rig.toml", "--report", "-"][..],
        &["tables", "--report", "-"],
        &["align", "views", "--rig", "rig.toml", "--out", "-"],
        &["convert", "rig.toml", "--out", "-"],
        &["convert", "rig.toml", "--ros", "-"],
        &["man", "-"],
        &["--report", "-"],
    ] {
        refused_dash(&run(desk.folder.path(), command));
    }
    assert!(!desk.path("-").exists());
    run(desk.folder.path(), &["verify", "-"]).failed(1, &["-: ", "/dev/stdin"]);
}

#[test]
fn wrong_point_is_named_with_line_and_camera() {
    let desk = Desk::new();
    let text = desk.read("points.csv");
    // The sixth line is the point with id 1 in the camera in the middle.
    let row = text.lines().nth(5).expect("a row");
    let (start, y1) = row.rsplit_once(',').expect("columns");
    let y1: f64 = y1.parse().expect("a number");
    desk.write(
        "points.csv",
        text.replace(row, &format!("{start},{}", y1 + 9.0)),
    );
    let outcome = desk.estimate(&["--json"]);
    let line = &outcome.good_json()[0];
    let said = line["warnings"][0].as_str().expect("a warning");
    assert!(
        said.starts_with("points.csv:6: field `y1`: camera `middle`"),
        "{said}"
    );
    assert!(said.contains("9.0"), "{said}");
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
    assert_eq!(line["warnings"].as_array().map(Vec::len), Some(1));
}

#[test]
fn replaced_rig_keeps_comments() {
    let desk = Desk::new();
    desk.write(
        "old.toml",
        format!("# our bench\n{}", desk.read("rig.toml")),
    );
    desk.change("rig.toml", "533.16", "544.5");
    let convert = ["convert", "rig.toml", "--out", "old.toml", "--force"];
    assert_eq!(run(desk.folder.path(), &convert).code, Some(0));
    let kept = desk.read("old.toml");
    assert!(
        kept.starts_with("# our bench\n") && kept.contains("544.5"),
        "{kept}"
    );
    desk.write("old.toml", kept.replace("\"left\"", "\"west\""));
    let outcome = run(desk.folder.path(), &convert);
    let said = "its comments are dropped";
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
    assert!(!desk.read("old.toml").contains('#'));
}
