//! Messages with images: `sensor_msgs/Image` and `sensor_msgs/CompressedImage`, as grey images.

use crate::cdr::{CdrFault, Reader};
use crate::message::read_header;
use image::{DynamicImage, ImageBuffer, Rgb};
use trinocular_vision::images::Image;
use trinocular_vision::images::decode::{self, MOST_PIXELS, Picture, decode_deep};

/// Types of messages that hold images.
pub const KINDS: [&str; 2] = ["sensor_msgs/Image", "sensor_msgs/CompressedImage"];

/// Reason for which a message is no image that can be read.
#[derive(Debug, thiserror::Error)]
pub enum ImageFault {
    /// The message is malformed.
    #[error("malformed: {0}")]
    Cdr(#[from] CdrFault),
    /// The encoding of the pixels is not read.
    #[error(
        "its pixels are {0:?}, which is not read; mono8, mono16, rgb8, bgr8, rgba8, bgra8 are: \
         convert it with image_proc, or record the grey image"
    )]
    Encoding(String),
    /// Size and pixels contradict each other.
    #[error("{width} x {height} px with rows of {step} bytes do not fit {bytes} bytes of pixels")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes per row.
        step: u32,
        /// Bytes of the pixels.
        bytes: usize,
    },
    /// The file within the message cannot be decoded.
    #[error(transparent)]
    File(#[from] decode::Refusal),
}

/// Returns the capture time of a message with an image, ns.
///
/// # Errors
/// [`CdrFault`] if it has none.
pub fn stamp_ns(message: &[u8]) -> Result<u64, CdrFault> {
    read_header(&mut Reader::new(message)?)
}

/// Decodes the image of a message of type `kind`, one of [`KINDS`], as 8-bit grey, scaled by the bits
/// that it uses. Frame sets are scaled all alike by [`FrameSets`](super::frames::FrameSets).
///
/// # Errors
/// [`ImageFault`] if it cannot be read.
pub fn read(kind: &str, message: &[u8]) -> Result<Image, ImageFault> {
    let picture = read_deep(kind, message)?;
    let bits = picture.bits_in_use();
    Ok(picture.scaled(bits))
}

/// Decodes the image of a message of type `kind`, one of [`KINDS`], as grey with its depth, 8 or 16
/// bits.
///
/// # Errors
/// [`ImageFault`] if it cannot be read.
pub fn read_deep(kind: &str, message: &[u8]) -> Result<Picture, ImageFault> {
    let mut reader = Reader::new(message)?;
    read_header(&mut reader)?;
    if kind == "sensor_msgs/CompressedImage" {
        reader.text()?;
        return Ok(decode_deep(reader.block()?, None)?);
    }
    let (height, width) = (reader.u32()?, reader.u32()?);
    let encoding = reader.text()?;
    let is_bigendian = reader.u8()? != 0;
    let step = reader.u32()?;
    let pixels = reader.block()?;
    let depth: u32 = match encoding {
        "mono8" | "8UC1" => 1,
        "mono16" | "16UC1" => 2,
        "rgb8" | "bgr8" | "8UC3" => 3,
        "rgba8" | "bgra8" => 4,
        other => return Err(ImageFault::Encoding(other.chars().take(40).collect())),
    };
    let size = || ImageFault::Size {
        width,
        height,
        step,
        bytes: pixels.len(),
    };
    let row = u64::from(width) * u64::from(depth);
    let is_sound = width > 0
        && height > 0
        && u64::from(width) * u64::from(height) <= MOST_PIXELS
        && row <= u64::from(step)
        && u64::from(step) * u64::from(height) <= pixels.len() as u64;
    if !is_sound {
        return Err(size());
    }
    let rows = pixels.chunks_exact(step as usize).take(height as usize);
    let packed: Vec<u8> = rows.flat_map(|r| &r[..row as usize]).copied().collect();
    let grey = match depth {
        1 => packed,
        2 => {
            let (pairs, _) = packed.as_chunks::<2>();
            let number = |pair: &[u8; 2]| match is_bigendian {
                true => u16::from_be_bytes(*pair),
                false => u16::from_le_bytes(*pair),
            };
            // As 16-bit files are read: the bits in use are known with the whole frame set.
            return Ok(Picture::Sixteen {
                width: width as usize,
                height: height as usize,
                levels: pairs.iter().map(number).collect(),
            });
        }
        _ => {
            let is_rgb = encoding.starts_with("rgb");
            let colours = packed
                .chunks_exact(depth as usize)
                .flat_map(|p| match is_rgb {
                    true => [p[0], p[1], p[2]],
                    false => [p[2], p[1], p[0]],
                });
            let whole = ImageBuffer::<Rgb<u8>, Vec<u8>>::from_raw(width, height, colours.collect());
            DynamicImage::from(whole.ok_or_else(size)?)
                .into_luma8()
                .into_raw()
        }
    };
    Ok(Picture::Eight(Image {
        width: width as usize,
        height: height as usize,
        grey,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Writer;

    fn message(encoding: &str, [width, height]: [u32; 2], step: u32, pixels: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes);
        writer.i32(12);
        writer.u32(345);
        writer.text("optical");
        writer.u32(height);
        writer.u32(width);
        writer.text(encoding);
        writer.u8(0);
        writer.u32(step);
        writer.block(pixels);
        bytes
    }

    fn grey(encoding: &str, size: [u32; 2], step: u32, pixels: &[u8]) -> Vec<u8> {
        let message = message(encoding, size, step, pixels);
        assert_eq!(stamp_ns(&message), Ok(12_000_000_345));
        let image = read("sensor_msgs/Image", &message).expect("an image");
        assert_eq!([image.width as u32, image.height as u32], size);
        image.grey
    }

    #[test]
    fn padding_of_rows_is_skipped() {
        assert_eq!(
            grey("mono8", [2, 2], 3, &[1, 2, 99, 3, 4, 99]),
            [1, 2, 3, 4]
        );
    }

    #[test]
    fn sixteen_bits_become_eight() {
        assert_eq!(grey("mono16", [2, 1], 4, &[0, 0, 0xff, 0xff]), [0, 255]);
        assert_eq!(grey("16UC1", [1, 1], 2, &[0x80, 0x80]), [128]);
        // The upper bits of a camera of 12 bits are unused.
        assert_eq!(
            grey("mono16", [2, 1], 4, &[0xff, 0x0f, 0, 0x08]),
            [255, 128]
        );
    }

    #[test]
    fn colour_becomes_its_luminance() {
        let [red, other] = ["rgb8", "bgr8"].map(|order| grey(order, [1, 1], 3, &[200, 0, 0])[0]);
        assert!(red > other, "{red} {other}");
        assert_eq!(grey("bgra8", [1, 1], 4, &[0, 0, 200, 0]), [red]);
    }

    #[test]
    fn impossible_sizes_are_refused() {
        for (encoding, size, step, reason) in [
            ("mono8", [3, 2], 3, "do not fit"),
            ("mono8", [2, 2], 1, "do not fit"),
            ("mono8", [0, 2], 2, "do not fit"),
            ("mono8", [u32::MAX, u32::MAX], u32::MAX, "do not fit"),
            ("bayer_rggb8", [2, 2], 2, "bayer_rggb8"),
        ] {
            let message = message(encoding, size, step, &[1, 2, 3, 4]);
            let fault = read("sensor_msgs/Image", &message).unwrap_err().to_string();
            assert!(fault.contains(reason), "{fault}");
        }
    }
}
