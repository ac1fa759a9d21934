//! Conversion of a camera's bytes to a grey image.
//!
//! Most formats carry the luminance by itself. It is taken unchanged, studio range (16 to 235) or
//! full range, because the flow needs contrasts and no absolute brightness. Red, green and blue
//! become luminance by the weights of ITU-R BT.709, as they do for image files.

use std::sync::OnceLock;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::images::Image;
use crate::images::decode::{Refusal, decode};

/// Pixel format of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One byte of luminance per pixel.
    Grey,
    /// Pairs of pixels: `Y U Y V`.
    Yuyv,
    /// Pairs of pixels: `U Y V Y`.
    Uyvy,
    /// Plane of luminance, then one of `U V` pairs.
    Nv12,
    /// Plane of luminance, then one of `U`, then one of `V`.
    Yu12,
    /// Red, green, blue.
    Rgb,
    /// Blue, green, red.
    Bgr,
    /// One JPEG file per image, often without its Huffman tables.
    Mjpeg,
}

/// Reason why bytes are not an image.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unreadable {
    /// The camera delivered less than an image.
    #[error("{given} bytes, but an image has {needed}")]
    Short {
        /// Number of bytes delivered.
        given: usize,
        /// Number of bytes needed.
        needed: usize,
    },
    /// The bytes are not a JPEG, or one of another size.
    #[error("{0}")]
    Jpeg(String),
}

/// Returns the rows of an image: `height` of them, each of `row` bytes, that begin `stride` bytes
/// apart, which is at least `row`.
///
/// # Errors
/// [`Unreadable::Short`] if bytes are missing.
pub(super) fn rows(
    bytes: &[u8],
    row: usize,
    stride: usize,
    height: usize,
) -> Result<impl Iterator<Item = &[u8]>, Unreadable> {
    let needed = match height {
        0 => 0,
        _ => stride.saturating_mul(height - 1).saturating_add(row),
    };
    if bytes.len() < needed {
        let given = bytes.len();
        return Err(Unreadable::Short { given, needed });
    }
    // Rows without bytes have no starts.
    let starts = bytes.chunks(stride.max(1)).take(height);
    Ok(starts.map(move |bytes| bytes.get(..row).unwrap_or(bytes)))
}

impl Format {
    /// All formats, best first: grey formats, then those with the whole luminance, then compressed
    /// ones.
    pub const ALL: [Self; 8] = [
        Self::Grey,
        Self::Yuyv,
        Self::Uyvy,
        Self::Nv12,
        Self::Yu12,
        Self::Rgb,
        Self::Bgr,
        Self::Mjpeg,
    ];

    /// Returns V4L2's name of the format.
    pub const fn fourcc(self) -> [u8; 4] {
        *match self {
            Self::Grey => b"GREY",
            Self::Yuyv => b"YUYV",
            Self::Uyvy => b"UYVY",
            Self::Nv12 => b"NV12",
            Self::Yu12 => b"YU12",
            Self::Rgb => b"RGB3",
            Self::Bgr => b"BGR3",
            Self::Mjpeg => b"MJPG",
        }
    }

    /// Returns the bytes of one pixel in the rows that hold the luminance; `None` for formats
    /// without rows.
    const fn bytes_per_pixel(self) -> Option<usize> {
        match self {
            Self::Grey | Self::Nv12 | Self::Yu12 => Some(1),
            Self::Yuyv | Self::Uyvy => Some(2),
            Self::Rgb | Self::Bgr => Some(3),
            Self::Mjpeg => None,
        }
    }

    /// Converts `bytes` to an image of `width` by `height` pixels. Rows begin `stride` bytes apart;
    /// 0, or less than a row needs, is taken for rows without gaps.
    ///
    /// # Errors
    /// [`Unreadable`], with the reason.
    pub fn to_grey(
        self,
        bytes: &[u8],
        [width, height]: [usize; 2],
        stride: usize,
    ) -> Result<Image, Unreadable> {
        let Some(per_pixel) = self.bytes_per_pixel() else {
            return jpeg(bytes, [width, height]);
        };
        let row = width.saturating_mul(per_pixel);
        let rows = rows(bytes, row, stride.max(row), height)?;
        let luminance: fn(&[u8]) -> u8 = match self {
            Self::Uyvy => |pixel| pixel.get(1).copied().unwrap_or(0),
            Self::Rgb => |pixel| bt709([pixel[0], pixel[1], pixel[2]]),
            Self::Bgr => |pixel| bt709([pixel[2], pixel[1], pixel[0]]),
            _ => |pixel| pixel.first().copied().unwrap_or(0),
        };
        let mut grey = Vec::with_capacity(width * height);
        for row in rows {
            grey.extend(row.chunks_exact(per_pixel).map(luminance));
        }
        Ok(Image {
            width,
            height,
            grey,
        })
    }
}

fn bt709([red, green, blue]: [u8; 3]) -> u8 {
    let [r, g, b] = [red, green, blue].map(u32::from);
    // The weights add up to 10,000, so the result is at most 255.
    ((2126 * r + 7152 * g + 722 * b) / 10_000) as u8
}

fn jpeg(bytes: &[u8], size: [usize; 2]) -> Result<Image, Unreadable> {
    // Bytes with another start would be another format to the decoder.
    if !bytes.starts_with(&[0xFF, 0xD8]) {
        return Err(Unreadable::Jpeg("no JPEG".to_owned()));
    }
    let size_px = size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    decode(&with_tables(bytes), Some(size_px)).map_err(|refusal| {
        Unreadable::Jpeg(match refusal {
            Refusal::OtherSize {
                given: [width, height],
                wanted: [w, h],
            } => format!("a JPEG of {width} x {height} px, not {w} x {h}"),
            other => other.to_string(),
        })
    })
}

/// Second bytes of the markers that start a scan and a segment of Huffman tables.
const SCAN: u8 = 0xDA;
const TABLES: u8 = 0xC4;

/// Returns the segments between a JPEG's start and its first scan: the marker's second byte, and
/// the whole segment.
fn segments(bytes: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    let mut rest = bytes.get(2..).unwrap_or_default();
    std::iter::from_fn(move || {
        let [0xFF, marker, high, low, ..] = *rest else {
            return None;
        };
        let length = 2 + usize::from(u16::from_be_bytes([high, low]));
        let (segment, behind) = rest.split_at_checked(length)?;
        rest = behind;
        (marker != SCAN).then_some((marker, segment))
    })
}

/// Returns the JPEG with the standard's Huffman tables, which most cameras use and many leave out.
fn with_tables(bytes: &[u8]) -> std::borrow::Cow<'_, [u8]> {
    static STANDARD: OnceLock<Vec<u8>> = OnceLock::new();
    if segments(bytes).any(|(marker, _)| marker == TABLES) {
        return bytes.into();
    }
    let standard = STANDARD.get_or_init(|| {
        // An encoder without optimised codes writes the standard tables.
        let mut file = Vec::new();
        let encoded = JpegEncoder::new(&mut file).encode(&[0; 3], 1, 1, ExtendedColorType::Rgb8);
        let tables = segments(&file).filter(|(marker, _)| *marker == TABLES && encoded.is_ok());
        tables.flat_map(|(_, segment)| segment.to_vec()).collect()
    });
    let before: usize = segments(bytes).map(|(_, segment)| segment.len()).sum();
    let (before, scan) = bytes.split_at((2 + before).min(bytes.len()));
    [before, standard, scan].concat().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    /// Grey levels of three by two different pixels.
    const GREY: [u8; 6] = [10, 20, 30, 200, 210, 255];

    fn image() -> Image {
        Image {
            width: 3,
            height: 2,
            grey: GREY.to_vec(),
        }
    }

    /// Returns the grey image as rows of `format`; colours and gaps are filled with 99.
    fn rows(format: Format, gap: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        for row in GREY.chunks(3) {
            for grey in row {
                match format {
                    Format::Grey | Format::Nv12 | Format::Yu12 => bytes.push(*grey),
                    Format::Yuyv => bytes.extend([*grey, 99]),
                    Format::Uyvy => bytes.extend([99, *grey]),
                    Format::Rgb | Format::Bgr => bytes.extend([*grey; 3]),
                    Format::Mjpeg => unreachable!("has no rows"),
                }
            }
            bytes.extend(vec![99; gap]);
        }
        bytes
    }

    #[test]
    fn layouts_give_luminance() {
        for format in Format::ALL {
            let Some(per_pixel) = format.bytes_per_pixel() else {
                continue;
            };
            for gap in [0, 1, 5] {
                let bytes = rows(format, gap);
                let stride = if gap == 0 { 0 } else { 3 * per_pixel + gap };
                let grey = format.to_grey(&bytes, [3, 2], stride);
                assert_eq!(grey, Ok(image()), "{format:?} {gap}");
                // The last row's gap may be missing, and planes of colour may follow.
                let short = &bytes[..bytes.len() - gap];
                assert_eq!(format.to_grey(short, [3, 2], stride), Ok(image()));
                let long = [&bytes[..], &[1, 2, 3]].concat();
                assert_eq!(format.to_grey(&long, [3, 2], stride), Ok(image()));
                let [given, needed] = [short.len() - 1, short.len()];
                assert_eq!(
                    format.to_grey(&short[..given], [3, 2], stride),
                    Err(Unreadable::Short { given, needed })
                );
            }
        }
    }

    #[test]
    fn colours_weigh_as_in_files() {
        let colours = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [12, 200, 77]];
        for [r, g, b] in colours {
            let file = RgbImage::from_pixel(1, 1, image::Rgb([r, g, b]));
            let expected = image::DynamicImage::from(file).into_luma8().into_raw();
            let rgb = Format::Rgb.to_grey(&[r, g, b], [1, 1], 0).unwrap();
            let bgr = Format::Bgr.to_grey(&[b, g, r], [1, 1], 0).unwrap();
            assert_eq!((&rgb.grey, &bgr.grey), (&expected, &expected));
        }
    }

    #[test]
    fn jpeg_without_tables_is_read() {
        let grey: Vec<u8> = (0..64 * 48).map(|i| (i % 64 * 3) as u8).collect();
        let mut file = Vec::new();
        JpegEncoder::new_with_quality(&mut file, 95)
            .encode(&grey, 64, 48, ExtendedColorType::L8)
            .unwrap();
        let near = |image: &Image| {
            let pairs = image.grey.iter().zip(&grey);
            pairs.map(|(a, b)| a.abs_diff(*b)).max()
        };
        let whole = Format::Mjpeg.to_grey(&file, [64, 48], 0).unwrap();
        assert!(near(&whole) < Some(12), "{:?}", near(&whole));
        assert_eq!(
            Format::Mjpeg.to_grey(&without_tables(&file), [64, 48], 0),
            Ok(whole)
        );
        let mut coloured = Vec::new();
        JpegEncoder::new_with_quality(&mut coloured, 95)
            .encode(&grey, 32, 32, ExtendedColorType::Rgb8)
            .unwrap();
        let whole = Format::Mjpeg.to_grey(&coloured, [32, 32], 0);
        assert!(whole.is_ok());
        assert_eq!(
            Format::Mjpeg.to_grey(&without_tables(&coloured), [32, 32], 0),
            whole
        );

        let other = Format::Mjpeg.to_grey(&file, [64, 40], 0).unwrap_err();
        assert!(other.to_string().contains("64 x 48"), "{other}");
        assert!(Format::Mjpeg.to_grey(&file[..40], [64, 48], 0).is_err());
        assert!(Format::Mjpeg.to_grey(b"", [64, 48], 0).is_err());
    }

    fn without_tables(file: &[u8]) -> Vec<u8> {
        let all = |segments: Vec<&[u8]>| segments.concat();
        let whole = all(segments(file).map(|(_, segment)| segment).collect());
        let others = segments(file).filter(|(marker, _)| *marker != TABLES);
        let others = all(others.map(|(_, segment)| segment).collect());
        assert!(others.len() < whole.len());
        [&file[..2], &others, &file[2 + whole.len()..]].concat()
    }

    #[test]
    fn names_are_v4l2s_and_differ() {
        for (i, format) in Format::ALL.iter().enumerate() {
            assert!(format.fourcc().is_ascii());
            assert!(
                Format::ALL[..i]
                    .iter()
                    .all(|f| f.fourcc() != format.fourcc())
            );
        }
    }
}
