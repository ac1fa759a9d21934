//! Live cameras: pictures that come one by one, each on its camera's own time, put together into
//! captures.
//!
//! ```text
//! camera -> grey -> \
//! camera -> grey ->  matching -> Live, an iterator of captures
//! camera -> grey -> /
//! ```
//!
//! [`grey`] turns a camera's bytes into an image, [`stamp`] tells when it was taken and [`numbers`]
//! what the driver lost, [`matching`] finds the pictures that were taken at the same time, [`live`]
//! runs a thread per camera. `device` is the only part that knows V4L2, and the only one that is
//! built with the feature `camera` alone.
//!
//! *Time* is the host's monotonic clock, in µs since the cameras were started.

#[cfg(all(feature = "camera", target_os = "linux"))]
pub mod device;
pub mod grey;
pub mod live;
pub mod matching;
pub mod numbers;
pub mod stamp;
