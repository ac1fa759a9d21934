//! Publisher of a run, on a thread of its own, and the commands that come back.
//!
//! ```text
//! loop -> Feed -> queue, bounded by bytes -> thread -> Zenoh session -> CommandSink
//! ```
//!
//! *Invariant:* a run in real time never waits for the network. What does not fit the queue is
//! dropped and counted.

mod outlet;

use crate::command::{Command, CommandFault, CommandTopic};
use crate::name::SameName;
use outlet::Outlet;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use trinocular_recording::message::Measurement;
use trinocular_recording::queue::{Pace, Popped, Queue};
use trinocular_vision::images::{FrameSet, Image};

/// Endpoint of a Zenoh router on this computer, as `rmw_zenohd` opens it.
pub const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";

/// Longest time that the thread waits for the next frame set.
const PATIENCE: Duration = Duration::from_millis(200);

/// Taker of the commands of nodes, or of the reason for which a message is none. It is called on a
/// thread of the session and must not wait.
pub type CommandSink = Arc<dyn Fn(CommandTopic, Result<Command, CommandFault>) + Send + Sync>;

/// Settings of a publisher.
#[derive(Clone)]
pub struct Settings {
    /// Endpoint of the Zenoh router, such as `tcp/127.0.0.1:7447`.
    pub endpoint: String,
    /// ROS domain, 0 to 232.
    pub domain: u32,
    /// Names of the cameras, in the rig's order.
    pub cameras: Vec<String>,
    /// Behaviour if the network is too slow.
    pub pace: Pace,
    /// Taker of commands; without one there are no topics of commands.
    pub commands: Option<CommandSink>,
}

/// Reason for which nothing can be published.
#[derive(Debug, thiserror::Error)]
pub enum PublisherError {
    /// The endpoint has no form of Zenoh's.
    #[error(
        "{endpoint} is no endpoint of Zenoh: write tcp/ADDRESS:PORT, such as {DEFAULT_ENDPOINT}"
    )]
    Endpoint {
        /// Endpoint as given.
        endpoint: String,
    },
    /// No router answers. Zenoh's own reason names places in its sources.
    #[error(
        "no Zenoh router answers: start one (`ros2 run rmw_zenoh_cpp rmw_zenohd`, or `zenohd`), or \
         give its endpoint"
    )]
    Router,
    /// The session did not take a topic.
    #[error("Zenoh does not take the topic: {0}")]
    Topic(String),
    /// Two cameras have one name.
    #[error(transparent)]
    Name(#[from] SameName),
    /// The system gives no thread.
    #[error("the system gives no thread: {0}")]
    Thread(#[from] io::Error),
}

/// One thing to publish.
#[derive(Debug)]
enum Content {
    /// Stamp, µs, and images.
    Images(u64, Vec<Image>),
    Measurement(Box<Measurement>),
}

/// Entrance for the frame sets of a run. Cheap to share.
#[derive(Debug)]
pub struct Feed {
    queue: Queue<Content>,
    dropped: AtomicU64,
}

impl Feed {
    /// Takes in a frame set, whose images may be missing, and its measurement.
    pub fn take(&self, images: Option<&FrameSet>, measurement: Measurement) {
        if let Some(set) = images {
            let bytes = set.images.iter().map(|image| image.grey.len()).sum();
            let content = Content::Images(measurement.stamp_us, set.images.clone());
            self.push(content, bytes, true);
        }
        self.push(Content::Measurement(Box::new(measurement)), 1_000, false);
    }

    fn push(&self, content: Content, bytes: usize, is_image: bool) {
        if !self.queue.push(content, bytes, is_image) {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// Account of a publisher that has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Account {
    /// Messages that went to the router.
    pub messages: u64,
    /// Messages that the session did not take.
    pub failed: u64,
    /// Image sets and measurements that the full queue had no room for.
    pub dropped: u64,
}

/// Publisher under way. Dropping it ends the session as [`Publisher::finish`] does.
#[derive(Debug)]
pub struct Publisher {
    feed: Arc<Feed>,
    thread: Option<JoinHandle<Account>>,
}

impl Publisher {
    /// Opens a session with the router, and announces node and topics.
    ///
    /// # Errors
    /// [`PublisherError`] if the router cannot be reached or the names do not suit ROS 2.
    pub fn open(settings: &Settings) -> Result<Self, PublisherError> {
        let mut outlet = Outlet::open(settings)?;
        let feed = Arc::new(Feed {
            queue: Queue::new(settings.pace),
            dropped: AtomicU64::new(0),
        });
        let taken = Arc::clone(&feed);
        let run = move || {
            loop {
                match taken.queue.pop(PATIENCE) {
                    Popped::Entry(Content::Images(stamp_us, images)) => {
                        outlet.images(stamp_us, &images);
                    }
                    Popped::Entry(Content::Measurement(measurement)) => {
                        outlet.measurement(*measurement);
                    }
                    Popped::Nothing => {}
                    Popped::Closed => return outlet.close(),
                }
            }
        };
        let thread = std::thread::Builder::new().name("zenoh".to_owned());
        Ok(Self {
            feed,
            thread: Some(thread.spawn(run)?),
        })
    }

    /// Returns the entrance for the frame sets of the run.
    pub fn feed(&self) -> Arc<Feed> {
        Arc::clone(&self.feed)
    }

    /// Sends what waits, and ends the session.
    pub fn finish(mut self) -> Account {
        self.join()
    }

    fn join(&mut self) -> Account {
        self.feed.queue.close();
        // A thread that panicked has said so.
        let account = self.thread.take().and_then(|thread| thread.join().ok());
        Account {
            dropped: self.feed.dropped.load(Ordering::Relaxed),
            ..account.unwrap_or_default()
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.join();
    }
}
