//! Rig files with any edits.
//!
//! Laws: no panic; an error names the file; a rig that is written is read again, bit for bit.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station_fuzz::edit::{Edit, edited};
use station_fuzz::law::check_error;
use std::path::Path;
use trinocular_rig::rig_file::RigFile;

const GOOD: &str = r#"image_size_px = [320, 240]
[[camera]]
name = "left"
focal_px = [533.16, 529.12]
principal_px = [154.43, 123.0]
offset_mm = [-70.0, 0.0]
distortion = [0.01, 0.0, 0.0, 0.0, 0.0]
rotation_deg = [0.0, 0.5, 0.0]
[[camera]]
name = "middle"
focal_px = [538.14, 533.83]
principal_px = [152.43, 111.18]
offset_mm = [0.0, 0.0]
[[camera]]
name = "right"
focal_px = [535.0, 530.0]
principal_px = [150.0, 120.0]
offset_mm = [68.0, 0.0]
[stage]
steps_per_mm = [80, 80, 400]
max_speed_mm_s = [50, 50, 10]
max_acceleration_mm_s2 = [500, 500, 100]
max_jerk_mm_s3 = [5e3, 5e3, 1e3]
travel_mm = [[-50, 50], [-50, 50], [0, 30]]
invert = [false, true, false]
matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
driver = "TMC2209"
backlash_mm = [0.02, 0.02, 0.05]
home_switch = ["negative", "negative", "none"]
home_position_mm = [-61.0, -61.0, 0.0]
slow_speed_mm_s = 5.0
largest_error_mm = 20.0
"#;

fuzz_target!(|edits: Vec<Edit>| {
    let file = Path::new("some/rig.toml");
    let Ok(text) = String::from_utf8(edited(GOOD, &edits)) else {
        return;
    };
    match RigFile::parse(file, &text) {
        Ok(rig) => assert_eq!(RigFile::parse(file, &rig.to_toml()), Ok(rig)),
        Err(error) => check_error(&error, &[file]),
    }
});
