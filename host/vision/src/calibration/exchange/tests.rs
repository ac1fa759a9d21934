mod assembled;
mod refused;
mod several;
mod spellings;

use super::*;
use trinocular_core::rig::Rotation;

const OPENCV: &str = "%YAML:1.0
---
nframes: 13
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.3591573396163199e+02, 0., 3.4228315473308373e+02, 0.,
       5.3591573396163199e+02, 2.3557082909788173e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.6637260909660682e-01, -3.8588898922304653e-02,
       1.7831947042852964e-03, -2.8122100441115472e-04,
       2.3839153080878486e-01 ]
";

const XML: &str = "<?xml version=\"1.0\"?>
<!-- written by a test -->
<opencv_storage>
<calibration_time>\"Mon\"</calibration_time>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id=\"opencv-matrix\">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    533.5 0. 342.25 0.
    533. 234.5 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id=\"opencv-matrix\">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    -0.28 0.03 1e-3 -1e-4 0.13</data></distortion_coefficients>
</opencv_storage>
";

fn parse(text: &str) -> Result<CameraFile, InputError> {
    CameraFile::parse(Path::new("left.yml"), text.as_bytes())
}

fn camera() -> Camera {
    Camera {
        focal_px: [533.16, 1.0 / 3.0 + 529.0],
        principal_px: [154.43, 123.0],
        offset_mm: [-70.0, 0.25],
        distortion: [-0.28, 0.05, 1e-3, -2e-3, 0.0],
        rational: [0.0; 3],
        rotation: Rotation::from_degrees([0.4, -1.3, 2.0]),
    }
}

fn rational() -> Camera {
    Camera {
        rational: [0.02, -0.01, 1.0 / 3.0],
        ..camera()
    }
}

/// Returns the camera that a file describes.
fn back(file: &CameraFile) -> Camera {
    let motion = file.motion.expect("the file says where the camera is");
    let place = motion.inverse_transform_vector(&-motion.translation.vector);
    assert!(place.z.abs() < 1e-12);
    let degrees = motion.rotation.scaled_axis().map(f64::to_degrees);
    Camera {
        offset_mm: [place.x, place.y],
        rotation: Rotation::from_degrees(degrees.into()),
        ..file.camera()
    }
}

#[track_caller]
fn assert_same(found: &Camera, expected: &Camera) {
    assert_eq!(
        (Lens::of(found), found.rational),
        (Lens::of(expected), expected.rational),
        "lenses are written with every digit"
    );
    for i in 0..2 {
        assert!(
            (found.offset_mm[i] - expected.offset_mm[i]).abs() < 1e-12,
            "{found:?}"
        );
    }
    for (a, b) in found
        .rotation
        .degrees()
        .iter()
        .zip(expected.rotation.degrees())
    {
        assert!((a - b).abs() < 1e-12, "{found:?}");
    }
}

#[test]
fn opencv_file_is_read() {
    let file = parse(OPENCV).unwrap();
    assert_eq!(file.image_size_px, [640, 480]);
    assert_eq!(file.lens.0[0], 535.915_733_961_632);
    assert_eq!(file.lens.0[6], 1.783_194_704_285_296_4e-3);
    assert_eq!(file.lens.0[8], 0.238_391_530_808_784_86);
    assert_eq!(file.motion, None);
}

#[test]
fn both_formats_round_trip() {
    let rig = Rig {
        image_size_px: [320, 240],
        cameras: [camera(), Rig::paper().cameras[2], rational()]
            .into_iter()
            .collect(),
    };
    for camera in &rig.cameras {
        for text in [opencv(camera, rig.image_size_px), ros("left", camera, &rig)] {
            let file = parse(&text).unwrap();
            assert_eq!(file.image_size_px, rig.image_size_px);
            assert_same(&back(&file), camera);
        }
    }
}

/// Tests that a number has a decimal point, because YAML 1.1 takes `1e-5` for a text.
#[test]
fn small_numbers_keep_a_point() {
    let text = list(&[1e-5, -2e-7, 1.5e-9, 3.0, -0.25, 1e16]);
    assert_eq!(text, "1.0e-5, -2.0e-7, 1.5e-9, 3.0, -0.25, 1.0e16");
    let mut rig = Rig::paper();
    rig.cameras[0].distortion = [1e-5, -1e-6, 2e-7, 0.0, 0.0];
    let camera = &rig.cameras[0];
    for text in [opencv(camera, rig.image_size_px), ros("left", camera, &rig)] {
        assert!(text.contains("1.0e-5, -1.0e-6, 2.0e-7"), "{text}");
        assert_eq!(parse(&text).unwrap().lens, Lens::of(camera));
    }
}

#[test]
fn names_like_numbers_stay_names() {
    let rig = Rig::paper();
    for name in [
        "left", "007", "yes", "- q", "a #b", "it's", "größe", "a \"b\"",
    ] {
        let text = ros(name, &rig.cameras[0], &rig);
        assert!(parse(&text).is_ok(), "{text}");
        let document = Document::parse(Path::new("camera.yaml"), &text, &KEYS).unwrap();
        let root = document.root();
        assert_eq!(root.required("camera_name").unwrap().text().unwrap(), name);
    }
}

/// Returns the values of [`OPENCV`] that all layouts have.
fn known(file: &CameraFile) -> ([u32; 2], Lens) {
    (file.image_size_px, file.lens)
}

#[test]
fn gzip_files_are_read() {
    use std::io::Write as _;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("left.yml.gz");
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packer.write_all(OPENCV.as_bytes()).unwrap();
    let packed = packer.finish().unwrap();
    std::fs::write(&path, &packed).unwrap();
    let file = CameraFile::read(&path).unwrap();
    assert_eq!(known(&file), known(&parse(OPENCV).unwrap()));
    std::fs::write(&path, &packed[..packed.len() / 2]).unwrap();
    let error = CameraFile::read(&path).unwrap_err();
    assert!(error.reason.starts_with("cannot unpack"), "{error}");
}

#[test]
fn camera_is_named_by_its_file() {
    for (file, name) in [
        ("cv/left.yml", "left"),
        ("left.yml.gz", "left"),
        ("left.GZ", "left"),
        ("cam.0.json", "cam.0"),
        ("right", "right"),
    ] {
        assert_eq!(camera_name(Path::new(file)), name, "{file}");
    }
}
