//! Three fake cameras, and what they say that they did.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tempfile::TempDir;
use trinocular_tests::binary::{c_library, interrupt};
use trinocular_vision::images::cameras::genicam::list;

/// Serial numbers of the cameras, by their addresses.
pub const SERIALS: [&str; 3] = ["GV01", "GV02", "GV03"];

/// Variable of the stand-in for network interfaces.
const VARIABLE: &str = "TRINOCULAR_LOOPBACK";

/// Returns true in a program that has the network interfaces of the fake cameras. Otherwise runs the
/// test `name` of this program again, in a program that has them, and returns false.
pub fn has_interfaces(name: &str) -> bool {
    if std::env::var_os(VARIABLE).is_some() {
        return true;
    }
    // Tests of one program have the same addresses, and take turns.
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    // Other runs of this program have other addresses.
    let [_, high, low, _] = std::process::id().to_be_bytes().map(|byte| byte.max(1));
    let [_, _, _, last] = std::process::id().to_be_bytes();
    let addresses =
        [0, 1, 2].map(|k| format!("127.{high}.{low}.{}", 1 + (u32::from(last) + k) % 254));
    let status = Command::new(std::env::current_exe().expect("the running test is a file"))
        .args([name, "--exact", "--include-ignored", "--nocapture"])
        .env(VARIABLE, addresses.join(","))
        .env("LD_PRELOAD", c_library("cameras"))
        .status();
    assert!(status.expect("the test starts").success(), "{name}");
    false
}

fn addresses() -> Vec<String> {
    let list = std::env::var(VARIABLE).expect("the interfaces");
    list.split(',').map(String::from).collect()
}

/// Running fake cameras.
pub struct Fakes {
    cameras: Vec<Option<Child>>,
    logs: TempDir,
}

impl Fakes {
    /// Starts three cameras that lose `lost` of 1000 packets, and waits until they answer.
    pub fn start(lost: u32) -> Self {
        let logs = tempfile::tempdir().expect("a folder");
        let cameras = SERIALS.iter().zip(addresses()).map(|(serial, address)| {
            let log = File::create(logs.path().join(serial)).expect("a file of ours");
            let camera = Command::new("arv-fake-gv-camera-0.8")
                .args(["-i", &address, "-s", serial, "-r", &lost.to_string()])
                .args(["-d", "stream-thread:2"])
                .stdin(Stdio::null())
                .stderr(log.try_clone().expect("the file"))
                .stdout(log)
                .spawn();
            Some(camera.expect("arv-fake-gv-camera-0.8 of the package aravis-tools"))
        });
        let fakes = Self {
            cameras: cameras.collect(),
            logs,
        };
        while list().len() < SERIALS.len() {
            std::thread::sleep(Duration::from_millis(50));
        }
        fakes
    }

    /// Ends one camera.
    pub fn end(&mut self, index: usize) {
        if let Some(mut camera) = self.cameras[index].take() {
            interrupt(&camera);
            camera.wait().expect("the camera ends");
        }
    }

    /// Ends all cameras and returns what each did.
    pub fn finish(mut self) -> Vec<Sent> {
        (0..SERIALS.len()).for_each(|index| self.end(index));
        let logs = SERIALS.iter().map(|serial| self.logs.path().join(serial));
        logs.map(|log| Sent::read(&fs::read_to_string(log).expect("a log")))
            .collect()
    }
}

impl Drop for Fakes {
    fn drop(&mut self) {
        (0..SERIALS.len()).for_each(|index| self.end(index));
    }
}

/// What a fake camera says that it sent.
#[derive(Debug, Default)]
pub struct Sent {
    /// Numbers of the images, in order.
    pub images: Vec<u64>,
    /// Numbers of the images of which a packet was withheld.
    pub broken: BTreeSet<u64>,
}

impl Sent {
    fn read(log: &str) -> Self {
        let mut sent = Self::default();
        let number = |text: &str| -> Option<u64> {
            let text = text.trim_start();
            let end = text
                .find(|c: char| !c.is_ascii_digit())
                .unwrap_or(text.len());
            text[..end].parse().ok()
        };
        for line in log.lines() {
            if let Some((_, rest)) = line.split_once("Send frame") {
                sent.images.extend(number(rest));
            } else if line.contains("Drop GVSP")
                && let Some((_, rest)) = line.split_once("frame:")
            {
                sent.broken.extend(number(rest));
            }
        }
        sent
    }
}
