//! A scenario as data: motion of the target, events, and expected result.
//!
//! ```toml
//! title = "A step, then a line"
//! seed = 1                              # of poster and noise
//!
//! [cameras]
//! kind = "rendered"                     # images through the flow; "points": ideal points
//! frames_per_s = 60.0
//! latency_ms = 20.0                     # from a frame set to its frame at the station
//! depth_mm = 850.0
//! noise_grey = 2.0                      # points: noise_px = 0.03 and points = 100 instead
//!
//! [[target]]                            # legs, one after the other
//! motion = "step"                       # still; step; line; lissajous
//! by_mm = [4.0, 4.0, 1.0]               # lissajous: amplitude_mm, ratio, peak_mm_s
//! seconds = 1.0
//! [[target]]
//! motion = "line"
//! velocity_mm_s = [30.0, 40.0, 0.0]
//! seconds = 2.0
//! ramp_in_s = 0.3                       # optional, default 0; likewise ramp_out_s
//!
//! [[event]]                             # see `Happening`
//! at_s = 1.5
//! what = "occlusion"
//! seconds = 0.5
//!
//! [measure]                             # optional
//! from_s = 1.0                          # figures are taken from here (0)
//! until_s = 3.0                         # to here (the end)
//! settle_within_mm = [0.03, 0.03, 0.08] # a step has settled when the error stays within (these)
//!
//! [stage]                               # optional: as in a rig file; without it the twin's own
//!
//! [expect]                              # see `Expect`
//! rms_mm = [0.1, 0.1, 0.2]
//! ```
//!
//! Time starts at the keyframe, whose view is to be kept. Unknown, missing and impossible fields
//! are refused with file, line and name.

use super::expect::Expect;
use super::motion::Leg;
use trinocular_rig::rig_file::Stage;
use trinocular_vision::images::TextureKind;

/// Content of a scenario file.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Title for the reader.
    pub title: String,
    /// Seed of poster and noise.
    pub seed: u64,
    /// Cameras of the scenario.
    pub cameras: Cameras,
    /// Path of the target.
    pub legs: Vec<Leg>,
    /// Events, in the file's order.
    pub events: Vec<Event>,
    /// The stage that carries the cameras.
    pub stage: Stage,
    /// Measured time and tolerance of the figures.
    pub measure: Measure,
    /// Expected figures and events.
    pub expect: Expect,
}

/// The paper's three cameras on the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cameras {
    /// Source of the flow.
    pub sight: ImageSource,
    /// Frame sets per second, 1 to 200.
    pub frames_per_s: f64,
    /// Time from a frame set to its frame's arrival at the station, ms.
    pub latency_ms: f64,
    /// Distance of the target from the cameras at the keyframe, mm.
    pub depth_mm: f64,
}

/// Source of a frame set's flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImageSource {
    /// Images of a poster, rendered through lens and sensor, and the flow found in them.
    Rendered {
        /// Texture of the poster.
        texture: TextureKind,
        /// Noise, grey levels of 0 to 255.
        noise_grey: f64,
    },
    /// Points around `depth_mm`, projected exactly, with noise on every pixel coordinate. They give
    /// the same kind of sums without matching.
    Points {
        /// Number of points.
        count: usize,
        /// Noise, px.
        noise_px: f64,
    },
}

/// A disturbance, or a command to the station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// Start of the event, s.
    pub at_s: f64,
    /// Kind of the event.
    pub what: Happening,
}

/// Kinds of events. `frames` counts frame sets from the event on; `seconds` is the duration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Happening {
    /// `occlusion`: the cameras see an even grey instead of the target.
    Occlusion {
        /// Duration, s.
        seconds: f64,
    },
    /// `drop`: the frames of these frame sets are never sent.
    Drop {
        /// Number of frame sets.
        frames: u32,
    },
    /// `late`: frames that arrive later than the others. If the delay exceeds a period, they arrive
    /// after their successors.
    Late {
        /// Number of frame sets.
        frames: u32,
        /// Additional delay, ms.
        by_ms: f64,
    },
    /// `outlier`: frames that report a wrong position of the target with a small sigma.
    Outlier {
        /// Number of frame sets.
        frames: u32,
        /// Error of the position, mm.
        by_mm: [f64; 3],
    },
    /// `silence`: the host sends nothing, no heartbeat either; its last ping goes out at the event.
    Silence {
        /// Duration, s.
        seconds: f64,
    },
    /// `limit`: a limit switch is tripped.
    Limit {
        /// Stage axis, 0 to 2; `axis = "x"` in the file.
        axis: usize,
        /// End of the travel: 0 is the negative end, 1 the positive one; `end = "positive"` in the
        /// file.
        end: usize,
        /// Duration, s.
        seconds: f64,
    },
    /// `emergency_stop`: the emergency stop is open.
    EmergencyStop {
        /// Duration, s.
        seconds: f64,
    },
    /// `driver_fault`: a driver reports a fault.
    DriverFault {
        /// Duration, s.
        seconds: f64,
    },
    /// `stop`: the host sends a stop.
    Stop,
    /// `reset`: the host sends a reset.
    Reset,
    /// `zero`: the host declares the present position to be zero.
    Zero,
}

impl Happening {
    /// Returns the duration, s; 0 for events that count frame sets or take no time.
    pub fn seconds(&self) -> f64 {
        match *self {
            Self::Occlusion { seconds }
            | Self::Silence { seconds }
            | Self::Limit { seconds, .. }
            | Self::EmergencyStop { seconds }
            | Self::DriverFault { seconds } => seconds,
            Self::Drop { .. }
            | Self::Late { .. }
            | Self::Outlier { .. }
            | Self::Stop
            | Self::Reset
            | Self::Zero => 0.0,
        }
    }

    /// Returns true if a moving stage stops at once on this event, without a ramp.
    pub fn is_abrupt(&self) -> bool {
        matches!(
            self,
            Self::Limit { .. } | Self::EmergencyStop { .. } | Self::DriverFault { .. }
        )
    }
}

/// Measured time and tolerance of the figures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measure {
    /// Start of the measured time, s.
    pub from_s: f64,
    /// End of the measured time, s.
    pub until_s: f64,
    /// Tolerance within which a step counts as settled, mm.
    pub settle_within_mm: [f64; 3],
}

impl ImageSource {
    /// Points that are about as uncertain as images with 2 grey levels of noise.
    pub const POINTS: Self = Self::Points {
        count: 200,
        noise_px: 0.01,
    };
}

impl Scenario {
    /// Returns the duration of the scenario, s.
    pub fn seconds(&self) -> f64 {
        self.legs.iter().map(|leg| leg.seconds).sum()
    }

    /// Returns the scenario with [`ImageSource::POINTS`] instead of rendered images, which is about as
    /// hard and much faster.
    pub fn with_points(mut self) -> Self {
        self.cameras.sight = ImageSource::POINTS;
        self
    }
}
