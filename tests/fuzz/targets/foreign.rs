//! Camera files of other programs with any edits: XML, INI, MATLAB, Kalibr, stereo_calib, and gzip
//! around them.
//!
//! Laws: no panic; an error names one of the files; memory is bounded (`tests/fuzz/run`).
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use station_fuzz::edit::{Edit, edited};
use station_fuzz::law::check_error;
use station_fuzz::picture::gzip;
use std::path::Path;
use trinocular_vision::calibration::exchange::{CameraFile, Member, assemble, several};

const XML: &str = r#"<?xml version="1.0"?>
<opencv_storage>
<!-- of May -->
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows> <cols>3</cols> <dt>d</dt>
  <data> 533. 0. 320. 0. 534. 240. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>1</rows> <cols>5</cols> <dt>d</dt>
  <data> -0.1 0.01 0. 0. 0.</data></distortion_coefficients>
</opencv_storage>
"#;
const INI: &str = "# oST version 5.0 parameters\n[image]\nwidth\n640\nheight\n480\n[narrow/left]\n\
camera matrix\n533 0 320\n0 534 240\n0 0 1\ndistortion\n-0.1 0.01 0 0 0 0.01 0 0\n\
rectification\n1 0 0\n0 1 0\n0 0 1\nprojection\n533 0 320 0\n0 533 240 0\n0 0 1 0\n";
const MATLAB: &str = "fc = [ 533.1 ; 534.2 ];\ncc = [ 320.5 ; 240.5 ];\nalpha_c = 0.0;\n\
kc = [ -0.1 ; 0.01 ; 0 ; 0 ; 0 ];\nnx = 640;\nny = 480;\n";
const CHAIN: &str = "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.01, 0, 0, 0]\n  \
distortion_model: radtan\n  intrinsics: [384, 386, 324, 238]\n  resolution: [640, 480]\ncam1:\n  \
T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.08]\n  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n  - \
[0.0, 0.0, 0.0, 1.0]\n  camera_model: pinhole\n  distortion_coeffs: [0, 0, 0, 0]\n  \
distortion_model: radtan\n  intrinsics: [384, 386, 324, 238]\n  resolution: [640, 480]\n";
const STEREO: &str = "%YAML:1.0\n---\nM1: {rows: 3, cols: 3, data: [533, 0, 320, 0, 534, 240, 0, 0, 1]}\n\
D1: {rows: 1, cols: 5, data: [-0.1, 0, 0, 0, 0]}\n\
M2: {rows: 3, cols: 3, data: [533, 0, 320, 0, 534, 240, 0, 0, 1]}\n\
D2: {rows: 1, cols: 5, data: [-0.1, 0, 0, 0, 0]}\n\
R: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\nT: {rows: 3, cols: 1, data: [-80, 0, 0]}\n";

/// Program that wrote the file.
#[derive(Arbitrary, Clone, Copy, Debug)]
enum Program {
    Xml,
    Ini,
    Matlab,
    Chain,
    Stereo,
}

fuzz_target!(|input: (Program, Vec<Edit>, bool, Vec<Edit>)| {
    let (program, edits, is_packed, breaks) = input;
    let good = match program {
        Program::Xml => XML,
        Program::Ini => INI,
        Program::Matlab => MATLAB,
        Program::Chain => CHAIN,
        Program::Stereo => STEREO,
    };
    let mut bytes = edited(good, &edits);
    if is_packed {
        bytes = station_fuzz::picture::broken(gzip(&bytes), &breaks);
    }
    let Ok(dir) = tempfile::tempdir() else {
        return;
    };
    let path = dir.path().join("left.yml");
    if std::fs::write(&path, &bytes).is_err() {
        return;
    }
    let paths: [&Path; 1] = [&path];
    match CameraFile::read(&path) {
        Ok(file) => assert!(
            file.lens
                .0
                .iter()
                .chain(&file.rational)
                .all(|n| n.is_finite())
        ),
        Err(error) => check_error(&error, &paths),
    }
    let cameras = match several(&[path.clone()], Some([640, 480])) {
        Ok(Some(several)) => several.cameras,
        Ok(None) => return,
        Err(error) => return check_error(&error, &paths),
    };
    let member = |(name, path, file)| Member {
        name,
        path,
        file,
        offset_mm: None,
    };
    let members: Vec<Member> = cameras.into_iter().map(member).collect();
    if !members.is_empty()
        && let Err(error) = assemble(&members)
    {
        check_error(&error, &paths);
    }
});
