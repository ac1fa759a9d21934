//! Decoding of images: bytes of a PNG, JPEG, PNM, TIFF, BMP or WebP file to a grey image.
//!
//! Of a TIFF file with several pages, the first is the image; stacks are read by
//! [`series`](super::series).
//!
//! All claims of a file are checked before they cost anything: its size in pixels, the memory that
//! decoding takes, and that the file is whole and long enough for such an image. Metadata are never
//! inflated. A panic of a decoder is an error of the file and does not end the program.
//!
//! *Invariant:* every encoded image of every command comes through [`decode_deep`] or
//! [`decode_tiff`], live JPEG images too.

use std::io::{BufRead, Cursor, Seek};

use image::codecs::bmp::BmpDecoder;
use image::codecs::jpeg::JpegDecoder;
use image::codecs::png::PngDecoder;
use image::codecs::pnm::PnmDecoder;
use image::codecs::tiff::TiffDecoder;
use image::codecs::webp::WebPDecoder;
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, Limits};

use super::Image;
use super::tiff_directory::Form;

pub use depth::{Picture, bits_in_use, scale};
pub use panic::caught;

mod depth;
mod jpeg;
mod panic;
mod png;
mod pnm;

/// Largest file that is read, bytes.
pub const LARGEST_FILE: u64 = 256 << 20;
/// Largest number of pixels: 8192 x 6144. A corner search needs 8 bytes for each.
pub const MOST_PIXELS: u64 = 48 << 20;
/// Largest memory for one image, bytes: the file, the decoder's own memory, and the grey image.
pub const MEMORY: u64 = 512 << 20;

/// Largest number of pixels that a byte of a TIFF file makes: deflate of 1-bit pixels.
const TIFF_AT_BEST: u64 = 1032 * 8;
/// Largest number of pixels that a byte of a BMP file makes: half of a run of 255.
const BMP_AT_BEST: u64 = 128;

/// Reason why bytes are not an image.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The image has another size than the required one.
    #[error(
        "{} x {} px, but expected are {} x {} px",
        .given[0], .given[1], .wanted[0], .wanted[1]
    )]
    OtherSize {
        /// Width and height, px.
        given: [u32; 2],
        /// Width and height required, px.
        wanted: [u32; 2],
    },
    /// A side is 0.
    #[error("{0} x {1} px is no image")]
    Empty(u32, u32),
    /// The image has more than [`MOST_PIXELS`] pixels.
    #[error("{0} x {1} px are too many; an image has {MOST_PIXELS} pixels (8192 x 6144) at most")]
    TooLarge(u32, u32),
    /// Decoding needs more than [`MEMORY`] bytes.
    #[error("to read it takes {} MB; {} MB is the limit", .0 >> 20, MEMORY >> 20)]
    TooMuchMemory(u64),
    /// The file ends before the image does.
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

/// Decodes an image as 8-bit grey, scaled by the bits that it uses. `size_px` (width, height) is
/// the size it must have, if that is known.
///
/// # Errors
/// [`Refusal`], also if the decoder panics.
pub fn decode(bytes: &[u8], size_px: Option<[u32; 2]>) -> Result<Image, Refusal> {
    let picture = decode_deep(bytes, size_px)?;
    let bits = picture.bits_in_use();
    Ok(picture.scaled(bits))
}

/// Decodes an image as grey with the depth of its file, 8 or 16 bits. `size_px` (width, height) is
/// the size it must have, if that is known.
///
/// # Errors
/// [`Refusal`], also if the decoder panics.
pub fn decode_deep(bytes: &[u8], size_px: Option<[u32; 2]>) -> Result<Picture, Refusal> {
    panic::caught(|| decode_as_claimed(bytes, size_px)).unwrap_or_else(|| Err(confused()))
}

/// Decodes the first page of a TIFF file of `length` bytes. See [`decode_deep`].
///
/// # Errors
/// [`Refusal`], also if the decoder panics.
pub fn decode_tiff(
    reader: impl BufRead + Seek,
    length: u64,
    size_px: Option<[u32; 2]>,
) -> Result<Picture, Refusal> {
    let decode = || {
        let judge = Judge {
            length,
            size_px,
            extra: 0,
        };
        judge.tiff(reader)
    };
    panic::caught(decode).unwrap_or_else(|| Err(confused()))
}

fn confused() -> Refusal {
    Refusal::Malformed("its content confuses the decoder".to_owned())
}

/// Returns the least length of a TIFF file of this size, bytes.
fn tiff_least([width, height]: [u64; 2]) -> u64 {
    width * height / TIFF_AT_BEST
}

fn decode_as_claimed(bytes: &[u8], size_px: Option<[u32; 2]>) -> Result<Picture, Refusal> {
    let is_big_tiff = [b"II\x2b\0", b"MM\0\x2b"]
        .iter()
        .any(|start| bytes.starts_with(*start));
    let format = match is_big_tiff {
        true => Some(ImageFormat::Tiff),
        false => image::guess_format(bytes).ok(),
    };
    match format {
        Some(ImageFormat::Png) => {
            let file = png::without_metadata(bytes)?;
            let least = |size| png::least_bytes(bytes, size);
            let judge = Judge {
                length: bytes.len() as u64,
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
                length: bytes.len() as u64,
                size_px,
                extra: frame.coefficient_bytes(),
            };
            judge.size(frame.size_px, |_| frame.least_bytes())?;
            jpeg::check_data(bytes)?;
            judge.decode(JpegDecoder::new(Cursor::new(bytes))?)
        }
        Some(ImageFormat::Pnm) => {
            let decoder = PnmDecoder::new(Cursor::new(bytes))?;
            let judge = Judge::plain(bytes, size_px);
            let least = pnm::least_bytes(decoder.header());
            judge.size(decoder.dimensions().into(), |_| least)?;
            judge.decode(decoder)
        }
        Some(ImageFormat::Tiff) => Judge::plain(bytes, size_px).tiff(Cursor::new(bytes)),
        Some(ImageFormat::Bmp) => {
            let decoder = BmpDecoder::new(Cursor::new(bytes))?;
            Judge::plain(bytes, size_px)
                .whole(decoder, |[width, height]| width * height / BMP_AT_BEST)
        }
        Some(ImageFormat::WebP) => {
            let decoder = WebPDecoder::new(Cursor::new(bytes))?;
            // An even image of any size is a few bytes.
            Judge::plain(bytes, size_px).whole(decoder, |_| 0)
        }
        _ if bytes.is_empty() => Err(Refusal::Malformed("the file is empty".to_owned())),
        _ => {
            let reason = "none of PNG, JPEG, PNM, TIFF, BMP and WebP";
            Err(Refusal::Malformed(reason.to_owned()))
        }
    }
}

/// Check of a file's claims against the limits.
struct Judge {
    /// Length of the file, bytes.
    length: u64,
    size_px: Option<[u32; 2]>,
    /// Memory that the decoder needs beside its output, bytes.
    extra: u64,
}

impl Judge {
    /// Creates the judge of a file whose decoder needs no more memory than its output.
    fn plain(bytes: &[u8], size_px: Option<[u32; 2]>) -> Self {
        Self {
            length: bytes.len() as u64,
            size_px,
            extra: 0,
        }
    }

    /// Checks the size that the decoder has read, then decodes.
    fn whole(
        &self,
        decoder: impl ImageDecoder,
        least: impl FnOnce([u64; 2]) -> u64,
    ) -> Result<Picture, Refusal> {
        self.size(decoder.dimensions().into(), least)?;
        self.decode(decoder)
    }

    /// Decodes the first page of a TIFF file.
    fn tiff(&self, mut reader: impl BufRead + Seek) -> Result<Picture, Refusal> {
        let unread = |cause: std::io::Error| Refusal::Malformed(cause.to_string());
        let form = Form::of(&mut reader).map_err(unread)?;
        let at = form.first_directory(&mut reader).map_err(unread)?;
        let directory = form.directory(&mut reader, at).map_err(unread)?;
        if let Some(reason) = directory.unfit_values() {
            return Err(Refusal::Malformed(reason));
        }
        reader.rewind().map_err(unread)?;
        self.whole(TiffDecoder::new(reader)?, tiff_least)
    }

    /// Checks the claimed size. `least` returns the least length of a file of this size, bytes.
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
        if self.length < least([width.into(), height.into()]) {
            return Err(Refusal::CutOff("it is too short for an image of its size"));
        }
        Ok(())
    }

    fn limits(&self) -> Limits {
        let mut limits = Limits::default();
        limits.max_alloc = Some(MEMORY);
        limits
    }

    /// Decodes if the memory suffices.
    fn decode(&self, mut decoder: impl ImageDecoder) -> Result<Picture, Refusal> {
        let (width, height) = decoder.dimensions();
        // The decoded image is the one that was checked.
        self.size([width, height], |_| 0)?;
        let pixels = u64::from(width) * u64::from(height);
        // A page of a stack is read piece by piece.
        let file = self.length.min(LARGEST_FILE);
        // Colour of 16 bits becomes grey of 16 bits first.
        let grey = match decoder.color_type() {
            ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => 3 * pixels,
            _ => pixels,
        };
        let needed = [decoder.total_bytes(), grey, file, self.extra];
        let needed = needed.into_iter().fold(0, u64::saturating_add);
        if needed > MEMORY {
            return Err(Refusal::TooMuchMemory(needed));
        }
        decoder.set_limits(self.limits())?;
        let picture = DynamicImage::from_decoder(decoder)?;
        let (width, height) = (width as usize, height as usize);
        Ok(match picture.color() {
            ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
                Picture::Sixteen {
                    width,
                    height,
                    levels: picture.into_luma16().into_raw(),
                }
            }
            _ => Picture::Eight(Image {
                width,
                height,
                grey: picture.into_luma8().into_raw(),
            }),
        })
    }
}

#[cfg(test)]
mod tests;
