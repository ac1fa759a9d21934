//! Messages of every kind, with all fields of a message different.

use trinocular_core::estimate::{Gate, Refusal};
use trinocular_core::frame::message::*;
use trinocular_core::frame::receive::Rejects;
use trinocular_core::motion::AxisConfig;
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_core::steps::DriverTiming;
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::sums::pair::FixedPairSums;
use trinocular_core::time::Instant;
use trinocular_core::track::pursuit::{Settings, Sight};

fn axis() -> AxisConfig {
    AxisConfig {
        steps_per_m: 80_000,
        max_speed_um_s: 100_000,
        max_acceleration_um_s2: 2_000_000,
        max_jerk_um_s3: 50_000_000,
        travel_um: [-60_000, 60_000],
        invert: true,
    }
}

fn config() -> Config {
    Config {
        axes: [axis(); 3],
        matrix: [[1 << 29, 0, 0], [0, 1 << 29, 0], [0, 0, -(1 << 29)]],
        driver: DriverTiming::TMC2209,
        gate: Gate::DEFAULT,
        heartbeat_ms: 100,
        slow_speed_um_s: 5_000,
        mounting: Mounting::OnStage,
        tracking: Settings::DEFAULT,
        stage: StageConfig {
            backlash_um: [20, 0, 50],
            home: [
                Some(HomeSwitch {
                    side: Side::Negative,
                    position_um: -61_000,
                }),
                None,
                Some(HomeSwitch {
                    side: Side::Positive,
                    position_um: 61_000,
                }),
            ],
            largest_error_um: 20_000,
            longest_error_ms: 1_000,
            unseen_um: 5_000,
            motors_off_after_s: 600,
            ..StageConfig::DEFAULT
        },
    }
}

pub fn pair_sums(value: i32) -> FixedPairSums {
    FixedPairSums {
        points: 200,
        a1: value,
        a2: -value,
        a3: value,
        b1: value,
        b2: -value,
        b3: value,
        d1: value,
        d2: value,
        d3: value,
        d4: value,
    }
}

pub fn centred_sums(value: i32) -> FixedCentredSums {
    FixedCentredSums {
        points: 200,
        freedom: 1197,
        mean_nm: [value, -value],
        centroid: [value, value],
        spread: 0x8000_0001,
        exponent: -4,
        coupling: value,
        residual_nm: 40_000,
    }
}

fn frame(sums: Sums) -> Command {
    let capture = Instant::from_micros(1_234_567);
    Command::Frame(Frame {
        capture,
        reference: Instant::from_micros(33_333),
        sums,
    })
}

pub fn commands() -> Vec<(&'static str, Command)> {
    vec![
        ("hello", Command::Hello),
        ("config", Command::Config(config())),
        (
            "frame closed_form",
            frame(Sums::ClosedForm(pair_sums(123_456_789))),
        ),
        (
            "frame midpoint",
            frame(Sums::Midpoint(centred_sums(123_456_789))),
        ),
        (
            "setpoint",
            Command::Setpoint {
                position_um: [4_000, -4_000, 1_000],
            },
        ),
        (
            "jog",
            Command::Jog {
                distance_um: [0, 100, -100],
            },
        ),
        ("zero", Command::Zero),
        ("stop", Command::Stop),
        ("reset", Command::Reset),
        (
            "ping",
            Command::Ping {
                host_us: 987_654_321,
            },
        ),
        (
            "home",
            Command::Home {
                axes: [true, false, true],
            },
        ),
        ("motors", Command::Motors { on: true }),
        (
            "trigger",
            Command::Trigger(Trigger {
                rate_hz: 120,
                pulse_us: 2_000,
                active_low: true,
                quiet_us: 0,
            }),
        ),
    ]
}

fn status() -> Status {
    Status {
        time: Instant::from_micros(5_000_000),
        tick: 5_000,
        state: State::Following,
        fault: Some(Fault::Heartbeat),
        trust: Trust::Homed,
        position_steps: [320, -320, 80],
        target_steps: [321, -320, 80],
        frames_used: 150,
        frames_refused: 2,
        drops: Drops {
            rejects: Rejects {
                too_long: 1,
                framing: 2,
                checksum: 3,
                malformed: 4,
            },
            duplicate: 5,
            stale: 6,
            overflow: 7,
            answers: 8,
        },
        estimate: Some(EstimateReport {
            sequence: 77,
            displacement_nm: [4_000_000, -4_000_000, 1_000_000],
            sigma_nm: Some([900, 900, 8_000]),
            latency_us: 21_500,
        }),
        sight: Sight::Coasting,
        seen_ms: 321,
        faults: [Fault::Heartbeat, Fault::Limit].into_iter().collect(),
        motors: true,
    }
}

pub fn reports() -> Vec<(&'static str, Report)> {
    let board = "twin".try_into().unwrap();
    let hello = Hello {
        protocol: 1,
        schema: 0x0102_0304,
        version: [0, 1, 0],
        board,
        word_rate_hz: 1_000_000,
        delay_us: 512,
        session: 9,
        reset_cause: ResetCause::Watchdog,
    };
    let answer = |outcome| Report::Answer {
        sequence: 258,
        tick: 70_000,
        outcome,
    };
    let received = Instant::from_micros(100);
    let last_run = LastRun {
        starts: 3,
        fault: Some(Fault::Underrun),
        end: End::HardFault,
        places: [0x0800_1234, 0x0800_5679, 0x0801_0001, 0, 0, 0],
    };
    vec![
        ("hello", Report::Hello(hello)),
        (
            "pong",
            Report::Pong {
                host_us: 987_654_321,
                received,
                sent: Instant::from_micros(150),
            },
        ),
        ("status", Report::Status(status())),
        ("answer accepted", answer(Outcome::Accepted)),
        (
            "answer denied",
            answer(Outcome::Denied(Denial::Estimate(Refusal::TooUncertain))),
        ),
        ("last_run", Report::LastRun(last_run)),
        ("last_run unknown", Report::LastRun(LastRun::UNKNOWN)),
        (
            "triggered",
            Report::Triggered(Triggered {
                number: 70_000,
                instant: Instant::from_micros(9_000_751),
                lost: 3,
            }),
        ),
    ]
}
