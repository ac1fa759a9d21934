//! The wire: committed bytes of every message, and the effects of a bad line on them.
//!
//! The bytes are in `golden/wire.txt`. After an intended change, `REGENERATE=1 cargo test -p
//! trinocular-tests --test link` writes them anew.

#[path = "link/samples.rs"]
mod samples;

use proptest::prelude::*;
use samples::{centred_sums, commands, pair_sums, reports};
use std::fmt::Write as _;
use trinocular_core::estimate::Gate;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::*;
use trinocular_core::frame::receive::{Receiver, Reject, Rejects};
use trinocular_core::frame::{MAX_PACKET, SCHEMA};
use trinocular_core::motion::AxisConfig;
use trinocular_core::safety::Fault;
use trinocular_core::steps::DriverTiming;
use trinocular_core::time::Instant;
use trinocular_core::track::pursuit::Settings;

#[test]
fn golden_bytes_of_every_message() {
    let mut text = String::new();
    let mut line = |kind: &str, name: &str, bytes: &[u8]| {
        let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
        writeln!(text, "{kind} {name}: {hex}").unwrap();
    };
    for (name, command) in commands() {
        line(
            "command",
            name,
            &encode(&Packet {
                sequence: 0x0102,
                command,
            })
            .unwrap(),
        );
    }
    for (name, report) in reports() {
        line("report", name, &encode(&report).unwrap());
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/wire.txt");
    if std::env::var_os("REGENERATE").is_some() {
        std::fs::write(path, &text).unwrap();
    }
    let golden = std::fs::read_to_string(path).expect("golden/wire.txt is committed");
    for (now, committed) in text.lines().zip(golden.lines()) {
        assert_eq!(
            now, committed,
            "a message changed on the wire: old stations would misread it"
        );
    }
    assert_eq!(text.lines().count(), golden.lines().count());
}

/// The schema names every variant at its number: `command 3 setpoint` and so on.
#[test]
fn schema_numbers_every_variant() {
    let number = |bytes: &[u8], at: usize| {
        let mut plain = bytes[1..bytes.len() - 1].to_vec();
        let length = cobs_decode(&mut plain);
        plain[..length][at]
    };
    for (name, command) in commands() {
        let bytes = encode(&Packet {
            sequence: 0x0102,
            command,
        })
        .unwrap();
        let word = name.split(' ').next().unwrap();
        let line = format!("command {} {word}", number(&bytes, 2));
        assert!(
            SCHEMA.lines().any(|l| l.starts_with(&line)),
            "schema.txt lacks `{line}`"
        );
    }
    for (name, report) in reports() {
        let word = name.split(' ').next().unwrap();
        let line = format!("report {} {word}", number(&encode(&report).unwrap(), 0));
        assert!(
            SCHEMA.lines().any(|l| l.starts_with(&line)),
            "schema.txt lacks `{line}`"
        );
    }
    for (number, fault) in (0..).zip(Fault::ALL) {
        assert_eq!(fault.number(), number);
        let name = trinocular_client::diagnosis::fault(fault).name;
        assert!(
            SCHEMA.contains(&format!("{} {name}", fault.number())),
            "schema.txt lacks fault {name}"
        );
    }
}

fn cobs_decode(bytes: &mut [u8]) -> usize {
    let mut out = Vec::new();
    let mut rest = &bytes[..];
    while let Some((&code, tail)) = rest.split_first() {
        let (block, next) = tail.split_at(usize::from(code) - 1);
        out.extend_from_slice(block);
        if code != 0xff && !next.is_empty() {
            out.push(0);
        }
        rest = next;
    }
    bytes[..out.len()].copy_from_slice(&out);
    out.len()
}

/// Every field is at its encodable extreme: a flow frame of either kind still fits one USB packet.
#[test]
fn flow_frame_fits_64_bytes_at_extremes() {
    let month = Instant::from_micros(30 * 24 * 3_600 * 1_000_000);
    for time in [Instant::MAX, month, Instant::from_micros(0)] {
        for value in [i32::MIN, i32::MAX, 0, -1] {
            let mut pair = pair_sums(value.max(-i32::MAX));
            pair.points = u16::MAX;
            let mut centred = centred_sums(value.max(-i32::MAX));
            (centred.points, centred.freedom) = (u16::MAX, u16::MAX);
            (centred.spread, centred.exponent, centred.residual_nm) = (u32::MAX, i8::MIN, u32::MAX);
            for sums in [Sums::ClosedForm(pair), Sums::Midpoint(centred)] {
                let command = Command::Frame(Frame {
                    capture: time,
                    reference: time,
                    sums,
                });
                let length = encode(&Packet {
                    sequence: u16::MAX,
                    command,
                })
                .unwrap()
                .len();
                assert!(length <= 64, "{length} bytes");
            }
        }
    }
}

/// The host relies on this.
#[test]
fn every_message_fits() {
    let axis = AxisConfig {
        steps_per_m: u32::MAX,
        max_speed_um_s: u32::MAX,
        max_acceleration_um_s2: u32::MAX,
        max_jerk_um_s3: u32::MAX,
        travel_um: [i32::MIN; 2],
        invert: true,
    };
    let gate = Gate {
        min_points: u16::MAX,
        max_sigma_nm: [u32::MAX; 3],
        max_displacement_nm: u32::MAX,
    };
    let driver = DriverTiming {
        step_high_ns: u32::MAX,
        step_low_ns: u32::MAX,
        dir_setup_ns: u32::MAX,
        dir_hold_ns: u32::MAX,
    };
    let extreme = Config {
        axes: [axis; 3],
        matrix: [[i32::MIN; 3]; 3],
        driver,
        gate,
        heartbeat_ms: u16::MAX,
        slow_speed_um_s: u32::MAX,
        mounting: Mounting::Fixed,
        tracking: Settings {
            prediction: true,
            coast_ms: u16::MAX,
        },
        stage: StageConfig {
            backlash_um: [u16::MAX; 3],
            home: [Some(HomeSwitch {
                side: Side::Positive,
                position_um: i32::MIN,
            }); 3],
            home_speed_um_s: [u32::MAX; 2],
            back_off_um: u32::MAX,
            window_um: u32::MAX,
            largest_error_um: u32::MAX,
            longest_error_ms: u16::MAX,
            unseen_um: u32::MAX,
            motors_off_after_s: u16::MAX,
        },
    };
    let longest = encode(&Packet {
        sequence: u16::MAX,
        command: Command::Config(extreme),
    })
    .unwrap()
    .len();
    assert!(longest <= MAX_PACKET, "{longest}");
    for (_, report) in reports() {
        assert!(encode(&report).unwrap().len() <= MAX_PACKET / 2);
    }
}

fn receive(bytes: &[u8], chunk: usize) -> (Vec<Packet>, Rejects) {
    let mut receiver = Receiver::<Packet>::default();
    let (mut packets, mut rejects) = (Vec::new(), Rejects::default());
    for mut piece in bytes.chunks(chunk) {
        while let Some(outcome) = receiver.next(&mut piece) {
            match outcome {
                Ok(packet) => packets.push(packet),
                Err(reject) => rejects.count(reject),
            }
        }
    }
    (packets, rejects)
}

fn stream() -> (Vec<Packet>, Vec<Vec<u8>>) {
    let packets: Vec<Packet> = commands()
        .into_iter()
        .enumerate()
        .map(|(i, (_, command))| Packet {
            sequence: i as u16,
            command,
        })
        .collect();
    let bytes = packets
        .iter()
        .map(|p| encode(p).unwrap().to_vec())
        .collect();
    (packets, bytes)
}

#[test]
fn chunking_does_not_change_packets() {
    let (packets, bytes) = stream();
    let bytes = bytes.concat();
    for chunk in 1..=bytes.len() {
        assert_eq!(
            receive(&bytes, chunk),
            (packets.clone(), Rejects::default())
        );
    }
}

#[test]
fn data_loss_sandwich() {
    let (packets, bytes) = stream();
    // Every byte is lost in turn: its packet is gone, all others arrive. A lost closing zero loses
    // no packet, because the next packet begins with a zero.
    let all = bytes.concat();
    for lost in 0..all.len() {
        let mut damaged = all.clone();
        damaged.remove(lost);
        let (got, rejects) = receive(&damaged, 7);
        let gone = packets.iter().filter(|p| !got.contains(p)).count();
        assert!(gone <= 1, "byte {lost}: {gone} packets gone");
        assert!(
            got.iter().all(|p| packets.contains(p)),
            "a packet appeared that was never sent"
        );
        assert!(rejects.total() > 0 || gone == 0 || lost + 1 == all.len());
    }
}

/// Noise on an idle line never costs the packet behind it.
#[test]
fn noise_before_packet_costs_nothing() {
    let (packets, bytes) = stream();
    for length in 1..=3 {
        for noise in [0x00, 0x01, 0x02, 0x55, 0x80, 0xff] {
            for (packet, sent) in packets.iter().zip(&bytes) {
                let line = [vec![noise; length], sent.clone()].concat();
                assert_eq!(receive(&line, 64).0, [*packet]);
            }
        }
    }
}

#[test]
fn rejects_are_counted_by_reason() {
    let (_, bytes) = stream();
    let hello = &bytes[0];
    let mut flipped = bytes[3].clone(); // its third byte is no COBS code
    flipped[2] ^= 0x40;
    assert_eq!(
        receive(&flipped, 3).1,
        Rejects {
            checksum: 1,
            ..Rejects::default()
        }
    );
    assert_eq!(
        receive(&[200, 1, 2, 0], 3).1,
        Rejects {
            framing: 1,
            ..Rejects::default()
        }
    );
    let long = [vec![1; MAX_PACKET + 1], vec![0], hello.clone()].concat();
    let (packets, rejects) = receive(&long, 64);
    assert_eq!(
        (packets.len(), rejects),
        (
            1,
            Rejects {
                too_long: 1,
                ..Rejects::default()
            }
        )
    );
    // A valid packet with an unknown variant, and one with an extra byte.
    let unknown = encode(&(0x0102u16.to_le_bytes(), 200u8)).unwrap();
    let longer = encode(&(0x0102u16.to_le_bytes(), 0u8, 0u8)).unwrap();
    assert_eq!(
        receive(&unknown, 1).1,
        Rejects {
            malformed: 1,
            ..Rejects::default()
        }
    );
    assert_eq!(
        receive(&longer, 1).1,
        Rejects {
            malformed: 1,
            ..Rejects::default()
        }
    );
    assert_eq!(receive(&[0, 0, 0], 1), (vec![], Rejects::default()));
    assert_eq!(
        Receiver::<Packet>::default().next(&mut &[1, 0][..]),
        Some(Err(Reject::Checksum))
    );
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: ProptestConfig::default().cases.max(500),
        ..ProptestConfig::default()
    })]

    #[test]
    fn garbage_never_becomes_a_packet(
        garbage in prop::collection::vec(any::<u8>(), 0..2000),
        chunk in 1usize..300,
    ) {
        let (packets, _) = receive(&garbage, chunk);
        prop_assert!(packets.is_empty());
    }

    #[test]
    fn packet_after_garbage_arrives(garbage in prop::collection::vec(any::<u8>(), 0..600)) {
        let (_, bytes) = stream();
        let all = [garbage, vec![0], bytes[3].clone()].concat();
        prop_assert_eq!(receive(&all, 64).0.len(), 1);
    }
}
