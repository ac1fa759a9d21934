//! Commands from the fuzzer's bytes: well-formed ones with any values, which bytes alone would
//! hardly ever form behind their checksum.

use arbitrary::Arbitrary;
use trinocular_core::estimate::Gate;
use trinocular_core::frame::message::{
    Command, Config, Frame, HomeSwitch, MATRIX_BITS, Mounting, Side, StageConfig, Sums, Trigger,
};
use trinocular_core::motion::AxisConfig;
use trinocular_core::steps::DriverTiming;
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::sums::pair::FixedPairSums;
use trinocular_core::time::Instant;
use trinocular_core::track::pursuit;

/// A [`Command`].
#[derive(Arbitrary, Clone, Copy, Debug)]
pub enum Order {
    /// Starts a session.
    Hello,
    /// A usual stage, with some fields replaced.
    Config(Settings),
    /// A flow frame.
    Frame(Sight),
    /// A setpoint, µm.
    Setpoint([i32; 3]),
    /// A setpoint near zero, 1/100 mm.
    Near([i16; 3]),
    /// A jog, µm.
    Jog([i32; 3]),
    /// Zero.
    Zero,
    /// Stop.
    Stop,
    /// Reset.
    Reset,
    /// Heartbeat.
    Ping(u64),
    /// Home.
    Home([bool; 3]),
    /// Motors on or off.
    Motors(bool),
    /// Triggers of cameras.
    Trigger(u16, u32, bool, u32),
}

/// Configuration. `None` stands for a usual value.
#[derive(Arbitrary, Clone, Copy, Debug, Default)]
pub struct Settings {
    axis: Option<(u8, Axis)>,
    matrix: Option<[[i32; 3]; 3]>,
    heartbeat_ms: Option<u16>,
    slow_speed_um_s: Option<u32>,
    fixed: bool,
    drv8825: bool,
    prediction: bool,
    coast_ms: Option<u16>,
    backlash_um: Option<[u16; 3]>,
    home: Option<[Option<(bool, i32)>; 3]>,
    home_speed_um_s: Option<[u32; 2]>,
    back_off_um: Option<u32>,
    window_um: Option<u32>,
    watched: Option<(u32, u16, u32)>,
}

#[derive(Arbitrary, Clone, Copy, Debug)]
struct Axis {
    steps_per_m: u32,
    max_speed_um_s: u32,
    max_acceleration_um_s2: u32,
    max_jerk_um_s3: u32,
    travel_um: [i32; 2],
    invert: bool,
}

/// Flow frame, with its instants relative to now.
#[derive(Arbitrary, Clone, Copy, Debug)]
pub struct Sight {
    age_us: u16,
    reference: Reference,
    sums: Seen,
}

#[derive(Arbitrary, Clone, Copy, Debug)]
enum Reference {
    Origin,
    LastCapture,
    At(u64),
}

#[derive(Arbitrary, Clone, Copy, Debug)]
enum Seen {
    /// A clean view of a target that moved by this, µm.
    Moved([i16; 3]),
    Centred {
        counts: [u16; 2],
        mean_nm: [i32; 2],
        centroid: [i32; 2],
        spread: u32,
        exponent: i8,
        coupling: i32,
        residual_nm: u32,
    },
    Pair([i32; 10], u16),
}

impl Order {
    /// Converts to the command that the station gets at `now`; `last` is the capture time of the
    /// last frame.
    pub fn command(self, now: Instant, last: &mut Instant) -> Command {
        match self {
            Self::Hello => Command::Hello,
            Self::Config(settings) => Command::Config(settings.config()),
            Self::Frame(sight) => Command::Frame(sight.frame(now, last)),
            Self::Setpoint(position_um) => Command::Setpoint { position_um },
            Self::Near(near) => Command::Setpoint {
                position_um: near.map(|v| i32::from(v) * 10),
            },
            Self::Jog(distance_um) => Command::Jog { distance_um },
            Self::Zero => Command::Zero,
            Self::Stop => Command::Stop,
            Self::Reset => Command::Reset,
            Self::Ping(host_us) => Command::Ping { host_us },
            Self::Home(axes) => Command::Home { axes },
            Self::Motors(on) => Command::Motors { on },
            Self::Trigger(rate_hz, pulse_us, active_low, quiet_us) => Command::Trigger(Trigger {
                rate_hz,
                pulse_us,
                active_low,
                quiet_us,
            }),
        }
    }
}

impl Settings {
    /// Returns the configuration.
    pub fn config(self) -> Config {
        let usual = AxisConfig {
            steps_per_m: 80_000,
            max_speed_um_s: 100_000,
            max_acceleration_um_s2: 2_000_000,
            max_jerk_um_s3: 50_000_000,
            travel_um: [-60_000, 60_000],
            invert: false,
        };
        let mut axes = [usual; 3];
        if let Some((index, axis)) = self.axis {
            axes[usize::from(index % 3)] = AxisConfig {
                steps_per_m: axis.steps_per_m,
                max_speed_um_s: axis.max_speed_um_s,
                max_acceleration_um_s2: axis.max_acceleration_um_s2,
                max_jerk_um_s3: axis.max_jerk_um_s3,
                travel_um: axis.travel_um,
                invert: axis.invert,
            };
        }
        let one = 1 << MATRIX_BITS;
        Config {
            axes,
            matrix: self
                .matrix
                .unwrap_or([[one, 0, 0], [0, one, 0], [0, 0, one]]),
            driver: if self.drv8825 {
                DriverTiming::DRV8825
            } else {
                DriverTiming::TMC2209
            },
            gate: Gate::DEFAULT,
            heartbeat_ms: self.heartbeat_ms.unwrap_or(100),
            slow_speed_um_s: self.slow_speed_um_s.unwrap_or(5_000),
            mounting: if self.fixed {
                Mounting::Fixed
            } else {
                Mounting::OnStage
            },
            tracking: pursuit::Settings {
                prediction: self.prediction,
                coast_ms: self.coast_ms.unwrap_or(800),
            },
            stage: self.stage(),
        }
    }
}

impl Settings {
    fn stage(self) -> StageConfig {
        let usual = StageConfig::DEFAULT;
        let home = |(positive, position_um)| HomeSwitch {
            side: if positive {
                Side::Positive
            } else {
                Side::Negative
            },
            position_um,
        };
        let (largest_error_um, longest_error_ms, unseen_um) = self.watched.unwrap_or_default();
        StageConfig {
            // Mostly some, because that is the harder half.
            backlash_um: self.backlash_um.unwrap_or([25, 50, 0]),
            home: match self.home {
                Some(homes) => homes.map(|each| each.map(home)),
                None => [false, true, false].map(|positive| Some(home((positive, 10_000)))),
            },
            home_speed_um_s: self.home_speed_um_s.unwrap_or(usual.home_speed_um_s),
            back_off_um: self.back_off_um.unwrap_or(usual.back_off_um),
            window_um: self.window_um.unwrap_or(usual.window_um),
            largest_error_um,
            longest_error_ms,
            unseen_um,
            motors_off_after_s: usual.motors_off_after_s,
        }
    }
}

impl Sight {
    fn frame(self, now: Instant, last: &mut Instant) -> Frame {
        let capture = Instant::from_micros(now.micros().saturating_sub(self.age_us.into()));
        let reference = match self.reference {
            Reference::Origin => Instant::from_micros(0),
            Reference::LastCapture => *last,
            // As many bits as the wire has.
            Reference::At(micros) => Instant::from_micros(micros >> 16),
        };
        *last = capture;
        Frame {
            capture,
            reference,
            sums: self.sums.sums(),
        }
    }
}

impl Seen {
    fn sums(self) -> Sums {
        match self {
            Self::Moved([x, y, z]) => Sums::Midpoint(FixedCentredSums {
                points: 100,
                freedom: 597,
                mean_nm: [i32::from(x) * 1000, i32::from(y) * 1000],
                centroid: [0, 0],
                // 0.8 in 2^-32, with the exponent 0.05; the coupling is z times that in its own
                // scale.
                spread: 3_435_973_837,
                exponent: -4,
                coupling: i32::from(z) * 6_400,
                residual_nm: 30_000,
            }),
            Self::Centred {
                counts: [points, freedom],
                mean_nm,
                centroid,
                spread,
                exponent,
                coupling,
                residual_nm,
            } => Sums::Midpoint(FixedCentredSums {
                points,
                freedom,
                mean_nm,
                centroid,
                spread,
                exponent,
                coupling,
                residual_nm,
            }),
            Self::Pair([a1, a2, a3, b1, b2, b3, d1, d2, d3, d4], points) => {
                Sums::ClosedForm(FixedPairSums {
                    points,
                    a1,
                    a2,
                    a3,
                    b1,
                    b2,
                    b3,
                    d1,
                    d2,
                    d3,
                    d4,
                })
            }
        }
    }
}
