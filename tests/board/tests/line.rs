//! Selection of the active link, and noise on either link.
//!
//! Noise is bytes that are no packet: single bytes as from a floating receiver, bursts, zeros,
//! halves of packets, and packets with a wrong checksum.

use station_board::board::Make;
use station_board::image::Image;
use station_board::order::jog;
use station_board::reference::agreement;
use station_board::station::{Link, Station};
use station_board::time::{Beats, MS};
use station_board::wiring::steps;
use trinocular_core::frame::message::Command;
use trinocular_core::safety::State;
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::Driver;

/// Returns a station whose host uses this link. USB is plugged in in either case.
fn station(link: Link) -> Station {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.plug_usb();
    station.use_link(link);
    station
}

fn other(link: Link) -> Link {
    match link {
        Link::Uart => Link::Usb,
        Link::Usb => Link::Uart,
    }
}

/// Returns noise of one kind.
fn noise(kind: usize, random: &mut Random, whole: &[u8]) -> Vec<u8> {
    match kind {
        0 => vec![0x55],
        1 => vec![0],
        2 => (0..40).map(|_| random.next_u64() as u8).collect(),
        // Longer than any packet, without an end.
        3 => vec![0xa7; 400],
        // Half a packet, and nothing to end it.
        4 => whole[..whole.len() / 2].to_vec(),
        // A packet with one bit wrong.
        _ => {
            let mut broken = whole.to_vec();
            let at = broken.len() / 2;
            broken[at] ^= 0x10;
            broken
        }
    }
}

/// Lets time pass with noise of all kinds on a link.
fn run_with_noise(station: &mut Station, link: Link, every: Beats, times: usize) {
    let mut random = Random::seeded(times as u64);
    let mut client = trinocular_client::conversation::Client::default();
    let (_, whole) = client.packet(Command::Ping { host_us: 1 });
    for kind in (0..6).cycle().take(times) {
        let bytes = noise(kind, &mut random, &whole);
        station.board.chip(|chip| match link {
            Link::Uart => chip.uart_arrives(&bytes),
            Link::Usb => chip.usb_host.write(&bytes),
        });
        station.run(every);
    }
}

/// Returns the number of hellos that are answered, of ten, with noise on the other link.
fn answered(link: Link) -> usize {
    let mut station = station(link);
    run_with_noise(&mut station, other(link), 5 * MS, 6);
    station.client.begin_again();
    let mut answered = 0;
    for _ in 0..10 {
        let before = station.reports.len();
        station.send(Command::Hello);
        run_with_noise(&mut station, other(link), 5 * MS, 6);
        answered += usize::from(station.reports.len() > before);
    }
    answered
}

#[test]
fn uart_noise_spares_usb_answers() {
    assert_eq!(answered(Link::Usb), 10);
}

#[test]
fn usb_noise_spares_uart_answers() {
    assert_eq!(answered(Link::Uart), 10);
}

/// Not a byte of the other link reaches the machine: reports, including the counts of rejects, and
/// edges are the twin's.
fn moves_as_without(link: Link) {
    let mut station = station(link);
    run_with_noise(&mut station, other(link), MS, 6);
    station.greet();
    station.set_up(Driver::Tmc2209);
    assert_eq!(station.command(jog([25_000, -20_000, 15_000])), Ok(()));
    run_with_noise(&mut station, other(link), 2 * MS, 60);
    assert_eq!(station.status().state, State::Moving);
    run_with_noise(&mut station, other(link), 2 * MS, 90);
    let status = station.status();
    assert_eq!(
        (status.state, status.drops.rejects.total()),
        (State::Idle, 0)
    );
    assert_eq!(steps(&station.edges()).0, [2_000, -1_600, 1_200]);
    agreement(&mut station);
}

#[test]
fn uart_noise_spares_a_usb_move() {
    moves_as_without(Link::Usb);
}

#[test]
fn usb_noise_spares_a_uart_move() {
    moves_as_without(Link::Uart);
}

/// Noise on the active link costs the packets that it hits; it is counted, and the next packet is
/// accepted.
#[test]
fn noise_on_the_active_link_counts() {
    for link in [Link::Uart, Link::Usb] {
        let mut station = station(link);
        station.greet();
        station.set_up(Driver::Tmc2209);
        run_with_noise(&mut station, link, 5 * MS, 12);
        let status = station.status();
        assert!(status.drops.rejects.total() >= 4, "{:?}", status.drops);
        assert_eq!(station.command(jog([1_000, 0, 0])), Ok(()));
    }
}

/// The host of the active link dies and its link carries noise, as after its cable was pulled: the
/// other link becomes active after half a second.
#[test]
fn noise_does_not_hold_the_link() {
    for link in [Link::Uart, Link::Usb] {
        let mut station = station(link);
        station.greet();
        station.set_up(Driver::Tmc2209);
        assert_eq!(station.command(jog([40_000, 0, 0])), Ok(()));
        station.run(100 * MS);
        station.set_pings(false);
        run_with_noise(&mut station, link, 10 * MS, 40);
        // Not yet: the first host may come back.
        station.use_link(other(link));
        let before = station.reports.len();
        station.client.begin_again();
        station.send(Command::Hello);
        run_with_noise(&mut station, link, 10 * MS, 4);
        assert_eq!(station.reports.len(), before);
        run_with_noise(&mut station, link, 10 * MS, 12);
        station.greet();
        let status = station.status();
        assert_eq!(status.state, State::Faulted, "the heartbeat ended the move");
        assert_eq!(station.command(Command::Reset), Ok(()));
    }
}

/// A packet that was cut off on one link is not continued by bytes of the other.
#[test]
fn halves_of_two_links_do_not_join() {
    let mut station = station(Link::Usb);
    let hello = station.client.packet(Command::Hello).1;
    let (first, second) = hello.split_at(hello.len() / 2);
    station.board.chip(|chip| chip.uart_arrives(first));
    station.run(5 * MS);
    station.write(second);
    station.run(50 * MS);
    assert_eq!(station.reports.len(), 0);
    station.greet();
}
