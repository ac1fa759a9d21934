//! Image files with a valid structure and any content.

use crate::edit::{Edit, edited};
use crate::stack::{Bmp, Tiff, WebP};
use arbitrary::Arbitrary;

/// Image file.
#[derive(Arbitrary, Clone, Debug)]
pub enum File {
    /// Any bytes.
    Any(Vec<u8>),
    /// PNG: chunks with right lengths and checksums.
    Png {
        /// Width and height.
        size: [Side; 2],
        /// Bits per sample, colour type, compression, filter, interlacing.
        kind: [u8; 5],
        /// Chunks between header and end.
        chunks: Vec<(Name, Vec<u8>)>,
        /// Final edits, which break the file.
        edits: Vec<Edit>,
    },
    /// PNM: a header and samples.
    Pnm {
        /// P1 to P7.
        kind: u8,
        /// Width, height, depth.
        size: [Side; 3],
        /// The largest sample.
        most: u16,
        /// Sample bytes, any.
        samples: Vec<u8>,
    },
    /// JPEG: one of our files with changed segments.
    Jpeg {
        /// Index of the file.
        which: u8,
        /// Segments that are left out, moved or changed.
        changes: Vec<(u8, Change)>,
        /// Final edits, which break the file.
        edits: Vec<Edit>,
    },
    /// TIFF: directories with right offsets.
    Tiff(Tiff),
    /// BMP: a header and pixels.
    Bmp(Bmp),
    /// WebP: chunks with right lengths.
    WebP(WebP),
}

/// Side of an image, mostly a plausible one.
#[derive(Arbitrary, Clone, Copy, Debug)]
pub enum Side {
    /// Small.
    Small(u8),
    /// Any.
    Any(u32),
}

impl Side {
    /// Returns the number of pixels.
    pub fn px(self) -> u32 {
        match self {
            Self::Small(px) => px.into(),
            Self::Any(px) => px,
        }
    }
}

/// Name of a chunk.
#[derive(Arbitrary, Clone, Copy, Debug)]
pub enum Name {
    /// Standard name, by its index.
    Known(u8),
    /// Any.
    Any([u8; 4]),
}

/// Change of a JPEG segment.
#[derive(Arbitrary, Clone, Debug)]
pub enum Change {
    /// Leaves the segment out.
    Drop,
    /// Repeats the segment.
    Double,
    /// Changes a byte of the content.
    Byte(u16, u8),
    /// Replaces the content; the length fits.
    Content(Vec<u8>),
    /// Replaces the marker.
    Marker(u8),
}

const CHUNKS: [&[u8; 4]; 16] = [
    b"IDAT", b"PLTE", b"tRNS", b"iCCP", b"zTXt", b"tEXt", b"iTXt", b"gAMA", b"cHRM", b"sRGB",
    b"acTL", b"fcTL", b"fdAT", b"eXIf", b"IHDR", b"IEND",
];

const JPEGS: [&[u8]; 3] = [
    include_bytes!("../../../host/vision/src/images/decode/tests/progressive.jpg"),
    include_bytes!("../../../host/vision/src/images/decode/tests/thumbnail.jpg"),
    include_bytes!("../../images/chessboard/left/01.jpg"),
];

impl File {
    /// Returns the bytes of the file.
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Any(bytes) => bytes.clone(),
            Self::Png {
                size,
                kind,
                chunks,
                edits,
            } => {
                let mut header = Vec::new();
                header.extend(size.iter().flat_map(|side| side.px().to_be_bytes()));
                header.extend(kind);
                let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
                file.extend(chunk(b"IHDR", &header));
                for (name, content) in chunks {
                    let name = match name {
                        Name::Known(index) => *CHUNKS[usize::from(*index) % CHUNKS.len()],
                        Name::Any(name) => *name,
                    };
                    // Pixels must reach the code that undoes the filters.
                    match &name {
                        b"IDAT" => file.extend(chunk(&name, &stored(content))),
                        _ => file.extend(chunk(&name, content)),
                    }
                }
                file.extend(chunk(b"IEND", &[]));
                broken(file, edits)
            }
            Self::Pnm {
                kind,
                size: [width, height, depth],
                most,
                samples,
            } => {
                let (width, height, depth) = (width.px(), height.px(), depth.px());
                let head = match kind % 7 {
                    0 => format!("P1 {width} {height}\n"),
                    3 => format!("P4 {width} {height}\n"),
                    6 => format!(
                        "P7\nWIDTH {width}\nHEIGHT {height}\nDEPTH {depth}\nMAXVAL {most}\nENDHDR\n"
                    ),
                    kind => format!("P{} {width} {height} {most}\n", kind + 1),
                };
                [head.as_bytes(), samples].concat()
            }
            Self::Jpeg {
                which,
                changes,
                edits,
            } => {
                let file = JPEGS[usize::from(*which) % JPEGS.len()];
                broken(changed(file, changes), edits)
            }
            Self::Tiff(tiff) => tiff.bytes(),
            Self::Bmp(bmp) => bmp.bytes(),
            Self::WebP(webp) => webp.bytes(),
        }
    }
}

/// Applies the edits to a file that is no text.
pub fn broken(file: Vec<u8>, edits: &[Edit]) -> Vec<u8> {
    // Edits are for text; bytes as Latin-1 serve as well.
    match edits {
        [] => file,
        edits => {
            let text: String = file.iter().map(|&byte| char::from(byte)).collect();
            let text = String::from_utf8_lossy(&edited(&text, edits)).into_owned();
            text.chars().map(|c| c as u8).collect()
        }
    }
}

fn chunk(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let named = [&name[..], content].concat();
    let length = (content.len() as u32).to_be_bytes();
    [&length, &named[..], &crc32(&named).to_be_bytes()].concat()
}

/// Returns a gzip file of these bytes, not compressed.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let bytes = &bytes[..bytes.len().min(65_535)];
    let length = bytes.len() as u16;
    let head = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 3, 1];
    let sizes = [length.to_le_bytes(), (!length).to_le_bytes()].concat();
    let tail = [crc32(bytes).to_le_bytes(), u32::from(length).to_le_bytes()].concat();
    [&head[..], &sizes, bytes, &tail].concat()
}

fn crc32(bytes: &[u8]) -> u32 {
    let mut sum = !0_u32;
    for byte in bytes {
        sum ^= u32::from(*byte);
        for _ in 0..8 {
            sum = (sum >> 1) ^ (0xEDB8_8320 & (sum & 1).wrapping_neg());
        }
    }
    !sum
}

/// Returns a zlib stream of these bytes, not compressed.
fn stored(bytes: &[u8]) -> Vec<u8> {
    let bytes = &bytes[..bytes.len().min(65_535)];
    let length = bytes.len() as u16;
    let sizes = [length.to_le_bytes(), (!length).to_le_bytes()].concat();
    let (mut a, mut b) = (1_u32, 0_u32);
    for byte in bytes {
        a = (a + u32::from(*byte)) % 65_521;
        b = (b + a) % 65_521;
    }
    [
        &[0x78, 1, 1][..],
        &sizes,
        bytes,
        &(b << 16 | a).to_be_bytes(),
    ]
    .concat()
}

/// Returns a JPEG with changed segments, whose lengths are right.
fn changed(file: &[u8], changes: &[(u8, Change)]) -> Vec<u8> {
    let mut segments: Vec<(u8, Vec<u8>)> = Vec::new();
    let mut rest = &file[2..];
    while let [0xFF, marker, high, low, ..] = *rest {
        let length = usize::from(u16::from_be_bytes([high, low]));
        segments.push((marker, rest[4..2 + length].to_vec()));
        rest = &rest[2 + length..];
        if marker == 0xDA {
            break;
        }
    }
    for (at, change) in changes {
        if segments.is_empty() {
            break;
        }
        let at = usize::from(*at) % segments.len();
        match change {
            Change::Drop => drop(segments.remove(at)),
            Change::Double => segments.insert(at, segments[at].clone()),
            Change::Byte(place, value) => {
                let content = &mut segments[at].1;
                if !content.is_empty() {
                    let place = usize::from(*place) % content.len();
                    content[place] = *value;
                }
            }
            Change::Content(content) => segments[at].1 = content.clone(),
            Change::Marker(marker) => segments[at].0 = *marker,
        }
    }
    let mut new = vec![0xFF, 0xD8];
    for (marker, content) in segments {
        let length = (content.len().min(65_533) + 2) as u16;
        new.extend([0xFF, marker]);
        new.extend(length.to_be_bytes());
        new.extend(&content[..usize::from(length) - 2]);
    }
    [&new, rest].concat()
}
