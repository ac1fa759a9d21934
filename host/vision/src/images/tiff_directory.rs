//! Directories of a TIFF file (IFDs): the fields that describe a page, in TIFF 6.0 and BigTIFF.

use std::io::{self, Read, Seek, SeekFrom};

/// Largest number of fields in a directory.
const MOST_FIELDS: u64 = 4_096;
/// Largest length of a description that is read, bytes.
const LONGEST_DESCRIPTION: u64 = 4_096;

/// Byte order and width of the offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    /// True if the lower byte of a value comes first.
    pub is_little: bool,
    /// True for BigTIFF, whose offsets have 8 bytes.
    pub is_big: bool,
}

/// Fields of a directory; 0 for one that the directory lacks, and TIFF's default for those with
/// one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Directory {
    /// Width and height, px.
    pub size_px: [u64; 2],
    /// Bits per value of the first channel.
    pub bits: u64,
    /// Format of the values: 1 unsigned, 2 signed, 3 floating point.
    pub format: u64,
    /// Compression scheme; 1 is none.
    pub compression: u64,
    /// Values per pixel.
    pub samples: u64,
    /// Offset of the first strip.
    pub strip: u64,
    /// Description of the image, as text.
    pub description: String,
    /// True for a reduced copy of another page.
    pub is_reduced: bool,
    /// Offset of the next directory; 0 after the last.
    pub next: u64,
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
    pub fn first(self) -> usize {
        if self.is_big { 8 } else { 4 }
    }

    /// Reads the header.
    ///
    /// # Errors
    /// If the reader has no TIFF file.
    pub fn of(reader: &mut impl Read) -> io::Result<Self> {
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

    /// Reads the offset of the first directory.
    ///
    /// # Errors
    /// If the file is cut off.
    pub fn first_directory(self, reader: &mut (impl Read + Seek)) -> io::Result<u64> {
        reader.seek(SeekFrom::Start(self.first() as u64))?;
        self.offset(reader)
    }

    /// Reads the directory at the offset `at`.
    ///
    /// # Errors
    /// If the file is cut off, or the directory has too many fields.
    pub fn directory(self, reader: &mut (impl Read + Seek), at: u64) -> io::Result<Directory> {
        reader.seek(SeekFrom::Start(at))?;
        let count = match self.is_big {
            true => self.read::<8>(reader)?,
            false => self.read::<2>(reader)?,
        };
        if count > MOST_FIELDS {
            return Err(io::Error::other(format!("a directory of {count} fields")));
        }
        let mut directory = Directory {
            bits: 1,
            format: 1,
            compression: 1,
            samples: 1,
            ..Directory::default()
        };
        for _ in 0..count {
            let tag = self.read::<2>(reader)?;
            let kind = self.read::<2>(reader)?;
            let length = self.offset(reader)?;
            let here = reader.stream_position()?;
            let mut value = || self.first_value(reader, kind, length);
            match tag {
                254 => directory.is_reduced = value()? & 1 == 1,
                256 => directory.size_px[0] = value()?,
                257 => directory.size_px[1] = value()?,
                258 => directory.bits = value()?,
                259 => directory.compression = value()?,
                270 => directory.description = self.text(reader, length)?,
                273 => directory.strip = value()?,
                277 => directory.samples = value()?,
                339 => directory.format = value()?,
                _ => {}
            }
            reader.seek(SeekFrom::Start(here))?;
            self.offset(reader)?;
        }
        directory.next = self.offset(reader)?;
        Ok(directory)
    }

    /// Reads the first value of a field whose content is here or, if too long, at an offset.
    fn first_value(
        self,
        reader: &mut (impl Read + Seek),
        kind: u64,
        length: u64,
    ) -> io::Result<u64> {
        let bytes = match kind {
            3 => 2,
            4 => 4,
            16 => 8,
            _ => 1,
        };
        self.go_to_content(reader, length.saturating_mul(bytes))?;
        match bytes {
            2 => self.read::<2>(reader),
            4 => self.read::<4>(reader),
            8 => self.read::<8>(reader),
            _ => self.read::<1>(reader),
        }
    }

    fn text(self, reader: &mut (impl Read + Seek), length: u64) -> io::Result<String> {
        self.go_to_content(reader, length)?;
        let mut bytes = Vec::new();
        let mut limited = reader.take(length.min(LONGEST_DESCRIPTION));
        limited.read_to_end(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Goes to the content of a field of `bytes`: here, if it fits into an offset's place.
    fn go_to_content(self, reader: &mut (impl Read + Seek), bytes: u64) -> io::Result<()> {
        let fits = if self.is_big { 8 } else { 4 };
        if bytes > fits {
            let at = self.offset(reader)?;
            reader.seek(SeekFrom::Start(at))?;
        }
        Ok(())
    }
}

impl Directory {
    /// Returns the reason why the values cannot be read, with the way out; `None` for unsigned
    /// values of at most 16 bits.
    pub fn unfit_values(&self) -> Option<String> {
        let kind = match self.format {
            3 => "floating-point",
            2 => "signed",
            _ if self.bits > 16 => "whole",
            _ => return None,
        };
        Some(format!(
            "its values are {kind} numbers of {} bits, but unsigned ones of 8 or 16 bits are read; \
             scale them to 0 to 65535 and save as 16 bits (ImageJ: Image > Type > 16-bit)",
            self.bits
        ))
    }

    /// Returns the number of images that ImageJ has put one after the other behind a single
    /// directory; 1 for any other file.
    pub fn image_count(&self) -> u64 {
        let mut lines = self.description.lines();
        if !lines.next().is_some_and(|line| line.starts_with("ImageJ=")) {
            return 1;
        }
        let count = lines.find_map(|line| line.strip_prefix("images="));
        count
            .and_then(|count| count.trim().parse().ok())
            .unwrap_or(1)
    }
}
