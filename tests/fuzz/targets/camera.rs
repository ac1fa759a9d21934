//! Camera files of OpenCV and ROS with any edits, and the rigs made from them.
//!
//! Laws: no panic; an error names one of the files; a camera that is written in either format has
//! the same lens when it is read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station_fuzz::edit::{Edit, edited};
use station_fuzz::law::check_error;
use std::path::{Path, PathBuf};
use trinocular_core::rig::Rig;
use trinocular_vision::calibration::exchange::{CameraFile, Member, assemble, opencv, ros};

fuzz_target!(|input: (bool, Vec<Edit>, Vec<Edit>, Option<[f64; 2]>)| {
    let (is_ros, left, right, offset_mm) = input;
    let paper = Rig::paper();
    let text = |index: usize| match is_ros {
        true => ros("camera", &paper.cameras[index], &paper),
        false => opencv(&paper.cameras[index], paper.image_size_px),
    };
    let mut members = Vec::new();
    for (index, edits) in [(0, left), (2, right)] {
        let path = PathBuf::from(format!("some/{index}.yaml"));
        match CameraFile::parse(&path, &edited(&text(index), &edits)) {
            Ok(file) => members.push(Member {
                name: index.to_string(),
                offset_mm: offset_mm.filter(|_| index == 2),
                path,
                file,
            }),
            Err(error) => check_error(&error, &[&path]),
        }
    }
    let [_, _] = members.as_slice() else {
        return;
    };
    let rig = match assemble(&members) {
        Ok(assembled) => assembled.rig.rig,
        Err(error) => {
            let paths: Vec<&Path> = members.iter().map(|member| member.path.as_path()).collect();
            return check_error(&error, &paths);
        }
    };
    for (camera, member) in rig.cameras.iter().zip(&members) {
        for text in [opencv(camera, rig.image_size_px), ros("a", camera, &rig)] {
            let file = CameraFile::parse(&member.path, text.as_bytes());
            let file = file.unwrap_or_else(|error| panic!("{error} in {text}"));
            assert_eq!(
                (file.lens, file.rational),
                (member.file.lens, member.file.rational)
            );
        }
    }
});
