//! Commands limit the size of their input, and write whole files, only as requested.

use std::fs;

use super::{Desk, run};

/// Runs `trinocular verify rig.toml --report FILE` with more arguments.
fn report(desk: &Desk, file: &str, more: &[&str]) -> trinocular_tests::binary::Outcome {
    let arguments = ["verify", "rig.toml", "--report", file];
    run(desk.folder.path(), &[&arguments[..], more].concat())
}

#[test]
fn report_replaces_only_a_report() {
    let desk = Desk::new();
    for _ in 0..2 {
        assert_eq!(report(&desk, "a.html", &[]).code, Some(0));
    }
    let before = desk.read("points.csv");
    report(&desk, "points.csv", &[]).failed(
        1,
        &["points.csv", "is no report of this program", "--force"],
    );
    assert_eq!(desk.read("points.csv"), before);
    report(&desk, "rig.toml", &[]).failed(1, &["rig.toml", "is an input of this command"]);
    assert_eq!(report(&desk, "points.csv", &["--force"]).code, Some(0));
    assert!(desk.read("points.csv").starts_with("<!doctype html>"));
}

#[test]
fn unwritable_report_fails_before_work() {
    let desk = Desk::new();
    let place = ["--report", "no/such/page.html"];
    for command in [&["tables"][..], &["verify", "rig.toml"], &[]] {
        let outcome = run(desk.folder.path(), &[command, &place].concat());
        outcome.failed(1, &["no/such/page.html: cannot write: no such folder"]);
    }
    let same = run(desk.folder.path(), &["--report", "a", "--figure", "a"]);
    same.failed(2, &["--report and --figure"]);
    assert!(!desk.path("a").exists());
}

#[test]
fn converted_files_are_all_or_none() {
    let desk = Desk::new();
    fs::create_dir_all(desk.path("ros/right.yaml")).expect("ours");
    let convert = |more: &[&str]| {
        let all = [
            "convert", "rig.toml", "--out", "b.toml", "--opencv", "new/cv", "--ros", "ros",
        ];
        run(desk.folder.path(), &[&all[..], more].concat())
    };
    for more in [&[][..], &["--force"]] {
        convert(more).failed(1, &["ros/right.yaml", "is a folder"]);
        assert!(!desk.path("b.toml").exists() && !desk.path("new").exists());
        assert_eq!(fs::read_dir(desk.path("ros")).expect("ours").count(), 1);
    }
    fs::remove_dir(desk.path("ros/right.yaml")).expect("ours");
    assert_eq!(convert(&[]).stdout.lines().count(), 7);
    assert_eq!(convert(&["--force"]).code, Some(0));
    fs::create_dir(desk.path("other")).expect("ours");
    let twice = [
        "convert",
        "rig.toml",
        "--out",
        "other/left.yaml",
        "--ros",
        "other",
    ];
    run(desk.folder.path(), &twice).failed(2, &["other/left.yaml", "twice"]);
}

#[test]
fn image_that_breaks_decoder_is_named() {
    let desk = super::folder::desk_with_views(&[super::folder::AT_REST; 3]);
    // 400000 x 400000 px, and a side of no pixels.
    let huge = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\x06\x1a\x80\0\x06\x1a\x80\x08\
                 \0\0\0\0\0\0\0\0\0\0\0\0IEND\xaeB\x60\x82";
    for bytes in [&huge[..], b"P5 0 1 255\n"] {
        desk.write("views/left/0001.pgm", bytes);
        let estimate = ["estimate", "views", "--rig", "rig.toml"];
        let outcome = run(desk.folder.path(), &estimate);
        assert_eq!(outcome.code, Some(1), "{}", outcome.stderr);
        assert!(
            outcome.stdout.contains("left/0001.pgm: "),
            "{}",
            outcome.stdout
        );
        assert!(!outcome.stderr.contains("panicked"), "{}", outcome.stderr);
        for command in [
            &["calibrate", "views", "--board", "9x6", "--square", "25"][..],
            &["bench", "flow", "views", "--rig", "rig.toml"],
        ] {
            let outcome = run(desk.folder.path(), command);
            outcome.failed_after_notes(1, &["0001.pgm"]);
        }
    }
}

#[test]
fn control_characters_are_not_printed() {
    let desk = Desk::new();
    let name = "a\u{1b}[2J\u{202e}.toml";
    for argument in [name, "\u{9b}31m"] {
        let outcome = run(desk.folder.path(), &["verify", argument]);
        assert_eq!(outcome.code, Some(1));
        let is_bad = |c: char| c.is_control() && c != '\n' || c == '\u{202e}';
        assert!(!outcome.stderr.contains(is_bad), "{:?}", outcome.stderr);
    }
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::process::{Command, Stdio};
    use trinocular_tests::binary::trinocular;

    #[test]
    fn endless_input_is_refused() {
        let desk = Desk::new();
        let zero = ["rig.toml", "points.csv", "camera.yml"];
        for file in zero {
            let _ = fs::remove_file(desk.path(file));
            std::os::unix::fs::symlink("/dev/zero", desk.path(file)).expect("ours");
        }
        for arguments in [
            &["verify", "rig.toml"][..],
            &["simulate", "rig.toml"],
            &["convert", "camera.yml", "camera.yml"],
            &["estimate", "rig.toml", "--rig", "rig.toml"],
        ] {
            run(desk.folder.path(), arguments).failed(1, &["is no regular file, but a device"]);
        }
    }

    #[test]
    fn pipe_is_read_up_to_limit() {
        let desk = Desk::new();
        let verify = |input: &str| {
            let mut writer = Command::new("sh");
            writer.args(["-c", input]).current_dir(desk.folder.path());
            let mut writer = writer.stdout(Stdio::piped()).spawn().expect("sh runs");
            let output = writer.stdout.take().expect("piped");
            let mut verify = trinocular();
            verify.args(["verify", "/dev/stdin"]).stdin(output);
            let outcome = trinocular_tests::binary::Outcome::of(&mut verify);
            // Dropping it closes the reading end, so the writer ends.
            drop(verify);
            let _ = writer.wait();
            outcome
        };
        assert_eq!(verify("cat rig.toml").code, Some(0));
        verify("yes").failed(1, &["/dev/stdin: longer than 1 MB"]);
    }

    #[test]
    fn report_to_stdout_joins_output() {
        let desk = Desk::new();
        let outcome = report(&desk, "/dev/stdout", &[]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        assert!(outcome.stdout.contains("</html>\n") && outcome.stdout.contains("note: "));
        assert_eq!(report(&desk, "/dev/null", &[]).code, Some(0));
        assert!(!fs::metadata("/dev/null").expect("it stays").is_file());
    }

    #[test]
    fn file_size_limit_leaves_no_file() {
        let desk = Desk::new();
        let names = fs::read_dir(desk.folder.path()).expect("ours").count();
        let program = trinocular().get_program().to_owned();
        let mut limited = Command::new("sh");
        limited.args([
            "-c",
            "ulimit -f 4; exec \"$0\" verify rig.toml --report a.html",
        ]);
        limited.arg(program).current_dir(desk.folder.path());
        let outcome = trinocular_tests::binary::Outcome::of(&mut limited);
        outcome.failed(1, &["a.html: cannot write: ", "ulimit"]);
        assert_eq!(
            fs::read_dir(desk.folder.path()).expect("ours").count(),
            names
        );
    }
}
