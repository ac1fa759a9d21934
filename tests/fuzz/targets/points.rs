//! Files of points with any edits.
//!
//! Laws: no panic; an error names the file; the points read are finite, and have sums or a refusal.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station_fuzz::edit::{Edit, edited};
use station_fuzz::law::check_error;
use std::path::Path;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::points;
use trinocular_vision::sums::Sums;

const GOOD: &str = "id,camera,x0,y0,x1,y1\n\
    a,left,193,101,197,105\n\
    a,middle,159,101,163,105\n\
    a,right,120,101,124,105\n\
    b,right,20,11,24,15\n\
    \"b\",left,93,11,97,15\n\
    b , middle,59,11,63,15\r\n";

fuzz_target!(|edits: Vec<Edit>| {
    let (file, rig) = (Path::new("some/points.csv"), RigFile::paper());
    match points::parse(file, &edited(GOOD, &edits), &rig) {
        Ok(points) => {
            let pixels = points
                .correspondences
                .iter()
                .flat_map(|point| &point.pixels);
            assert!(pixels.flatten().flatten().all(|number| number.is_finite()));
            let _ = Sums::new(&rig.rig, &points.correspondences);
        }
        Err(error) => check_error(&error, &[file]),
    }
});
