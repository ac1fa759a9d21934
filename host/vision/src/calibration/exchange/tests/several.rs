//! Files that hold all cameras of a rig.

use super::*;

const CHAIN: &str = "cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.0007, -0.0063, 0.001, 0.0004]
  distortion_model: radtan
  intrinsics: [384.5, 386.0, 324.5, 238.4]
  resolution: [640, 480]
  rostopic: /cam0
cam1:
  T_cn_cnm1:
  - [0.0, -1.0, 0.0, 0.002]
  - [1.0, 0.0, 0.0, -0.08]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: none
  intrinsics: [375.4, 376.3, 321.3, 235.6]
  resolution: [640, 480]
cam2:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.05]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [375.4, 376.3, 321.3, 235.6]
  resolution: [640, 480]
";

/// Returns the cameras of files with these contents.
fn read_several(texts: &[&str], size_px: Option<[u32; 2]>) -> Result<Option<Several>, InputError> {
    let dir = tempfile::tempdir().unwrap();
    let paths = texts.iter().enumerate().map(|(index, text)| {
        let path = dir.path().join(format!("{index}.yml"));
        std::fs::write(&path, text).unwrap();
        path
    });
    several(&paths.collect::<Vec<_>>(), size_px)
}

#[test]
fn kalibr_camchain_is_read() {
    let cameras = read_several(&[CHAIN], None).unwrap().unwrap().cameras;
    let names: Vec<&str> = cameras.iter().map(|(name, ..)| name.as_str()).collect();
    assert_eq!(names, ["cam0", "cam1", "cam2"]);
    let [(_, _, first), (_, _, second), (_, _, third)] = cameras.as_slice() else {
        panic!("three cameras");
    };
    assert_eq!(
        first.lens.0[..8],
        [384.5, 386.0, 324.5, 238.4, -0.0007, -0.0063, 0.001, 0.0004]
    );
    assert_eq!(first.motion, Some(Isometry3::identity()));
    // A camera is at -R^T T; the chain turns the third one's step.
    let centre = |file: &CameraFile| {
        let motion = file.motion.unwrap();
        motion.inverse_transform_vector(&-motion.translation.vector)
    };
    assert!((centre(second) - Vector3::new(80.0, 2.0, 0.0)).norm() < 1e-9);
    assert!(
        (centre(third) - Vector3::new(80.0, -48.0, 0.0)).norm() < 1e-9,
        "{}",
        centre(third)
    );
    for (from, to, field, reason) in [
        ("pinhole", "omni", "cam0.camera_model", "only pinhole"),
        (
            "radtan",
            "equidistant",
            "cam0.distortion_model",
            "only radtan",
        ),
        (
            "0.0, -1.0, 0.0, 0.002",
            "0.0, -2.0, 0.0, 0.002",
            "cam1.T_cn_cnm1",
            "not a rotation",
        ),
        ("384.5,", "", "cam0.intrinsics", "expected 4 numbers"),
        ("324.5", "700", "cam0.intrinsics", "principal point"),
    ] {
        let error = read_several(&[&CHAIN.replacen(from, to, 1)], None).unwrap_err();
        assert_eq!(error.field.as_deref(), Some(field), "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}

#[test]
fn files_of_stereo_calib_are_read() {
    let lens = |number: u32, focal: f64| {
        format!(
            "M{number}: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {focal}, 0., \
             342.3, 0., 533.1, 234.4, 0., 0., 1. ]\nD{number}: !!opencv-matrix\n   rows: 1\n   \
             cols: 14\n   dt: d\n   data: [ -0.1, 0.03, 0.001, 0., 0., 0., 0., 0.02, 0., 0., 0., \
             0., 0., 0. ]\n"
        )
    };
    let intrinsics = format!("%YAML 1.2\n---\n{}{}", lens(1, 533.0), lens(2, 535.5));
    let extrinsics = "%YAML:1.0\n---\nR: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ \
                      1., 0., 0., 0., 1., 0., 0., 0., 1. ]\nT: !!opencv-matrix\n   rows: 3\n   cols: \
                      1\n   dt: d\n   data: [ -83.2, 0.5, 0. ]\nR1: 0\nP1: 0\n";
    let size = Some([640, 480]);
    for order in [[&intrinsics, extrinsics], [extrinsics, &intrinsics]] {
        let cameras = read_several(&order, size).unwrap().unwrap().cameras;
        let [(left, _, first), (right, _, second)] = cameras.as_slice() else {
            panic!("two cameras");
        };
        assert_eq!((left.as_str(), right.as_str()), ("left", "right"));
        assert_eq!((first.lens.0[0], second.lens.0[0]), (533.0, 535.5));
        assert_eq!(
            (first.image_size_px, second.rational),
            ([640, 480], [0.0, 0.0, 0.02])
        );
        let shift = second.motion.unwrap().translation.vector;
        assert_eq!(shift, Vector3::new(-83.2, 0.5, 0.0));
    }
    for (texts, size, reason) in [
        (
            vec![intrinsics.as_str(), extrinsics],
            None,
            "--image-size 640x480",
        ),
        (vec![intrinsics.as_str()], size, "give both files"),
        (vec![intrinsics.as_str(), "R: 0\n"], size, "give both files"),
    ] {
        let error = read_several(&texts, size).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
    assert_eq!(read_several(&[OPENCV, OPENCV], None), Ok(None));
}
