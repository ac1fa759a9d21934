//! Structure of a JPEG file: segments after markers, and compressed data after each scan's segment.
//!
//! Decoders tolerate missing data at a file's end. This module therefore follows the markers to the
//! last one: a file that was cut off anywhere has no end of image after its last scan. An image in
//! the metadata has its own end of image, but lies within a segment of known length.

use super::Refusal;

mod huffman;
mod scan;

/// Largest number of scans of a progressive file; encoders make about ten.
const MOST_SCANS: usize = 100;
/// Side of a block of coefficients, px.
const BLOCK: u64 = 8;

const NO_END: Refusal = Refusal::CutOff("its end-of-image marker is missing");

/// Properties of a whole file, from its markers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    /// Width and height, px.
    pub size_px: [u32; 2],
    /// Horizontal and vertical sampling factors of each component.
    sampling: Vec<[u8; 2]>,
    is_progressive: bool,
    scans: usize,
    /// Compressed data in all scans, bytes.
    data: u64,
}

impl Frame {
    /// Returns the number of blocks of all components.
    fn blocks(&self) -> u64 {
        let most = |side: usize| self.sampling.iter().map(|s| s[side].max(1)).max();
        let [wide, high] = [0, 1].map(|side| u64::from(most(side).unwrap_or(1)));
        let [columns, rows] = self.size_px.map(u64::from);
        let units = columns.div_ceil(BLOCK * wide) * rows.div_ceil(BLOCK * high);
        let blocks = self
            .sampling
            .iter()
            .map(|[h, v]| u64::from(*h) * u64::from(*v));
        units.saturating_mul(blocks.sum())
    }

    /// Returns the size of the coefficients that the decoder keeps, bytes: all of them if they come
    /// in parts.
    pub fn coefficient_bytes(&self) -> u64 {
        let is_whole = self.is_progressive || self.scans > 1;
        u64::from(is_whole) * self.blocks().saturating_mul(2 * BLOCK * BLOCK)
    }

    /// Returns the least length of the compressed data: a bit for every block, or two if its
    /// coefficients come together.
    fn least_data(&self) -> u64 {
        let bits = if self.is_progressive { 1 } else { 2 };
        // The blocks of a single component end with the image, not with the unit.
        (self.blocks() / 4).max(1) * bits / BLOCK
    }

    /// Returns 0 if the compressed data can be an image of this size, otherwise more than any file
    /// has.
    pub fn least_bytes(&self) -> u64 {
        if self.data < self.least_data() {
            u64::MAX
        } else {
            0
        }
    }
}

/// Follows the markers of a file to its end of image.
///
/// # Errors
/// [`Refusal`] if there is no end of image, or no image before it.
pub(super) fn frame(file: &[u8]) -> Result<Frame, Refusal> {
    let mut frame = None;
    let (mut scans, mut data) = (0, 0);
    let mut rest = file.get(2..).unwrap_or_default();
    loop {
        let (skipped, marker) = next_marker(rest)?;
        rest = &rest[skipped + 2..];
        if scans > 0 {
            data += skipped as u64;
        }
        match marker {
            0xD9 if scans > 0 => break,
            // Start of another file.
            0xD8 => return Err(NO_END),
            0x01 | 0xD0..=0xD9 => continue,
            _ => {}
        }
        let segment = segment(rest)?;
        rest = &rest[segment.len()..];
        match marker {
            0xDA => scans += 1,
            // Markers of tables lie between those of frames.
            0xC4 | 0xC8 | 0xCC => {}
            0xC0..=0xCF if frame.is_some() => {
                return Err(Refusal::Malformed("two frames in one file".to_owned()));
            }
            0xC0..=0xCF => frame = Some(of_header(segment, marker)?),
            _ => {}
        }
    }
    let Some(frame) = frame else {
        return Err(Refusal::Malformed("a scan without a frame".to_owned()));
    };
    if scans > MOST_SCANS {
        let reason = format!("{scans} scans; {MOST_SCANS} are read at most");
        return Err(Refusal::Malformed(reason));
    }
    Ok(Frame {
        scans,
        data,
        ..frame
    })
}

/// Returns the number of bytes before the next marker, and the marker's second byte.
fn next_marker(rest: &[u8]) -> Result<(usize, u8), Refusal> {
    // A zero after 0xFF makes it data, another 0xFF makes it padding.
    let pairs = rest.windows(2).enumerate();
    let mut markers = pairs.filter(|(_, pair)| pair[0] == 0xFF && !matches!(pair[1], 0 | 0xFF));
    let found = markers.next().map(|(at, pair)| (at, pair[1]));
    found.ok_or(NO_END)
}

fn segment(rest: &[u8]) -> Result<&[u8], Refusal> {
    let cut_off = Refusal::CutOff("it ends within a segment");
    let &[high, low, ..] = rest else {
        return Err(cut_off);
    };
    let length = usize::from(u16::from_be_bytes([high, low]));
    rest.get(..length.max(2)).ok_or(cut_off)
}

/// Follows the compressed data to the last block.
///
/// # Errors
/// [`Refusal`] if data are missing.
pub(super) fn check_data(file: &[u8]) -> Result<(), Refusal> {
    scan::check(file)
}

fn of_header(segment: &[u8], marker: u8) -> Result<Frame, Refusal> {
    let unread = match marker {
        0xC9 | 0xCA => Some("an arithmetic-coded"),
        0xC3 | 0xCB => Some("a lossless"),
        0xC5..=0xC7 | 0xCD..=0xCF => Some("a hierarchical"),
        _ => None,
    };
    if let Some(kind) = unread {
        return Err(Refusal::Malformed(format!(
            "it is {kind} JPEG file, which is not read; save it as a baseline JPEG or a PNG file"
        )));
    }
    let &[_, _, _, h1, h0, w1, w0, _, ref components @ ..] = segment else {
        return Err(Refusal::Malformed(
            "the frame's header is too short".to_owned(),
        ));
    };
    let [width, height] = [[w1, w0], [h1, h0]].map(u16::from_be_bytes);
    let sampling = components.chunks_exact(3).map(|c| [c[1] >> 4, c[1] & 15]);
    Ok(Frame {
        size_px: [width.into(), height.into()],
        sampling: sampling.collect(),
        is_progressive: matches!(marker, 0xC2 | 0xC6 | 0xCA | 0xCE),
        scans: 0,
        data: 0,
    })
}
