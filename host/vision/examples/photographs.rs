//! Calibration of cameras and rig from photographs of a chessboard.
//!
//! Without an argument the photographs are those of `tests/images/chessboard`: a board with 9 x 6
//! inner corners and squares of 25 mm. The rig is printed as a rig file.
//!
//! ```sh
//! cargo run --release -p trinocular-vision --example photographs -- FOLDER
//! ```

use std::error::Error;
use std::path::{Path, PathBuf};
use trinocular_vision::calibration::board::Board;
use trinocular_vision::calibration::folder::{Calibration, CalibrationSettings, calibrate};

/// Calibrates the cameras, each of which has a subfolder of photographs, and prints the residuals.
fn calibrated(folder: &Path) -> Result<Calibration, Box<dyn Error>> {
    let board = Board {
        corners: [9, 6],
        square_mm: 25.0,
    };
    let settings = CalibrationSettings::new(board);
    let calibration = calibrate(folder, &settings, &mut |_share_done| ())?;
    for camera in &calibration.cameras {
        println!("# {}: rms {:.3} px", camera.name, camera.intrinsics.rms_px);
    }
    for warning in calibration.warnings() {
        println!("# warning: {warning}");
    }
    Ok(calibration)
}

fn main() -> Result<(), Box<dyn Error>> {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/images/chessboard");
    let folder = std::env::args_os().nth(1).map_or(shipped, PathBuf::from);
    let calibration = calibrated(&folder)?;
    let rig = calibration.rig_file().ok_or("one camera makes no rig")?;
    print!("{}", rig.to_toml());
    Ok(())
}

#[test]
fn shipped_photographs_give_a_rig() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/images/chessboard");
    let calibration = calibrated(&shipped).unwrap();
    let rms_px = |camera: usize| calibration.cameras[camera].intrinsics.rms_px;
    assert!(rms_px(0) < 0.25 && rms_px(1) < 0.25);
    let rig = calibration.rig_file().unwrap();
    let [left, right] = [0, 1].map(|camera| rig.rig.cameras[camera].offset_mm[0]);
    assert!(
        (right - left - 83.0).abs() < 2.0,
        "baseline {} mm",
        right - left
    );
}
