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

#[test]
fn unknown_coefficients_must_be_zero() {
    let with = |data: &str, cols: usize| {
        format!(
            "image_width: 640\nimage_height: 480\ncamera_matrix: {{rows: 3, cols: 3, data: [500, \
             0, 320, 0, 500, 240, 0, 0, 1]}}\ndistortion_coefficients: {{rows: 1, cols: {cols}, \
             data: [{data}]}}\n"
        )
    };
    assert_eq!(
        parse(&with("0.1, 0.2, 0.003, 0.004", 4)).unwrap().lens.0[4..],
        [0.1, 0.2, 0.003, 0.004, 0.0]
    );
    assert!(parse(&with("0.1, 0.2, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0", 12)).is_ok());
    let prism = "0.1, 0.2, 0, 0, 0.5, 0, 0, 0, 0.01, 0, 0, 0";
    let error = parse(&with(prism, 12)).unwrap_err();
    assert_eq!(
        (error.line, error.field.as_deref()),
        (Some(4), Some("distortion_coefficients"))
    );
}

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

#[test]
fn opencv_xml_is_read() {
    let file = parse(XML).unwrap();
    assert_eq!(file.image_size_px, [640, 480]);
    let lens = [533.5, 533.0, 342.25, 234.5, -0.28, 0.03, 1e-3, -1e-4, 0.13];
    assert_eq!(file.lens.0, lens);
    assert_eq!(
        (file.places.matrix.line, file.places.distortion.line),
        (7, 14)
    );
}

#[test]
fn bad_xml_is_refused_by_line() {
    let error = parse(&XML.replace("533. 234.5", "533. x")).unwrap_err();
    assert_eq!(error.line, Some(13), "{error}");
    assert_eq!(error.field.as_deref(), Some("camera_matrix.data[5]"));
    let error = parse(&XML.replace("image_width", "wide")).unwrap_err();
    assert!(error.to_string().contains("image_width"), "{error}");
    let error = parse(&XML.replace("opencv_storage", "html")).unwrap_err();
    assert!(error.reason.contains("opencv_storage"), "{error}");
    for length in 0..XML.trim_end().len() {
        assert!(parse(&XML[..length]).is_err(), "{length}");
    }
}

/// Returns a ROS file with this model and coefficients.
fn with_model(model: &str, data: &str, cols: usize) -> String {
    format!(
        "image_width: 640\nimage_height: 480\ncamera_matrix: {{rows: 3, cols: 3, data: [500, 0, \
         320, 0, 500, 240, 0, 0, 1]}}\ndistortion_model: {model}\ndistortion_coefficients: \
         {{rows: 1, cols: {cols}, data: [{data}]}}\n"
    )
}

#[test]
fn model_is_judged_by_its_coefficients() {
    let eight = "0.1, 0.2, 0.003, 0.004, 0.5, 0.01, 0.02, 0.03";
    let rational = parse(&with_model("rational_polynomial", eight, 8)).unwrap();
    assert_eq!(rational.lens.0[4..], [0.1, 0.2, 0.003, 0.004, 0.5]);
    assert_eq!(rational.rational, [0.01, 0.02, 0.03]);
    let five = parse(&with_model("rational_polynomial", "0.1, 0, 0, 0, 0", 5)).unwrap();
    assert_eq!(five.rational, [0.0; 3]);
    let plain = parse(&with_model("''", "0, 0, 0, 0, 0", 5)).unwrap();
    assert_eq!(plain.lens.0[4..], [0.0; 5]);
    let none = parse(&with_model("''", "", 0)).unwrap();
    assert_eq!(none.lens.0[4..], [0.0; 5]);
    for (text, field, reason) in [
        (
            with_model("rational_polynomial", "0, 0, 0, 0, 0, -8, 0, 0", 8),
            "distortion_coefficients",
            "cannot be inverted",
        ),
        (
            with_model("''", "0.1, 0, 0, 0, 0", 5),
            "distortion_model",
            "the model is empty",
        ),
    ] {
        let error = parse(&text).unwrap_err();
        assert_eq!(error.field.as_deref(), Some(field), "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}

#[test]
fn binning_and_roi_are_refused_by_name() {
    let plain = with_model("plumb_bob", "0, 0, 0, 0, 0", 5);
    let none = "binning_x: 1\nbinning_y: 0\nroi: {x_offset: 0, y_offset: 0, height: 0, width: \
                0, do_rectify: false}\n";
    assert!(parse(&format!("{plain}{none}")).is_ok());
    for (line, field) in [
        ("binning_x: 4", "binning_x"),
        ("roi: {x_offset: 16, y_offset: 0}", "roi.x_offset"),
    ] {
        let error = parse(&format!("{plain}{line}\n")).unwrap_err();
        assert_eq!(error.field.as_deref(), Some(field), "{error}");
        assert!(error.reason.contains("not supported"), "{error}");
    }
}

#[track_caller]
fn refused(from: &str, to: &str, line: usize, field: &str, reason: &str) {
    assert!(OPENCV.contains(from), "the change must apply");
    let error = parse(&OPENCV.replacen(from, to, 1)).unwrap_err();
    assert_eq!(error.field.as_deref(), Some(field), "{error}");
    assert_eq!(error.line, Some(line), "{error}");
    assert!(error.reason.contains(reason), "{error}");
}

#[test]
fn bad_values_are_refused_by_line() {
    refused(
        "image_width: 640",
        "image_width: x",
        4,
        "image_width",
        "whole number",
    );
    refused(
        "image_width: 640",
        "image_width: 0",
        4,
        "image_width",
        "from 8",
    );
    refused("image_width: 640", "wide: 640", 3, "image_width", "missing");
    refused(
        "   rows: 3",
        "   rows: 4",
        10,
        "camera_matrix.data",
        "9 numbers",
    );
    refused(
        "3.4228315473308373e+02",
        ".Nan",
        10,
        "camera_matrix.data[2]",
        "finite",
    );
    refused(
        "[ 5.3591573396163199e+02, 0.,",
        "[ 5e2, 1.,",
        6,
        "camera_matrix",
        "[fx 0 cx",
    );
    refused(
        "[ 5.3591573396163199e+02",
        "[ -5.3591573396163199e+02",
        6,
        "camera_matrix",
        "greater than 0",
    );
    refused(
        "3.4228315473308373e+02",
        "-3.",
        6,
        "camera_matrix",
        "the principal point -3, 235.57",
    );
    refused(
        "2.3557082909788173e+02",
        "480.",
        6,
        "camera_matrix",
        "480 is outside the image of 640 x 480 px",
    );
    refused(
        "[ 5.3591573396163199e+02",
        "[ 5.3591573396163199e+08",
        6,
        "camera_matrix",
        "out of range",
    );
    refused(
        "-3.8588898922304653e-02",
        "-3.8588898922304653e+02",
        12,
        "distortion_coefficients",
        "cannot be inverted",
    );
    refused(
        "image_height: 480",
        "image_width: 480",
        5,
        "image_width",
        "given twice",
    );
    refused(
        "image_height: 480",
        "image_height: 480\ndistortion_model: equidistant",
        6,
        "distortion_model",
        "the model is `equidistant`; only plumb_bob",
    );
    refused(
        "image_height: 480",
        "image_height: 480\nfisheye_model: 1",
        6,
        "fisheye_model",
        "fisheye",
    );
    let plain = OPENCV.replacen("nframes: 13", "fisheye_model: 0", 1);
    assert!(parse(&plain).is_ok());
    let turned = "nframes: 13\nT: {rows: 3, cols: 1, data: [0, 0, 0]}\nR: {rows: 3, cols: 3, \
                  data: [1, 0, 0, 0, 1, 0, 0, 0, -1]}";
    refused("nframes: 13", turned, 5, "R", "not a rotation");
}

#[test]
fn other_files_are_refused() {
    for (text, reason) in [
        ("", "empty"),
        ("%YAML:1.0\n---\n", "names with values"),
        ("a: [1, 2", "not valid YAML"),
        ("a: &x 1\nb: *x", "aliases"),
        ("? [1]\n: 2", "name before the colon"),
        ("just text", "names with values"),
    ] {
        let error = parse(text).unwrap_err();
        assert!(error.to_string().contains(reason), "{text:?}: {error}");
    }
    let deep = format!("a: {}", "[".repeat(100_000));
    assert!(parse(&deep).is_err());
    let error = CameraFile::parse(Path::new("a.yml"), b"a: 1\nb: \xff").unwrap_err();
    assert_eq!(error.line, Some(2), "{error}");
}

#[test]
fn long_file_is_read_in_linear_time() {
    let mut text = OPENCV.to_owned();
    for key in 0..200_000 {
        text += &format!("k{key}: 1\n");
    }
    text += &format!("corners: [{}0]\n", "1.5, ".repeat(200_000));
    assert!(text.len() > 2_000_000 && text.len() < LIMIT.bytes as usize);
    assert_eq!(parse(&text).unwrap().lens, parse(OPENCV).unwrap().lens);
    let error = parse(&(text + "k77: 2\n")).unwrap_err();
    assert_eq!(error.field.as_deref(), Some("k77"), "{error}");
}

#[test]
fn long_value_is_shortened_in_error() {
    let long = "9".repeat(100_000);
    let (number, key) = (
        format!("image_width: {long}x"),
        format!("? {long}\n: 1\n? {long}\n: 2"),
    );
    let list = format!("T: [{}1]", "1, ".repeat(2_000));
    for (line, reason) in [
        (number, "whole number"),
        (key, "given twice"),
        (list, "1000 values"),
    ] {
        let text = OPENCV.replacen("image_width: 640", &line, 1);
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains(reason) && error.len() < 500, "{error}");
    }
}

fn member(name: &str, text: &str) -> Member {
    let path = format!("{name}.yml").into();
    let file = CameraFile::parse(Path::new("unused"), text.as_bytes()).unwrap();
    Member {
        path,
        name: name.to_owned(),
        file,
        offset_mm: None,
    }
}

/// Returns a file with these rows of R, and T.
fn turned(rows: [[f64; 3]; 3], shift: [f64; 3]) -> String {
    let rows = list(rows.as_flattened());
    let shift = list(&shift);
    format!(
        "{OPENCV}R: {{rows: 3, cols: 3, data: [{rows}]}}\nT: {{rows: 3, cols: 1, data: \
         [{shift}]}}\n"
    )
}

const STRAIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const BACKWARDS: [[f64; 3]; 3] = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];

#[track_caller]
fn blamed(members: &[Member], file: &str, field: Option<&str>, reason: &str) {
    let error = assemble(members).unwrap_err();
    assert_eq!(error.file, Path::new(file), "{error}");
    assert_eq!(error.field.as_deref(), field, "{error}");
    assert_eq!(error.line.is_some(), field.is_some(), "{error}");
    assert!(error.reason.contains(reason), "{error}");
}

#[test]
fn broken_rule_names_its_file() {
    let straight = |name: &str, x: f64| member(name, &turned(STRAIGHT, [-x, 0.0, 0.0]));
    let [left, right] = [straight("left", 0.0), straight("right", 80.0)];
    assert!(assemble(&[left.clone(), right.clone()]).is_ok());

    let far = straight("right", 500_000.0);
    blamed(&[left.clone(), far], "right.yml", Some("T"), "out of range");
    let same = straight("right", 0.0);
    blamed(&[left.clone(), same], "right.yml", Some("T"), "same place");
    let wrong_way = [left.clone(), straight("middle", 90.0), right.clone()];
    blamed(&wrong_way, "right.yml", Some("T"), "left < middle < right");
    let named = |name: &str| Member {
        name: name.to_owned(),
        ..right.clone()
    };
    blamed(
        &[left.clone(), named("a\nb")],
        "right.yml",
        None,
        "cannot name a folder",
    );
    blamed(
        &[left.clone(), named("LEFT")],
        "right.yml",
        None,
        "named `left` already",
    );
    let given = Member {
        offset_mm: Some([0.0; 2]),
        ..right.clone()
    };
    blamed(
        &[left.clone(), given],
        "right.yml",
        None,
        "--offset right: ",
    );
    let back = member("right", &turned(BACKWARDS, [9.0, 0.0, 0.0]));
    blamed(
        &[left.clone(), back],
        "right.yml",
        Some("R"),
        "rotation_deg",
    );
    // Opposite axes have no mean.
    let back = member("right", &turned(BACKWARDS, [9.0, 0.0, 5.0]));
    blamed(&[left, back], "left.yml", Some("R"), "no axes of a rig");
}

#[test]
fn huge_shift_is_refused() {
    for shift in [[1e9, 0.0, 0.0], [0.0, 0.0, -1e300]] {
        let error = parse(&turned(STRAIGHT, shift)).unwrap_err();
        assert_eq!(error.field.as_deref(), Some("T"), "{error}");
        assert!(error.reason.contains("1 km"), "{error}");
    }
}

/// Returns the values of [`OPENCV`] that all layouts have.
fn known(file: &CameraFile) -> ([u32; 2], Lens) {
    (file.image_size_px, file.lens)
}

#[test]
fn spellings_of_opencv_2_4_are_read() {
    let mut text = OPENCV.to_owned();
    for (new, old) in [
        ("image_width", "image_Width"),
        ("image_height", "image_Height"),
        ("camera_matrix", "Camera_Matrix"),
        ("distortion_coefficients", "Distortion_Coefficients"),
    ] {
        text = text.replace(new, old);
    }
    assert_eq!(
        known(&parse(&text).unwrap()),
        known(&parse(OPENCV).unwrap())
    );
    let error = parse(&text.replace("5.3591573396163199e+02, 0., 3", "-5., 0., 3")).unwrap_err();
    assert_eq!(error.field.as_deref(), Some("Camera_Matrix"));
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

const MATRIX: &str = "533.0, 0.0, 342.3, 0.0, 533.1, 234.4, 0.0, 0.0, 1.0";
const PROJECTION: &str = "500.0, 0.0, 320.0, -41.6, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0";

/// Returns ROS's file of a camera 83.2 mm right of the origin.
fn ros_file() -> CameraFile {
    parse(&format!(
        "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n\
         camera_matrix: {{rows: 3, cols: 3, data: [{MATRIX}]}}\n\
         distortion_coefficients: {{rows: 1, cols: 5, data: [-0.28, 0.03, 0.001, 0.0, 0.1]}}\n\
         rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}\n\
         projection_matrix: {{rows: 3, cols: 4, data: [{PROJECTION}]}}\n"
    ))
    .unwrap()
}

#[test]
fn printed_camera_info_is_read() {
    let file = parse(&format!(
        "header: \n  seq: 5\n  frame_id: \"right\"\nheight: 480\nwidth: 640\n\
         distortion_model: \"plumb_bob\"\nD: [-0.28, 0.03, 0.001, 0.0, 0.1]\nK: [{MATRIX}]\n\
         R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\nP: [{PROJECTION}]\n\
         binning_x: 0\nbinning_y: 0\nroi: \n  x_offset: 0\n  y_offset: 0\n  height: 0\n  \
         width: 0\n  do_rectify: False\n---\n"
    ))
    .unwrap();
    let expected = ros_file();
    assert_eq!(
        (known(&file), file.motion),
        (known(&expected), expected.motion)
    );
    assert!((back(&file).offset_mm[0] - 83.2).abs() < 1e-9);
    assert_eq!(file.places.matrix.field, "K");
}

/// Tests the spelling of ROS 2, with block lists as `ros2 topic echo` prints them.
#[test]
fn printed_camera_info_of_ros_2_is_read() {
    let list = |numbers: &str| {
        let numbers = numbers.split(',');
        numbers
            .map(|n| format!("- {}\n", n.trim()))
            .collect::<String>()
    };
    let file = parse(&format!(
        "header:\n  stamp:\n    sec: 5\n    nanosec: 0\n  frame_id: right\nheight: 480\n\
         width: 640\ndistortion_model: plumb_bob\nd:\n{}k:\n{}r:\n{}p:\n{}binning_x: 0\nbinning_y: 0\nroi:\n  \
         x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n  do_rectify: false\n---\n",
        list("-0.28, 0.03, 0.001, 0.0, 0.1"),
        list(MATRIX),
        list("1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0"),
        list(PROJECTION),
    ))
    .unwrap();
    let expected = ros_file();
    assert_eq!(
        (known(&file), file.motion),
        (known(&expected), expected.motion)
    );
    assert_eq!(file.places.matrix.field, "k");
}

#[test]
fn ini_of_ros_calibration_is_read() {
    let rows = |text: &str, length: usize| {
        let numbers: Vec<&str> = text.split(", ").collect();
        let rows = numbers.chunks(length).map(|row| row.join(" "));
        rows.collect::<Vec<_>>().join("\n")
    };
    let text = format!(
        "# oST version 5.0 parameters\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n\
         [narrow_stereo/right]\n\ncamera matrix\n{}\n\ndistortion\n-0.28 0.03 0.001 0.0 0.1\n\n\
         rectification\n1 0 0\n0 1 0\n0 0 1\n\nprojection\n{}\n\n",
        rows(MATRIX, 3),
        rows(PROJECTION, 4)
    );
    let (file, expected) = (parse(&text).unwrap(), ros_file());
    assert_eq!(
        (known(&file), file.motion),
        (known(&expected), expected.motion)
    );
    let eight = text.replace("0.0 0.1\n", "0.0 0.1 0.01 0.02 0.03\n");
    assert_eq!(parse(&eight).unwrap().rational, [0.01, 0.02, 0.03]);
    let error = parse(&format!("{text}[other]\n")).unwrap_err();
    assert!(error.reason.starts_with("a second camera"), "{error}");
    let error = parse(&text.replace("533.1", "x")).unwrap_err();
    assert_eq!(
        (error.line, error.field.as_deref()),
        (Some(15), Some("camera_matrix.data[4]"))
    );
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

#[test]
fn matlab_file_is_read() {
    let text = "% Intrinsic and Extrinsic Camera Parameters\n\n%-- Focal length:\nfc = [ \
                657.395445 ; 657.763178 ];\n\ncc = [ 302.983690 ; 242.616570 ];\n\nalpha_c = \
                0.000000000000000;\n\nkc = [ -0.255584 ; 0.127569 ; -0.000208 ;\n 0.000032 ; \
                0.000000 ];\n\nfc_error = [ 0.346 ; 0.370 ];\n\nnx = 640;\nny = 480;\n\nomc_1 = [ \
                1.65e+00 ; 1.6e+00 ; -6.6e-01 ];\n";
    let file = parse(text).unwrap();
    assert_eq!(file.image_size_px, [640, 480]);
    let expected = [
        657.395_445,
        657.763_178,
        302.983_69,
        242.616_57,
        -0.255_584,
        0.127_569,
        -0.000_208,
        0.000_032,
        0.0,
    ];
    assert_eq!(file.lens.0, expected);
    assert_eq!((file.motion, file.places.matrix.line), (None, 4));
    for (from, to, line, reason) in [
        ("alpha_c = 0.000", "alpha_c = 0.001", Some(8), "must be 0"),
        ("302.983690 ;", "", Some(6), "expected 2 numbers, found 1"),
        ("nx = 640;", "", None, "nx is missing"),
        ("-0.255584", "x", Some(10), "not a finite number"),
    ] {
        let error = parse(&text.replace(from, to)).unwrap_err();
        assert_eq!(error.line, line, "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}

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
