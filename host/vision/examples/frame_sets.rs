//! Displacement of a target from frame sets: images of all cameras in, millimetres out.
//!
//! The first frame set is the keyframe, from which all others are measured. Without arguments the
//! images are those of `examples/data`.
//!
//! ```sh
//! cargo run -p trinocular-vision --example frame_sets -- RIG.toml FOLDER
//! ```

use std::error::Error;
use std::path::{Path, PathBuf};
use trinocular_core::estimate::midpoint;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::{Flow, FlowSettings};
use trinocular_vision::images::folder::{DEFAULT_PERIOD_US, Folder};
use trinocular_vision::measure::measure;

/// Prints the displacement of every frame set in `folder` and returns them, in mm.
fn displacements(rig: &Path, folder: &Path) -> Result<Vec<[f64; 3]>, Box<dyn Error>> {
    // The rig file names the cameras; each has a subfolder of its name.
    let RigFile { rig, names, .. } = RigFile::read(rig)?;
    let folder = Folder::open(folder, &names, rig.image_size_px, DEFAULT_PERIOD_US)?;
    let mut frame_sets = folder.frame_sets();

    let mut flow = Flow::new(&rig, FlowSettings::default())?;
    let keyframe = frame_sets.next().ok_or("the folder holds no frame set")??;
    flow.set_keyframe(&keyframe)?;

    let mut displacements = Vec::new();
    for frame_set in frame_sets {
        let (measurement, sums) = measure(&mut flow, &rig, &frame_set?)?;
        let estimate = midpoint::solve(&sums.centred)?;
        let [x, y, z] = estimate.displacement_mm;
        let sigma = estimate.sigma_mm().map(|mm| format!("{mm:.3}")).join(" ");
        let points = measurement.correspondences.len();
        println!("{x:8.3} {y:8.3} {z:8.3} mm, sigma {sigma} mm, {points} points");
        displacements.push(estimate.displacement_mm);
    }
    Ok(displacements)
}

fn main() -> Result<(), Box<dyn Error>> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/data");
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let rig = arguments.next().unwrap_or_else(|| data.join("rig.toml"));
    let folder = arguments.next().unwrap_or_else(|| data.join("captures"));
    displacements(&rig, &folder)?;
    Ok(())
}

#[test]
fn shipped_frame_sets_show_their_motion() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/data");
    let found = displacements(&data.join("rig.toml"), &data.join("captures")).unwrap();
    // The target moved by (4, 4, 1) mm between two frame sets.
    for (moves, found) in (1..).zip(&found) {
        let moved = [4.0, 4.0, 1.0].map(|mm| mm * f64::from(moves));
        let error: [f64; 3] = std::array::from_fn(|axis| found[axis] - moved[axis]);
        assert!(error.iter().all(|mm| mm.abs() < 0.02), "{error:?} mm");
    }
    assert_eq!(found.len(), 3);
}
