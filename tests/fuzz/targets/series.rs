//! TIFF stacks and Y4M videos with any content.
//!
//! Laws: no panic and no abort; every image that is read has as many pixels as its size says, which
//! is bounded; memory is bounded (`tests/fuzz/run`); an error names the file.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use station_fuzz::law::check_error;
use station_fuzz::stack::{Tiff, Video};
use trinocular_vision::images::decode::{MOST_PIXELS, Picture};
use trinocular_vision::images::series::Series;

/// File of several images.
#[derive(Arbitrary, Debug)]
enum File {
    Stack(Tiff),
    Video(Video),
    AnyStack(Vec<u8>),
    AnyVideo(Vec<u8>),
}

/// Largest number of images that are read.
const MOST: usize = 4;

fuzz_target!(|file: File| {
    let Ok(dir) = tempfile::tempdir() else {
        return;
    };
    let (bytes, is_stack) = match file {
        File::Stack(tiff) => (tiff.bytes(), true),
        File::Video(video) => (video.bytes(), false),
        File::AnyStack(bytes) => (bytes, true),
        File::AnyVideo(bytes) => (bytes, false),
    };
    let path = dir
        .path()
        .join(if is_stack { "left.tif" } else { "left.y4m" });
    if std::fs::write(&path, bytes).is_err() {
        return;
    }
    let series = match is_stack {
        true => Series::stack("left", &path),
        false => Series::video("left", &path),
    };
    let series = match series {
        Ok(series) => series,
        Err(error) => return check_error(&error, &[&path]),
    };
    for still in series.stills().iter().take(MOST) {
        match still.read(None) {
            Ok(picture) => {
                let [width, height] = picture.size_px().map(u64::from);
                assert!((1..=MOST_PIXELS).contains(&(width * height)));
                let pixels = match picture {
                    Picture::Eight(image) => image.grey.len(),
                    Picture::Sixteen { levels, .. } => levels.len(),
                };
                assert_eq!(pixels as u64, width * height);
            }
            Err(error) => check_error(&error, &[&path]),
        }
    }
});
