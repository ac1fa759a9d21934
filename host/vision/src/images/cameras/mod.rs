//! Live cameras: images that arrive one by one, each at its camera's own time, assembled into frame
//! sets.
//!
//! ```text
//! camera -> grey -> \
//! camera -> grey ->  matching -> LiveCameras, an iterator of frame sets
//! camera -> grey -> /
//! ```
//!
//! [`grey`] turns a camera's bytes into an image, [`stamp`] converts its time stamp, [`numbers`]
//! counts the images that the driver lost, [`matching`] finds images of the same instant, [`live`]
//! runs a thread per camera. [`stream`] is a camera of another program. Only `device` depends on
//! V4L2, and only it needs the feature `camera`. GenICam cameras (`genicam`, which needs the feature
//! of this name) have formats of their own ([`mono`]), numbers of their own ([`block_ids`]) and a
//! clock of their own ([`device_clock`]). Everything else comes through GStreamer (`gstreamer`, with
//! the feature of this name).
//!
//! *Time* is the host's monotonic clock, in µs since the cameras were started.

pub mod block_ids;
#[cfg(all(feature = "camera", target_os = "linux"))]
pub mod device;
pub mod device_clock;
#[cfg(feature = "genicam")]
pub mod genicam;
pub mod grey;
#[cfg(feature = "gstreamer")]
pub mod gstreamer;
pub mod live;
pub mod matching;
pub mod mono;
pub mod numbers;
pub mod stamp;
pub mod stream;
pub mod triggers;
