//! The file of a recording. It is written in whole chunks, and ends with one after a failure, too.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// End of a recording without a summary: an empty data end record, a footer, and the magic bytes.
const PLAIN_END: [&[u8]; 3] = [
    &[0x0f, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    &[
        0x02, 20, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    ],
    mcap::MAGIC,
];

/// File that takes bytes into memory, and to the disk at each [`flush`](Write::flush) only.
#[derive(Debug)]
pub struct Sink {
    file: File,
    /// True if the file is a regular one, which can be cut.
    is_regular: bool,
    waiting: Vec<u8>,
    /// Bytes on the disk, all of whole records.
    written: u64,
}

impl Sink {
    /// Takes over a new, empty file.
    ///
    /// # Errors
    /// If the system says nothing about the file.
    pub fn new(file: File) -> io::Result<Self> {
        Ok(Self {
            is_regular: file.metadata()?.is_file(),
            file,
            waiting: Vec::new(),
            written: 0,
        })
    }

    /// Returns the number of bytes on the disk.
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Ends the file after a failed write: cuts what is not whole, and closes the file as well as a
    /// full disk allows it. The end takes less room than what was cut.
    pub fn rescue(&mut self) {
        self.waiting.clear();
        if !self.is_regular {
            return;
        }
        let is_cut = self.file.set_len(self.written).is_ok();
        if is_cut && self.file.seek(SeekFrom::Start(self.written)).is_ok() {
            let end = PLAIN_END.concat();
            // Without an end the file is read up to its last whole chunk nevertheless.
            if fits_limit(self.written, end.len()).is_ok() && self.file.write_all(&end).is_err() {
                let _ = self.file.set_len(self.written);
            }
        }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.waiting.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        fits_limit(self.written, self.waiting.len())?;
        self.file.write_all(&self.waiting)?;
        self.written += self.waiting.len() as u64;
        self.waiting.clear();
        Ok(())
    }
}

/// Tells the position only; the file grows at its end.
impl Seek for Sink {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let place = self.written + self.waiting.len() as u64;
        match to {
            SeekFrom::Current(0) | SeekFrom::End(0) => Ok(place),
            SeekFrom::Start(start) if start == place => Ok(place),
            _ => Err(io::Error::other("a recording is written from front to end")),
        }
    }
}

/// Refuses to write beyond the file size limit of this process, because the system would end the
/// process in the middle.
#[cfg(unix)]
fn fits_limit(written: u64, more: usize) -> io::Result<()> {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Fsize).current;
    match limit {
        Some(limit) if written + more as u64 > limit => Err(io::Error::new(
            io::ErrorKind::FileTooLarge,
            format!("this process may write files of {limit} bytes (ulimit -f)"),
        )),
        _ => Ok(()),
    }
}

#[cfg(not(unix))]
fn fits_limit(_: u64, _: usize) -> io::Result<()> {
    Ok(())
}
