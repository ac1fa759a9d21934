//! `trinocular twin`: a simulated station that other commands connect to.

#[path = "twin/triggered.rs"]
mod triggered;
#[path = "twin/view.rs"]
mod view;

use serde_json::Value;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, interrupt, signal, suspend, trinocular};

/// A heartbeat timeout that a busy test machine does not exceed.
const HEARTBEAT: [&str; 2] = ["--heartbeat", "5000"];

/// A running `trinocular twin`.
struct Twin {
    program: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
    /// Value of --port.
    port: String,
    folder: TempDir,
}

impl Drop for Twin {
    fn drop(&mut self) {
        // It has ended already, if the test did that.
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

impl Twin {
    fn start(options: impl FnOnce(&TempDir) -> Vec<String>) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let rig = trinocular()
            .args(["init", "rig.toml"])
            .stdin(Stdio::null())
            .current_dir(folder.path())
            .output()
            .expect("trinocular runs");
        assert!(rig.status.success(), "{rig:?}");
        let mut program = trinocular();
        program
            .arg("twin")
            .args(options(&folder))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut program = program.spawn().expect("trinocular runs");
        let mut output = BufReader::new(program.stdout.take().expect("it is piped"));
        let mut line = String::new();
        output.read_line(&mut line).expect("it says where it is");
        let port = line.strip_prefix("station simulated on ");
        let port = port
            .and_then(|rest| rest.split(';').next())
            .expect("a port");
        Self {
            input: program.stdin.take(),
            output,
            port: port.to_owned(),
            program,
            folder,
        }
    }

    fn on_link() -> Self {
        Self::start(|folder| {
            let link = folder.path().join("station");
            vec!["--link".to_owned(), link.display().to_string()]
        })
    }

    fn run(&self, words: &str) -> Outcome {
        let mut command = trinocular();
        command
            .args(words.split_whitespace())
            .args(["--port", &self.port])
            .current_dir(self.folder.path());
        Outcome::of(&mut command)
    }

    fn good(&self, words: &str) -> String {
        let done = self.run(words);
        assert_eq!(done.code, Some(0), "{words}: {}", done.stderr);
        done.stdout
    }

    fn order(&mut self, order: &str) {
        let input = self.input.as_mut().expect("it is open");
        writeln!(input, "{order}").expect("it reads");
    }

    /// Returns the line that the twin prints next.
    fn says(&mut self) -> String {
        let mut line = String::new();
        self.output.read_line(&mut line).expect("it speaks UTF-8");
        line
    }
}

#[test]
fn every_command_by_hand_works() {
    let mut twin = Twin::on_link();
    assert!(twin.good("hello").contains("twin"));
    let jog = format!("jog x=5 y=-2 --rig rig.toml {}", HEARTBEAT.join(" "));
    twin.good(&jog);
    twin.order("where");
    assert!(twin.says().starts_with("stage at 5.0000 -2.0000 0.0000 mm"));
    twin.good("zero");
    twin.good("motors off");
    twin.good("motors on");
    twin.good("stop");
    assert!(twin.good("status").contains("stopped"));
    twin.good("reset");
}

#[test]
fn pressed_button_is_a_fault() {
    let mut twin = Twin::on_link();
    twin.order("press");
    twin.order("where");
    twin.says();
    // The station senses the button within a control tick of the order.
    let status = twin.run("status");
    assert_eq!(status.code, Some(3), "{}", status.stdout);
    assert!(
        status.stdout.contains("emergency stop"),
        "{}",
        status.stdout
    );
    twin.order("release");
    twin.order("where");
    twin.says();
    twin.good("reset");
    twin.good("status");
}

#[test]
fn restart_is_noticed() {
    let mut twin = Twin::on_link();
    let jog = format!("jog x=1 --rig rig.toml {}", HEARTBEAT.join(" "));
    twin.good(&jog);
    twin.order("restart");
    twin.order("where");
    // The stage stays where it is.
    assert!(twin.says().starts_with("stage at 1.0000 0.0000 0.0000 mm"));
    let refused = twin.run("jog x=1");
    assert_eq!(refused.code, Some(3), "{}", refused.stderr);
    assert!(
        refused.stderr.contains("no configuration"),
        "{}",
        refused.stderr
    );
}

/// A station that was up for longer than the patience of a command counts its ticks from zero again.
#[test]
fn restart_in_motion_is_no_success() {
    let mut twin = Twin::on_link();
    std::thread::sleep(Duration::from_secs(5));
    let heartbeat = HEARTBEAT.join(" ");
    twin.good(&format!("zero --rig rig.toml {heartbeat}"));
    let words = format!("jog x=40 --rig rig.toml {heartbeat} --port {}", twin.port);
    let mut jog = trinocular();
    jog.args(words.split_whitespace())
        .current_dir(twin.folder.path());
    let jog = jog
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it runs");
    loop {
        twin.order("where");
        if !twin.says().starts_with("stage at 0.0000") {
            break;
        }
    }
    twin.order("restart");
    let done = jog.wait_with_output().expect("it ends");
    let text = String::from_utf8(done.stderr).expect("UTF-8");
    assert_eq!(done.status.code(), Some(3), "{text}");
    assert!(text.contains("restarted"), "{text}");
    assert!(!text.contains("on its ramp"), "{text}");
    // The station counts from zero again: a distance would be false.
    let said = String::from_utf8(done.stdout).expect("UTF-8");
    assert!(said.contains("an unknown distance"), "{said}");
    // A stop reaches the restarted station.
    twin.good("stop");
}

#[test]
fn tcp_serves_one_program_after_another() {
    let twin = Twin::start(|_| vec!["--tcp".to_owned(), "127.0.0.1:0".to_owned()]);
    assert!(twin.port.starts_with("tcp://127.0.0.1:"), "{}", twin.port);
    let jog = format!("jog x=1 --rig rig.toml {}", HEARTBEAT.join(" "));
    twin.good(&jog);
    assert!(twin.good("status").contains("80 0 0 steps"));
}

/// Starts a twin with the paper's cameras and a target on this path.
fn bench(path: &str) -> Twin {
    Twin::start(|folder| {
        let mut rig = RigFile::paper();
        rig.stage = Some(default_stage());
        std::fs::write(folder.path().join("bench.toml"), rig.to_toml()).expect("it is ours");
        let place = |name: &str| folder.path().join(name).display().to_string();
        let (link, rig) = (place("station"), place("bench.toml"));
        let options = [
            "--link",
            &link,
            "--with-target",
            "--path",
            path,
            "--rig",
            &rig,
        ];
        options.map(str::to_owned).to_vec()
    })
}

#[test]
fn live_cameras_calibrate_stage() {
    let twin = bench("still");
    let heartbeat = HEARTBEAT.join(" ");
    twin.good(&format!("zero --rig bench.toml {heartbeat}"));
    let words = format!("calibrate-stage --cameras twin --rig bench.toml --json {heartbeat}");
    let found = &twin.run(&words).good_json()[0];
    for axis in 0..3 {
        for column in 0..3 {
            let is = found["fit"]["matrix"][axis][column]
                .as_f64()
                .expect("a number");
            let sigma = found["fit"]["sigma"][axis][column]
                .as_f64()
                .expect("a number");
            let wanted = f64::from(u8::from(axis == column));
            assert!(
                (is - wanted).abs() < 5.0 * sigma,
                "{axis} {column}: {is} +- {sigma}"
            );
        }
    }
    // A busy computer holds up the simulated station, so that the delay is of that computer.
    assert!(found["delay"]["delay_ms"].is_number(), "{found}");
}

/// The whole bench: cameras, target and station are simulated in one program, and followed by
/// another.
#[test]
fn simulated_cameras_follow_target() {
    let mut twin = bench("line");
    let words = format!(
        "track --cameras twin --rig bench.toml --json --seconds 6 {}",
        HEARTBEAT.join(" ")
    );
    let done = twin.run(&words);
    let rows = done.good_json();
    let stage_mm = |row: &serde_json::Value| row["stage_mm"][0].as_f64();
    let moved_mm = rows.last().and_then(stage_mm).expect("a row");
    // At (4, 4, 1) / sqrt(33) times 5 mm/s from some moment on; the busiest computer sees a second.
    assert!(
        (1.0..40.0).contains(&moved_mm),
        "{moved_mm}: {}",
        done.stderr
    );
    assert!(
        rows.iter().any(|row| row["displacement_mm"].is_array()),
        "{}",
        done.stderr
    );
    twin.order("where");
    let says = twin.says();
    let pins_mm = says
        .strip_prefix("stage at ")
        .and_then(|rest| rest.split(' ').next());
    let pins_mm: f64 = pins_mm.and_then(|x| x.parse().ok()).expect("a position");
    assert!((pins_mm - moved_mm).abs() < 10.0, "{pins_mm}");
}

/// Returns the state of the page at `address`.
fn state(address: &str) -> Value {
    let mut stream = TcpStream::connect(address).expect("it is served");
    let request =
        format!("GET /state.json HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("it reads");
    let answer = std::io::read_to_string(stream).expect("UTF-8");
    let (_, body) = answer.split_once("\r\n\r\n").expect("a body");
    serde_json::from_str(body).expect("JSON")
}

/// A reader that is suspended or slow loses images, and counts them; it keeps its cameras.
#[test]
fn suspended_reader_loses_images_only() {
    let mut twin = bench("still");
    let mut serve = trinocular();
    serve
        .args([
            "serve",
            "--cameras",
            &format!("twin:{}", twin.port),
            "--rig",
            "bench.toml",
        ])
        .args(["--listen", "127.0.0.1:0"])
        .current_dir(twin.folder.path())
        .stderr(Stdio::piped());
    let mut serve = serve.spawn().expect("it runs");
    let mut lines = BufReader::new(serve.stderr.take().expect("piped")).lines();
    let mut lines = lines.by_ref().map_while(Result::ok);
    let address = lines.find_map(|line| Some(line.split_once("http://")?.1.to_owned()));
    let address = address.expect("the page's address");
    let address = address.trim_end_matches('/');
    let turns = |state: &Value| state["turns"].as_u64().unwrap_or(0);
    let reaches = |what: &str, wanted: &dyn Fn(&Value) -> bool| {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let state = state(address);
            if wanted(&state) {
                return turns(&state);
            }
            assert!(Instant::now() < end, "{what}: {state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    reaches("the first images", &|state| turns(state) > 5);
    reaches("a position", &|state| {
        state["latest"]["stage_mm"][2].is_number()
    });
    suspend(&serve);
    // Longer than the 3 s for which a program waits for images.
    std::thread::sleep(Duration::from_millis(3_500));
    signal(&serve, "CONT");
    let lost = |state: &Value| {
        let drops = state["drops"].as_array().into_iter().flatten();
        let drops: Vec<_> = drops
            .map(|camera| camera["lost by the driver"].as_u64())
            .collect();
        drops.len() == 3 && drops.iter().all(|lost| lost >= &Some(10))
    };
    let after = reaches("the loss is counted", &lost);
    reaches("images go on", &|state| turns(state) > after + 10);
    // The end of the twin is named as what it is.
    twin.program.kill().expect("it runs");
    twin.program.wait().expect("it ended");
    let rest: Vec<String> = lines.collect();
    assert_eq!(serve.wait().expect("it ends").code(), Some(1), "{rest:?}");
    let rest = rest.join("\n");
    assert!(rest.contains("its program has ended"), "{rest}");
    assert!(!rest.contains("unexpected end"), "{rest}");
}

#[test]
fn absent_twin_is_named() {
    let mut track = trinocular();
    let folder = tempfile::tempdir().expect("a folder");
    let rig = folder.path().join("rig.toml");
    std::fs::write(&rig, RigFile::paper().to_toml()).expect("it is ours");
    track
        .args(["track", "--cameras", "twin:/no/twin", "--rig"])
        .arg(&rig);
    Outcome::of(&mut track).failed(1, &["twin:/no/twin", "trinocular twin --with-target"]);
}

#[test]
fn second_twin_on_a_link_is_refused() {
    let mut twin = Twin::on_link();
    let second = trinocular()
        .args(["twin", "--link", &twin.port])
        .stdin(Stdio::null())
        .output()
        .expect("trinocular runs");
    let text = String::from_utf8_lossy(&second.stderr).into_owned();
    assert_eq!(second.status.code(), Some(1), "{text}");
    assert!(
        text.contains("--link") && text.contains(&twin.port),
        "{text}"
    );
    // A crash leaves the link, which the next twin replaces.
    twin.program.kill().expect("it runs");
    twin.program.wait().expect("it ended");
    assert!(std::fs::symlink_metadata(&twin.port).is_ok());
    let mut next = trinocular();
    next.args(["twin", "--link", &twin.port]);
    let mut next = next
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it runs");
    let mut line = String::new();
    let mut output = BufReader::new(next.stdout.take().expect("it is piped"));
    output.read_line(&mut line).expect("it says where it is");
    assert!(twin.good("hello").contains("twin"));
    interrupt(&next);
    assert_eq!(next.wait().expect("it ends").code(), Some(0));
    assert!(
        std::fs::symlink_metadata(&twin.port).is_err(),
        "the link is removed"
    );
}

#[test]
fn link_in_the_way_is_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "mine").expect("it is ours");
    let mut twin = trinocular();
    twin.arg("twin")
        .arg("--link")
        .arg(&file)
        .stdin(Stdio::null());
    Outcome::of(&mut twin).failed(1, &["notes.txt", "--link"]);
    assert_eq!(std::fs::read_to_string(&file).expect("it is there"), "mine");
    let files = std::fs::read_dir(folder.path()).expect("it is ours");
    assert_eq!(files.count(), 1, "no lock is left behind");
}

#[test]
fn link_of_the_user_is_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "mine").expect("it is ours");
    for (name, target) in [("link", file.as_path()), ("device", "/dev/null".as_ref())] {
        let link = folder.path().join(name);
        std::os::unix::fs::symlink(target, &link).expect("a link");
        let mut twin = trinocular();
        twin.arg("twin")
            .arg("--link")
            .arg(&link)
            .stdin(Stdio::null());
        Outcome::of(&mut twin).failed(1, &[name, "--link"]);
        assert_eq!(std::fs::read_link(&link).expect("it is there"), target);
    }
}

#[test]
fn station_goes_on_without_orders() {
    let mut twin = Twin::on_link();
    twin.order("dance");
    drop(twin.input.take());
    twin.good("hello");
    interrupt(&twin.program);
    assert_eq!(twin.program.wait().expect("it ends").code(), Some(0));
}

/// The pseudo-terminal behind the link of a killed twin may be another program's by now.
#[test]
fn link_of_killed_twin_is_not_opened() {
    let mut twin = Twin::on_link();
    twin.good("status");
    twin.program.kill().expect("it runs");
    twin.program.wait().expect("it ends");
    let outcome = twin.run("stop");
    outcome.failed(1, &["has crashed", "run `trinocular twin` again"]);
    // The next twin takes the link over.
    let link = twin.port.clone();
    let next = Twin::start(|_| vec!["--link".to_owned(), link]);
    next.good("status");
}

#[test]
fn jog_ends_when_its_twin_is_killed() {
    let mut twin = Twin::on_link();
    let jog = trinocular()
        .args(["jog", "x=-8", "--port", &twin.port, "--rig", "rig.toml"])
        .args(HEARTBEAT)
        .current_dir(twin.folder.path())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    loop {
        twin.order("where");
        if !twin.says().starts_with("stage at 0.0000") {
            break;
        }
    }
    twin.program.kill().expect("it runs");
    let outcome = jog.wait_with_output().expect("it ends");
    let text = String::from_utf8(outcome.stderr).expect("UTF-8");
    assert_eq!(outcome.status.code(), Some(3), "{text}");
    for part in [twin.port.as_str(), "not opened again"] {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}
