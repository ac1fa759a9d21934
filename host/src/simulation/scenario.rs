//! A scenario as data: what the target does, what goes wrong and when, and what must come of it.
//!
//! ```toml
//! title = "A step, then a line"
//! seed = 1                              # of poster and noise
//!
//! [cameras]
//! kind = "rendered"                     # real pictures through the flow; "points": ideal points with pixel noise, fast
//! frames_per_s = 60.0
//! latency_ms = 20.0                     # from a capture to its frame at the station
//! depth_mm = 850.0
//! noise_grey = 2.0                      # rendered: grey levels of 255. points: noise_px = 0.03 and points = 100 instead
//!
//! [[target]]                            # legs, one after the other
//! motion = "step"                       # still; step; line; lissajous
//! by_mm = [4.0, 4.0, 1.0]               # line: velocity_mm_s. lissajous: amplitude_mm, ratio, peak_mm_s
//! seconds = 1.0
//! [[target]]
//! motion = "line"
//! velocity_mm_s = [30.0, 40.0, 0.0]
//! seconds = 2.0
//! ramp_in_s = 0.3                       # line, lissajous: optional, 0 without; ramp_out_s likewise
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
use crate::images::TextureKind;
use crate::rig_file::Stage;

/// All that a scenario file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// For people.
    pub title: String,
    /// Of poster and noise.
    pub seed: u64,
    /// What the cameras are.
    pub cameras: Cameras,
    /// The target's way.
    pub legs: Vec<Leg>,
    /// What happens meanwhile, in the file's order.
    pub events: Vec<Event>,
    /// The stage that carries the cameras.
    pub stage: Stage,
    /// What the figures are taken over.
    pub measure: Measure,
    /// What they must be.
    pub expect: Expect,
}

/// The paper's three cameras on the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cameras {
    /// How their pictures become flow.
    pub sight: Sight,
    /// Captures per second, 1 to 200.
    pub frames_per_s: f64,
    /// From a capture to its frame's arrival at the station, ms.
    pub latency_ms: f64,
    /// Distance of the target from the cameras at the keyframe, mm.
    pub depth_mm: f64,
}

/// How a capture becomes flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sight {
    /// Pictures of a poster through lens and sensor, and the flow that is found in them.
    Rendered {
        /// The poster.
        texture: TextureKind,
        /// Noise, grey levels of 0 to 255.
        noise_grey: f64,
    },
    /// Points around `depth_mm`, projected exactly, with noise on every pixel coordinate. Same
    /// sums, no matching.
    Points {
        /// How many.
        count: usize,
        /// Noise, px.
        noise_px: f64,
    },
}

/// Something that goes wrong, or is done to the station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// When, s.
    pub at_s: f64,
    /// What.
    pub what: Happening,
}

/// The kinds of events. `frames` counts captures from the event on, `seconds` is how long it lasts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Happening {
    /// `occlusion`: the cameras see an even grey instead of the target.
    Occlusion {
        /// How long, s.
        seconds: f64,
    },
    /// `drop`: captures whose frames are never sent.
    Drop {
        /// How many.
        frames: u32,
    },
    /// `late`: frames that arrive later than the others; by more than a period, they arrive after
    /// their successors.
    Late {
        /// How many.
        frames: u32,
        /// By how much, ms.
        by_ms: f64,
    },
    /// `outlier`: frames that say, with all confidence, that the target is elsewhere.
    Outlier {
        /// How many.
        frames: u32,
        /// Off by so much, mm.
        by_mm: [f64; 3],
    },
    /// `silence`: the host sends nothing, no heartbeat either; its last ping goes out at the event.
    Silence {
        /// How long, s.
        seconds: f64,
    },
    /// `limit`: a limit switch is tripped.
    Limit {
        /// Stage axis, 0 to 2; `axis = "x"` in the file.
        axis: usize,
        /// 0 at the negative end, 1 at the positive one; `end = "positive"` in the file.
        end: usize,
        /// How long, s.
        seconds: f64,
    },
    /// `emergency_stop`: the emergency stop is open.
    EmergencyStop {
        /// How long, s.
        seconds: f64,
    },
    /// `driver_fault`: a driver reports a fault.
    DriverFault {
        /// How long, s.
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
    /// How long it lasts by itself, s; 0 for what is counted in frames or done at once.
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

    /// Whether the stage stops at once, without a ramp, if it is struck in motion.
    pub fn is_abrupt(&self) -> bool {
        matches!(
            self,
            Self::Limit { .. } | Self::EmergencyStop { .. } | Self::DriverFault { .. }
        )
    }
}

/// What the figures are taken over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measure {
    /// From, s.
    pub from_s: f64,
    /// Until, s.
    pub until_s: f64,
    /// A step has settled when the error stays within, mm.
    pub settle_within_mm: [f64; 3],
}

impl Sight {
    /// Points that are about as uncertain as pictures with 2 grey levels of noise.
    pub const POINTS: Self = Self::Points {
        count: 200,
        noise_px: 0.01,
    };
}

impl Scenario {
    /// How long it lasts, s.
    pub fn seconds(&self) -> f64 {
        self.legs.iter().map(|leg| leg.seconds).sum()
    }

    /// The same with [`Sight::POINTS`] instead of rendered pictures: about as hard, and without the
    /// work.
    pub fn with_points(mut self) -> Self {
        self.cameras.sight = Sight::POINTS;
        self
    }
}
