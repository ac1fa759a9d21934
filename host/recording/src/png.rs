//! PNG files of recorded images.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use std::io;
use trinocular_vision::images::Image;

/// Encodes an image as a PNG file.
pub(crate) fn png(image: &Image) -> io::Result<Vec<u8>> {
    let mut file = Vec::new();
    let encoder =
        PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive);
    let (width, height) = (image.width as u32, image.height as u32);
    let written = encoder.write_image(&image.grey, width, height, ExtendedColorType::L8);
    written.map_err(|cause| io::Error::other(cause.to_string()))?;
    Ok(file)
}
