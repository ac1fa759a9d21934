//! Video that comes through a pipe: read by a thread, so that a program which writes the videos of
//! several cameras may be some frames ahead with one of them. Beyond that it waits.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use super::super::decode::Picture;
use super::y4m::Header;
use super::{said, sized};
use trinocular_rig::error::InputError;

/// Frames that are read ahead of their use.
const AHEAD: usize = 16;

/// Path of standard input.
pub const STANDARD_INPUT: &str = "-";

type Came = Result<Picture, InputError>;

/// Frames of a Y4M video from a pipe. Clones share the frames: each comes once.
#[derive(Clone, Debug)]
pub struct Pipe {
    /// Path of the pipe, or [`STANDARD_INPUT`].
    pub path: PathBuf,
    frames: Arc<Mutex<Receiver<Came>>>,
}

impl Pipe {
    /// Opens the pipe, which waits for its writer in a thread.
    pub fn open(path: &Path) -> Self {
        let (send, frames) = sync_channel(AHEAD);
        let own = path.to_owned();
        // The thread ends with the video, or when the receiver of its frames is dropped.
        thread::spawn(move || {
            let fault = |reason: String| InputError::file(&own, reason);
            let open = || -> Result<Box<dyn Read>, InputError> {
                if own == Path::new(STANDARD_INPUT) {
                    return Ok(Box::new(std::io::stdin()));
                }
                let file = File::open(&own);
                file.map(|file| Box::new(file) as Box<dyn Read>)
                    .map_err(|cause| InputError::io(&own, "read", &cause))
            };
            let mut reader = match open() {
                Ok(reader) => BufReader::new(reader),
                Err(error) => return drop(send.send(Err(error))),
            };
            let header = match Header::read(&mut reader) {
                Ok(header) => header,
                Err(reason) => return drop(send.send(Err(fault(reason)))),
            };
            for index in 0.. {
                let frame = header.next(&mut reader, index);
                let frame = frame.map_err(|reason| fault(format!("frame {}: {reason}", index + 1)));
                let (is_last, frame) = match frame {
                    Ok(Some(picture)) => (false, Ok(picture)),
                    Ok(None) => return,
                    Err(error) => (true, Err(error)),
                };
                if send.send(frame).is_err() || is_last {
                    return;
                }
            }
        });
        Self {
            path: path.to_owned(),
            frames: Arc::new(Mutex::new(frames)),
        }
    }

    /// Waits for the next frame, which must have `size_px` if that is known; `None` at the end of the
    /// video.
    pub fn next(&self, size_px: Option<[u32; 2]>) -> Option<Came> {
        let frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        let picture = match frames.recv().ok()? {
            Ok(picture) => picture,
            Err(error) => return Some(Err(error)),
        };
        let sized = sized(Ok(picture), size_px);
        Some(sized.map_err(|refusal| InputError::file(&self.path, said(&refusal))))
    }
}
