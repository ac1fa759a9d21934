//! The machine and its connections: bytes and switches in, bytes and segments out.

use crate::{board, clock, crash, engine, link, pins, switches, watch};
use embassy_futures::select::select3;
use embassy_time::{Instant, Timer};
use static_cell::StaticCell;
use trinocular_core::frame::message::{LastRun, ResetCause};
use trinocular_core::machine::{Board, Machine, Output};

/// Waiting time when a segment is due and the engine has no room, µs.
const NO_ROOM_US: u64 = 50;

/// Runs the machine forever.
#[embassy_executor::task]
pub async fn run(session: u32, reset_cause: ResetCause, last_run: LastRun) {
    static MACHINE: StaticCell<Machine> = StaticCell::new();
    let machine = MACHINE.init_with(|| {
        Machine::new(Board {
            name: board::NAME,
            version: VERSION,
            word_rate: board::WORD_RATE,
            delay_us: engine::DELAY_US,
            session,
            reset_cause,
            last_run,
            camera_pin: board::CAMERA_PIN,
        })
    });
    let mut words_given: u64 = 0;
    let mut words_emitted: u64 = 0;
    let mut driven = false;
    loop {
        if engine::plays() {
            let queued = engine::words(engine::queued_us());
            words_emitted = words_given.saturating_sub(queued as u64).max(words_emitted);
        }
        let trigger_losses = engine::trigger_losses();
        machine.sense(switches::inputs(words_emitted, trigger_losses));
        while let Some(arrival) = link::received() {
            machine.take(arrival.at, arrival.outcome);
        }
        let now = clock::now();
        match machine.poll(now, engine::room()) {
            Output::Send(bytes) => link::send(bytes),
            Output::Segment(segment) => {
                words_given = words_given.saturating_add(u64::from(segment.slots()) * 2);
                // `poll` got the room of the engine, so the segment fits.
                let _ = engine::give(segment, machine.inverted(), machine.camera_edges());
            }
            Output::Idle(until) => {
                watch::alive(watch::Task::Control);
                let state = machine.state();
                watch::show(state);
                crash::keep_fault(machine.fault());
                if driven != machine.motors_on() {
                    driven = !driven;
                    pins::set_drivers(driven);
                }
                if !state.is_moving() {
                    engine::resume();
                }
                let wake = if until > now {
                    until.micros()
                } else {
                    now.micros() + NO_ROOM_US
                };
                select3(
                    Timer::at(Instant::from_micros(wake)),
                    link::wait(),
                    switches::changed(),
                )
                .await;
            }
        }
    }
}

/// Version of the crate, for hello.
const VERSION: [u8; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn number(text: &str) -> u8 {
    let digits = text.as_bytes();
    let mut value = 0;
    let mut at = 0;
    while at < digits.len() {
        value = value * 10 + (digits[at] - b'0');
        at += 1;
    }
    value
}
