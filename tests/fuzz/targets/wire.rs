//! The receiver under any bytes in any chunking.
//!
//! Laws: no panic; the chunking does not matter; every packet is decoded as it was encoded, and
//! never with one byte changed; bytes that are no packet do not hide the packet after them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station_fuzz::command::Order;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Command, Packet, Report};
use trinocular_core::frame::receive::{Receiver, Reject};
use trinocular_core::time::Instant;

/// Packet with a change of one of its bytes.
type Damaged = (Order, u8, u8);

fuzz_target!(|data: (Vec<u8>, Vec<u8>, Option<Damaged>)| {
    let (bytes, chunks, damaged) = data;
    let whole = receive::<Packet>(&[&bytes]);
    let mut pieces = Vec::new();
    let mut rest = bytes.as_slice();
    for length in chunks {
        let (piece, after) = rest.split_at(usize::from(length).min(rest.len()));
        pieces.push(piece);
        rest = after;
    }
    pieces.push(rest);
    assert_eq!(receive::<Packet>(&pieces), whole, "chunking matters");
    let _ = receive::<Report>(&[&bytes]);

    if let Some((order, at, change)) = damaged {
        let command = order.command(Instant::from_micros(1 << 40), &mut Instant::default());
        let packet = Packet {
            sequence: u16::from(at),
            command,
        };
        let mut sound = encode(&packet).expect("every packet fits");
        assert_eq!(receive(&[sound.as_slice()]), [Ok(packet)]);
        if let Some(byte) = sound.get_mut(usize::from(at)) {
            *byte ^= change.max(1);
        } else if let Some(last) = sound.last_mut() {
            *last ^= change.max(1);
        }
        let outcomes = receive::<Packet>(&[sound.as_slice(), &[0]]);
        assert!(outcomes.iter().all(Result::is_err), "damage went unnoticed");
    }

    let packet = Packet {
        sequence: 7,
        command: Command::Ping { host_us: 1 << 40 },
    };
    let sound = encode(&packet).expect("a ping is short");
    let after = receive::<Packet>(&[&bytes, &[0], &sound]);
    assert_eq!(after.last(), Some(&Ok(packet)), "noise hides a packet");
});

fn receive<T: serde::de::DeserializeOwned>(pieces: &[&[u8]]) -> Vec<Result<T, Reject>> {
    let mut receiver = Receiver::default();
    let mut all = Vec::new();
    for piece in pieces {
        let mut left = *piece;
        while let Some(outcome) = receiver.next(&mut left) {
            all.push(outcome);
        }
    }
    all
}
