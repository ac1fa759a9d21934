//! The station in QEMU: builds the image, starts the emulator, and ends it in every case.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use trinocular_core::replay::Record;

const QEMU: &str = "qemu-system-arm";

/// Returns the image, built by the compiler that `embedded-toolchain.sh` finds.
pub fn image() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| {
        let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
        let build = ". tests/embedded-toolchain.sh && embedded_cargo build --release --locked \
                     --manifest-path tests/qemu/Cargo.toml --target-dir tests/qemu/target";
        let status = Command::new("bash")
            .args(["-c", build])
            .current_dir(tests.join(".."))
            .status()
            .expect("bash runs");
        assert!(status.success(), "the image for QEMU could not be built");
        tests.join("qemu/target/thumbv7em-none-eabihf/release/station-qemu")
    })
}

/// Reads the step pins of a finished station from its trace: steps since the start, and rising
/// edges per axis.
pub fn pins(trace: &Path) -> ([i64; 3], [u64; 3]) {
    let bytes = std::fs::read(trace).expect("the image wrote its trace");
    let mut rest = &bytes[..];
    let (mut rises, mut steps) = ([0; 3], [0; 3]);
    while let Some(record) = Record::read(&mut rest) {
        let Record::Digest(_, digest) = record else {
            continue;
        };
        steps = digest.steps.map(i64::from);
        for (sum, count) in rises.iter_mut().zip(digest.edges.rises) {
            *sum += u64::from(count);
        }
    }
    (steps, rises)
}

/// A running emulator. Dropping the value ends it.
pub struct Emulator {
    process: Child,
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Result of an emulator that has ended.
pub struct Ended {
    /// True if the image exited with 0.
    pub success: bool,
    /// Standard output of the emulator.
    pub output: String,
}

impl Emulator {
    fn start(machine: &[&str], arguments: &[OsString]) -> Self {
        let mut semihosting = OsString::from("enable=on,target=native");
        for argument in arguments {
            semihosting.push(",arg=");
            semihosting.push(argument);
        }
        let process = Command::new(QEMU)
            .args(["-M", "mps2-an386", "-display", "none", "-monitor", "none"])
            .args(machine)
            .arg("-semihosting-config")
            .arg(semihosting)
            .arg("-kernel")
            .arg(image())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap_or_else(|cause| {
                panic!("{QEMU} does not start ({cause}): apt-get install qemu-system-arm")
            });
        Self { process }
    }

    /// Runs the image with these arguments to its end.
    ///
    /// # Panics
    /// Panics if it does not end within `patience`.
    pub fn run(machine: &[&str], arguments: &[OsString], patience: Duration) -> Ended {
        let mut emulator = Self::start(machine, arguments);
        let stdout = emulator.process.stdout.take().expect("stdout is a pipe");
        let reader = std::thread::spawn(move || std::io::read_to_string(stdout));
        let end = Instant::now() + patience;
        let success = loop {
            match emulator.process.try_wait().expect("the emulator is ours") {
                Some(status) => break status.success(),
                None if Instant::now() > end => {
                    panic!("the emulator did not end within {patience:?}")
                }
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        let output = reader.join().expect("the reader does not panic");
        Ended {
            success,
            output: output.expect("the image prints UTF-8"),
        }
    }

    /// Starts a station that serves its UART, and returns the path of its pseudo-terminal. The
    /// station writes its actions to `trace`.
    pub fn live(trace: &Path) -> (Self, String) {
        let machine = ["-chardev", "pty,id=link", "-serial", "chardev:link"];
        let mut emulator = Self::start(&machine, &["live".into(), trace.into()]);
        let stdout = emulator.process.stdout.take().expect("stdout is a pipe");
        // "char device redirected to /dev/pts/7 (label link)"
        let line = BufReader::new(stdout).lines().next();
        let line = line
            .expect("QEMU names the pseudo-terminal")
            .expect("QEMU prints UTF-8");
        let path = line
            .split_whitespace()
            .find(|word| word.starts_with("/dev/"));
        let path = path.unwrap_or_else(|| panic!("no device in {line:?}"));
        (emulator, path.to_owned())
    }
}
