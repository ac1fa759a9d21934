//! A station on UART0, on the emulated clock.
//!
//! The emulator's host may suspend the processor for many milliseconds, which happens on no real
//! board. The station therefore executes every tick at the instant when it was due, however late: a
//! delay only delays reports.

use crate::board::{BOARD, PORT, RING_WORDS, SEGMENT_WORDS};
use crate::port_log::PortLog;
use crate::{Failure, Path, executor, time, uart};
use embassy_futures::select::{Either, select};
use embassy_time::Timer;
use trinocular_core::machine::TICK_US;
use trinocular_core::replay::{Event, Station};
use trinocular_core::time::Instant;

/// Interval at which the trace goes to its file, µs.
const FLUSH_US: u64 = 100_000;

/// Starts the station. With `trace`, its actions go to that file.
pub fn run(trace: Option<Path>) -> Result<(), Failure> {
    let station = Station::new(BOARD, PORT, RING_WORDS).map_err(|_| Failure("impossible pins"))?;
    let port_log = trace.as_ref().map(PortLog::create).transpose()?;
    time::start();
    uart::start();
    executor::run(|spawner| {
        // Each task is started once, so its one place is free.
        spawner.spawn(uart::sender().unwrap());
        spawner.spawn(serve(station, port_log).unwrap());
    })
}

fn now() -> Instant {
    Instant::from_micros(embassy_time::Instant::now().as_micros())
}

#[embassy_executor::task]
async fn serve(mut station: Station, mut port_log: Option<PortLog>) {
    let mut words = [0; SEGMENT_WORDS];
    let mut buffer = [0; 64];
    let mut next_flush = now();
    loop {
        let event = station.run(now(), &mut words);
        if let Some(port_log) = &mut port_log {
            port_log.note(station.now(), &event, &words, |_| {});
            if station.now() >= next_flush {
                port_log.flush();
                next_flush = station.now().plus_micros(FLUSH_US);
            }
        }
        match event {
            Event::Sent(bytes) => uart::send(&bytes),
            Event::Segment(..) => {}
            Event::Refused(fault) => panic!("{fault}"),
            Event::Idle(until) => {
                // A tick's segments are made at its end: the pins are simulated, and the emulator
                // wakes up less often.
                let tick = until.micros().next_multiple_of(TICK_US);
                let due = embassy_time::Instant::from_micros(tick);
                if let Either::Second(count) =
                    select(Timer::at(due), uart::receive(&mut buffer)).await
                {
                    station.receive(buffer.get(..count).unwrap_or_default());
                }
            }
        }
    }
}
