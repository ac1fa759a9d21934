//! Pages of a TIFF file, of which each is one image of a stack.
//!
//! A page is decoded as the first page of a file: its reader replaces the header's offset of the
//! first directory by that of the page. So pages have the limits and checks of single images.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::super::decode::{Picture, Refusal, decode_tiff};
use trinocular_rig::error::InputError;
use trinocular_rig::input;

/// Largest number of pages.
const MOST_PAGES: usize = 1_000_000;
/// Largest number of fields in a directory.
const MOST_FIELDS: u64 = 4_096;
/// Tag of the field that marks reduced copies of a page.
const SUBFILE_TYPE: u16 = 254;

/// Byte order and width of the offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Form {
    is_little: bool,
    /// True for BigTIFF, whose offsets have 8 bytes.
    is_big: bool,
}

impl Form {
    fn number<const N: usize>(self, bytes: [u8; N]) -> u64 {
        let join = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        match self.is_little {
            true => bytes.iter().rev().fold(0, join),
            false => bytes.iter().fold(0, join),
        }
    }

    fn read<const N: usize>(self, reader: &mut impl Read) -> io::Result<u64> {
        let mut bytes = [0; N];
        reader.read_exact(&mut bytes)?;
        Ok(self.number(bytes))
    }

    /// Reads an offset.
    fn offset(self, reader: &mut impl Read) -> io::Result<u64> {
        match self.is_big {
            true => self.read::<8>(reader),
            false => self.read::<4>(reader),
        }
    }

    /// Returns the place of the first directory's offset in the header.
    fn first(self) -> usize {
        if self.is_big { 8 } else { 4 }
    }

    /// Reads the header.
    fn of(reader: &mut impl Read) -> io::Result<Self> {
        let mut start = [0; 4];
        reader.read_exact(&mut start)?;
        let (is_little, is_big) = match &start {
            b"II\x2a\0" => (true, false),
            b"II\x2b\0" => (true, true),
            b"MM\0\x2a" => (false, false),
            b"MM\0\x2b" => (false, true),
            _ => return Err(io::Error::other("not a TIFF file")),
        };
        Ok(Self { is_little, is_big })
    }
}

/// Returns the offsets of the directories of all pages, without reduced copies.
///
/// # Errors
/// [`InputError`] if the file cannot be read or its directories form a loop.
pub fn pages(path: &Path) -> Result<Vec<u64>, InputError> {
    let mut reader = BufReader::new(input::open(path)?);
    let fault = |reason: String| InputError::file(path, format!("cannot read the pages: {reason}"));
    let cut = |cause: io::Error| fault(cause.to_string());
    let form = Form::of(&mut reader).map_err(cut)?;
    reader
        .seek(SeekFrom::Start(form.first() as u64))
        .map_err(cut)?;
    let mut next = form.offset(&mut reader).map_err(cut)?;
    let (mut pages, mut seen) = (Vec::new(), HashSet::new());
    while next != 0 {
        if !seen.insert(next) {
            return Err(fault("its directories form a loop".to_owned()));
        }
        if seen.len() > MOST_PAGES {
            return Err(fault(format!("more than {MOST_PAGES} pages")));
        }
        let at = next;
        reader.seek(SeekFrom::Start(at)).map_err(cut)?;
        let count = match form.is_big {
            true => form.read::<8>(&mut reader),
            false => form.read::<2>(&mut reader),
        };
        let count = count.map_err(cut)?;
        if count > MOST_FIELDS {
            return Err(fault(format!("a directory of {count} fields")));
        }
        let mut is_reduced = false;
        for _ in 0..count {
            let tag = form.read::<2>(&mut reader).map_err(cut)? as u16;
            form.read::<2>(&mut reader).map_err(cut)?;
            form.offset(&mut reader).map_err(cut)?;
            let value = form.offset(&mut reader).map_err(cut)?;
            is_reduced |= tag == SUBFILE_TYPE && value & 1 == 1;
        }
        next = form.offset(&mut reader).map_err(cut)?;
        if !is_reduced {
            pages.push(at);
        }
    }
    match pages.is_empty() {
        true => Err(fault("it has none".to_owned())),
        false => Ok(pages),
    }
}

/// Reads the page whose directory is at `directory`.
///
/// # Errors
/// [`InputError`] if the file cannot be opened; the [`Refusal`] of a page that cannot be decoded is
/// within.
pub fn read(
    path: &Path,
    directory: u64,
    size_px: Option<[u32; 2]>,
) -> Result<Result<Picture, Refusal>, InputError> {
    let file = input::open(path)?;
    let unreadable = |cause: io::Error| InputError::io(path, "read", &cause);
    let length = file.metadata().map_err(unreadable)?.len();
    let page = Page::new(file, directory).map_err(unreadable)?;
    Ok(decode_tiff(BufReader::new(page), length, size_px))
}

/// Reader of a TIFF file in which a page comes first.
struct Page {
    file: File,
    at: u64,
    head: Vec<u8>,
}

impl Page {
    fn new(mut file: File, directory: u64) -> io::Result<Self> {
        let form = Form::of(&mut file)?;
        let bytes = match form.is_little {
            true => directory.to_le_bytes(),
            false => directory.to_be_bytes(),
        };
        file.seek(SeekFrom::Start(0))?;
        let mut head = vec![0; if form.is_big { 16 } else { 8 }];
        file.read_exact(&mut head)?;
        let offset = match (form.is_big, form.is_little) {
            (true, _) => &bytes[..],
            (false, true) => &bytes[..4],
            (false, false) => &bytes[4..],
        };
        head[form.first()..].copy_from_slice(offset);
        file.seek(SeekFrom::Start(0))?;
        Ok(Self { file, at: 0, head })
    }
}

impl Read for Page {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let rest = self.head.get(self.at as usize..).unwrap_or_default();
        if rest.is_empty() {
            let count = self.file.read(out)?;
            self.at += count as u64;
            return Ok(count);
        }
        let count = rest.len().min(out.len());
        out[..count].copy_from_slice(&rest[..count]);
        self.at += count as u64;
        self.file.seek(SeekFrom::Start(self.at))?;
        Ok(count)
    }
}

impl Seek for Page {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::images::Image;

    /// Returns the TIFF file of 16-bit pages of the same size, little or big endian.
    fn stack(pages: &[Vec<u16>], [width, height]: [u32; 2], is_little: bool) -> Vec<u8> {
        let short = |n: u16| match is_little {
            true => n.to_le_bytes(),
            false => n.to_be_bytes(),
        };
        let long = |n: u32| match is_little {
            true => n.to_le_bytes(),
            false => n.to_be_bytes(),
        };
        let strip = 2 * width * height;
        let length = 2 + 12 * 7 + 4;
        let mut file = if is_little { b"II" } else { b"MM" }.to_vec();
        file.extend(short(42));
        let mut at = 8 + strip;
        file.extend(long(at));
        for (index, page) in pages.iter().enumerate() {
            file.extend(page.iter().flat_map(|level| short(*level)));
            file.extend(short(7));
            let fields = [
                (256, width),
                (257, height),
                (258, 16),
                (259, 1),
                (262, 1),
                (273, at - strip),
                (279, strip),
            ];
            for (tag, value) in fields {
                file.extend(short(tag));
                file.extend(short(4));
                file.extend(long(1));
                file.extend(long(value));
            }
            at += length + strip;
            file.extend(long(if index + 1 < pages.len() { at } else { 0 }));
        }
        file
    }

    /// Returns the stack of 16-bit pages whose values are those of the images times `factor`.
    pub fn stack_of(pages: &[Image], factor: u16) -> Vec<u8> {
        let size = [pages[0].width as u32, pages[0].height as u32];
        let levels = |page: &Image| page.grey.iter().map(|g| u16::from(*g) * factor).collect();
        stack(&pages.iter().map(levels).collect::<Vec<_>>(), size, true)
    }

    #[test]
    fn every_page_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("left.tif");
        let expected = [
            vec![1, 2, 3, 4, 5, 4095],
            vec![9, 8, 7, 6, 5, 4],
            vec![0, 0, 300, 0, 0, 0],
        ];
        for is_little in [true, false] {
            std::fs::write(&path, stack(&expected, [3, 2], is_little)).unwrap();
            let found = pages(&path).unwrap();
            assert_eq!(found.len(), 3);
            for (at, levels) in found.iter().zip(&expected) {
                let picture = read(&path, *at, Some([3, 2])).unwrap().unwrap();
                let Picture::Sixteen { levels: read, .. } = picture else {
                    panic!("16 bits");
                };
                assert_eq!(read, *levels);
            }
            let refusal = read(&path, found[1], Some([4, 2])).unwrap().unwrap_err();
            assert!(matches!(refusal, Refusal::OtherSize { .. }));
        }
    }

    #[test]
    fn damaged_stack_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("left.tif");
        let whole = stack(&[vec![1; 6], vec![2; 6]], [3, 2], true);
        // The second directory follows itself.
        let mut loops = whole.clone();
        let second = pages_of(&path, &whole)[1] as u32;
        let end = loops.len() - 4;
        loops[end..].copy_from_slice(&second.to_le_bytes());
        for (content, reason) in [
            (&b"II"[..], "cannot read the pages"),
            (b"not a TIFF", "not a TIFF file"),
            (&whole[..40], "cannot read the pages"),
            (&loops, "form a loop"),
        ] {
            std::fs::write(&path, content).unwrap();
            let error = pages(&path).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    fn pages_of(path: &Path, content: &[u8]) -> Vec<u64> {
        std::fs::write(path, content).unwrap();
        pages(path).unwrap()
    }
}
