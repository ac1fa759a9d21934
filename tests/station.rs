//! The station as its host meets it: commands over the link, switches, frames, and the motion at
//! the pins.

#[path = "station/faults.rs"]
mod faults;
#[path = "station/frames.rs"]
mod frames;
#[path = "station/motors.rs"]
mod motors;
#[path = "station/moves.rs"]
mod moves;
#[path = "station/stops.rs"]
mod stops;

use trinocular_client::StationError;
use trinocular_client::stage::{configuration, default_stage};
use trinocular_client::twin::Twin;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{
    Command, Config, ConfigField, Denial, Frame, Mounting, Packet, Status, Sums,
};
use trinocular_core::safety::{Fault, Inputs, State, Trust};
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::{Driver, Stage};

fn twin() -> Twin {
    Twin::start(&default_stage(), "twin", Mounting::OnStage).unwrap()
}

fn setpoint(mm: [i32; 3]) -> Command {
    Command::Setpoint {
        position_um: mm.map(|mm| mm * 1000),
    }
}

fn wait(twin: &mut Twin, ms: u64) {
    twin.advance(twin.now().plus_micros(ms * 1000));
}

/// Returns a fresh status; the station sends one at least every 100 ms.
fn status(twin: &mut Twin) -> Status {
    wait(twin, 110);
    *twin.status().unwrap()
}

fn denial<T: std::fmt::Debug>(outcome: Result<T, StationError>) -> Denial {
    match outcome {
        Err(StationError::Denied { denial, .. }) => denial,
        other => panic!("not denied: {other:?}"),
    }
}

/// Returns a frame of a target displaced by `mm`: every point at the same depth, without noise.
fn frame(mm: [f64; 3], capture: Instant, reference: Instant) -> Command {
    let spread = 0.05f64;
    let sums = FixedCentredSums {
        points: 100,
        freedom: 597,
        mean_nm: [(mm[0] * 1e6) as i32, (mm[1] * 1e6) as i32],
        centroid: [0, 0],
        spread: (spread * 16.0 * 2f64.powi(32)) as u32,
        exponent: -4,
        coupling: (mm[2] * spread * 16.0 * 8e6).round() as i32,
        residual_nm: 30_000,
    };
    Command::Frame(Frame {
        capture,
        reference,
        sums: Sums::Midpoint(sums),
    })
}

#[test]
fn setpoint_takes_exact_pulses() {
    let mut twin = twin();
    for target in [[4, -4, 1], [-20, 30, 7], [0, 0, 0]] {
        twin.command("setpoint", setpoint(target)).unwrap();
        wait(&mut twin, 2_000);
        let status = status(&mut twin);
        assert_eq!(status.state, State::Idle);
        assert_eq!(
            status.position_steps.map(i64::from),
            target.map(|mm| i64::from(mm) * 80)
        );
        assert_eq!(status.position_steps.map(i64::from), twin.steps_from_zero());
    }
    let timing = trinocular_core::steps::DriverTiming::TMC2209;
    assert_eq!(
        twin.plant()
            .violations(&timing, trinocular_core::steps::WordRate::MHZ_1),
        vec![]
    );
}

#[test]
fn unconfigured_stage_does_not_move() {
    let stage = default_stage();
    let mut twin = Twin::power_on(&stage, "twin").unwrap();
    assert_eq!(
        denial(twin.command("setpoint", setpoint([1, 1, 1]))),
        Denial::Unconfigured
    );
    assert_eq!(
        denial(twin.command(
            "jog",
            Command::Jog {
                distance_um: [1000; 3]
            }
        )),
        Denial::Unconfigured
    );
    assert_eq!(
        denial(twin.command("zero", Command::Zero)),
        Denial::Unconfigured
    );
    let config = configuration(&stage, Mounting::OnStage).unwrap();
    twin.command("config", Command::Config(config)).unwrap();
    assert_eq!(status(&mut twin).trust, Trust::Unknown);
    assert_eq!(
        denial(twin.command("setpoint", setpoint([1, 1, 1]))),
        Denial::PositionUnknown
    );
    let now = twin.now();
    assert_eq!(
        denial(twin.command("frame", frame([1.0; 3], now, Instant::from_micros(0)))),
        Denial::PositionUnknown
    );
    assert_eq!(twin.steps(), [0; 3]);
    // A slow jog is allowed: 2 mm at 5 mm/s take 0.4 s instead of 0.05 s.
    twin.command(
        "jog",
        Command::Jog {
            distance_um: [2_000, 0, 0],
        },
    )
    .unwrap();
    wait(&mut twin, 200);
    assert!(twin.position_mm()[0] < 1.1, "{:?}", twin.position_mm());
    wait(&mut twin, 600);
    assert_eq!(twin.steps(), [160, 0, 0]);
}

#[test]
fn impossible_config_is_refused_whole() {
    let stage = default_stage();
    let good = configuration(&stage, Mounting::OnStage).unwrap();
    let with = |change: fn(&mut Config)| {
        let mut config = good;
        change(&mut config);
        config
    };
    let cases = [
        (
            with(|c| c.axes[1].steps_per_m = 0),
            "steps_per_m of axis 1 must be at least 1",
        ),
        (
            with(|c| c.axes[2].max_speed_um_s = u32::MAX),
            "max_speed_um_s of axis 2 must be at most 6250000",
        ),
        (
            with(|c| c.axes[0].max_jerk_um_s3 = 1_000_000),
            "max_jerk_um_s3 of axis 0 must be at least 1455192",
        ),
        (
            with(|c| c.axes[0].travel_um = [5, -5]),
            "travel_um[1] of axis 0 must be at least 13",
        ),
        (
            with(|c| c.matrix = [[1 << 29; 3]; 3]),
            "the matrix is singular",
        ),
        (
            with(|c| c.driver = trinocular_core::steps::DriverTiming::DRV8825),
            "the driver does not support this board's word rate",
        ),
        (
            with(|c| c.gate.max_sigma_nm[1] = 0),
            "max_sigma_nm of axis 1 must be at least 1",
        ),
        (
            with(|c| c.gate.max_displacement_nm = 0),
            "max_displacement_nm must be at least 1",
        ),
        (
            with(|c| c.heartbeat_ms = 19),
            "heartbeat_ms must be at least 20",
        ),
        (
            with(|c| c.heartbeat_ms = 10_001),
            "heartbeat_ms must be at most 10000",
        ),
        (
            with(|c| c.slow_speed_um_s = 1),
            "slow_speed_um_s of axis 0 must be at least 2",
        ),
        (
            with(|c| c.tracking.coast_ms = 0),
            "coast_ms must be at least 1",
        ),
        (
            with(|c| c.tracking.coast_ms = 5_001),
            "coast_ms must be at most 5000",
        ),
        (
            with(|c| c.stage.window_um = 0),
            "window_um must be at least 1",
        ),
        (
            with(|c| {
                c.axes[2].travel_um = [0, 50_000];
                c.stage.backlash_um[2] = 65_000;
            }),
            "backlash_um of axis 2 must be at most 50006",
        ),
        (
            with(|c| {
                c.stage.largest_error_um = 1;
                c.stage.longest_error_ms = 0;
            }),
            "longest_error_ms must be at least 1",
        ),
    ];
    for (config, text) in cases {
        let mut twin = Twin::power_on(&stage, "twin").unwrap();
        let denied = denial(twin.command("config", Command::Config(config)));
        assert_eq!(denied.to_string(), format!("configuration: {text}"));
        assert_eq!(status(&mut twin).state, State::Unconfigured);
    }
}

#[test]
fn silent_host_ramps_down_for_good() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([50, 50, 50])).unwrap();
    wait(&mut twin, 200);
    twin.set_pings(false);
    wait(&mut twin, 75); // the last ping is up to 20 ms old
    assert_eq!(twin.status().unwrap().fault, None);
    let at_loss = twin.position_mm();
    wait(&mut twin, 425);
    let fault = *twin.status().unwrap();
    assert_eq!(
        (fault.state, fault.fault, fault.trust),
        (State::Faulted, Some(Fault::Heartbeat), Trust::Homed)
    );
    // At 100 mm/s: 25 ms until the fault at most 2.5 mm, v²/2a another 2.5 mm, and the onset of
    // braking at 50,000 mm/s³ some 2 mm.
    let way = twin.position_mm()[0] - at_loss[0];
    assert!(way > 1.0 && way < 8.0, "{way}");
    let stopped = twin.steps();
    twin.set_pings(true);
    wait(&mut twin, 500);
    assert_eq!(twin.steps(), stopped, "no automatic resume");
    assert_eq!(
        denial(twin.command("setpoint", setpoint([0, 0, 0]))),
        Denial::Faulted
    );
    assert_eq!(
        status(&mut twin).position_steps.map(i64::from),
        twin.steps_from_zero(),
        "position kept"
    );
    twin.command("reset", Command::Reset).unwrap();
    twin.command("setpoint", setpoint([0, 0, 0])).unwrap();
    wait(&mut twin, 2_000);
    assert_eq!(twin.steps_from_zero(), [0; 3]);
}

/// This includes the tick in which braking ends.
#[test]
fn stop_while_braking_changes_nothing() {
    for after_ms in 100..300 {
        let mut twin = twin();
        twin.command("setpoint", setpoint([50, 0, 0])).unwrap();
        wait(&mut twin, 200);
        twin.set_pings(false);
        wait(&mut twin, after_ms);
        twin.command("stop", Command::Stop).unwrap();
        let stopped = status(&mut twin);
        assert_eq!(
            (stopped.state, stopped.fault),
            (State::Faulted, Some(Fault::Heartbeat)),
            "after {after_ms} ms"
        );
    }
}

#[test]
fn stop_holds_until_reset() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&mut twin, 200);
    twin.command("stop", Command::Stop).unwrap();
    assert_eq!(
        denial(twin.command("setpoint", setpoint([0, 0, 0]))),
        Denial::Stopped
    );
    assert_eq!(
        denial(twin.command("reset", Command::Reset)),
        Denial::Moving
    );
    wait(&mut twin, 300);
    let stopped = status(&mut twin);
    assert_eq!(
        (stopped.state, stopped.trust, stopped.fault),
        (State::Stopped, Trust::Homed, None)
    );
    assert_eq!(
        stopped.position_steps.map(i64::from),
        twin.steps_from_zero()
    );
    twin.command("reset", Command::Reset).unwrap();
    assert_eq!(status(&mut twin).state, State::Idle);
}

#[test]
fn emergency_stop_degrades_position() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&mut twin, 200);
    let pressed = Inputs {
        emergency_stop: true,
        ..Inputs::default()
    };
    let before = twin.steps()[0];
    twin.set_switches(pressed);
    wait(&mut twin, 3);
    let after = twin.steps()[0];
    // The bound is the rest of the present tick and the queued words: at 100 mm/s at most 2 ms, 16
    // steps.
    assert!(after - before <= 20, "{}", after - before);
    wait(&mut twin, 200);
    assert_eq!(twin.steps()[0], after);
    let fault = status(&mut twin);
    assert_eq!(
        (fault.state, fault.fault, fault.trust),
        (State::Faulted, Some(Fault::EmergencyStop), Trust::Degraded)
    );
    assert_eq!(
        denial(twin.command("reset", Command::Reset)),
        Denial::CauseRemains
    );
    twin.set_switches(Inputs::default());
    wait(&mut twin, 10);
    assert_eq!(twin.steps()[0], after, "released, but nothing moves");
    twin.command("reset", Command::Reset).unwrap();
    assert_eq!(
        denial(twin.command("setpoint", setpoint([0, 0, 0]))),
        Denial::PositionUnknown
    );
    twin.zero().unwrap();
    twin.command("setpoint", setpoint([1, 0, 0])).unwrap();
    wait(&mut twin, 500);
    assert_eq!(twin.steps_from_zero(), [80, 0, 0]);
}

#[test]
fn limit_switch_allows_the_way_off() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([50, 0, 0])).unwrap();
    wait(&mut twin, 200);
    let mut limits = [[false; 2]; 3];
    limits[0][1] = true;
    twin.set_switches(Inputs {
        limits,
        ..Inputs::default()
    });
    let fault = status(&mut twin);
    assert_eq!(
        (fault.fault, fault.trust),
        (Some(Fault::Limit), Trust::Degraded)
    );
    twin.command("reset", Command::Reset).unwrap();
    let onto = Command::Jog {
        distance_um: [100, 0, 0],
    };
    assert_eq!(denial(twin.command("jog", onto)), Denial::LimitSwitch);
    let before = twin.steps()[0];
    twin.command(
        "jog",
        Command::Jog {
            distance_um: [-100, 0, 0],
        },
    )
    .unwrap();
    wait(&mut twin, 300);
    assert_eq!(twin.steps()[0], before - 8);
    assert_eq!(status(&mut twin).fault, None);
}

#[test]
fn soft_limits_clamp() {
    let mut twin = twin();
    twin.command("setpoint", setpoint([500, -500, 0])).unwrap();
    wait(&mut twin, 3_000);
    assert_eq!(twin.steps_from_zero(), [4800, -4800, 0]);
    twin.command(
        "jog",
        Command::Jog {
            distance_um: [1000, 0, 0],
        },
    )
    .unwrap();
    wait(&mut twin, 300);
    assert_eq!(
        (twin.steps_from_zero(), status(&mut twin).fault),
        ([4800, -4800, 0], None)
    );
}

#[test]
fn bad_packets_change_only_counters() {
    let mut twin = twin();
    let jog = |sequence| {
        encode(&Packet {
            sequence,
            command: Command::Jog {
                distance_um: [1000, 0, 0],
            },
        })
        .unwrap()
    };
    let sequence = twin.send(Command::Jog {
        distance_um: [1000, 0, 0],
    });
    twin.write(&jog(sequence)); // a duplicate
    twin.write(&jog(sequence.wrapping_sub(5))); // from behind
    let mut garbled = jog(sequence.wrapping_add(1)).to_vec();
    garbled[5] ^= 4;
    twin.write(&garbled);
    twin.write(&jog(sequence.wrapping_add(1))[..6]); // cut off
    twin.write(&[0]);
    wait(&mut twin, 1_000);
    let drops = status(&mut twin).drops;
    assert_eq!(twin.steps_from_zero(), [80, 0, 0], "one jog only");
    assert_eq!(
        (drops.duplicate, drops.stale, drops.rejects.total()),
        (1, 1, 2)
    );
    assert_eq!(drops.overflow, 0);
}

#[test]
fn too_slow_driver_is_refused() {
    let stage = Stage {
        driver: Driver::Drv8825,
        ..default_stage()
    };
    let refused = Twin::start(&stage, "twin", Mounting::OnStage);
    assert_eq!(denial(refused), Denial::Config(ConfigField::Driver));
}

/// With any input in any pieces, the same log gives the same reports and the same pulses.
#[test]
fn same_inputs_give_same_bits() {
    let run = |chunk: usize| {
        let mut twin = twin();
        wait(&mut twin, 100);
        let reference = twin.now();
        for i in 0..60u32 {
            wait(&mut twin, 17);
            let now = twin.now();
            let x = f64::from(i % 7) - 3.0;
            let Command::Frame(f) = frame([x, -x, 0.5 * x], now, reference) else {
                unreachable!()
            };
            let sequence = 40_000u16.wrapping_add(i as u16);
            let bytes = encode(&Packet {
                sequence,
                command: Command::Frame(f),
            })
            .unwrap();
            for piece in bytes.chunks(chunk) {
                twin.write(piece);
            }
        }
        wait(&mut twin, 500);
        (
            twin.steps(),
            *twin.status().unwrap(),
            twin.plant().words(),
            twin.plant().shortest(),
        )
    };
    let whole = run(64);
    assert_eq!(run(1), whole);
    assert_eq!(run(13), whole);
}
