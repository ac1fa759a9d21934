//! The watchdog checks every task: when one is dead, the chip restarts.

use station_board::board::Make;
use station_board::fault_table::observed;
use station_board::image::Image;
use station_board::station::Station;
use station_board::time::MS;
use station_board::trial::{faulted, last_step, moving, restarted, switch};
use station_board::wiring;
use trinocular_core::frame::message::ResetCause;
use trinocular_core::safety::{Fault, Trust};

/// Kills a task, by part of the name of its memory and its number there, in the middle of a move:
/// it is never polled again.
fn dead_task(pool: &str, number: u32) {
    let image = Image::firmware();
    let mut station = moving();
    let pools = image.symbol(pool);
    let size = image.size(pool);
    // Tasks of one kind share a pool of equal parts.
    let parts = if pool.contains("limit") { 6 } else { 1 };
    station.board.kill_task(pools + number * size / parts);
    let at = station.board.now();
    // The planned steps continue until then, as with any task of the links.
    let (cause, _) = restarted(&mut station, 130 * MS);
    let reset = station.board.last_reset().0;
    println!("{pool} {number}: reset after {} ms", (reset - at) / MS);
    last_step(&mut station, reset, 0);
    assert_eq!(cause, ResetCause::Watchdog);
}

#[test]
fn dead_step_task_resets_the_chip() {
    dead_task("engine3run4POOL", 0);
}

#[test]
fn dead_control_task_resets_the_chip() {
    dead_task("control3run4POOL", 0);
}

#[test]
fn dead_uart_task_resets_the_chip() {
    dead_task("link4uart4POOL", 0);
}

#[test]
fn dead_usb_tasks_reset_the_chip() {
    dead_task("usb5serve4POOL", 0);
    dead_task("usb6device4POOL", 0);
}

#[test]
fn dead_stop_task_resets_the_chip() {
    dead_task("switches14emergency_stop4POOL", 0);
}

#[test]
fn dead_switch_tasks_reset_the_chip() {
    dead_task("switches12driver_fault4POOL", 0);
    for number in [0, 3, 5] {
        dead_task("switches5limit4POOL", number);
    }
    observed(
        "a task is dead",
        "its executor made to believe that it waits in the queue: step, control, \
         links, USB device, each switch, emergency stop",
        "planned steps until the reset at most, none after it",
        "watchdog: hello says watchdog; fault 9, position unknown; nothing moves before a reset",
    );
}

/// The external interrupt of the emergency stop is lost: the task's own sample of the pin finds it
/// open.
#[test]
fn lost_emergency_edge_is_found() {
    const EXTI15_10: u16 = 40;
    let mut station = moving();
    station.board.disable_interrupt(EXTI15_10);
    let at = station.board.now();
    switch(&mut station, wiring::EMERGENCY_STOP, true);
    faulted(&mut station, Fault::EmergencyStop, Trust::Degraded);
    last_step(&mut station, at, 11_000);
    observed(
        "lost edge of the emergency stop",
        "its external interrupt disabled in the NVIC, then it opens",
        "no step after 11 ms",
        "fault 1, position degraded",
    );
}

/// A task without a slot is a panic at the start, so a station without one of its switches never
/// runs.
#[test]
fn task_without_a_slot_panics() {
    let image = Image::firmware();
    let pool = image.symbol("switches14emergency_stop4POOL");
    let mut station = Station::power_on(&image, Make::default());
    // As if it had been spawned before: memory is cleared before the watchdog starts, and tasks are
    // spawned after it.
    while station.board.chip(|chip| !chip.iwdg.started()) {
        station.run(MS / 100);
    }
    for at in (pool..pool + 0x40).step_by(4) {
        station.board.poke(at, 1);
    }
    station.run(20 * MS);
    station.set_pings(false);
    while station.board.last_reset().1 == 0 {
        station.run(MS);
    }
    station.run(20 * MS);
    station.greet();
    let last_run = *station.client.last_run().expect("last run");
    assert_eq!(last_run.end, trinocular_core::frame::message::End::Panic);
}
