//! The command line as a user meets it: results, messages and exit codes of the built program.

#[path = "cli/align.rs"]
mod align;
#[path = "cli/bad_input.rs"]
mod bad_input;
#[path = "cli/bench.rs"]
mod bench;
#[path = "cli/cameras.rs"]
mod cameras;
#[path = "cli/files.rs"]
mod files;
#[path = "cli/folder.rs"]
mod folder;
#[path = "cli/forms.rs"]
mod forms;
#[cfg(unix)]
#[path = "cli/inputs.rs"]
mod inputs;
#[cfg(unix)]
#[path = "cli/interrupted.rs"]
mod interrupted;
#[path = "cli/mistakes.rs"]
mod mistakes;
#[path = "cli/points.rs"]
mod points;
#[path = "cli/pose.rs"]
mod pose;
#[path = "cli/reference.rs"]
mod reference;
#[path = "cli/setting_up.rs"]
mod setting_up;
#[path = "cli/spot.rs"]
mod spot;
#[path = "cli/targets.rs"]
mod targets;
#[path = "cli/usage.rs"]
mod usage;
#[path = "cli/verify.rs"]
mod verify;
#[path = "cli/watch.rs"]
mod watch;

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, trinocular};

/// Returns the root of the repository.
fn root() -> PathBuf {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("tests/ is in a folder").to_owned()
}

/// Runs the program with `arguments` in `folder`.
fn run(folder: &Path, arguments: &[&str]) -> Outcome {
    Outcome::of(trinocular().args(arguments).current_dir(folder))
}

/// A folder with the paper's `rig.toml` and a `points.csv` of five points that have moved by (1, 0,
/// 0) mm.
struct Desk {
    folder: TempDir,
}

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let desk = Self { folder };
        let rig = RigFile::paper();
        let mut csv = String::from("id,camera,x0,y0,x1,y1\n");
        for (id, point) in POINTS_MM.iter().enumerate() {
            for (name, camera) in rig.names.iter().zip(&rig.rig.cameras) {
                let [x, y, z] = *point;
                let [x0, y0] = camera.project(*point);
                let [x1, y1] = camera.project([x + 1.0, y, z]);
                csv += &format!("{id},{name},{x0},{y0},{x1},{y1}\n");
            }
        }
        desk.write("points.csv", csv);
        desk.write("rig.toml", rig.to_toml());
        desk
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).expect("the file was written")
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).expect("the folder can be written to");
    }

    /// Replaces the first `from` in a file and returns its line number.
    #[track_caller]
    fn change(&self, name: &str, from: &str, to: &str) -> usize {
        let text = self.read(name);
        let at = text.find(from).expect("the change must apply");
        self.write(name, text.replacen(from, to, 1));
        1 + text[..at].matches('\n').count()
    }

    /// Runs `trinocular estimate points.csv --rig rig.toml` with more arguments.
    fn estimate(&self, more: &[&str]) -> Outcome {
        let mut arguments = vec!["estimate", "points.csv", "--rig", "rig.toml"];
        arguments.extend(more);
        run(self.folder.path(), &arguments)
    }
}

const POINTS_MM: [[f64; 3]; 5] = [
    [0.0, 0.0, 900.0],
    [40.0, -30.0, 800.0],
    [-50.0, 35.0, 1000.0],
    [30.0, 45.0, 950.0],
    [-20.0, -40.0, 850.0],
];
