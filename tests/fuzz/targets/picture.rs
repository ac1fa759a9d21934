//! Image files: PNG, JPEG, PNM, TIFF, BMP and WebP with any content.
//!
//! Laws: no panic and no abort; an image has as many pixels as its size says, which is bounded, and
//! decodes the same if its size is known before; memory is bounded (`tests/fuzz/run`); messages are
//! printable.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station_fuzz::law::check_message;
use station_fuzz::picture::File;
use trinocular_vision::images::decode::{MOST_PIXELS, decode};

fuzz_target!(|file: File| {
    let bytes = file.bytes();
    match decode(&bytes, None) {
        Ok(image) => {
            assert_eq!(image.grey.len(), image.width * image.height);
            assert!((1..=MOST_PIXELS).contains(&(image.grey.len() as u64)));
            let size_px = [image.width, image.height].map(|side| side as u32);
            assert_eq!(decode(&bytes, Some(size_px)), Ok(image));
        }
        Err(refusal) => check_message(&trinocular_rig::printable::printable(refusal)),
    }
});
