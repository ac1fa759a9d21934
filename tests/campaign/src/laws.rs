//! Laws that every life must keep.

/// A law. Its text is in [`Law::text`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Law {
    Panic,
    Wedge,
    Segment,
    Report,
    Pulse,
    Asked,
    Direction,
    Silent,
    Cause,
    Limit,
    Motors,
    LastWord,
    Heartbeat,
    Speed,
    Acceleration,
    Jerk,
    SoftLimit,
    Window,
    Position,
    Trust,
    Answered,
    Pong,
    Stale,
    Named,
    Worst,
    Reset,
    Zero,
    Healthy,
    Sick,
    Runaway,
}

impl Law {
    /// Laws of random lives.
    pub const STATION: [Self; 27] = [
        Self::Panic,
        Self::Wedge,
        Self::Segment,
        Self::Report,
        Self::Pulse,
        Self::Asked,
        Self::Direction,
        Self::Silent,
        Self::Cause,
        Self::Limit,
        Self::Motors,
        Self::LastWord,
        Self::Heartbeat,
        Self::Speed,
        Self::Acceleration,
        Self::Jerk,
        Self::SoftLimit,
        Self::Window,
        Self::Position,
        Self::Trust,
        Self::Answered,
        Self::Pong,
        Self::Stale,
        Self::Named,
        Self::Worst,
        Self::Reset,
        Self::Zero,
    ];

    /// Laws of lives that follow a target.
    pub const LOOP: [Self; 4] = [Self::Panic, Self::Healthy, Self::Sick, Self::Runaway];

    /// Returns the law's short name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Panic => "panic",
            Self::Wedge => "wedge",
            Self::Segment => "segment",
            Self::Report => "report",
            Self::Pulse => "pulse",
            Self::Asked => "asked",
            Self::Direction => "direction",
            Self::Silent => "silent",
            Self::Cause => "cause",
            Self::Limit => "limit",
            Self::Motors => "motors",
            Self::LastWord => "last-word",
            Self::Heartbeat => "heartbeat",
            Self::Speed => "speed",
            Self::Acceleration => "acceleration",
            Self::Jerk => "jerk",
            Self::SoftLimit => "soft-limit",
            Self::Window => "window",
            Self::Position => "position",
            Self::Trust => "trust",
            Self::Answered => "answered",
            Self::Pong => "pong",
            Self::Stale => "stale",
            Self::Named => "named",
            Self::Worst => "worst",
            Self::Reset => "reset",
            Self::Zero => "zero",
            Self::Healthy => "healthy",
            Self::Sick => "sick",
            Self::Runaway => "runaway",
        }
    }

    /// Returns the law's text.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Panic => "The station never panics.",
            Self::Wedge => {
                "Every life comes back by reset, configuration, zero and a move that ends exactly."
            }
            Self::Segment => "The step generator takes every segment.",
            Self::Report => "Everything the station sends is a report.",
            Self::Pulse => {
                "STEP pulses, their pauses, DIR set-up and DIR hold last as long as the driver \
                 asks."
            }
            Self::Asked => "An axis makes a step only if a command that names it is under way.",
            Self::Direction => "A jog from rest never makes a step the other way.",
            Self::Silent => {
                "No step is made without a configuration, or while a status says idle, stopped or \
                 faulted."
            }
            Self::Cause => {
                "No step is made from one control tick after an emergency stop or a driver fault \
                 is sensed, while it lasts."
            }
            Self::Limit => {
                "No step towards a tripped limit switch is made from one control tick after it is \
                 sensed."
            }
            Self::Motors => "No step is made while the motors are off.",
            Self::LastWord => {
                "After a stop and its ramp no step is made until a reset that was sent after it is \
                 accepted."
            }
            Self::Heartbeat => {
                "No step is made later than the heartbeat time and the ramp after the last ping."
            }
            Self::Speed => {
                "No axis exceeds its speed: the configured one, or that of an unknown position or \
                 a search for a home switch."
            }
            Self::Acceleration => {
                "No axis exceeds its acceleration, but for a stop with a cause that makes it \
                 abrupt."
            }
            Self::Jerk => "No axis exceeds its jerk, but for such a stop.",
            Self::SoftLimit => {
                "With a known position no step leads beyond a soft limit, or away from it beyond \
                 it."
            }
            Self::Window => {
                "With an unknown position no step leads beyond the window round the place where \
                 power came on or trust was lost."
            }
            Self::Position => "Every position that a status reports equals the counted steps.",
            Self::Trust => {
                "After motion that ended abruptly, or motors that were off, no status says homed."
            }
            Self::Answered => {
                "Every command that arrives whole is answered exactly once, or counted as dropped."
            }
            Self::Pong => "Every ping and hello is answered, or counted as dropped.",
            Self::Stale => "A packet that was seen before or is from behind is not answered.",
            Self::Named => {
                "An emergency stop, a driver fault or an abrupt end is named by a status before a \
                 reset is accepted."
            }
            Self::Worst => {
                "Every status shows the worst of its faults; the emergency stop is the worst."
            }
            Self::Reset => {
                "No reset is accepted while the emergency stop or a driver fault is present."
            }
            Self::Zero => {
                "No zero is accepted while a fault is latched, or the emergency stop or a driver \
                 fault is present."
            }
            Self::Healthy => {
                "A healthy stage that follows is never stopped for lost steps, unstable following \
                 or anything else."
            }
            Self::Sick => {
                "A stage that follows wrongly is stopped by a named fault within 2 s of useless \
                 motion, or comes to rest."
            }
            Self::Runaway => {
                "No stage that follows wrongly goes farther than the unseen way and the way to \
                 stop."
            }
        }
    }
}

/// A law that was broken.
#[derive(Clone, Debug)]
pub struct Violation {
    /// Law that was broken.
    pub law: Law,
    /// Time of the violation, ms since the life began.
    pub at_ms: f64,
    /// Description of the violation.
    pub text: String,
}
