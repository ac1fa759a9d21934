//! The same camera in the spellings of other programs and versions.

use super::*;

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
