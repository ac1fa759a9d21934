//! Faults from outside the program, in the middle of a fast move of all axes: the edges at the
//! pins, and the station's state afterwards.
//!
//! Each test ends with a look-up of its line in FAULTS.md, so that the table holds observations. A
//! missing line is printed.

use station_board::board::{Board, Make};
use station_board::fault_table::observed;
use station_board::image::{FLASH_BASE, Image};
use station_board::order::jog;
use station_board::station::Station;
use station_board::time::{MS, US};
use station_board::trial::{
    RING_US, TICK_AND_RING_US, configure, drivers_are_on, faulted, last_step, moving, recovers,
    restarted, rises_after, switch,
};
use station_board::wiring::{self, C};
use trinocular_core::frame::message::{Command, Denial, End, ResetCause};
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_rig::rig_file::Driver;

#[test]
fn refill_starved() {
    let mut station = moving();
    let at = station.board.now();
    station.board.disable_interrupt(53);
    let (cause, last_run) = restarted(&mut station, 80 * MS);
    last_step(&mut station, at, RING_US);
    // The machine gets no room and so has no ticks: it latches nothing.
    assert_eq!(
        (cause, last_run.fault, last_run.end),
        (ResetCause::Watchdog, None, End::Outside)
    );
    observed(
        "refill task starved",
        "its executor's interrupt (UART5) disabled in the NVIC",
        "last step within one ring",
        "watchdog: hello says watchdog, no fault latched (without room the machine has no ticks); \
         fault 9, position unknown; \
         nothing moves before a reset",
    );
}

#[test]
fn interrupts_masked_for_ever() {
    let mut station = moving();
    while station.board.cpu().regs().in_handler() {
        station.run(US);
    }
    let at = station.board.now();
    station.board.mask_interrupts();
    let (cause, last_run) = restarted(&mut station, 80 * MS);
    last_step(&mut station, at, RING_US);
    assert_eq!((cause, last_run.end), (ResetCause::Watchdog, End::Outside));
    observed(
        "interrupts masked for ever",
        "PRIMASK set in thread mode",
        "last step within one ring",
        "watchdog: hello says watchdog; fault 9, position unknown; nothing moves before a reset",
    );
}

#[test]
fn processor_held() {
    let mut station = moving();
    let at = station.board.now();
    station.board.hold(true);
    let (cause, _) = restarted(&mut station, 80 * MS);
    last_step(&mut station, at, RING_US);
    assert_eq!(cause, ResetCause::Watchdog);
    observed(
        "processor held",
        "its clock stopped; timers, DMA and watchdog run on",
        "last step within one ring: the eraser",
        "watchdog: hello says watchdog; fault 9, position unknown; nothing moves before a reset",
    );
}

#[test]
fn processor_held_for_5_ms() {
    let mut station = moving();
    let at = station.board.now();
    station.board.hold(true);
    station.run(5 * MS);
    station.board.hold(false);
    faulted(&mut station, Fault::Underrun, Trust::Degraded);
    last_step(&mut station, at, RING_US);
    recovers(&mut station);
    observed(
        "processor held for 5 ms",
        "its clock stopped and started again",
        "last step within one ring; none when it goes on",
        "fault 4, position degraded; after reset and zero it moves exactly again",
    );
}

fn stream_fails(stream: usize) -> Station {
    let mut station = moving();
    let at = station.board.now();
    station
        .board
        .chip(|chip| chip.dma[1].streams[stream].fails = true);
    faulted(&mut station, Fault::Underrun, Trust::Degraded);
    last_step(&mut station, at, RING_US);
    recovers(&mut station);
    station
}

#[test]
fn player_stream_fails() {
    stream_fails(1);
    observed(
        "DMA error of the player",
        "bus error on its next transfer: the stream is switched off",
        "last step within one ring",
        "fault 4, position degraded; after reset and zero it moves exactly again",
    );
}

#[test]
fn eraser_stream_fails() {
    stream_fails(2);
    observed(
        "DMA error of the eraser",
        "bus error on its next transfer: the stream is switched off",
        "last step within one ring, no word twice",
        "fault 4, position degraded; after reset and zero it moves exactly again",
    );
}

#[test]
fn panic() {
    let mut station = moving();
    let image = Image::firmware();
    station.board.derail(image.symbol("9panicking5panic"));
    let at = station.board.now();
    station.run(MS);
    assert!(!drivers_are_on(&mut station), "off at once");
    let (cause, last_run) = restarted(&mut station, 80 * MS);
    last_step(&mut station, at, 20);
    assert_eq!((cause, last_run.end), (ResetCause::Watchdog, End::Panic));
    assert_ne!(last_run.places[0], 0);
    observed(
        "panic",
        "the processor sent to core's panic function",
        "no step after 20 µs; drivers off",
        "watchdog: hello says watchdog, panic and where; fault 9, position unknown; \
         nothing moves before a reset",
    );
}

#[test]
fn hard_fault() {
    let mut station = moving();
    station.board.derail(0x3000_0000);
    let at = station.board.now();
    let (cause, last_run) = restarted(&mut station, 80 * MS);
    last_step(&mut station, at, 20);
    assert_eq!(
        (cause, last_run.end),
        (ResetCause::Watchdog, End::HardFault)
    );
    assert_eq!(last_run.places[0], 0x3000_0000);
    observed(
        "hard fault",
        "the processor sent to an address without memory",
        "no step after 20 µs; drivers off",
        "watchdog: hello says watchdog, hard fault and where; fault 9, position unknown; \
         nothing moves before a reset",
    );
}

#[test]
fn stack_too_long() {
    // Core-coupled memory begins at 0x1000_0000: room for one more exception's frame, but not for
    // its handler.
    let mut station = moving();
    station.board.deepen_stack(0x1000_0080);
    let at = station.board.now();
    station.run(MS);
    assert!(!drivers_are_on(&mut station), "off at once");
    let (cause, last_run) = restarted(&mut station, 80 * MS);
    last_step(&mut station, at, 300);
    assert_eq!(
        (cause, last_run.end),
        (ResetCause::Watchdog, End::HardFault)
    );
    let program = FLASH_BASE..FLASH_BASE + 0x2_0000;
    assert!(program.contains(&last_run.places[0]), "{last_run:?}");
    observed(
        "stack too long",
        "the stack pointer set to the end of its memory",
        "no step after 300 µs; drivers off",
        "watchdog: hello says watchdog, hard fault and the callers; fault 9, position unknown; \
         nothing moves before a reset",
    );
}

#[test]
fn watchdog_expires() {
    let mut station = moving();
    while station.board.cpu().regs().in_handler() {
        station.run(US);
    }
    // An endless loop in thread mode: links and watch task are dead, motion is not.
    let flash = Image::firmware().flash;
    let code = 0x188..0x1_0000;
    let found = code
        .step_by(2)
        .find(|at| flash[*at..*at + 2] == [0xfe, 0xe7]);
    let at = station.board.now();
    station
        .board
        .derail(FLASH_BASE + found.expect("a branch to itself") as u32);
    let (cause, last_run) = restarted(&mut station, 80 * MS);
    let reset = station.board.last_reset().0;
    last_step(&mut station, reset, 0);
    println!("reset {} ms after the hang", (reset - at) / MS);
    assert_eq!(
        (cause, last_run.fault, last_run.end),
        (ResetCause::Watchdog, None, End::Outside)
    );
    observed(
        "thread hangs",
        "the processor sent to a branch to itself in thread mode: links and watch task dead, \
         motion alive",
        "planned steps until the reset, none after it",
        "watchdog: hello says watchdog; fault 9, position unknown; nothing moves before a reset",
    );
}

#[test]
fn reset_pin() {
    let mut station = moving();
    let at = station.board.now();
    station.board.press_reset();
    station.set_pings(false);
    station.run(20 * MS);
    station.greet();
    last_step(&mut station, at, 0);
    assert_eq!(
        station.client.hello().expect("hello").reset_cause,
        ResetCause::Pin
    );
    assert!(!drivers_are_on(&mut station));
    observed(
        "reset pressed",
        "the chip's reset pin",
        "no step; pins are inputs, drivers off",
        "hello says pin; unconfigured, position unknown",
    );
}

#[test]
fn limit_switch_ahead() {
    let mut station = moving();
    let at = station.board.now();
    // X moves forwards; the contact bounces shut after 100 µs.
    switch(&mut station, wiring::LIMITS[0][1], true);
    station.run(100 * US);
    switch(&mut station, wiring::LIMITS[0][1], false);
    faulted(&mut station, Fault::Limit, Trust::Degraded);
    last_step(&mut station, at, TICK_AND_RING_US);
    recovers(&mut station);
    observed(
        "limit switch ahead",
        "opens for 100 µs",
        "last step within a tick and a ring",
        "fault 2, position degraded; after reset and zero it moves exactly again",
    );
}

#[test]
fn limit_switch_behind() {
    let mut station = moving();
    let at = station.board.now();
    switch(&mut station, wiring::LIMITS[0][0], true);
    station.run(20 * MS);
    let status = station.status();
    assert_eq!(
        (status.state, status.fault, status.trust),
        (State::Moving, None, Trust::Homed)
    );
    assert!(rises_after(&mut station, at).len() > 300);
    observed("limit switch behind", "opens", "it moves on", "no fault");
}

#[test]
fn emergency_stop() {
    let mut station = moving();
    let at = station.board.now();
    switch(&mut station, wiring::EMERGENCY_STOP, true);
    station.run(100 * US);
    switch(&mut station, wiring::EMERGENCY_STOP, false);
    faulted(&mut station, Fault::EmergencyStop, Trust::Degraded);
    last_step(&mut station, at, 100);
    recovers(&mut station);
    observed(
        "emergency stop",
        "opens for 100 µs",
        "no step after 100 µs",
        "fault 1, position degraded, drivers on; after reset and zero it moves exactly again",
    );
}

/// The emergency stop may erase the word that writes DIR: the next move must write it again.
#[test]
fn emergency_stop_in_a_reversal() {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    station.set_up(Driver::Tmc2209);
    for quarter in 0..12 {
        assert_eq!(station.command(jog([500, 0, 0])), Ok(()));
        station.run(80 * MS);
        station.send(Command::Jog {
            distance_um: [-500, 0, 0],
        });
        // From before the arrival of its packet to after its first steps.
        station.run(quarter * 250 * US);
        switch(&mut station, wiring::EMERGENCY_STOP, true);
        station.run(100 * US);
        switch(&mut station, wiring::EMERGENCY_STOP, false);
        faulted_at_any_trust(&mut station);
        assert_eq!(station.command(Command::Reset), Ok(()));
        assert_eq!(station.command(Command::Zero), Ok(()));
        let before = wiring::steps(&station.edges()).0;
        assert_eq!(station.command(jog([-500, 0, 0])), Ok(()));
        station.run(80 * MS);
        let after = wiring::steps(&station.edges()).0;
        assert_eq!(
            after[0] - before[0],
            -40,
            "stopped after {quarter} quarters"
        );
    }
}

fn faulted_at_any_trust(station: &mut Station) {
    station.run(30 * MS);
    let status = station.status();
    assert_eq!(
        (status.state, status.fault),
        (State::Faulted, Some(Fault::EmergencyStop))
    );
}

#[test]
fn spark_on_the_emergency_stop() {
    let mut station = moving();
    let at = station.board.now();
    switch(&mut station, wiring::EMERGENCY_STOP, true);
    station.run(10 * US);
    switch(&mut station, wiring::EMERGENCY_STOP, false);
    station.run(20 * MS);
    assert_eq!(station.status().fault, None);
    assert!(rises_after(&mut station, at).len() > 300);
    observed(
        "spark on the emergency stop",
        "opens for 10 µs",
        "it moves on",
        "no fault",
    );
}

#[test]
fn driver_fault() {
    let mut station = moving();
    let at = station.board.now();
    switch(&mut station, wiring::DRIVER_FAULT, false);
    faulted(&mut station, Fault::Driver, Trust::Degraded);
    last_step(&mut station, at, TICK_AND_RING_US);
    assert_eq!(station.command(Command::Reset), Err(Denial::CauseRemains));
    switch(&mut station, wiring::DRIVER_FAULT, true);
    station.run(10 * MS);
    recovers(&mut station);
    observed(
        "driver's fault line",
        "goes low and stays",
        "last step within a tick and a ring",
        "fault 3, position degraded; reset refused while it is low",
    );
}

#[test]
fn host_falls_silent() {
    let mut station = moving();
    let at = station.board.now();
    station.set_pings(false);
    station.run(250 * MS);
    let status = faulted(&mut station, Fault::Heartbeat, Trust::Homed);
    // The heartbeat timeout is 100 ms; the ramp takes 50 ms from 100 mm/s at 2,000 mm/s², and 40 ms
    // for the jerk.
    last_step(&mut station, at, 220_000);
    assert_eq!(
        status.position_steps.map(i64::from),
        wiring::steps(&station.edges()).0
    );
    observed(
        "host falls silent",
        "no bytes on the link",
        "ramp after 100 ms; every step counted",
        "fault 0, position kept",
    );
}

#[test]
fn power_on_with_emergency_stop() {
    let board = Board::power_on(&Image::firmware(), Make::default(), |fabric| {
        wiring::well(fabric);
        wiring::open(fabric, wiring::EMERGENCY_STOP);
    });
    let mut station = Station::of(board);
    station.run(20 * MS);
    station.greet();
    assert!(!drivers_are_on(&mut station), "it knows no stage");
    configure(&mut station);
    assert_eq!(station.command(jog([1_000; 3])), Err(Denial::Faulted));
    assert_eq!(station.command(Command::Reset), Err(Denial::CauseRemains));
    station.run(100 * MS);
    let status = station.status();
    assert_eq!(
        (status.state, status.fault),
        (State::Faulted, Some(Fault::EmergencyStop))
    );
    assert_eq!(wiring::stepper_edges(&station.board.changes(C)), []);
    switch(&mut station, wiring::EMERGENCY_STOP, false);
    station.run(10 * MS);
    recovers(&mut station);
    observed(
        "power-on with the emergency stop pressed",
        "open before power comes",
        "no edge; drivers off before the configuration",
        "fault 1, jog and reset refused; after its release and a reset it moves exactly",
    );
}
