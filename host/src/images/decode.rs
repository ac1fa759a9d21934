//! The front door for pictures: bytes of a PNG, JPEG or PNM file to a grey image.
//!
//! Everything that a file claims is judged before it costs anything: its size in pixels, the memory
//! that decoding takes, and whether the file is long enough to hold such a picture and is whole.
//! Metadata are never inflated. A decoder that panics has met a bad file, not a fault that ends
//! the program.
//!
//! *Invariant:* every picture of every command comes through [`decode`], live JPEG frames too.

use std::io::Cursor;

use image::codecs::jpeg::JpegDecoder;
use image::codecs::png::PngDecoder;
use image::codecs::pnm::PnmDecoder;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, Limits};

use super::Image;

mod jpeg;
mod panic;
mod png;
mod pnm;

/// Bytes of the largest file that is read.
pub const LARGEST_FILE: u64 = 256 << 20;
/// Pixels of the largest picture: 8192 x 6144. Whoever looks for corners in it needs 8 bytes for
/// each.
pub const MOST_PIXELS: u64 = 48 << 20;
/// Bytes that one picture may take: the file, what the decoder needs, and the grey image.
pub const MEMORY: u64 = 512 << 20;

/// Why bytes are no picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The picture has a size, but not the one that was asked for.
    #[error("{} x {} px, but expected are {} x {} px", .given[0], .given[1], .wanted[0], .wanted[1])]
    OtherSize {
        /// Width and height, px.
        given: [u32; 2],
        /// Width and height that the picture must have, px.
        wanted: [u32; 2],
    },
    /// A side is 0.
    #[error("{0} x {1} px is no picture")]
    Empty(u32, u32),
    /// More than [`MOST_PIXELS`].
    #[error("{0} x {1} px are too many; a picture has {MOST_PIXELS} pixels (8192 x 6144) at most")]
    TooLarge(u32, u32),
    /// More than [`MEMORY`].
    #[error("to read it takes {} MB; {} MB is the limit", .0 >> 20, MEMORY >> 20)]
    TooMuchMemory(u64),
    /// The file ends before the picture does.
    #[error("cannot read the image: the file is cut off: {0}")]
    CutOff(&'static str),
    /// The file contradicts its format.
    #[error("cannot read the image: {0}")]
    Malformed(String),
}

impl From<ImageError> for Refusal {
    fn from(error: ImageError) -> Self {
        Self::Malformed(error.to_string())
    }
}

/// Decodes a picture as grey. `size_px` (width, height) is the size it must have, if that is known.
///
/// # Errors
/// [`Refusal`]. Also where the decoder panics.
pub fn decode(bytes: &[u8], size_px: Option<[u32; 2]>) -> Result<Image, Refusal> {
    panic::caught(|| decode_as_claimed(bytes, size_px)).unwrap_or_else(|| {
        let reason = "its content confuses the decoder";
        Err(Refusal::Malformed(reason.to_owned()))
    })
}

fn decode_as_claimed(bytes: &[u8], size_px: Option<[u32; 2]>) -> Result<Image, Refusal> {
    let format = image::guess_format(bytes).ok();
    match format {
        Some(ImageFormat::Png) => {
            let file = png::without_metadata(bytes)?;
            let least = |size| png::least_bytes(bytes, size);
            let judge = Judge {
                bytes,
                size_px,
                extra: file.len() as u64,
            };
            judge.size(png::size_px(bytes)?, least)?;
            let limits = judge.limits();
            judge.decode(PngDecoder::with_limits(Cursor::new(&file[..]), limits)?)
        }
        Some(ImageFormat::Jpeg) => {
            let frame = jpeg::frame(bytes)?;
            let judge = Judge {
                bytes,
                size_px,
                extra: frame.coefficient_bytes(),
            };
            judge.size(frame.size_px, |_| frame.least_bytes())?;
            jpeg::check_data(bytes)?;
            judge.decode(JpegDecoder::new(Cursor::new(bytes))?)
        }
        Some(ImageFormat::Pnm) => {
            let decoder = PnmDecoder::new(Cursor::new(bytes))?;
            let judge = Judge {
                bytes,
                size_px,
                extra: 0,
            };
            let least = pnm::least_bytes(decoder.header());
            judge.size(decoder.dimensions().into(), |_| least)?;
            judge.decode(decoder)
        }
        _ => {
            let reason = "neither PNG nor JPEG nor PNM";
            Err(Refusal::Malformed(reason.to_owned()))
        }
    }
}

/// What a file's claims are held against.
struct Judge<'a> {
    bytes: &'a [u8],
    size_px: Option<[u32; 2]>,
    /// Bytes that the decoder takes beside its output.
    extra: u64,
}

impl Judge<'_> {
    /// Judges the claimed size. `least` is how many bytes a file of this size has at least.
    fn size(&self, given: [u32; 2], least: impl FnOnce([u64; 2]) -> u64) -> Result<(), Refusal> {
        let [width, height] = given;
        if width == 0 || height == 0 {
            return Err(Refusal::Empty(width, height));
        }
        if let Some(wanted) = self.size_px
            && given != wanted
        {
            return Err(Refusal::OtherSize { given, wanted });
        }
        if u64::from(width) * u64::from(height) > MOST_PIXELS {
            return Err(Refusal::TooLarge(width, height));
        }
        if (self.bytes.len() as u64) < least([width.into(), height.into()]) {
            return Err(Refusal::CutOff("it is too short for a picture of its size"));
        }
        Ok(())
    }

    fn limits(&self) -> Limits {
        let mut limits = Limits::default();
        limits.max_alloc = Some(MEMORY);
        limits
    }

    /// Decodes, if the memory for it suffices.
    fn decode(&self, mut decoder: impl ImageDecoder) -> Result<Image, Refusal> {
        let (width, height) = decoder.dimensions();
        // The picture that is decoded is the one that was judged.
        self.size([width, height], |_| 0)?;
        let pixels = u64::from(width) * u64::from(height);
        let file = self.bytes.len() as u64;
        let needed = [decoder.total_bytes(), pixels, file, self.extra];
        let needed = needed.into_iter().fold(0, u64::saturating_add);
        if needed > MEMORY {
            return Err(Refusal::TooMuchMemory(needed));
        }
        decoder.set_limits(self.limits())?;
        let picture = DynamicImage::from_decoder(decoder)?;
        Ok(Image {
            width: width as usize,
            height: height as usize,
            grey: picture.into_luma8().into_raw(),
        })
    }
}

#[cfg(test)]
mod tests;
