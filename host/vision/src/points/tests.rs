use super::*;

const GOOD: &str = "id,camera,x0,y0,x1,y1\n\
    a,left,193,101,197,105\n\
    a,middle,159,101,163,105\n\
    a,right,120,101,124,105\n\
    b,right,20,11,24,15\n\
    b,left,93,11,97,15\n\
    b,middle,59,11,63,15\n";

fn parse_bytes(bytes: &[u8]) -> Result<Points, InputError> {
    parse(Path::new("points.csv"), bytes, &RigFile::paper())
}

#[track_caller]
fn refused(from: &str, to: &str, line: usize, field: &str, reason: &str) {
    assert!(GOOD.contains(from), "the change must apply");
    let error = parse_bytes(GOOD.replacen(from, to, 1).as_bytes()).unwrap_err();
    assert_eq!(error.line, Some(line), "{error}");
    assert_eq!(error.field.as_deref(), Some(field), "{error}");
    assert!(error.reason.contains(reason), "{error}");
}

fn pixels(points: &Points) -> Vec<Vec<[[f64; 2]; 2]>> {
    points
        .correspondences
        .iter()
        .map(|t| t.pixels.clone())
        .collect()
}

#[test]
fn row_order_does_not_matter() {
    let points = parse_bytes(GOOD.as_bytes()).unwrap();
    assert_eq!(points.rejected, 0);
    assert_eq!(
        pixels(&points),
        [
            vec![
                [[193.0, 101.0], [197.0, 105.0]],
                [[159.0, 101.0], [163.0, 105.0]],
                [[120.0, 101.0], [124.0, 105.0]],
            ],
            vec![
                [[93.0, 11.0], [97.0, 15.0]],
                [[59.0, 11.0], [63.0, 15.0]],
                [[20.0, 11.0], [24.0, 15.0]],
            ],
        ]
    );
}

#[test]
fn csv_variants_read_alike() {
    let plain = pixels(&parse_bytes(GOOD.as_bytes()).unwrap());
    let windows = format!("\u{feff}{}", GOOD.replace('\n', "\r\n"));
    let airy = GOOD.replace(',', " ,\t").replace('\n', "\n\n  \n");
    let quoted = GOOD.replace("left", "\"left\"").replace("193", "\"193\"");
    let open = GOOD.trim_end();
    for text in [&windows, &airy, &quoted, open] {
        assert_eq!(
            pixels(&parse_bytes(text.as_bytes()).unwrap()),
            plain,
            "{text:?}"
        );
    }
}

#[test]
fn incomplete_points_are_counted() {
    let points = parse_bytes(GOOD.replace("b,left,93,11,97,15\n", "").as_bytes()).unwrap();
    assert_eq!((points.correspondences.len(), points.rejected), (1, 1));
}

#[test]
fn bad_values_name_line_and_field() {
    refused("197", "abc", 2, "x1", "not a number");
    refused("197", "1 97", 2, "x1", "not a number");
    refused("197", "", 2, "x1", "empty");
    refused("63,105", "63,NaN", 3, "y1", "finite");
    refused("120", "-inf", 4, "x0", "finite");
    refused("120", "1e999", 4, "x0", "finite");
    refused("24,15", "24,15.0.0", 5, "y1", "not a number");
    refused("b,left,93", "b,left,-320.1", 6, "x0", "farther outside");
    refused("93,11", "93,480.1", 6, "y0", "farther outside");
    refused("b,left", "b,outer", 6, "camera", "left, middle, right");
    refused("b,left", "b,Left", 6, "camera", "did you mean `left`?");
    refused("b,left", ",left", 6, "id", "empty");
    refused("b,middle", "a,middle", 7, "id", "line 3 already");
}

#[test]
fn points_near_image_are_accepted() {
    let far = GOOD.replacen("193,101", "-320,480", 1);
    assert!(parse_bytes(far.as_bytes()).is_ok());
}

#[test]
fn wrong_columns_name_line() {
    refused(",105\n", "\n", 2, "y1", "missing: 5 of 6");
    refused(",105\n", ",105,7\n", 2, "column 7", "too many");
    refused("a,middle,159,101,163,105", "a", 3, "camera", "missing");
    refused("id,camera", "camera,id", 1, "id", "found `camera`");
    refused("x0,y0,x1,y1", "x0,y0,u1,y1", 1, "x1", "found `u1`");
    refused("x1,y1", "x1", 1, "y1", "end of the line");
    refused(
        "x1,y1",
        "x1,y1,z1",
        1,
        "column 7",
        "`z1` is one column too many",
    );
    refused("id,camera,x0,y0,x1,y1\n", "", 1, "id", "found `a`");
}

#[test]
fn camera_without_rows_is_refused() {
    let lines: Vec<&str> = GOOD.lines().filter(|l| !l.contains("right")).collect();
    let error = parse_bytes(lines.join("\n").as_bytes()).unwrap_err();
    assert_eq!(error.field.as_deref(), Some("camera"));
    assert!(error.reason.contains("`right`"), "{error}");
    let header = parse_bytes(b"id,camera,x0,y0,x1,y1\n").unwrap_err();
    assert_eq!(header.field.as_deref(), Some("camera"));
}

#[test]
fn empty_files_are_refused() {
    for empty in [&b""[..], b"\n\r\n", b"\xef\xbb\xbf", b"  \n"] {
        let error = parse_bytes(empty).unwrap_err();
        assert!(error.reason.contains("empty"), "{error}");
        assert_eq!(error.line, Some(1));
    }
}

#[test]
fn line_count_includes_blanks() {
    let text = GOOD.replacen("b,right", "\r\n\n   \n\nb,wrong", 1);
    let error = parse_bytes(text.as_bytes()).unwrap_err();
    assert_eq!(
        (error.line, error.field.as_deref()),
        (Some(9), Some("camera"))
    );
}

#[test]
fn invalid_utf8_names_line() {
    let mut bytes = GOOD.as_bytes().to_vec();
    let at = GOOD.find("163").unwrap();
    bytes[at] = 0xff;
    let error = parse_bytes(&bytes).unwrap_err();
    assert_eq!((error.line, error.field.as_deref()), (Some(3), Some("x1")));
    assert!(error.reason.contains("UTF-8"));
}

#[test]
fn corrupt_bytes_never_panic() {
    // Replace any byte by any other: the reader must answer, and never with an invalid point.
    for at in 0..GOOD.len() {
        for byte in [0_u8, b'"', b',', b'\r', b'\n', b'-', 0xff] {
            let mut bytes = GOOD.as_bytes().to_vec();
            bytes[at] = byte;
            if let Ok(points) = parse_bytes(&bytes) {
                assert!(points.correspondences.len() + points.rejected <= 4);
            }
        }
    }
}

#[test]
fn overlong_row_names_its_line() {
    let row = |end: &str| parse_bytes(format!("{GOOD}{end}").as_bytes()).unwrap_err();
    for (end, reason) in [
        (",".repeat(1_000_000), "more than 16 columns"),
        ("x".repeat(1_000_000), "more than 4096 bytes"),
        (
            format!("\"{}", "\n,".repeat(100_000)),
            "more than 4096 bytes",
        ),
    ] {
        let error = row(&end);
        assert_eq!(error.line, Some(8), "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
    let error = row(&format!("{},left,1,1,1,1{}", "i".repeat(2000), ",1"));
    assert!(error.to_string().len() < 300, "{error}");
    let camera = "\u{1b}".repeat(2000);
    let error = row(&format!("c,{camera},1,1,1,1"));
    assert!(error.to_string().len() < 1000, "{error}");
}
