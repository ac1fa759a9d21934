//! Files that are refused, with the reason and its place.

use super::*;

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
