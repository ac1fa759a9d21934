//! The pages of recordings and of runs: they are whole, hold the recording's numbers, and mark its
//! events at their times.

use std::fs;
use std::path::Path;
use trinocular_tests::binary::{Outcome, trinocular};

fn run(folder: &Path, arguments: &[&str]) -> Outcome {
    Outcome::of(trinocular().args(arguments).current_dir(folder))
}

fn done(folder: &Path, arguments: &[&str]) -> Outcome {
    let outcome = run(folder, arguments);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    outcome
}

fn page(folder: &Path, name: &str) -> String {
    let page = fs::read_to_string(folder.join(name)).expect("the page");
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    let outside = page
        .replace("http://www.w3.org/2000/svg", "")
        .replace("href=\"#", "")
        .replace("href=\"data:image/jpeg;base64,", "");
    for request in ["http", "src=", "href=", "url(", "@import", "fetch("] {
        assert!(!outside.contains(request), "{request}");
    }
    assert!(page.contains("(prefers-color-scheme:dark)"));
    for id in page
        .split("href=\"#")
        .skip(1)
        .filter_map(|rest| rest.split('"').next())
    {
        assert_eq!(page.matches(&format!(" id=\"{id}\"")).count(), 1, "{id}");
    }
    page
}

/// Returns the text of the first table to copy.
fn table(page: &str) -> String {
    let text = page.split("<pre>\n").nth(1).expect("a text to copy");
    let text = text.split("</pre>").next().unwrap_or_default();
    text.replace("&quot;", "\"").replace("&#39;", "'")
}

/// Returns the rows of the table of events: letter, start, end, and text.
fn events(page: &str) -> Vec<[String; 4]> {
    let section = page.split("id=\"events\"").nth(1).expect("events");
    let body = section.split("</tbody>").next().unwrap_or_default();
    let rows = body.split("<tr>").skip(2).map(|row| {
        let cell = |cell: &str| {
            let text = cell.split("</td>").next().unwrap_or_default();
            text.split_once('>').map_or("", |(_, text)| text).to_owned()
        };
        let cells: Vec<String> = row.split("<td").skip(1).map(cell).collect();
        [0, 1, 2, 4].map(|i| cells.get(i).cloned().unwrap_or_default())
    });
    rows.collect()
}

fn has_event(page: &str, letter: &str, at_s: f64, text: &str) -> bool {
    events(page).iter().any(|[kind, from_s, _, event]| {
        let near = |from_s: f64| (from_s - at_s).abs() < 0.03;
        kind == letter && from_s.parse().is_ok_and(near) && event.contains(text)
    })
}

fn scenario(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios");
    folder.join(name).display().to_string()
}

#[test]
fn page_of_recording_equals_that_of_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let track = ["track", "--sim", "--seconds", "1.2", "--json"];
    let outputs = ["--record", "run.mcap", "--report", "live.html"];
    let rows = run(folder, &[&track[..], &outputs].concat()).good_json();
    let summary = run(folder, &["report", "run.mcap", "--json"]).good_json();
    assert_eq!(summary[0]["report"], "run.html");
    assert_eq!(summary[0]["kind"], "run");
    assert_eq!(summary[0]["frames"], rows.len());
    done(folder, &["export", "run.mcap", "--csv", "run.csv"]);
    let csv = fs::read_to_string(folder.join("run.csv")).unwrap();
    let (recorded, live) = (page(folder, "run.html"), page(folder, "live.html"));
    assert_eq!(table(&recorded), csv);
    assert_eq!(table(&live), csv);
    for page in [&recorded, &live] {
        for part in [
            "Error X, stage - target",
            "X of target and stage",
            "± 1 sigma",
            "data-scene=",
            "<image ",
            "class=\"now\"",
            std::env::consts::ARCH,
            "track --sim --seconds 1.2",
            "[[camera]]",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(
            has_event(page, "S", 0.04, "Following"),
            "{:?}",
            events(page)
        );
    }
}

#[test]
fn occlusion_is_marked_where_it_happened() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let file = scenario("occlusion.toml");
    let outputs = ["--record", "run.mcap", "--report", "live.html"];
    done(folder, &[&["simulate", &file], &outputs[..]].concat());
    done(folder, &["report", "run.mcap"]);
    let recorded = page(folder, "run.html");
    assert!(has_event(&recorded, "R", 3.0, "30 frame sets not used"));
    // The station tells it with its next status.
    assert!(
        has_event(&recorded, "O", 3.2, "coasting"),
        "{:?}",
        events(&recorded)
    );
    let live = page(folder, "live.html");
    assert!(has_event(&live, "R", 3.0, "30 frame sets not used"));
    assert!(
        has_event(&live, "O", 3.0, "even grey"),
        "{:?}",
        events(&live)
    );
    // The pictures show the first frame set that was refused.
    assert!(live.contains("not used: lost") && live.contains(">true</text>"));
}

#[test]
fn switches_and_faults_are_marked_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let file = scenario("switches.toml");
    let outputs = ["--record", "run.mcap", "--report", "live.html"];
    done(folder, &[&["simulate", &file], &outputs[..]].concat());
    done(folder, &["report", "run.mcap"]);
    for name in ["run.html", "live.html"] {
        let page = page(folder, name);
        assert!(
            has_event(&page, "L", 1.0, "positive limit switch of X"),
            "{name}"
        );
        assert!(has_event(&page, "F", 1.0, "limit switch was met"), "{name}");
        assert!(has_event(&page, "L", 2.5, "emergency stop open"), "{name}");
        assert!(has_event(&page, "F", 2.5, "fault 1"), "{name}");
    }
}

#[test]
fn cut_recording_is_reported_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let record = ["track", "--sim", "--seconds", "2", "--record", "run.mcap"];
    done(folder, &record);
    let bytes = fs::read(folder.join("run.mcap")).unwrap();
    fs::write(folder.join("cut.mcap"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let outcome = run(folder, &["report", "cut.mcap", "--json"]);
    assert!(
        outcome.stderr.contains("cut.mcap: is cut off at byte"),
        "{}",
        outcome.stderr
    );
    let summary = outcome.good_json().remove(0);
    let frames = summary["frames"].as_u64();
    assert!(frames > Some(40) && frames < Some(110), "{summary}");
    assert!(
        summary["cut"]
            .as_str()
            .is_some_and(|cut| cut.contains("cut off"))
    );
    assert!(page(folder, "cut.html").contains("The end of the run is missing"));
    // Before the first frame set there is nothing to report.
    fs::write(folder.join("cut.mcap"), &bytes[..9_000]).unwrap();
    let outcome = run(folder, &["report", "cut.mcap", "--out", "none.html"]);
    outcome.failed_after_notes(1, &["cut.mcap: holds no measurement"]);
    assert!(!folder.join("none.html").exists());
}

/// Makes a recording foreign: its origin has another name.
fn estranged(recording: &Path) -> Vec<u8> {
    let mut bytes = fs::read(recording).unwrap();
    let name = b"\x0a\0\0\0trinocular";
    let at = bytes.windows(name.len()).position(|part| part == name);
    let at = at.expect("the origin");
    bytes[at + name.len() - 1] = b'x';
    bytes
}

#[test]
fn foreign_recording_shows_its_images() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let record = ["track", "--sim", "--seconds", "0.3", "--record"];
    done(folder, &[&record[..], &["own.mcap"]].concat());
    fs::write(
        folder.join("other.mcap"),
        estranged(&folder.join("own.mcap")),
    )
    .unwrap();
    let outcome = run(folder, &["report", "other.mcap", "--json"]);
    assert!(
        outcome.stderr.contains("topics and images"),
        "{}",
        outcome.stderr
    );
    let summary = outcome.good_json().remove(0);
    assert_eq!(
        (&summary["kind"], &summary["frames"]),
        (&"images".into(), &0.into())
    );
    let page = page(folder, "other.html");
    assert!(page.contains("/left/image_raw") && page.matches("<image ").count() == 12);
    // Without images there is nothing to show.
    let no_images = ["blind.mcap", "--record-images", "none"];
    done(folder, &[&record[..], &no_images].concat());
    fs::write(
        folder.join("blind.mcap"),
        estranged(&folder.join("blind.mcap")),
    )
    .unwrap();
    let outcome = run(folder, &["report", "blind.mcap"]);
    outcome.failed(
        1,
        &[
            "blind.mcap: is no recording of this program",
            "no topic has images",
        ],
    );
}

#[test]
fn report_of_bad_input_names_file_and_reason() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(folder, &["report", "none.mcap"]).failed(1, &["none.mcap"]);
    fs::write(folder.join("text.mcap"), "no recording").unwrap();
    run(folder, &["report", "text.mcap"]).failed(1, &["text.mcap: is no MCAP file"]);
    assert!(!folder.join("text.html").exists());
    let record = ["track", "--sim", "--seconds", "0.3", "--record", "run.mcap"];
    done(
        folder,
        &[&record[..], &["--record-images", "none"]].concat(),
    );
    fs::write(folder.join("run.html"), "a page of another program").unwrap();
    let outcome = run(folder, &["report", "run.mcap"]);
    outcome.failed(1, &["run.html: exists", "--force"]);
    done(folder, &["report", "run.mcap", "--force"]);
    // Its own page is replaced without a question.
    done(folder, &["report", "run.mcap"]);
    let outcome = run(
        folder,
        &["report", "run.mcap", "--out", "run.mcap", "--force"],
    );
    outcome.failed(1, &["run.mcap: is an input of this command"]);
    let same = ["--record", "a", "--report", "a"];
    let outcome = run(
        folder,
        &[&["track", "--sim", "--seconds", "0.3"], &same[..]].concat(),
    );
    outcome.failed(2, &["--report and --record must be different files"]);
    run(folder, &["track", "--sim", "--force"]).failed(2, &["--force goes with"]);
}
