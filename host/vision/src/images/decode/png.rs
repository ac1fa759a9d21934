//! Structure of a PNG file: chunks of length, name, content and checksum.

use std::borrow::Cow;

use super::Refusal;

const SIGNATURE: usize = 8;
/// Size of a chunk's length, name and checksum, bytes.
const AROUND: usize = 12;

/// Chunk: its name, its content, and all of its bytes.
type Chunk<'a> = (&'a [u8], &'a [u8], &'a [u8]);

/// Returns the file with only the chunks that make the image.
///
/// Text and colour profiles are compressed, and the file does not bound their inflated size.
///
/// # Errors
/// [`Refusal`] if the file ends before its last chunk, or the palette is malformed.
pub(super) fn without_metadata(file: &[u8]) -> Result<Cow<'_, [u8]>, Refusal> {
    let mut rest = file.get(SIGNATURE..).unwrap_or_default();
    // Until the first chunk is dropped, the kept chunks are the start of the file.
    let mut kept = SIGNATURE;
    let mut copy: Option<Vec<u8>> = None;
    loop {
        let (name, content, chunk) = first_chunk(rest)?;
        rest = &rest[chunk.len()..];
        if name == b"PLTE" && !content.len().is_multiple_of(3) {
            let reason = "the palette's length is no multiple of 3";
            return Err(Refusal::Malformed(reason.to_owned()));
        }
        let makes_picture = name[0].is_ascii_uppercase() || name == b"tRNS";
        match (makes_picture, &mut copy) {
            (true, None) => kept += chunk.len(),
            (true, Some(copy)) => copy.extend_from_slice(chunk),
            (false, None) => copy = Some(file[..kept].to_vec()),
            (false, Some(_)) => {}
        }
        if name == b"IEND" {
            return Ok(copy.map_or(Cow::Borrowed(&file[..kept]), Cow::Owned));
        }
    }
}

fn first_chunk(rest: &[u8]) -> Result<Chunk<'_>, Refusal> {
    let cut_off = Refusal::CutOff("its last chunk is missing");
    let [a, b, c, d, ..] = *rest else {
        return Err(cut_off);
    };
    let length = u32::from_be_bytes([a, b, c, d]) as usize;
    let chunk = length.checked_add(AROUND).and_then(|all| rest.get(..all));
    let chunk = chunk.ok_or(cut_off)?;
    Ok((&chunk[4..8], &chunk[8..8 + length], chunk))
}

/// Returns the width and height in the header.
///
/// # Errors
/// [`Refusal`] if the first chunk is not a header.
pub(super) fn size_px(file: &[u8]) -> Result<[u32; 2], Refusal> {
    let (name, content, _) = first_chunk(file.get(SIGNATURE..).unwrap_or_default())?;
    match (name, content) {
        (b"IHDR", &[a, b, c, d, e, f, g, h, ..]) => Ok([
            u32::from_be_bytes([a, b, c, d]),
            u32::from_be_bytes([e, f, g, h]),
        ]),
        _ => Err(Refusal::Malformed("the header is missing".to_owned())),
    }
}

/// Returns the least length of a file of this size, bytes: deflate makes 1 byte of 1032 at best.
pub(super) fn least_bytes(file: &[u8], [width, height]: [u64; 2]) -> u64 {
    let header = file.get(SIGNATURE + 16..SIGNATURE + 18);
    let &[depth, colour] = header.unwrap_or_default() else {
        return 0;
    };
    let channels = match colour {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    let bits = u64::from(depth.clamp(1, 16)) * channels * width;
    bits.div_ceil(8) * height / 1032
}
