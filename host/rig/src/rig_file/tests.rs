use std::fs;

use super::*;
use trinocular_core::steps::WordRate;
use trinocular_core::track::pursuit::Settings;

const STAGE: &str = r#"
[stage]
steps_per_mm = [80, 80, 400]
max_speed_mm_s = [50, 50, 10]
max_acceleration_mm_s2 = [500, 500, 100]
max_jerk_mm_s3 = [5e3, 5e3, 1e3]
travel_mm = [[-50, 50], [-50, 50], [0, 30]]
invert = [false, true, false]
matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
driver = "TMC2209"
"#;

fn paper_text() -> String {
    RigFile::paper().to_toml() + STAGE
}

fn parse(text: &str) -> Result<RigFile, InputError> {
    RigFile::parse(Path::new("rig.toml"), text)
}

/// Returns the error of the paper's rig with one change, and the line of the change.
#[track_caller]
fn refusal(from: &str, to: &str) -> (InputError, usize) {
    let text = paper_text();
    let at = text.find(from).expect("the change must apply");
    let line = 1 + text[..at].matches('\n').count();
    let error = parse(&text.replacen(from, to, 1)).expect_err("must be refused");
    (error, line)
}

#[track_caller]
fn refused(from: &str, to: &str, field: &str, reason: &str) {
    let (error, line) = refusal(from, to);
    assert_eq!(error.field.as_deref(), Some(field), "{error}");
    assert_eq!(error.line, Some(line), "{error}");
    assert!(error.reason.contains(reason), "{error}");
}

#[test]
fn paper_rig_reads_back_exactly() {
    let mut rig = RigFile::paper();
    assert_eq!(parse(&rig.to_toml()).unwrap(), rig);
    rig.rig.cameras[1].distortion = [-0.123_456_789_012_345_67, 1e-9, 1e-3 / 3.0, 0.0, -0.0];
    rig.rig.cameras[2].focal_px[0] = 500.0 + 1.0 / 3.0;
    rig.rig.cameras[0].rotation = Rotation::from_degrees([1.0 / 3.0, -0.7, 0.0]);
    rig.names[2] = "a \"b\" ü".to_owned();
    let text = rig.to_toml();
    assert!(
        parse(&text).is_err(),
        "quotes cannot stand in a folder's name"
    );
    rig.names[2] = "rechts außen".to_owned();
    assert_eq!(parse(&rig.to_toml()).unwrap(), rig);
}

#[test]
fn stage_reads_back() {
    let rig = parse(&paper_text()).unwrap();
    let stage = rig.stage.clone().unwrap();
    assert_eq!(stage.steps_per_mm, [80.0, 80.0, 400.0]);
    assert_eq!(stage.travel_mm[2], [0.0, 30.0]);
    assert_eq!(stage.invert, [false, true, false]);
    assert_eq!(stage.driver, Driver::Tmc2209);
    assert_eq!(parse(&rig.to_toml()).unwrap(), rig);
}

#[test]
fn tracking_settings_are_optional() {
    let standard = parse(&paper_text()).unwrap().stage.unwrap().tracking;
    assert_eq!(standard, Settings::DEFAULT);
    let chosen = paper_text() + "prediction = false\ncoast_ms = 250\n";
    let rig = parse(&chosen).unwrap();
    let expected = Settings {
        prediction: false,
        coast_ms: 250,
    };
    assert_eq!(rig.stage.as_ref().unwrap().tracking, expected);
    assert_eq!(parse(&rig.to_toml()).unwrap(), rig);
    for (line, field) in [
        ("coast_ms = 0", "coast_ms"),
        ("coast_ms = 5001", "coast_ms"),
        ("prediction = 1", "prediction"),
    ] {
        let error = parse(&(paper_text() + line)).expect_err("must be refused");
        assert_eq!(error.field, Some(format!("stage.{field}")), "{error}");
    }
}

#[test]
fn whole_numbers_serve_as_floats() {
    let text = paper_text().replace("[533.16, 529.12]", "[450, 0x1C2]");
    assert_eq!(
        parse(&text).unwrap().rig.cameras[0].focal_px,
        [450.0, 450.0]
    );
}

#[test]
fn trinocular_names_are_ordered() {
    let text = RigFile::paper().to_toml();
    let blocks: Vec<&str> = text.split("\n[[camera]]").collect();
    let shuffled = [blocks[0], blocks[3], blocks[1], blocks[2]].join("\n[[camera]]");
    assert_ne!(shuffled, text);
    assert_eq!(parse(&shuffled).unwrap(), RigFile::paper());
}

#[test]
fn other_names_keep_file_order() {
    let text = RigFile::paper().to_toml();
    let text = text
        .replace("\"left\"", "\"zulu\"")
        .replace("-70.0", "90.0");
    let rig = parse(&text).unwrap();
    assert_eq!(rig.names, ["zulu", "middle", "right"]);
    assert_eq!(rig.rig.cameras[0].offset_mm, [90.0, 0.0]);
    assert!(!rig.is_trinocular());
}

#[test]
fn impossible_numbers_are_named() {
    refused(
        "533.16",
        "-533.16",
        "camera[0].focal_px[0]",
        "greater than 0",
    );
    refused("534.18", "0", "camera[1].focal_px[1]", "greater than 0");
    refused("534.18", "nan", "camera[1].focal_px[1]", "finite");
    refused("534.18", "+inf", "camera[1].focal_px[1]", "finite");
    refused("534.18", "1e400", "camera[1].focal_px[1]", "finite");
    refused(
        "534.18",
        "99999999999999999999",
        "camera[1].focal_px[1]",
        "finite",
    );
    for focal in ["1e9", "1e-308", "0.5", "11.9"] {
        refused("534.18", focal, "camera[1].focal_px[1]", "out of range");
    }
    refused("534.18", "20", "camera[1].focal_px[1]", "factor of 10");
    refused(
        "534.18",
        "\"534\"",
        "camera[1].focal_px[1]",
        "expected a number",
    );
    refused(
        "117.76",
        "240.0",
        "camera[2].principal_px[1]",
        "outside the image",
    );
    refused(
        "154.43",
        "-0.5",
        "camera[0].principal_px[0]",
        "outside the image",
    );
    refused("68.0", "nan", "camera[2].offset_mm[0]", "finite");
    refused("68.0", "1e6", "camera[2].offset_mm[0]", "out of range");
    refused("320", "0", "image_size_px[0]", "out of range");
    refused("240]", "70000]", "image_size_px[1]", "out of range");
    refused("240]", "-240]", "image_size_px[1]", "out of range");
    refused("240]", "240.5]", "image_size_px[1]", "whole number");
}

#[test]
fn wrong_shapes_are_named() {
    refused(
        "[320, 240]",
        "[320]",
        "image_size_px",
        "expected 2 elements, found 1",
    );
    refused("[320, 240]", "320", "image_size_px", "expected an array");
    refused(
        "[68.0, 0.0]",
        "[68.0, 0.0, 0.0]",
        "camera[2].offset_mm",
        "expected 2",
    );
    refused("[0, 0, 1]", "[0, 1]", "stage.matrix[2]", "expected 3");
    refused("\"right\"", "3", "camera[2].name", "expected a text");
    refused("[false,", "[0,", "stage.invert[0]", "true or false");
}

#[test]
fn unknown_or_missing_key_is_named() {
    refused("image_size_px", "image_size", "image_size", "unknown field");
    let at_name = "name = \"middle\"";
    refused(
        at_name,
        "zoom = 1\nname = \"middle\"",
        "camera[1].zoom",
        "unknown field",
    );
    refused("driver", "drivers", "stage.drivers", "unknown field");
    let (error, _) = refusal("offset_mm = [68.0, 0.0]", "");
    assert_eq!(error.field.as_deref(), Some("camera[2].offset_mm"));
    assert!(error.reason.contains("missing"), "{error}");
    // A missing field is reported at the line of its table.
    assert_eq!(error.line, Some(15), "{error}");
    let (error, _) = refusal("image_size_px = [320, 240]", "");
    assert_eq!(error.field.as_deref(), Some("image_size_px"));
}

#[test]
fn two_to_eight_cameras_are_valid() {
    let camera = |i: usize| {
        format!(
            "[[camera]]\nname = \"c{i}\"\nfocal_px = [500, 500]\nprincipal_px = [160, 120]\n\
             offset_mm = [{}, 0]\n",
            10 * i
        )
    };
    for count in 0..10 {
        let cameras: String = (0..count).map(camera).collect();
        let read = parse(&format!("image_size_px = [320, 240]\n{cameras}"));
        assert_eq!(read.is_ok(), (2..=8).contains(&count), "{count}: {read:?}");
        if let Err(error) = read {
            assert_eq!(error.field.as_deref(), Some("camera"));
        }
    }
}

#[test]
fn camera_names_must_be_distinct() {
    refused("\"right\"", "\"left\"", "camera[2].name", "already");
    refused("\"right\"", "\"Left\"", "camera[2].name", "already");
    refused("\"right\"", "\"\"", "camera[2].name", "empty");
    for bad in ["a/b", "a\\\\b", ".", "..", " a", "a\\u0000", "a\\nb"] {
        refused("right", bad, "camera[2].name", "cannot name a folder");
    }
}

#[test]
fn camera_places_must_be_distinct() {
    refused("68.0", "0.0", "camera[2].offset_mm", "same place");
    refused(
        "68.0",
        "-30.0",
        "camera[2].offset_mm",
        "left < middle < right",
    );
    // Of two cameras in the wrong order, the error names the later one.
    let (error, _) = refusal("-70.0", "70.0");
    assert_eq!(error.field.as_deref(), Some("camera[1].offset_mm"));
    assert!(error.reason.contains("left < middle < right"), "{error}");
}

#[test]
fn impossible_stages_are_named() {
    refused("400]", "-400]", "stage.steps_per_mm[2]", "greater than 0");
    refused("[0, 30]", "[30, 0]", "stage.travel_mm[2]", "less than");
    refused("[0, 0, 1]]", "[0, 1, 0]]", "stage.matrix", "not invertible");
    refused(
        "TMC2209",
        "TMC9999",
        "stage.driver",
        "A4988, DRV8825, TMC2209",
    );
}

#[test]
fn broken_toml_names_the_line() {
    refused("\"left\"", "\"left", "name", "not valid TOML");
    let (error, line) = refusal("offset_mm = [-70.0, 0.0]", "offset_mm [-70.0, 0.0]");
    assert_eq!(error.line, Some(line), "{error}");
    let (error, line) = refusal("name = \"left\"", "focal_px = 1");
    assert_eq!(error.line, Some(line + 1), "{error}");
    assert!(error.reason.contains("duplicate"), "{error}");
}

#[test]
fn writing_replaces_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    fs::write(&path, "old").unwrap();
    RigFile::paper().write(&path).unwrap();
    assert_eq!(RigFile::read(&path).unwrap(), RigFile::paper());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);

    let nowhere = folder.path().join("none/rig.toml");
    let error = RigFile::paper().write(&nowhere).unwrap_err();
    assert!(error.to_string().contains("cannot write"), "{error}");
    // A file cannot replace a folder: the draft must be removed.
    let occupied = folder.path().join("occupied");
    fs::create_dir(&occupied).unwrap();
    RigFile::paper().write(&occupied).unwrap_err();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn folding_lens_model_is_refused() {
    let with = |k1: &str| format!("offset_mm = [68.0, 0.0]\ndistortion = [{k1}, 0, 0, 0, 0]");
    let (error, line) = refusal("offset_mm = [68.0, 0.0]", &with("-30"));
    assert_eq!(error.field.as_deref(), Some("camera[2].distortion"));
    assert_eq!(error.line, Some(line + 1), "{error}");
    for lens in ["-0.4", "0.4"] {
        let text = paper_text().replace("offset_mm = [68.0, 0.0]", &with(lens));
        assert!(parse(&text).is_ok(), "an ordinary lens: {lens}");
    }
}

#[test]
fn rational_lens_is_read_and_checked() {
    let with = |eight: &str| format!("offset_mm = [68.0, 0.0]\ndistortion = [{eight}]");
    let text = |eight: &str| paper_text().replace("offset_mm = [68.0, 0.0]", &with(eight));
    let rig = parse(&text("0.5, -2.6, 0.001, -0.0004, 1.5, 0.38, -2.4, 1.4")).unwrap();
    let camera = &rig.rig.cameras[2];
    assert_eq!(
        (camera.distortion[4], camera.rational),
        (1.5, [0.38, -2.4, 1.4])
    );
    assert_eq!(parse(&rig.to_toml()).unwrap(), rig);
    // The denominator is zero within the image, or the image folds within; the border is right.
    for eight in ["0, 0, 0, 0, 0, -50, 0, 0", "0, 0, 0, 0, 0, 0, 800, 0"] {
        let (error, line) = refusal("offset_mm = [68.0, 0.0]", &with(eight));
        assert_eq!(
            error.field.as_deref(),
            Some("camera[2].distortion"),
            "{eight}"
        );
        assert_eq!(
            (error.line, error.reason.as_str()),
            (Some(line + 1), NOT_A_LENS),
            "{eight}"
        );
    }
    let (error, _) = refusal("offset_mm = [68.0, 0.0]", &with("0, 0, 0, 0, 0, 0"));
    assert!(
        error
            .reason
            .contains("expected 5 elements, found 6; the rational model has 8"),
        "{error}"
    );
}

#[test]
fn slightly_turned_camera_is_valid() {
    let with = |degrees: &str| format!("offset_mm = [68.0, 0.0]\nrotation_deg = {degrees}");
    let text = paper_text().replace("offset_mm = [68.0, 0.0]", &with("[0.5, -1, 12]"));
    let rig = parse(&text).unwrap();
    assert_eq!(rig.rig.cameras[2].rotation.degrees(), [0.5, -1.0, 12.0]);
    for (bad, field, reason) in [
        ("[0, 0, 400]", "camera[2].rotation_deg[2]", "out of range"),
        (
            "[0, 0, 21]",
            "camera[2].rotation_deg",
            "turned by 21.0 degrees, mostly about its optical axis",
        ),
        (
            "[1.5, 2, -179.5]",
            "camera[2].rotation_deg",
            "ffmpeg -vf hflip,vflip",
        ),
        (
            "[0, 0, 90]",
            "camera[2].rotation_deg",
            "mount it as the others",
        ),
        (
            "[25, 0, 5]",
            "camera[2].rotation_deg",
            "where the others look",
        ),
        (
            "[15, 15, 0]",
            "camera[2].rotation_deg",
            "turned by 21.2 degrees",
        ),
        ("[0, nan, 0]", "camera[2].rotation_deg[1]", "finite"),
        ("[0, 0]", "camera[2].rotation_deg", "expected 3"),
    ] {
        let (error, line) = refusal("offset_mm = [68.0, 0.0]", &with(bad));
        assert_eq!(error.field.as_deref(), Some(field), "{error}");
        assert_eq!(error.line, Some(line + 1), "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}

#[test]
fn paper_estimators_need_line_rig() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    RigFile::paper().write(&path).unwrap();
    assert_eq!(RigFile::read_in_line(&path).unwrap(), RigFile::paper());

    // The limit, 0.3 % of Z, is 0.6435 mm between middle and right, and 0.6625 between left and
    // middle.
    let raised = |heights_mm: [f64; 3]| {
        let mut raised = RigFile::paper();
        for (camera, height) in raised.rig.cameras.iter_mut().zip(heights_mm) {
            camera.offset_mm[1] = height;
        }
        raised.write(&path).unwrap();
        assert_eq!(RigFile::read(&path).unwrap(), raised);
        RigFile::read_in_line(&path)
    };
    for near in [[0.0, 0.643, 0.0], [-0.662, 0.0, 0.643], [9.0; 3]] {
        raised(near).unwrap();
    }
    for (far, field, line) in [
        ([0.0, 0.644, 0.0], "camera[2].offset_mm[1]", 19),
        ([0.663, 0.0, 0.0], "camera[0].offset_mm[1]", 7),
        ([0.0, 0.0, -2.0], "camera[2].offset_mm[1]", 19),
    ] {
        let error = raised(far).unwrap_err();
        assert_eq!(error.field.as_deref(), Some(field), "{error}");
        assert_eq!(error.line, Some(line), "{error}");
        assert!(error.reason.contains("0.3 % at most"), "{error}");
    }

    let mut renamed = RigFile::paper();
    renamed.names[0] = "port".to_owned();
    renamed.write(&path).unwrap();
    let error = RigFile::read_in_line(&path).unwrap_err();
    assert_eq!(
        (error.line, error.field.as_deref()),
        (Some(3), Some("camera"))
    );
    assert!(error.reason.contains("port, middle, right"), "{error}");
}

#[test]
fn deep_nesting_is_refused() {
    for open in ["[", "{a = "] {
        let error = parse(&format!("image_size_px = {}", open.repeat(100_000))).unwrap_err();
        assert!(error.reason.contains("not valid TOML"), "{error}");
    }
}

#[test]
fn other_formats_are_named() {
    let reason = |text: &str| {
        let parsed = RigFile::parse(Path::new("rig.toml"), text);
        parsed.expect_err("it is no rig file").to_string()
    };
    let json = reason("{\"image_size_px\": [640, 480]}");
    assert!(json.contains("is JSON"), "{json}");
    for yaml in ["%YAML:1.0\n---\n", "# rig\nimage_width: 640\n"] {
        let yaml = reason(yaml);
        assert!(
            yaml.contains("is YAML") && yaml.contains("convert"),
            "{yaml}"
        );
    }
    let xml = reason("<?xml version=\"1.0\"?>\n<opencv_storage>\n");
    assert!(xml.contains("is XML"), "{xml}");
    let toml = reason("image_size_px = [640, 480\n");
    assert!(toml.contains("not valid TOML"), "{toml}");
}

#[test]
fn decimal_commas_are_named() {
    let whole = RigFile::paper().to_toml();
    let line = whole.lines().find(|line| line.starts_with("focal_px"));
    for wrong in [
        "focal_px = [533,16, 529,12]",
        "focal_px = [533,16, 529.12]",
        "focal_px = [533.16, 529,12]",
        "focal_px = 533,16 529,12",
    ] {
        let text = whole.replacen(line.expect("it has one"), wrong, 1);
        let error = RigFile::parse(Path::new("rig.toml"), &text).expect_err("two numbers");
        let error = error.to_string();
        assert!(error.contains("decimal commas?"), "{error}");
    }
    // A third number that no comma explains, with blanks and without.
    for wrong in ["focal_px = [533.16, 529.12, 1]", "focal_px = [533,529,1]"] {
        let text = whole.replacen(line.expect("it has one"), wrong, 1);
        let error = RigFile::parse(Path::new("rig.toml"), &text).expect_err("three numbers");
        assert!(!error.to_string().contains("decimal commas?"), "{error}");
    }
}

#[test]
fn pivot_is_read_and_written() {
    for (lines, expected) in [
        ("", Some(Pivot::Centroid)),
        (
            "pivot = [1, 2, 900]\n",
            Some(Pivot::Place([1.0, 2.0, 900.0])),
        ),
        ("rotation = \"refuse\"\n", None),
        ("rotation = \"estimate\"\n", Some(Pivot::Centroid)),
        (
            "rotation = \"estimate\"\npivot = \"centroid\"\n",
            Some(Pivot::Centroid),
        ),
        (
            "rotation = \"estimate\"\npivot = [1, -2.5, 850]\n",
            Some(Pivot::Place([1.0, -2.5, 850.0])),
        ),
    ] {
        let read = parse(&(lines.to_owned() + &paper_text())).unwrap();
        assert_eq!(read.estimated_pivot(), expected, "{lines}");
        assert_eq!(parse(&read.to_toml()).unwrap(), read);
    }
}

#[test]
fn spot_is_read_with_its_laser() {
    let laser = "[laser]\nfrom_mm = [0, 40, 0]\ndirection = [0, -0.05, 1]\n";
    let text = format!(
        "rotation = \"estimate\"\npivot = \"spot\"\n{}{laser}",
        paper_text()
    );
    let read = parse(&text).unwrap();
    let expected = Laser {
        from_mm: [0.0, 40.0, 0.0],
        direction: [0.0, -0.05, 1.0],
    };
    assert_eq!(read.pivot, Pivot::Spot(expected));
    assert_eq!(parse(&read.to_toml()).unwrap(), read);
}

#[test]
fn impossible_pivots_are_refused() {
    let estimated = "image_size_px = [320, 240]\nrotation = \"estimate\"\npivot";
    let first = "image_size_px = [320, 240]";
    for (to, field, reason) in [
        ("rotation = \"refuze\"", "rotation", "refuse"),
        ("rotation = true", "rotation", "a text in quotes"),
        (
            "rotation = \"refuse\"\npivot = \"centroid\"",
            "pivot",
            "leave out `rotation = \"refuse\"`",
        ),
    ] {
        let error = parse(&paper_text().replacen(first, &format!("{first}\n{to}"), 1));
        let error = error.expect_err(to);
        assert_eq!(error.field.as_deref(), Some(field), "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
    for (pivot, field, reason) in [
        ("\"laser\"", "pivot", "spot"),
        ("\"spot\"", "pivot", "add `[laser]`"),
        ("[0, 0]", "pivot", "3 elements"),
        ("[0, nan, 0]", "pivot[1]", "finite"),
        ("[0, 0, 1e9]", "pivot[2]", "out of range"),
        ("850", "pivot", "an array"),
    ] {
        let text = paper_text().replacen(first, &format!("{estimated} = {pivot}"), 1);
        let error = parse(&text).expect_err(pivot);
        assert_eq!(error.field.as_deref(), Some(field), "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}

#[test]
fn trigger_is_read_and_written() {
    let trigger = "[trigger]\nrate_hz = 50\npulse_us = 500\n";
    let mut rig = parse(&(paper_text() + trigger)).unwrap();
    let read = Trigger {
        rate_hz: 50,
        pulse_us: 500,
        active_low: false,
        exposure_us: 0,
        between_steps: false,
    };
    assert_eq!(rig.trigger, Some(read));
    rig.trigger = Some(Trigger {
        rate_hz: 1_000,
        pulse_us: 750,
        active_low: true,
        exposure_us: 1_000,
        between_steps: false,
    });
    assert_eq!(parse(&rig.to_toml()).unwrap(), rig);
    // As long as the station allows.
    let settings = |text: &str| {
        let rig = parse(&(paper_text() + "[trigger]\n" + text)).unwrap();
        assert_eq!(parse(&rig.to_toml()).unwrap(), rig);
        let settings = rig.trigger.unwrap().settings();
        assert_eq!(settings.check(WordRate::MHZ_1), Ok(()));
        settings.quiet_us
    };
    let waits = "rate_hz = 250\npulse_us = 3500\nbetween_steps = true\n";
    assert_eq!(settings(waits), 3_500);
    assert_eq!(settings(&(waits.to_owned() + "exposure_us = 4000")), 4_000);
    assert_eq!(settings(&waits.replace("true", "false")), 0);
}

#[test]
fn whole_numbers_may_have_a_point() {
    let text = paper_text() + "[trigger]\nrate_hz = 30.0\npulse_us = 2e3\n";
    let trigger = parse(&text).expect("a rig").trigger.expect("it is there");
    assert_eq!((trigger.rate_hz, trigger.pulse_us), (30, 2_000));
    for (rate, says) in [
        ("29.97", "29.97 is no whole number"),
        ("nan", "no whole number"),
        ("-30.0", "-30.0 is out of range"),
        ("1e10", "1e10 is out of range"),
        ("inf", "no whole number"),
    ] {
        let text = paper_text() + &format!("[trigger]\nrate_hz = {rate}\npulse_us = 2000\n");
        let error = parse(&text).expect_err(rate).to_string();
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn impossible_triggers_are_named() {
    let bad = [
        ("rate_hz = 0", "rate_hz"),
        ("rate_hz = 1001", "rate_hz"),
        ("rate_hz = 59.94", "rate_hz"),
        ("pulse_us = 9", "pulse_us"),
        ("pulse_us = 9751", "pulse_us"),
        ("active_low = 1", "active_low"),
        ("exposure_us = 10001", "exposure_us"),
        ("width_us = 5", "width_us"),
        ("between_steps = 1", "between_steps"),
    ];
    for (line, field) in bad {
        let key = line.split(' ').next().unwrap();
        let lines = ["rate_hz = 100", "pulse_us = 2000", line].into_iter();
        // The line replaces the one of the same field.
        let others = lines.filter(|other| *other == line || !other.starts_with(key));
        let text = paper_text() + "[trigger]\n" + &others.collect::<Vec<_>>().join("\n");
        let error = parse(&text).expect_err(line);
        let named = format!("trigger.{field}");
        let says = error.to_string();
        assert!(says.contains(&named), "{says}");
        assert!(error.line.is_some(), "{says}");
    }
    let waiting = paper_text() + "[trigger]\nbetween_steps = true\n";
    for (lines, field) in [
        ("rate_hz = 251\npulse_us = 100", "rate_hz"),
        ("rate_hz = 250\npulse_us = 3501", "pulse_us"),
        ("rate_hz = 10\npulse_us = 50001", "pulse_us"),
        (
            "rate_hz = 1\npulse_us = 100\nexposure_us = 50001",
            "exposure_us",
        ),
    ] {
        let error = parse(&(waiting.clone() + lines)).unwrap_err().to_string();
        assert!(error.contains(&format!("trigger.{field}")), "{error}");
    }
    let text = paper_text() + "[trigger]\nrate_hz = 100\n";
    assert!(parse(&text).unwrap_err().to_string().contains("pulse_us"));
}
