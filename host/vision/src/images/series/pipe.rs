//! Video that comes through a pipe: read by a thread, so that a program which writes the videos of
//! several cameras may be some frames ahead with one of them. Beyond that it waits.
//!
//! Two pipes whose program writes one whole video after the other would wait for each other for
//! ever; a reader that waits for long says so.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

use super::super::decode::Picture;
use super::y4m::Header;
use super::{said, sized};
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::printable::printable;

/// Frames that are read ahead of their use, if they are small.
const AHEAD: u64 = 16;
/// Memory for frames that are read ahead, bytes.
const MEMORY_AHEAD: u64 = 128 << 20;
/// Time without a frame after which the reader says that it waits.
const PATIENCE: Duration = Duration::from_secs(10);

/// Path of standard input.
pub const STANDARD_INPUT: &str = "-";

type Came = Result<Picture, InputError>;

/// Frames of a Y4M video from a pipe. Clones share the frames: each comes once.
#[derive(Clone, Debug)]
pub struct Pipe {
    /// Path of the pipe, or [`STANDARD_INPUT`].
    pub path: PathBuf,
    header: Arc<OnceLock<Header>>,
    frames: Arc<Mutex<Frames>>,
}

/// Frames to come.
#[derive(Debug)]
enum Frames {
    /// The video has not begun; its frames come through the channel that is sent first.
    Awaited(Receiver<Result<Receiver<Came>, InputError>>),
    Coming(Receiver<Came>),
    Over,
}

impl Pipe {
    /// Opens the pipe, which waits for its writer in a thread.
    pub fn open(path: &Path) -> Self {
        let (begin, frames) = sync_channel(1);
        let header = Arc::new(OnceLock::new());
        let (own, header_read) = (path.to_owned(), Arc::clone(&header));
        // The thread ends with the video, or when the receiver of its frames is dropped.
        thread::spawn(move || match start(&own) {
            Ok((mut reader, header)) => {
                let ahead = (MEMORY_AHEAD / header.picture_bytes()).clamp(1, AHEAD);
                let (send, frames) = sync_channel(ahead as usize);
                let is_first = header_read.set(header.clone()).is_ok();
                if is_first && begin.send(Ok(frames)).is_ok() {
                    forward(&own, &header, &mut reader, &send);
                }
            }
            Err(error) => drop(begin.send(Err(error))),
        });
        Self {
            path: path.to_owned(),
            header,
            frames: Arc::new(Mutex::new(Frames::Awaited(frames))),
        }
    }

    /// Returns the frames per second, as a fraction, once the video has begun.
    pub fn rate(&self) -> Option<[u32; 2]> {
        self.header.get()?.rate
    }

    /// Waits for the next frame, which must have `size_px` if that is known; `None` at the end of the
    /// video.
    pub fn next(&self, size_px: Option<[u32; 2]>) -> Option<Came> {
        let mut frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        if let Frames::Awaited(begin) = &*frames {
            *frames = match self.wait(begin) {
                Some(Ok(coming)) => Frames::Coming(coming),
                Some(Err(error)) => {
                    *frames = Frames::Over;
                    return Some(Err(error));
                }
                None => Frames::Over,
            };
        }
        let Frames::Coming(coming) = &*frames else {
            return None;
        };
        let picture = match self.wait(coming)? {
            Ok(picture) => picture,
            Err(error) => return Some(Err(error)),
        };
        let sized = sized(Ok(picture), size_px);
        Some(sized.map_err(|refusal| InputError::file(&self.path, said(&refusal))))
    }

    /// Waits for the next value, and says so once if that takes long; `None` at the end.
    fn wait<T>(&self, channel: &Receiver<T>) -> Option<T> {
        match channel.recv_timeout(PATIENCE) {
            Ok(value) => return Some(value),
            Err(RecvTimeoutError::Disconnected) => return None,
            Err(RecvTimeoutError::Timeout) => {}
        }
        notice!(
            "{}: waiting for a frame; a program that writes the videos of several cameras must \
             write them in turn, at most {AHEAD} frames ahead with one of them",
            printable(self.path.display())
        );
        channel.recv().ok()
    }
}

/// Opens the video and reads its header.
fn start(path: &Path) -> Result<(BufReader<Box<dyn Read>>, Header), InputError> {
    let stream: Box<dyn Read> = if path == Path::new(STANDARD_INPUT) {
        Box::new(std::io::stdin())
    } else {
        let file = File::open(path).map_err(|cause| InputError::io(path, "read", &cause))?;
        Box::new(file)
    };
    let mut reader = BufReader::new(stream);
    let header = Header::read(&mut reader).map_err(|reason| InputError::file(path, reason))?;
    Ok((reader, header))
}

/// Sends the frames of the video until it ends, or the receiver is dropped.
fn forward(path: &Path, header: &Header, reader: &mut impl BufRead, send: &SyncSender<Came>) {
    for index in 0.. {
        let frame = match header.next(reader, index) {
            Ok(Some(picture)) => Ok(picture),
            Ok(None) => return,
            Err(reason) => {
                let reason = format!("frame {}: {reason}", index + 1);
                Err(InputError::file(path, reason))
            }
        };
        let is_last = frame.is_err();
        if send.send(frame).is_err() || is_last {
            return;
        }
    }
}
