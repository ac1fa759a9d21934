//! TIFF, BMP, WebP and Y4M files with a valid structure and any content.

use crate::edit::{Edit, edited};
use crate::picture::Side;
use arbitrary::Arbitrary;

/// TIFF file: pages of uncompressed or compressed strips.
#[derive(Arbitrary, Clone, Debug)]
pub struct Tiff {
    /// True for the lower byte first.
    is_little: bool,
    /// True for BigTIFF.
    is_big: bool,
    pages: Vec<Page>,
    /// Description of the first page, as ImageJ writes it: the number of images.
    images: Option<u32>,
    edits: Vec<Edit>,
}

/// Page of a TIFF file.
#[derive(Arbitrary, Clone, Debug)]
struct Page {
    size: [Side; 2],
    /// Bits per value, compression, photometric interpretation, values per pixel, format.
    kind: [u8; 5],
    strip: Vec<u8>,
    /// Further fields: tag, type, count, value.
    more: Vec<(u8, u8, Side, Side)>,
}

const BITS: [u32; 8] = [8, 16, 1, 4, 32, 64, 12, 0];
const COMPRESSIONS: [u32; 8] = [1, 5, 8, 32_773, 7, 2, 0, 32_946];

impl Tiff {
    /// Returns the bytes of the file.
    pub fn bytes(&self) -> Vec<u8> {
        let mut file = match self.is_little {
            true => b"II".to_vec(),
            false => b"MM".to_vec(),
        };
        file.extend(self.number(if self.is_big { 43 } else { 42 }, 2));
        if self.is_big {
            file.extend(self.number(8, 2));
            file.extend([0, 0]);
        }
        for (index, page) in self.pages.iter().enumerate() {
            let mut description = match (index, self.images) {
                (0, Some(images)) => format!("ImageJ=1.54f\nimages={images}\n\0").into_bytes(),
                _ => Vec::new(),
            };
            let width = self.width();
            let start = file.len() + width;
            let directory = start + page.strip.len() + description.len();
            file.extend(self.number(directory as u64, width));
            file.extend(&page.strip);
            let text_at = file.len() as u32;
            let text_length = description.len() as u32;
            file.append(&mut description);
            let pick = |at: usize, list: [u32; 8]| list[usize::from(page.kind[at]) % list.len()];
            let [columns, rows] = page.size.map(Side::px);
            let mut fields = vec![
                (256, 4, 1, columns),
                (257, 4, 1, rows),
                (258, 3, 1, pick(0, BITS)),
                (259, 3, 1, pick(1, COMPRESSIONS)),
                (262, 3, 1, u32::from(page.kind[2] % 8)),
                (273, 4, 1, start as u32),
                (277, 3, 1, u32::from(page.kind[3] % 5)),
                (278, 4, 1, rows),
                (279, 4, 1, page.strip.len() as u32),
                (339, 3, 1, u32::from(page.kind[4] % 5)),
            ];
            if text_length > 0 {
                fields.push((270, 2, text_length, text_at));
            }
            for (tag, kind, count, value) in &page.more {
                let tag = 254 + u32::from(*tag);
                fields.push((tag, u32::from(kind % 20), count.px(), value.px()));
            }
            file.extend(self.number(fields.len() as u64, if self.is_big { 8 } else { 2 }));
            for (tag, kind, count, value) in fields {
                file.extend(self.number(tag.into(), 2));
                file.extend(self.number(kind.into(), 2));
                file.extend(self.number(count.into(), width));
                // A short value stands in the first bytes of its place.
                let bytes = if kind == 3 { 2 } else { width };
                file.extend(self.number(value.into(), bytes));
                file.extend(vec![0; width - bytes]);
            }
        }
        file.extend(self.number(0, self.width()));
        crate::picture::broken(file, &self.edits)
    }

    fn width(&self) -> usize {
        if self.is_big { 8 } else { 4 }
    }

    fn number(&self, value: u64, bytes: usize) -> Vec<u8> {
        match self.is_little {
            true => value.to_le_bytes()[..bytes].to_vec(),
            false => value.to_be_bytes()[8 - bytes..].to_vec(),
        }
    }
}

/// BMP file: a header and pixels.
#[derive(Arbitrary, Clone, Debug)]
pub struct Bmp {
    size: [Side; 2],
    /// Bits per pixel and compression.
    kind: [u8; 2],
    pixels: Vec<u8>,
    edits: Vec<Edit>,
}

impl Bmp {
    /// Returns the bytes of the file.
    pub fn bytes(&self) -> Vec<u8> {
        let bits = [1_u16, 2, 4, 8, 16, 24, 32, 0][usize::from(self.kind[0]) % 8];
        let mut header = 40_u32.to_le_bytes().to_vec();
        header.extend(self.size.iter().flat_map(|side| side.px().to_le_bytes()));
        header.extend(1_u16.to_le_bytes());
        header.extend(bits.to_le_bytes());
        header.extend(u32::from(self.kind[1] % 7).to_le_bytes());
        header.extend([0; 20]);
        let mut file = b"BM".to_vec();
        file.extend((54 + self.pixels.len() as u32).to_le_bytes());
        file.extend([0; 4]);
        file.extend(54_u32.to_le_bytes());
        file.extend(header);
        file.extend(&self.pixels);
        crate::picture::broken(file, &self.edits)
    }
}

/// WebP file: chunks with right lengths.
#[derive(Arbitrary, Clone, Debug)]
pub struct WebP {
    chunks: Vec<(u8, Vec<u8>)>,
    edits: Vec<Edit>,
}

const WEBP_CHUNKS: [&[u8; 4]; 8] = [
    b"VP8L", b"VP8 ", b"VP8X", b"ALPH", b"ANIM", b"ANMF", b"EXIF", b"ICCP",
];

impl WebP {
    /// Returns the bytes of the file.
    pub fn bytes(&self) -> Vec<u8> {
        let mut content = b"WEBP".to_vec();
        for (name, data) in &self.chunks {
            content.extend(WEBP_CHUNKS[usize::from(*name) % WEBP_CHUNKS.len()]);
            content.extend((data.len() as u32).to_le_bytes());
            content.extend(data);
            content.extend(vec![0; data.len() % 2]);
        }
        let length = (content.len() as u32).to_le_bytes();
        let file = [&b"RIFF"[..], &length, &content].concat();
        crate::picture::broken(file, &self.edits)
    }
}

/// Y4M video: a header line and frames.
#[derive(Arbitrary, Clone, Debug)]
pub struct Video {
    size: [Side; 2],
    rate: [u32; 2],
    colours: u8,
    frames: Vec<Vec<u8>>,
    /// True for frames of the length that the header states.
    is_whole: bool,
    edits: Vec<Edit>,
}

const COLOURS: [&str; 8] = [
    "420jpeg", "mono", "mono12", "444p16", "422", "411", "444alpha", "420p10",
];

impl Video {
    /// Returns the bytes of the file.
    pub fn bytes(&self) -> Vec<u8> {
        let [width, height] = self.size.map(Side::px);
        let [above, below] = self.rate;
        let colours = COLOURS[usize::from(self.colours) % COLOURS.len()];
        let head = format!("YUV4MPEG2 W{width} H{height} F{above}:{below} Ip C{colours}\n");
        let head = edited(&head, &self.edits);
        let mut file = head;
        for frame in &self.frames {
            file.extend(b"FRAME\n");
            file.extend(frame);
            if self.is_whole && width < 64 && height < 64 {
                let most = 8 * width as usize * height as usize;
                file.resize(file.len() + most.saturating_sub(frame.len()), 7);
            }
        }
        file
    }
}
