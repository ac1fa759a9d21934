//! Cameras of another program on this computer, over a byte stream: `trinocular twin` renders them.
//!
//! Every image is a header of 20 bytes, little-endian, and its grey levels row by row:
//!
//! | bytes | content |
//! |---|---|
//! | 4 | `TRIC` |
//! | 4 | number of the image, counting every exposure |
//! | 8 | time stamp, ns on the computer's monotonic clock |
//! | 2 + 2 | width and height, px |

use super::live::{Camera, CameraEvent};
use super::numbers::Numbers;
use super::stamp::{Clocks, Moments, Point, Stamp};
use crate::images::Image;
use std::io::{self, ErrorKind, Read};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use trinocular_rig::error::InputError;

/// First bytes of every image.
const MAGIC: [u8; 4] = *b"TRIC";

/// Length of the header, bytes.
const HEADER: usize = 20;

/// Header of one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamHeader {
    /// Number of the exposure.
    pub number: u32,
    /// Time stamp on the computer's monotonic clock.
    pub captured: Duration,
    /// Width and height, px.
    pub size_px: [u16; 2],
}

impl StreamHeader {
    /// Returns the header's bytes.
    pub fn bytes(&self) -> [u8; HEADER] {
        let [width, height] = self.size_px.map(u16::to_le_bytes);
        let captured_ns = u64::try_from(self.captured.as_nanos()).unwrap_or(u64::MAX);
        let mut bytes = [0; HEADER];
        let parts = [
            &MAGIC[..],
            &self.number.to_le_bytes(),
            &captured_ns.to_le_bytes(),
            &width,
            &height,
        ];
        for (place, byte) in bytes.iter_mut().zip(parts.concat()) {
            *place = byte;
        }
        bytes
    }

    /// Reads a header; `None` if the bytes are none.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (magic, rest) = bytes.split_first_chunk()?;
        let (number, rest) = rest.split_first_chunk()?;
        let (captured_ns, rest) = rest.split_first_chunk()?;
        let (width, rest) = rest.split_first_chunk()?;
        let (height, _) = rest.split_first_chunk()?;
        (*magic == MAGIC).then(|| Self {
            number: u32::from_le_bytes(*number),
            captured: Duration::from_nanos(u64::from_le_bytes(*captured_ns)),
            size_px: [u16::from_le_bytes(*width), u16::from_le_bytes(*height)],
        })
    }
}

/// Camera whose images come over a byte stream.
pub struct StreamCamera<R> {
    path: PathBuf,
    input: R,
    size_px: [u32; 2],
    /// Bytes of the next image that have arrived.
    arrived: Vec<u8>,
    moments: Moments,
    numbers: Numbers,
    /// True once an image has arrived.
    has_images: bool,
}

impl<R> StreamCamera<R> {
    /// Reads images of `size_px` from `input`, which must return from a read within a fraction of a
    /// second. `monotonic` reads the clock of the capture times; `path` is the camera's name in
    /// messages.
    pub fn new(
        path: PathBuf,
        input: R,
        size_px: [u32; 2],
        monotonic: impl Fn() -> Duration,
    ) -> Self {
        Self {
            path,
            input,
            size_px,
            arrived: Vec::new(),
            moments: Moments::new(Clocks::read(monotonic)),
            numbers: Numbers::default(),
            has_images: false,
        }
    }

    fn failed(&self, reason: &str) -> InputError {
        InputError::file(&self.path, reason)
    }
}

impl<R: Read> StreamCamera<R> {
    /// Reads until `count` bytes have arrived; returns false after a pause of the input.
    fn fill(&mut self, count: usize) -> io::Result<bool> {
        while self.arrived.len() < count {
            let missing = (count - self.arrived.len()) as u64;
            let read = (&mut self.input)
                .take(missing)
                .read_to_end(&mut self.arrived);
            match read {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(_) => {}
                Err(cause) => match cause.kind() {
                    ErrorKind::Interrupted => {}
                    ErrorKind::WouldBlock | ErrorKind::TimedOut => return Ok(false),
                    _ => return Err(cause),
                },
            }
        }
        Ok(true)
    }

    fn is_filled(&mut self, count: usize) -> Result<bool, InputError> {
        self.fill(count).map_err(|cause| self.ended(&cause))
    }

    /// Returns the error for the end of the input.
    fn ended(&self, cause: &io::Error) -> InputError {
        let is_closed = matches!(
            cause.kind(),
            ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe
        );
        match (is_closed, self.has_images) {
            (true, true) => self.failed("its program has ended"),
            (true, false) => self.failed(
                "its program closed the connection before the first image: it has ended, or has \
                 no such camera; give both programs the same rig file",
            ),
            (false, _) => self.failed(&format!("cannot be read: {cause}")),
        }
    }
}

impl<R: Read + Send + 'static> Camera for StreamCamera<R> {
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        if !self.is_filled(HEADER)? {
            return Ok(CameraEvent::Nothing);
        }
        let header = StreamHeader::read(&self.arrived);
        let header = header.ok_or_else(|| self.failed("sends no images of a simulated camera"))?;
        let [width, height] = header.size_px.map(u32::from);
        if [width, height] != self.size_px {
            let [expected, by] = self.size_px;
            let reason = format!(
                "has images of {width} x {height} px, but the rig file has {expected} x {by}: give \
                 both programs the same rig file"
            );
            return Err(self.failed(&reason));
        }
        let pixels = width as usize * height as usize;
        if !self.is_filled(HEADER + pixels)? {
            return Ok(CameraEvent::Nothing);
        }
        let grey = self.arrived.split_off(HEADER);
        self.arrived.clear();
        self.has_images = true;
        self.numbers.saw(header.number);
        let stamp = Stamp::Monotonic(header.captured, Point::Start);
        // An image waits in the line for as long as this program is suspended. Its stamp is right
        // all the same.
        let moment = self.moments.of(stamp, Instant::now(), false);
        let image = Image {
            width: width as usize,
            height: height as usize,
            grey,
        };
        Ok(moment.map_or(CameraEvent::Stale, |at| CameraEvent::Image(at, image)))
    }

    fn lost(&self) -> u64 {
        self.numbers.lost()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    /// Input that pauses between its parts.
    struct Parts(VecDeque<Vec<u8>>);

    impl Read for Parts {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let Some(part) = self.0.front_mut() else {
                return Ok(0);
            };
            if part.is_empty() {
                self.0.pop_front();
                return Err(ErrorKind::WouldBlock.into());
            }
            let count = part.len().min(buffer.len());
            buffer[..count].copy_from_slice(&part[..count]);
            part.drain(..count);
            Ok(count)
        }
    }

    fn camera(parts: Vec<Vec<u8>>) -> StreamCamera<Parts> {
        let clock = || Duration::from_secs(100);
        StreamCamera::new("twin:left".into(), Parts(parts.into()), [3, 2], clock)
    }

    fn image(number: u32) -> Vec<u8> {
        let header = StreamHeader {
            number,
            captured: Duration::from_secs(100),
            size_px: [3, 2],
        };
        let mut bytes = header.bytes().to_vec();
        bytes.extend([1, 2, 3, 4, 5, number as u8]);
        bytes
    }

    /// Returns the last grey levels of all images until the end or an error, and the camera.
    fn all(mut camera: StreamCamera<Parts>) -> (Vec<u8>, StreamCamera<Parts>, String) {
        let mut last = Vec::new();
        loop {
            match camera.next_image() {
                Ok(CameraEvent::Image(_, image)) => last.extend(image.grey.last()),
                Ok(_) => {}
                Err(error) => return (last, camera, error.to_string()),
            }
        }
    }

    #[test]
    fn images_come_in_any_parts() {
        let bytes = [image(7), image(8), image(11)].concat();
        for length in [1, 5, 19, 20, 21, 26, 100] {
            let parts = bytes.chunks(length).map(<[u8]>::to_vec).collect();
            let (last, camera, error) = all(camera(parts));
            assert_eq!(last, [7, 8, 11], "{length}");
            assert_eq!(camera.lost(), 2);
            assert_eq!(error, "twin:left: its program has ended");
        }
    }

    #[test]
    fn end_before_first_image_is_named() {
        for begun in [vec![], image(1)[..25].to_vec()] {
            let (last, _, error) = all(camera(vec![begun]));
            assert!(
                last.is_empty() && error.contains("the same rig file"),
                "{error}"
            );
        }
    }

    /// A program that was suspended finds an image in the line that is older than any camera's.
    #[test]
    fn image_from_suspension_is_stale() {
        let header = StreamHeader {
            number: 7,
            captured: Duration::from_secs(60),
            size_px: [3, 2],
        };
        let old = [header.bytes().to_vec(), vec![9; 6]].concat();
        let mut camera = camera(vec![[old, image(8)].concat()]);
        assert_eq!(camera.next_image(), Ok(CameraEvent::Stale));
        let Ok(CameraEvent::Image(_, next)) = camera.next_image() else {
            panic!("the stamps are believed as before");
        };
        assert_eq!(next.grey.last(), Some(&8));
    }

    #[test]
    fn other_bytes_are_refused() {
        let (last, _, error) = all(camera(vec![b"HTTP/1.1 200 OK, nothing here".to_vec()]));
        assert!(last.is_empty() && error.contains("no images"), "{error}");
        let header = StreamHeader {
            number: 1,
            captured: Duration::ZERO,
            size_px: [u16::MAX; 2],
        };
        let (_, _, error) = all(camera(vec![header.bytes().to_vec()]));
        assert!(
            error.contains("65535") && error.contains("3 x 2"),
            "{error}"
        );
    }
}
