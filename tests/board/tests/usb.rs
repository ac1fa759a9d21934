//! USB: the flashed image as a CDC-ACM device, from the plug to the last step.

use station_board::board::Make;
use station_board::fault_table::observed;
use station_board::image::Image;
use station_board::order::{config, jog};
use station_board::reference::agreement;
use station_board::scene;
use station_board::station::{Link, Station};
use station_board::time::MS;
use station_board::wiring::steps;
use trinocular_core::frame::message::Command;
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_rig::rig_file::Driver;

fn plugged() -> Station {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.plug_usb();
    station
}

fn configured() -> Station {
    let mut station = plugged();
    station.greet();
    station.set_up(Driver::Tmc2209);
    station
}

/// Asserts that no request failed, no toggle was wrong, and the driver used the FIFOs as the manual
/// demands.
fn bus_is_well(station: &mut Station) {
    let (failures, complaints) =
        (station.board).chip(|chip| (chip.usb_host.failures.clone(), chip.complaints.clone()));
    assert!(failures.is_empty(), "{failures:?}");
    let fifo = complaints.iter().find(|text| text.contains("FIFO"));
    assert_eq!(fifo, None);
}

#[test]
fn enumeration_matches_the_host() {
    let mut station = plugged();
    let ms = station.board.now() / MS;
    assert!(ms < 250, "{ms} ms from power to the open port");
    let found = station.board.chip(|chip| chip.usb_host.descriptors.clone());
    // USB 2.0, table 9-8: vendor 1209, product 0001, by which the host finds its station.
    assert_eq!(found.device[8..12], [0x09, 0x12, 0x01, 0x00]);
    assert_eq!(found.strings[..2], ["Trinocular", "olimex-h405"]);
    assert_eq!(found.strings[2].len(), 24, "96 bits of chip number");
    assert_eq!(
        found.configuration.len(),
        usize::from(found.configuration[2])
    );
    // Communications class with the abstract control model, then data.
    let interfaces: Vec<&[u8]> = (found.configuration.windows(9))
        .filter(|window| window[..2] == [9, 4])
        .map(|window| &window[5..8])
        .collect();
    assert_eq!(interfaces, [[2, 2, 0], [10, 0, 0]]);
    bus_is_well(&mut station);
}

#[test]
fn frames_jog_and_stop_over_usb() {
    let mut station = configured();
    scene::follow(&mut station, 500);
    assert_eq!(station.command(Command::Stop), Ok(()));
    station.run(300 * MS);
    assert_eq!(station.command(Command::Reset), Ok(()));
    assert_eq!(station.command(jog([-2_000, 3_000, 500])), Ok(()));
    station.run(100 * MS);
    assert_eq!(station.command(Command::Stop), Ok(()));
    station.run(200 * MS);
    let status = station.status();
    assert_eq!(status.frames_used + status.frames_refused, 500);
    assert!(status.frames_used >= 450, "{status:?}");
    let (reports, edges) = agreement(&mut station);
    println!("{reports} reports and {edges} edges agree");
    assert_eq!(
        status.position_steps.map(i64::from),
        steps(&station.edges()).0
    );
    bus_is_well(&mut station);
}

/// The cable is pulled while both sides have a packet in flight, in a fast move, and plugged in
/// again without a restart.
#[test]
fn unplugging_in_mid_write_recovers() {
    let mut station = configured();
    let session = station.client.hello().expect("hello").session;
    assert_eq!(station.command(jog([45_000, -45_000, 45_000])), Ok(()));
    station.run(150 * MS);
    // A long packet of which the device takes the first 64 bytes at most, and reports that the host
    // never fetches.
    let config = config(Driver::Tmc2209);
    for _ in 0..3 {
        station.send(Command::Config(config));
    }
    while station.board.chip(|chip| chip.usb_host.unsent()) > 200 {
        station.run(MS / 100);
    }
    station.board.chip(|chip| chip.usb_host.unplug());
    station.set_pings(false);
    station.run(400 * MS);
    assert_eq!(
        station.board.last_reset().1,
        0,
        "links may wait, the watchdog is fed"
    );
    let stood = steps(&station.edges()).0;
    station.plug_usb();
    station.greet();
    assert_eq!(station.client.hello().expect("hello").session, session);
    let status = station.status();
    assert_eq!(
        (status.state, status.fault),
        (State::Faulted, Some(Fault::Heartbeat))
    );
    assert_eq!(status.trust, Trust::Homed);
    assert_eq!(
        status.position_steps.map(i64::from),
        stood,
        "every step counted"
    );
    assert_eq!(station.command(Command::Reset), Ok(()));
    assert_eq!(station.command(jog([1_000, 0, 0])), Ok(()));
    station.run(200 * MS);
    let moved = steps(&station.edges()).0[0] - stood[0];
    assert_eq!(moved, 80);
    bus_is_well(&mut station);
    observed(
        "USB unplugged in mid-write",
        "the cable, while both sides have packets under way",
        "ramp after 100 ms; every step counted",
        "fault 0, position kept, no restart; plugged in again it answers, \
         and after a reset it moves exactly again",
    );
}

/// A host on the UART is accepted once the one on USB has been silent for half a second.
#[test]
fn uart_takes_over_from_dead_usb() {
    let mut station = configured();
    station.set_pings(false);
    station.use_link(Link::Uart);
    let hello = station.client.packet(Command::Hello).1;
    station.write(&hello);
    station.run(100 * MS);
    let heard = station.reports.len();
    assert_eq!(
        station.board.chip(|chip| chip.usart3.sent.len()),
        0,
        "USB speaks"
    );
    station.run(500 * MS);
    station.greet();
    assert!(station.reports.len() > heard);
    assert_eq!(station.status().state, State::Idle);
}
