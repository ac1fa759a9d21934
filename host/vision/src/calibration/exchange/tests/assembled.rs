//! Rigs assembled from the files of single cameras.

use super::*;

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
