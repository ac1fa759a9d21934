//! `init`, `completions`, `man` and `--version`.

use super::run;
use tempfile::tempdir;

#[test]
fn init_writes_rig_that_verify_accepts() {
    let folder = tempdir().expect("a folder");
    let folder = folder.path();
    let written = run(folder, &["init", "--defaults"]);
    assert_eq!(written.code, Some(0), "{written:?}");
    assert_eq!(written.stdout, "next: trinocular verify rig.toml\n");
    let verified = run(folder, &["verify", "rig.toml"]);
    assert!(verified.stdout.contains("The stage"), "{verified:?}");
    let before = std::fs::read_to_string(folder.join("rig.toml")).expect("it was written");
    let again = run(folder, &["init", "--steps-per-mm", "160"]);
    assert_eq!(again.code, Some(1));
    assert!(again.stderr.contains("--force"), "{}", again.stderr);
    let after = std::fs::read_to_string(folder.join("rig.toml")).expect("it stays");
    assert_eq!(after, before);
}

#[test]
fn init_refuses_wrong_values() {
    let folder = tempdir().expect("a folder");
    let values = "init - --board skr-2 --cameras left,right --size 320x240 --focal 500 \
                  --baseline 12.5 --steps-per-mm 80,80,400 --travel -5,80 --driver a4988";
    let values: Vec<&str> = values.split_whitespace().collect();
    let written = run(folder.path(), &values);
    for line in [
        "offset_mm = [-6.25, 0.0]",
        "steps_per_mm = [80.0, 80.0, 400.0]  # micro steps included",
        "travel_mm = [[-5.0, 80.0], [-5.0, 80.0], [-5.0, 80.0]]  # soft limits from zero",
    ] {
        assert!(written.stdout.lines().any(|l| l == line), "{line}");
    }
    for wrong in [
        ["--size", "640"],
        ["--focal", "-5"],
        ["--cameras", "one"],
        ["--steps-per-mm", "0"],
        ["--travel", "5,-5"],
        ["--driver", "L298"],
    ] {
        let refused = run(folder.path(), &["init", "-", wrong[0], wrong[1]]);
        assert_eq!(refused.code, Some(2), "{wrong:?}");
        assert!(refused.stdout.is_empty(), "{wrong:?}");
    }
    let same = run(folder.path(), &["init", "-", "--cameras", "a,a"]);
    assert_eq!(same.code, Some(1), "{same:?}");
}

#[test]
fn missing_fields_are_named_together() {
    let folder = tempdir().expect("a folder");
    let text = "image_size_px = [640, 480]\n[[camera]]\nname = \"left\"\n[[camera]]\n";
    std::fs::write(folder.path().join("rig.toml"), text).expect("it is ours");
    let refused = run(folder.path(), &["verify", "rig.toml"]);
    assert_eq!(refused.code, Some(1));
    assert!(
        refused.stderr.contains("rig.toml:2: "),
        "{}",
        refused.stderr
    );
    for field in ["focal_px = ", "principal_px = ", "offset_mm = "] {
        assert!(refused.stderr.contains(field), "{}", refused.stderr);
    }
}

#[test]
fn completions_list_all_options() {
    let folder = tempdir().expect("a folder");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let printed = run(folder.path(), &["completions", shell]);
        for word in ["calibrate-stage", "heartbeat"] {
            assert!(printed.stdout.contains(word), "{shell}: {word}");
        }
    }
}

#[test]
fn manual_has_page_per_command() {
    let folder = tempdir().expect("a folder");
    assert_eq!(run(folder.path(), &["man", "pages/man1"]).code, Some(0));
    for page in [
        "trinocular.1",
        "trinocular-jog.1",
        "trinocular-track.1",
        "trinocular-bench-flow.1",
        "trinocular-bench-pose.1",
        "trinocular-bench-robustness.1",
    ] {
        let text = std::fs::read_to_string(folder.path().join("pages/man1").join(page));
        assert!(text.expect(page).contains(".SH SYNOPSIS"), "{page}");
    }
    assert_eq!(run(folder.path(), &["man", "pages/man1"]).code, Some(1));
}

#[test]
fn version_names_commit_and_protocol() {
    let folder = tempdir().expect("a folder");
    let long = run(folder.path(), &["--version"]);
    let keys: Vec<_> = long
        .stdout
        .lines()
        .filter_map(|l| l.split("  ").next())
        .collect();
    assert_eq!(&keys[1..], ["commit", "protocol", "features"]);
    let short = run(folder.path(), &["-V"]);
    assert_eq!(short.stdout.lines().count(), 1);
}
