//! Pages of a TIFF file, of which each is one image of a stack.
//!
//! A page is decoded as the first page of a file: its reader replaces the header's offset of the
//! first directory by that of the page. So pages have the limits and checks of single images.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::super::Image;
use super::super::decode::{MOST_PIXELS, Picture, Refusal, decode_tiff};
use super::super::tiff_directory::{Directory, Form};
use trinocular_rig::error::InputError;
use trinocular_rig::input::{self, stand_in};

/// Largest number of pages.
const MOST_PAGES: usize = 1_000_000;

/// Pages of a TIFF file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pages {
    /// Offsets of the pages' directories, without reduced copies.
    Directories(Vec<u64>),
    /// Images one after the other behind a single directory, as ImageJ writes large stacks.
    Contiguous(Contiguous),
}

/// Images without compression, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contiguous {
    form: Form,
    size_px: [u32; 2],
    /// True for values of 16 bits, false for 8.
    is_deep: bool,
    /// Offset of the first image.
    start: u64,
    /// Number of images.
    pub count: usize,
}

impl Pages {
    /// Returns the number of pages.
    pub fn count(&self) -> usize {
        match self {
            Self::Directories(pages) => pages.len(),
            Self::Contiguous(images) => images.count,
        }
    }
}

/// Finds all pages.
///
/// # Errors
/// [`InputError`] if the file cannot be read or its directories form a loop.
pub fn pages(path: &Path) -> Result<Pages, InputError> {
    let mut reader = BufReader::new(input::open(path)?);
    let fault = |reason: String| InputError::file(path, format!("cannot read the pages: {reason}"));
    let cut = |cause: io::Error| fault(cause.to_string());
    let start = reader.fill_buf().map_err(cut)?;
    if start.is_empty() {
        return Err(fault("the file is empty".to_owned()));
    }
    if let Some(reason) = stand_in(start) {
        return Err(InputError::file(path, reason));
    }
    let form = Form::of(&mut reader).map_err(cut)?;
    let mut next = form.first_directory(&mut reader).map_err(cut)?;
    let (mut pages, mut seen) = (Vec::new(), HashSet::new());
    let mut first = None;
    while next != 0 {
        if !seen.insert(next) {
            return Err(fault("its directories form a loop".to_owned()));
        }
        if seen.len() > MOST_PAGES {
            return Err(fault(format!("more than {MOST_PAGES} pages")));
        }
        let directory = form.directory(&mut reader, next).map_err(cut)?;
        if !directory.is_reduced {
            pages.push(next);
        }
        next = directory.next;
        first.get_or_insert(directory);
    }
    match (pages.len(), first) {
        (0, _) => Err(fault("it has none".to_owned())),
        (1, Some(directory)) if directory.image_count() > 1 => {
            let length = reader.seek(SeekFrom::End(0)).map_err(cut)?;
            let images = Contiguous::new(form, &directory, length).map_err(fault)?;
            Ok(Pages::Contiguous(images))
        }
        _ => Ok(Pages::Directories(pages)),
    }
}

impl Contiguous {
    fn new(form: Form, directory: &Directory, length: u64) -> Result<Self, String> {
        let count = directory.image_count();
        if count > MOST_PAGES as u64 {
            return Err(format!("more than {MOST_PAGES} pages"));
        }
        if let Some(reason) = directory.unfit_values() {
            return Err(reason);
        }
        let is_plain = directory.compression == 1 && directory.samples == 1;
        if !(is_plain && [8, 16].contains(&directory.bits)) {
            return Err(format!(
                "{count} images of ImageJ behind one directory, which are read only as grey of 8 \
                 or 16 bits without compression; save the stack as Image Sequence"
            ));
        }
        let [width, height] = directory.size_px;
        let pixels = width.saturating_mul(height);
        if pixels == 0 || pixels > MOST_PIXELS {
            return Err(format!("{width} x {height} px is no size of an image"));
        }
        let images = Self {
            form,
            size_px: [width as u32, height as u32],
            is_deep: directory.bits == 16,
            start: directory.strip,
            count: usize::try_from(count).unwrap_or(usize::MAX),
        };
        let end = count
            .checked_mul(images.bytes())
            .and_then(|all| all.checked_add(images.start));
        match end {
            Some(end) if end <= length => Ok(images),
            _ => Err(format!(
                "ImageJ's description says {count} images, but the file is too short for them"
            )),
        }
    }

    /// Returns the length of an image, bytes.
    fn bytes(&self) -> u64 {
        let pixels = u64::from(self.size_px[0]) * u64::from(self.size_px[1]);
        pixels * if self.is_deep { 2 } else { 1 }
    }

    /// Reads the image `index`, counted from 0.
    ///
    /// # Errors
    /// [`InputError`] if the file cannot be read.
    pub fn read(&self, path: &Path, index: usize) -> Result<Picture, InputError> {
        let unreadable = |cause: io::Error| InputError::io(path, "read", &cause);
        let mut file = input::open(path)?;
        let at = self.start + self.bytes() * index as u64;
        file.seek(SeekFrom::Start(at)).map_err(unreadable)?;
        let mut bytes = vec![0; self.bytes() as usize];
        file.read_exact(&mut bytes).map_err(unreadable)?;
        let [width, height] = self.size_px.map(|side| side as usize);
        if !self.is_deep {
            return Ok(Picture::Eight(Image {
                width,
                height,
                grey: bytes,
            }));
        }
        let level = |pair: &[u8]| match self.form.is_little {
            true => u16::from_le_bytes([pair[0], pair[1]]),
            false => u16::from_be_bytes([pair[0], pair[1]]),
        };
        Ok(Picture::Sixteen {
            width,
            height,
            levels: bytes.chunks_exact(2).map(level).collect(),
        })
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
pub(in crate::images) mod tests {
    use super::*;

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
            let found = pages_of(&path);
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
        std::fs::write(&path, &whole).unwrap();
        let second = pages_of(&path)[1] as u32;
        let end = loops.len() - 4;
        loops[end..].copy_from_slice(&second.to_le_bytes());
        for (content, reason) in [
            (&b""[..], "the file is empty"),
            (
                b"version https://git-lfs.github.com/spec/v1\n",
                "git lfs pull",
            ),
            (b"II", "cannot read the pages"),
            (b"not a TIFF", "not a TIFF file"),
            (&whole[..40], "cannot read the pages"),
            (&loops, "form a loop"),
        ] {
            std::fs::write(&path, content).unwrap();
            let error = pages(&path).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    fn pages_of(path: &Path) -> Vec<u64> {
        match pages(path).unwrap() {
            Pages::Directories(pages) => pages,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn images_behind_one_directory_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("left.tif");
        for is_little in [true, false] {
            let text = b"ImageJ=1.54f\nimages=3\nslices=3\n\0";
            let images = [[10_u16, 20, 30, 40, 50, 4095], [1, 2, 3, 4, 5, 6], [7; 6]];
            let mut file = imagej([3, 2], 16, text, is_little);
            let bytes = |level: u16| match is_little {
                true => level.to_le_bytes(),
                false => level.to_be_bytes(),
            };
            file.extend(images.into_iter().flatten().flat_map(bytes));
            std::fs::write(&path, &file).unwrap();
            let Pages::Contiguous(found) = pages(&path).unwrap() else {
                panic!("one directory");
            };
            assert_eq!(found.count, 3);
            for (index, expected) in images.iter().enumerate() {
                let Picture::Sixteen { levels, .. } = found.read(&path, index).unwrap() else {
                    panic!("16 bits");
                };
                assert_eq!(levels, expected);
            }
            std::fs::write(&path, &file[..file.len() - 1]).unwrap();
            let error = pages(&path).unwrap_err().to_string();
            assert!(
                error.contains("says 3 images, but the file is too short"),
                "{error}"
            );
            std::fs::write(&path, imagej([3, 2], 32, text, is_little)).unwrap();
            let error = pages(&path).unwrap_err().to_string();
            assert!(error.contains("numbers of 32 bits"), "{error}");
        }
    }

    /// Returns the start of a TIFF file of ImageJ up to its images.
    fn imagej(size: [u32; 2], bits: u32, text: &[u8], is_little: bool) -> Vec<u8> {
        let number = |bytes: [u8; 4]| match is_little {
            true => bytes,
            false => {
                let [a, b, c, d] = bytes;
                [d, c, b, a]
            }
        };
        let short = |n: u16| number(u32::from(n).to_le_bytes());
        let mut file = if is_little {
            b"II*\0".to_vec()
        } else {
            b"MM\0*".to_vec()
        };
        let fields = [
            (256, size[0]),
            (257, size[1]),
            (258, bits),
            (259, 1),
            (277, 1),
        ];
        let text_at = 8 + 2 + 12 * 7 + 4;
        let start = text_at + text.len() as u32;
        let described = [(270, text_at), (273, start)];
        file.extend(number(8_u32.to_le_bytes()));
        let two = |n: u16| match is_little {
            true => [short(n)[0], short(n)[1]],
            false => [short(n)[2], short(n)[3]],
        };
        file.extend(two(7));
        for (tag, value) in fields.into_iter().chain(described) {
            file.extend(two(tag));
            let (kind, count) = if tag == 270 {
                (2, text.len() as u32)
            } else {
                (4, 1)
            };
            file.extend(two(kind));
            file.extend(number(count.to_le_bytes()));
            file.extend(number(value.to_le_bytes()));
        }
        file.extend([0; 4]);
        file.extend(text);
        file
    }
}
