//! The example data in `examples/data`: made by this file, and small.
//!
//! To write the points and images anew after a change of what makes them:
//! `RENEW=1 cargo test -p trinocular-tests --test docs example_data`.

use super::page::root;
use std::fs;
use std::path::{Path, PathBuf};
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::{Scene, SceneSettings, Texture, folder};

/// Target positions of the frame sets, mm.
const CAPTURES_MM: [[f64; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [4.0, 4.0, 1.0],
    [8.0, 8.0, 2.0],
    [12.0, 12.0, 3.0],
];
/// Motion of the matched points, mm.
const POINTS_MOVED_MM: [f64; 3] = [1.5, -0.5, 2.0];
const POINTS: usize = 40;
/// Noise of the matched points, px.
const NOISE_PX: f64 = 0.03;
/// Largest difference of a pixel between two machines' rendering, grey levels.
const ROUNDING_GREY: u8 = 1;
const MOST_BYTES: u64 = 2 << 20;

fn folder_of_data() -> PathBuf {
    root().join("examples/data")
}

fn rig() -> RigFile {
    RigFile::read(&folder_of_data().join("rig.toml")).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns true if the committed files are to be written anew.
pub fn renew() -> bool {
    std::env::var_os("RENEW").is_some()
}

/// Returns the matched points of a cloud in front of the cameras, with noise.
fn points() -> String {
    let rig = rig();
    let mut random = Random::new(1, 0);
    let mut csv = String::from("id,camera,x0,y0,x1,y1\n");
    for id in 1..=POINTS {
        let z = random.between(780.0, 1010.0);
        let [x, y] = [0.10, 0.12].map(|field: f64| z * random.between(-field, field));
        let start = [x, y, z];
        let end: [f64; 3] = std::array::from_fn(|axis| start[axis] + POINTS_MOVED_MM[axis]);
        for (name, camera) in rig.names.iter().zip(&rig.rig.cameras) {
            let [x0, y0, x1, y1] = {
                let [a, b] = [start, end].map(|point| camera.project(point));
                [a[0], a[1], b[0], b[1]].map(|px| px + NOISE_PX * random.gaussian())
            };
            csv += &format!("{id},{name},{x0:.3},{y0:.3},{x1:.3},{y1:.3}\n");
        }
    }
    csv
}

/// Renders the frame sets into `captures`.
fn render(captures: &Path) {
    let rig = rig();
    let settings = SceneSettings {
        tilt_rad: [0.05, -0.08],
        ..SceneSettings::default()
    };
    let scene = Scene::new(&rig.rig, &Texture::natural(1), settings).expect("a scene");
    for (index, at) in CAPTURES_MM.into_iter().enumerate() {
        let capture = scene.render(at, 0, index as u64);
        folder::save(captures, &rig.names, index, &capture).expect("the folder can be written");
    }
}

/// Returns the files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    let mut all = Vec::new();
    for entry in entries {
        let path = entry.expect("an entry").path();
        match path.is_dir() {
            true => all.extend(files(&path)),
            false => all.push(path),
        }
    }
    all.sort();
    all
}

#[test]
fn example_data_points_are_reproducible() {
    let path = folder_of_data().join("points.csv");
    if renew() {
        fs::write(&path, points()).expect("the file can be written");
    }
    let committed = fs::read_to_string(&path).expect("the points are committed");
    assert_eq!(committed, points());
}

#[test]
fn example_data_images_are_reproducible() {
    let captures = folder_of_data().join("captures");
    if renew() {
        render(&captures);
    }
    let made = tempfile::tempdir().expect("a folder");
    render(made.path());
    let size = rig().rig.image_size_px;
    let read = |path: &Path| folder::read(path, size).unwrap_or_else(|error| panic!("{error}"));
    let committed = files(&captures);
    assert_eq!(committed.len(), 3 * CAPTURES_MM.len());
    for path in committed {
        let same = made
            .path()
            .join(path.strip_prefix(&captures).expect("in the folder"));
        let (ours, theirs) = (read(&path), read(&same));
        let near = |(a, b): (&u8, &u8)| a.abs_diff(*b) <= ROUNDING_GREY;
        let equal = ours.grey.iter().zip(&theirs.grey).all(near);
        assert!(equal, "{} differs", path.display());
    }
}

#[test]
fn example_data_is_small() {
    let sizes = files(&folder_of_data()).into_iter().map(|path| {
        let file = fs::metadata(path).expect("a file");
        file.len()
    });
    let bytes: u64 = sizes.sum();
    assert!(bytes < MOST_BYTES, "{bytes} bytes");
}
