//! The heartbeat of a run on a loaded computer.

use super::{Desk, alone, ended};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use trinocular_client::stage::HEARTBEAT_MS;
use trinocular_core::frame::message::{Command as StationCommand, Packet};
use trinocular_core::frame::receive::Receiver;
use trinocular_tests::far_end::{FarEnd, station};

/// Number of threads that each load a processor.
const BUSY: usize = 20;

struct Load(Arc<AtomicBool>, Vec<std::thread::JoinHandle<()>>);

impl Load {
    fn start() -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let spin = |over: Arc<AtomicBool>| move || while !over.load(Ordering::Relaxed) {};
        let threads = (0..BUSY)
            .map(|_| std::thread::spawn(spin(Arc::clone(&over))))
            .collect();
        Self(over, threads)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        for thread in self.1.drain(..) {
            let _ = thread.join();
        }
    }
}

/// Returns the longest interval between two pings by the host's stamps, ms.
fn largest_gap_ms(end: &FarEnd) -> u64 {
    let (bytes, mut receiver) = (end.received(), Receiver::<Packet>::default());
    let mut bytes = &bytes[..];
    let packets = std::iter::from_fn(|| receiver.next(&mut bytes)).filter_map(Result::ok);
    let sent = packets.filter_map(|packet| match packet.command {
        StationCommand::Ping { host_us } => Some(host_us),
        _ => None,
    });
    let sent: Vec<u64> = sent.collect();
    let gaps = sent.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
    gaps.max().expect("there were pings") / 1_000
}

/// The test examines the pings themselves, because the station's clock is that of this computer.
#[test]
#[ignore = "loads the computer; tests/run includes it"]
fn heartbeat_holds_on_busy_computer() {
    let _alone = alone();
    let may_raise = Command::new("nice").args(["-n", "-20", "true"]).output();
    let may_raise = may_raise.is_ok_and(|done| done.stderr.is_empty());
    let desk = Desk::new();
    let end = station();
    let load = Load::start();
    let run = desk.start(&end, "jog x=2 --rig wide.toml");
    let (code, err) = ended(run);
    drop(load);
    let gap_ms = largest_gap_ms(&end);
    println!("{BUSY} busy threads: at most {gap_ms} ms between two pings; {err}");
    if !may_raise {
        println!("without the right to raise a priority: nothing to hold");
        return;
    }
    assert_eq!(code, Some(0), "{err}");
    assert!(gap_ms < u64::from(HEARTBEAT_MS), "{gap_ms} ms");
    assert_eq!(end.steps(), [160, 0, 0]);
}
