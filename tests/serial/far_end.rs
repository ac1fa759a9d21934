//! The far end of a pseudo-terminal: stations and strangers, each in a thread that ends with its handle.

use host::station::stage::{configuration, default_stage};
use host::station::twin::{PORT, RING_WORDS};
use serialport::{SerialPort as _, TTYPort};
use shared::frame::message::{Config, Mounting, ResetCause};
use shared::machine::Board;
use shared::replay::{Event, Station};
use shared::steps::WordRate;
use shared::time::Instant as StationInstant;
use std::io::{Read as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Somebody at the end of a line.
pub struct FarEnd {
    /// The port that leads there.
    pub path: String,
    received: Arc<Mutex<Vec<u8>>>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for FarEnd {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl FarEnd {
    /// Everything that came over the line.
    pub fn received(&self) -> Vec<u8> {
        self.received.lock().expect("no thread panics").clone()
    }
}

/// Calls `live` with the bytes that came, every millisecond; what it returns goes back.
fn far_end(mut live: impl FnMut(&[u8]) -> Vec<u8> + Send + 'static) -> FarEnd {
    let (mut far, near) = TTYPort::pair().expect("a pseudo-terminal");
    let path = near.name().expect("it has a name");
    let (received, over) = (
        Arc::new(Mutex::new(Vec::new())),
        Arc::new(AtomicBool::new(false)),
    );
    let (log, end) = (Arc::clone(&received), Arc::clone(&over));
    let thread = std::thread::spawn(move || {
        // The near end stays open here, or the line would end when the other program closes it.
        let _near = near;
        let mut buffer = [0; 256];
        far.set_timeout(Duration::from_millis(1))
            .expect("a timeout");
        while !end.load(Ordering::Relaxed) {
            let count = far.read(&mut buffer).unwrap_or(0);
            log.lock()
                .expect("no thread panics")
                .extend_from_slice(&buffer[..count]);
            let answer = live(&buffer[..count]);
            // A full line loses what nobody reads.
            let _ = far.write_all(&answer);
        }
    });
    FarEnd {
        path,
        received,
        over,
        thread: Some(thread),
    }
}

/// The machine, on this computer's clock.
pub fn station() -> FarEnd {
    let board = Board {
        name: "far end",
        version: [0, 1, 0],
        word_rate: WordRate::MHZ_1,
        delay_us: RING_WORDS as u32,
        session: 1,
        reset_cause: ResetCause::PowerOn,
    };
    let mut station = Station::new(board, PORT, RING_WORDS as u32).expect("possible pins");
    let mut words = [0; 2 * WordRate::MHZ_1.slots_per_segment() as usize];
    let mut last = Instant::now();
    far_end(move |bytes| {
        station.receive(bytes);
        // A computer that is busy elsewhere stops the station's clock, too: no real board misses a heartbeat for that.
        let passed = last.elapsed().min(Duration::from_millis(10));
        last = Instant::now();
        let until = station.now().micros() + passed.as_micros() as u64;
        let mut answer = Vec::new();
        loop {
            match station.run(StationInstant::from_micros(until), &mut words) {
                Event::Sent(packet) => answer.extend_from_slice(&packet),
                Event::Segment(..) => {}
                Event::Refused(fault) => panic!("{fault}"),
                Event::Idle(_) => return answer,
            }
        }
    })
}

/// Somebody who answers everything with the same bytes.
pub fn saying(bytes: Vec<u8>) -> FarEnd {
    far_end(move |received| {
        if received.is_empty() {
            Vec::new()
        } else {
            bytes.clone()
        }
    })
}

/// Nobody.
pub fn mute() -> FarEnd {
    far_end(|_| Vec::new())
}

/// A configuration that no station takes.
pub fn impossible() -> Config {
    let mut config = configuration(&default_stage(), Mounting::OnStage).expect("it fits");
    config.slow_speed_um_s = 0;
    config
}
