//! A commented rig file for a new rig: every field, its meaning, and its range.
//!
//! The values of cameras are guesses until `calibrate` has measured them, and the text says so.

use std::fmt::Write as _;

use super::stage::Driver;

/// Values of a new rig file, for [`text`].
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// Names of the cameras from left to right, 2 to 8.
    pub cameras: Vec<String>,
    /// Columns and rows of every image, px.
    pub image_size_px: [u32; 2],
    /// Focal length of every camera, px.
    pub focal_px: f64,
    /// Distance between neighbouring cameras, mm.
    pub baseline_mm: f64,
    /// The stage, if there is one.
    pub stage: Option<StageTemplate>,
}

/// Values of the `[stage]` section. Arrays are per stage axis X, Y, Z.
#[derive(Clone, Debug, PartialEq)]
pub struct StageTemplate {
    /// Name of its board in `firmware/build`.
    pub board: String,
    /// Steps per mm, micro steps included.
    pub steps_per_mm: [f64; 3],
    /// Greatest speed, mm/s.
    pub max_speed_mm_s: [f64; 3],
    /// Greatest acceleration, mm/s².
    pub max_acceleration_mm_s2: [f64; 3],
    /// Soft limits, mm from zero.
    pub travel_mm: [f64; 2],
    /// The step drivers.
    pub driver: Driver,
}

/// Jerk over acceleration, 1/s: full acceleration is reached within 40 ms.
const JERK_PER_ACCELERATION: f64 = 25.0;

/// Returns the text of a rig file with these values. [`RigFile::parse`](super::RigFile::parse)
/// checks it like a user's file.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::RigFile;
/// use trinocular_rig::rig_file::template::{Template, text};
///
/// let text = text(&Template {
///     cameras: ["left", "right"].map(String::from).to_vec(),
///     image_size_px: [640, 480],
///     focal_px: 800.0,
///     baseline_mm: 60.0,
///     stage: None,
/// });
/// let rig = RigFile::parse(Path::new("rig.toml"), &text)?.rig;
/// assert_eq!(rig.cameras[1].offset_mm, [30.0, 0.0]);
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
pub fn text(template: &Template) -> String {
    let mut text = String::from(HEAD);
    let [columns, rows] = template.image_size_px;
    let _ = writeln!(
        text,
        "image_size_px = [{columns}, {rows}]  # columns, rows of every camera's image"
    );
    text.push_str(CAMERAS);
    let middle = (template.cameras.len() as f64 - 1.0) / 2.0;
    for (index, name) in template.cameras.iter().enumerate() {
        let offset_mm = (index as f64 - middle) * template.baseline_mm;
        let centre = [columns, rows].map(|side| (f64::from(side) - 1.0) / 2.0);
        let _ = write!(
            text,
            "\n[[camera]]\nname = {}\nfocal_px = [{focal:?}, {focal:?}]\n\
             principal_px = {centre:?}\n\
             offset_mm = [{offset_mm:?}, 0.0]\n\
             # distortion = [0.0, 0.0, 0.0, 0.0, 0.0]\n# rotation_deg = [0.0, 0.0, 0.0]\n",
            toml::Value::from(name.as_str()),
            focal = template.focal_px,
        );
    }
    match &template.stage {
        Some(stage) => stage_text(&mut text, stage),
        None => text.push_str(NO_STAGE),
    }
    text
}

fn stage_text(text: &mut String, stage: &StageTemplate) {
    let jerk = stage
        .max_acceleration_mm_s2
        .map(|acceleration| acceleration * JERK_PER_ACCELERATION);
    let [low, high] = stage.travel_mm;
    let _ = write!(
        text,
        "\n# The stage, driven by the board {board} (firmware: `firmware/build {board}`).\n\
         # Values in brackets are per stage axis X, Y, Z.\n\
         [stage]\n\
         steps_per_mm = {steps:?}  # micro steps included\n\
         max_speed_mm_s = {speed:?}\n\
         max_acceleration_mm_s2 = {acceleration:?}\n\
         max_jerk_mm_s3 = {jerk:?}  # acceleration over the time to reach it\n\
         travel_mm = [[{low:?}, {high:?}], [{low:?}, {high:?}], [{low:?}, {high:?}]]  \
         # soft limits from zero\n\
         invert = [false, false, false]  # true: the motor's positive direction \
         is the axis's negative\n\
         driver = \"{driver}\"  # A4988, DRV8825 or TMC2209: sets pulse lengths and set-up times\n",
        board = stage.board,
        steps = stage.steps_per_mm,
        speed = stage.max_speed_mm_s,
        acceleration = stage.max_acceleration_mm_s2,
        driver = stage.driver.name(),
    );
    text.push_str(STAGE_TAIL);
}

const HEAD: &str = "\
# Rig file of Trinocular: the cameras, and the stage if there is one.
# All lengths are in mm, all image positions in px. Axes: x right, y down, z away from the cameras.
# `trinocular verify` checks this file and predicts what the rig can do.

";

const CAMERAS: &str = "
# Cameras, 2 to 8, parallel and in one plane. THESE VALUES ARE GUESSES: measure them with
#   trinocular calibrate boards/ --board 9x6 --square 25 --out rig.toml --force
# which keeps the [stage] section.
#   name          also the name of the camera's folder of images
#   focal_px      along x and y: focal length in mm / pixel pitch in mm
#   principal_px  where the optical axis meets the image, from the centre of the top left pixel
#   offset_mm     right and down of the rig's origin; beware of metres
#   distortion    k1 k2 p1 p2 k3 of OpenCV, or also k4 k5 k6; zero without
#   rotation_deg  turned about x, y, z against the rig's axes, at most 20 degrees; zero without
";

const NO_STAGE: &str = "
# There is no [stage] section: this rig measures and moves nothing.
# `trinocular init --board olimex-h405` writes one.
";

const STAGE_TAIL: &str = "\
# Displacements along the camera axes times this matrix are displacements along the stage axes.
# `trinocular calibrate-stage` measures it; a wrong sign makes the stage run away from the target.
matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

# Optional. The values hold without the lines, except where a comment says otherwise.
# prediction = true                     # false: no prediction, no watch for lost steps
# coast_ms = 800                        # go on at the last velocity for this time without a frame
# backlash_mm = [0.0, 0.0, 0.0]         # play of each axis when it reverses
# home_switch = [\"none\", \"none\", \"none\"] \
# end with the home switch: negative, positive or none
# home_position_mm = [0.0, 0.0, 0.0]    # where each home switch trips: required with home_switch,
#                                       # and outside travel_mm
# home_speed_mm_s = [10.0, 1.0]         # towards a home switch: first approach, second approach
# back_off_mm = 2.0                     # distance between the two approaches, and afterwards
# slow_speed_mm_s = 5.0                 # greatest speed while the position is unknown
# unknown_window_mm = 10.0              # greatest travel while the position is unknown
# largest_error_mm = 20.0               # a following error above this is a fault; without it: no limit
# longest_error_s = 1.0                 # after this time
# largest_unseen_mm = 10.0              # motion that the cameras do not see is a fault; 0: never
# motors_off_after_s = 0                # switch the motors off after this time at rest; 0: never
";

#[cfg(test)]
mod tests {
    use super::super::stage::KEYS;
    use super::super::{Care, RigFile};
    use super::*;
    use std::path::Path;

    fn example(cameras: &[&str]) -> Template {
        Template {
            cameras: cameras.iter().map(|name| String::from(*name)).collect(),
            image_size_px: [640, 480],
            focal_px: 800.0,
            baseline_mm: 30.0,
            stage: Some(StageTemplate {
                board: "skr-2".into(),
                steps_per_mm: [80.0, 80.0, 400.0],
                max_speed_mm_s: [100.0, 100.0, 20.0],
                max_acceleration_mm_s2: [2_000.0; 3],
                travel_mm: [-60.0, 60.0],
                driver: Driver::A4988,
            }),
        }
    }

    fn parsed(text: &str) -> RigFile {
        RigFile::parse(Path::new("rig.toml"), text).expect("a template is a rig file")
    }

    #[test]
    fn template_reads_back() {
        let file = parsed(&text(&example(&["left", "middle", "right"])));
        let offsets: Vec<_> = file.rig.cameras.iter().map(|c| c.offset_mm[0]).collect();
        assert_eq!(offsets, [-30.0, 0.0, 30.0]);
        assert_eq!(file.rig.cameras[0].principal_px, [319.5, 239.5]);
        let stage = file.stage.expect("it has one");
        assert_eq!(stage.steps_per_mm, [80.0, 80.0, 400.0]);
        assert_eq!(stage.max_jerk_mm_s3, [50_000.0; 3]);
        assert_eq!(stage.driver, Driver::A4988);
        assert_eq!(stage.care, Care::default());
    }

    #[test]
    fn template_names_all_stage_fields() {
        let known = std::collections::BTreeSet::from(KEYS);
        assert_eq!(known.len(), KEYS.len());
        let text = text(&example(&["a", "b"]));
        for key in KEYS {
            assert!(text.contains(&format!("{key} = ")), "{key}");
        }
    }

    #[test]
    fn optional_fields_show_defaults() {
        let with = text(&example(&["left", "right"]));
        let all = with
            .replace("# largest_error_mm = 20.0", "")
            .lines()
            .map(|line| match line.strip_prefix("# ") {
                Some(rest) if rest.contains(" = ") && !rest.starts_with(' ') => rest,
                _ => line,
            })
            .collect::<Vec<_>>()
            .join("\n");
        assert_ne!(all, with);
        let [all, with] = [&all, &with].map(|text| parsed(text));
        assert_eq!(all.rig, with.rig);
        assert_eq!(all.stage, with.stage);
    }
}
