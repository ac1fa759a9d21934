//! Simulated time: the same images on every computer.

use super::{LIMIT_MS, desk, number, run, written_ms};
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::{Care, RigFile};

/// Three cameras with delays of their own, over distances, textures and noise.
#[test]
fn delays_are_found_within_the_limit() {
    let desk = desk();
    for (more, truth_ms) in [
        ("--seed 1", [4.0, 7.5, 12.0]),
        ("--seed 2", [0.0, 0.0, 0.0]),
        ("--seed 3 --depth 1500", [-30.0, 33.3, 150.0]),
        ("--seed 4 --texture blobs --noise 5", [16.7, 1.0, -8.0]),
        ("--seed 5 --tilt 20 15 --reach 10", [280.0, -95.0, 60.0]),
    ] {
        let given = truth_ms.map(|ms| ms.to_string()).join(",");
        let words =
            format!("latency --sim --rig rig.toml --fps 60 --camera-delay={given} {more} --json");
        let found = &run(desk.path(), &words).good_json()[0];
        let cameras = found["cameras"].as_array().expect("cameras");
        assert_eq!(cameras.len(), 3, "{found}");
        for (camera, truth_ms) in cameras.iter().zip(truth_ms) {
            let off_ms = number(camera, "delay_ms") - truth_ms;
            let sigma_ms = number(camera, "sigma_ms");
            println!("{more}: {truth_ms} ms, off by {off_ms:.4} ± {sigma_ms:.4} ms");
            assert!(off_ms.abs() < LIMIT_MS, "{more}: {camera}");
            assert!(off_ms.abs() < 4.5 * sigma_ms, "{more}: {camera}");
            assert!(sigma_ms < LIMIT_MS / 2.0, "{more}: {camera}");
        }
        // The simulated cameras are exposed together.
        assert!(
            cameras[1..]
                .iter()
                .all(|camera| number(camera, "apart_ms") < 0.3)
        );
    }
}

#[test]
fn delays_are_written_and_compared() {
    let desk = desk();
    let rig = desk.path().join("rig.toml");
    let sim = "latency --sim --rig rig.toml --fps 60";
    let done = run(
        desk.path(),
        &format!("{sim} --camera-delay=4,7.5,-12 --out rig.toml --force"),
    );
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    assert!(
        done.stdout.contains("The delays differ by 19.5"),
        "{}",
        done.stdout
    );
    assert!(
        done.stdout.contains("Delays written to rig.toml."),
        "{}",
        done.stdout
    );
    assert_eq!(done.stderr, "");
    let text = std::fs::read_to_string(&rig).expect("it was written");
    assert!(text.starts_with("# our bench\n"), "{text}");
    let delays_ms = written_ms(&rig);
    assert_eq!(delays_ms.len(), 3);
    for (delay_ms, truth_ms) in delays_ms.iter().zip([4.0, 7.5, -12.0]) {
        let delay_ms = delay_ms.expect("a delay");
        assert!((delay_ms - truth_ms).abs() < LIMIT_MS, "{delay_ms} ms");
    }
    // The simulation has the rig file's delays unless it gets others.
    let same = run(desk.path(), sim);
    assert_eq!((same.code, same.stderr.as_str()), (Some(0), ""));
    assert!(!same.stdout.contains("differ"), "{}", same.stdout);
    let changed = run(desk.path(), &format!("{sim} --camera-delay=4,9,-12 --json"));
    let found = &changed.good_json()[0];
    let warning = changed.stderr.as_str();
    assert!(
        warning.starts_with("warning: `middle` has a delay of "),
        "{warning}"
    );
    assert!(warning.contains("but the rig file says 7."), "{warning}");
    assert_eq!(warning.lines().count(), 1, "{warning}");
    let flags = found["cameras"].as_array().expect("cameras").iter();
    let flags: Vec<_> = flags.map(|camera| camera["changed"].as_bool()).collect();
    assert_eq!(flags, [Some(false), Some(true), Some(false)]);
    assert!(
        found["warnings"][0]
            .as_str()
            .is_some_and(|it| it.contains("`middle`")),
        "{found}"
    );
}

#[test]
fn impossible_runs_are_refused() {
    let desk = desk();
    let mut rig = RigFile::paper();
    std::fs::write(desk.path().join("cameras.toml"), rig.to_toml()).expect("it is ours");
    let mut short = default_stage();
    short.travel_mm[1] = [-3.0, 9.0];
    short.care = Care::default();
    rig.stage = Some(short);
    std::fs::write(desk.path().join("short.toml"), rig.to_toml()).expect("it is ours");
    let before = std::fs::read_to_string(desk.path().join("rig.toml")).expect("it is ours");
    for (words, code, part) in [
        ("--sim", 2, "--rig"),
        ("--rig rig.toml", 2, "--sim"),
        ("--rig rig.toml --port /dev/no-such-port", 2, "--cameras"),
        ("--sim --rig rig.toml --cameras twin", 2, "--sim"),
        (
            "--sim --rig rig.toml --reach 0",
            2,
            "--reach is 0, must be 0.1 to 100",
        ),
        (
            "--sim --rig rig.toml --fps 1",
            2,
            "--fps is 1, must be 5 to 200",
        ),
        (
            "--sim --rig rig.toml --camera-delay 400",
            2,
            "must be -100 to 300",
        ),
        (
            "--sim --rig rig.toml --camera-delay 1,2",
            2,
            "left, middle, right",
        ),
        ("--sim --rig rig.toml --noise 999", 2, "--noise is 999"),
        ("--sim --rig cameras.toml", 1, "[stage]"),
        ("--sim --rig rig.toml --out rig.toml", 1, "rig.toml"),
        ("--sim --rig short.toml", 2, "soft limits are -3 to 9 mm"),
        ("--sim --rig rig.toml --texture bricks", 1, "cannot be used"),
        (
            "--sim --rig rig.toml --reach 0.1",
            1,
            "camera `left`: its image moves by",
        ),
        ("--sim --rig rig.toml --fps 5", 1, "images per second"),
        (
            "--rig rig.toml --port /dev/no-such-port --cameras twin:/no/twin",
            1,
            "trinocular twin --with-target",
        ),
    ] {
        let done = run(desk.path(), &format!("latency {words}"));
        assert_eq!(done.code, Some(code), "{words}: {}", done.stderr);
        assert!(done.stderr.contains(part), "{words}: {}", done.stderr);
        assert_eq!(done.stdout, "", "{words}");
    }
    let after = std::fs::read_to_string(desk.path().join("rig.toml")).expect("it is there");
    assert_eq!(after, before);
}
