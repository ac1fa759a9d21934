//! Power-on: clocks, watchdog and pins are in their intended state before the first packet.
//!
//! The required register values are derived here from RM0090, not from the firmware's source.

use station_board::board::{Board, Make};
use station_board::chip::rcc::Clocks;
use station_board::image::Image;
use station_board::station::Station;
use station_board::time::MS;
use station_board::wiring::{self, A, B, C};
use trinocular_core::frame::message::{End, ResetCause};
use trinocular_rig::rig_file::Driver;

/// Accesses of the HAL that the manual does not list. Each is harmless; remove the line here
/// together with the access.
const KNOWN: [&str; 4] = [
    // RCC_DCKCFGR exists on the F42x. embassy-stm32 writes its reset value here, where the chip has
    // a gap.
    "read of 0x4002388c: no model",
    "write of 0x0 to 0x4002388c: no such thing",
    // Hardware configuration 4 of the controller: present, but not in the manual.
    // embassy-usb-synopsys-otg reads settings from it that the embedded transceiver ignores.
    "read of 0x50000050: no model",
    // OTG_FS_DOEPCTL1: the CDC class polls its enable bit before the controller has its clock,
    // reads 0, and waits.
    "0x50000b20 has no clock",
];

fn booted() -> Board {
    let mut board = Board::power_on(&Image::firmware(), Make::default(), wiring::well);
    board.run_until(60 * MS);
    board
}

#[test]
fn clock_tree_is_as_intended() {
    let mut board = booted();
    let clocks = board.chip(|chip| chip.clocks());
    let intended = Clocks {
        hclk: 168_000_000,
        pclk1: 42_000_000,
        pclk2: 84_000_000,
        timer1: 84_000_000,
        timer2: 168_000_000,
        usb: 48_000_000,
    };
    assert_eq!(clocks, intended);
    let (cr, pllcfgr, cfgr) = board.chip(|chip| {
        let now = chip.fabric.now;
        (chip.rcc.read(0, now), chip.rcc.pllcfgr, chip.rcc.cfgr)
    });
    let cr = cr.expect("RCC_CR");
    // HSE on and ready, not bypassed; PLL on and ready; HSI off.
    assert_eq!(cr & 0x0307_0003, 0x0303_0000, "RCC_CR {cr:#x}");
    let factors = [(0, 0x3f), (6, 0x1ff), (16, 3), (22, 1), (24, 0xf)];
    // M 4, N 168, P 2 (coded 0), source HSE, Q 7.
    let found = factors.map(|(shift, mask)| pllcfgr >> shift & mask);
    assert_eq!(found, [4, 168, 0, 1, 7]);
    // The VCO's input is between 1 and 2 MHz, its output between 100 and 432 MHz.
    assert!((1..=2).contains(&(8 / found[0])) && (100..=432).contains(&(8 / found[0] * found[1])));
    assert_eq!(cfgr & 3, 2, "the PLL is the system clock");
}

/// RM0090, table "Number of wait states": five from 150 to 168 MHz at 2.7 to 3.6 V. Without its
/// caches the processor would wait for most jumps.
#[test]
fn flash_keeps_up_with_the_core() {
    let acr = booted().chip(|chip| chip.flash_acr);
    assert_eq!(acr & 7, 5, "wait states");
    assert_eq!(acr >> 8 & 7, 7, "prefetch, instruction cache, data cache");
}

/// Revision A, which reports the device number of the STM32F2 (ES0182), must run without prefetch.
#[test]
fn revision_a_runs_without_prefetch() {
    let mut make = Make::default();
    make.around.idcode = 0x2000_6411;
    let mut board = Board::power_on(&Image::firmware(), make, wiring::well);
    board.run_until(60 * MS);
    let acr = board.chip(|chip| chip.flash_acr);
    assert_eq!(acr >> 8 & 7, 6, "instruction cache, data cache");
}

/// Start by `dfu-util` with `:leave`: interrupts must not use the boot loader's vectors, which
/// still lie at address zero.
#[test]
fn jump_of_a_boot_loader_starts_it() {
    let make = Make {
        boot_loader_at_zero: true,
        ..Make::default()
    };
    let mut station = Station::power_on(&Image::firmware(), make);
    station.run(20 * MS);
    station.greet();
    station.set_up(Driver::Tmc2209);
    station.run(200 * MS);
    assert_eq!(station.board.last_reset().1, 0);
    assert_eq!(station.status().fault, None);
}

/// The data sheet's oscillator runs at 17 to 47 kHz.
#[test]
fn watchdog_timeout_is_as_stated() {
    for (lsi_hz, least, most) in [(17_000, 90, 100), (32_000, 48, 52), (47_000, 32, 36)] {
        let mut make = Make::default();
        make.around.lsi_hz = lsi_hz;
        let mut board = Board::power_on(&Image::firmware(), make, wiring::well);
        board.run_until(8 * MS);
        let (started, patience) = board.chip(|chip| (chip.iwdg.started(), chip.iwdg.patience()));
        assert!(started, "8 ms after power");
        let ms = patience / MS;
        assert!((least..=most).contains(&ms), "{ms} ms at {lsi_hz} Hz");
        board.run_until(400 * MS);
        assert_eq!(board.last_reset().1, 0, "it is fed at {lsi_hz} Hz");
    }
}

#[test]
fn pins_match_the_wiring_table() {
    let mut board = booted();
    board.chip(|chip| {
        let ports = &chip.fabric.ports;
        let steppers = wiring::STEPPERS;
        let outputs = steppers.step.into_iter().chain(steppers.dir);
        for pin in outputs.chain([wiring::CAMERA_PIN]) {
            assert_eq!(ports[C].mode(pin.into()), 1, "PC{pin} is an output");
        }
        let low = wiring::STEPPER_MASK | 1 << wiring::CAMERA_PIN;
        assert_eq!(ports[C].levels() & low, 0);
        for (port, pin) in wiring::LIMITS
            .into_iter()
            .flatten()
            .chain([wiring::EMERGENCY_STOP, wiring::DRIVER_FAULT])
        {
            let pull = ports[port].pupdr >> (2 * pin) & 3;
            assert_eq!(
                (ports[port].mode(pin.into()), pull),
                (0, 1),
                "an input with pull-up"
            );
            assert_eq!(chip.fabric.exti.port(pin.into()), port, "its EXTI line");
        }
        // Alternate functions (data sheet): USART3 is 7, OTG_FS is 10; the debug port keeps its
        // pins.
        for (port, pin, function) in [
            (B, 10, 7),
            (B, 11, 7),
            (A, 11, 10),
            (A, 12, 10),
            (A, 13, 0),
            (A, 14, 0),
        ] {
            let afr = ports[port].afr[pin as usize / 8] >> (4 * (pin % 8)) & 0xf;
            assert_eq!((ports[port].mode(pin), afr), (2, function), "pin {pin}");
        }
        // The UART's input is pulled up, the gate of the step timer (TIM8_ETR, function 3) down:
        // unconnected they are idle and open.
        assert_eq!(ports[B].pupdr >> 22 & 3, 1);
        assert_eq!((ports[A].mode(0), ports[A].afr[0] & 0xf), (2, 3));
        assert_eq!(ports[A].pupdr & 3, 2);
        // RM0090: the slowest edges for pins with a switch or a lamp.
        for (port, pin) in [wiring::NOT_ENABLE, wiring::LED] {
            assert_eq!(ports[port].ospeedr >> (2 * pin) & 3, 0);
        }
    });
}

#[test]
fn stage_is_dead_before_first_command() {
    let mut board = booted();
    board.run_until(400 * MS);
    assert_eq!(wiring::stepper_edges(&board.changes(C)), []);
    let enabled = 1 << wiring::NOT_ENABLE.1;
    assert!(
        board
            .changes(B)
            .iter()
            .all(|change| change.after & enabled != 0)
    );
    let led = 1 << wiring::LED.1;
    let changes = board.changes(C);
    let blinks = (changes.iter()).filter(|change| (change.before ^ change.after) & led != 0);
    assert!(blinks.count() >= 1, "the LED blinks");
}

#[test]
fn registers_are_used_as_documented() {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    station.run(100 * MS);
    let complaints = station.board.chip(|chip| chip.complaints.clone());
    let unknown: Vec<_> = (complaints.iter())
        .filter(|text| !KNOWN.contains(&text.as_str()))
        .collect();
    assert!(unknown.is_empty(), "{unknown:#?}");
    assert_eq!(complaints.len(), KNOWN.len(), "{complaints:#?}");
    assert_eq!(station.board.cpu().bus_faults(), (0, 0));
}

#[test]
fn start_has_new_session_and_cause() {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    let first = station.client.hello().expect("hello").clone();
    assert_eq!(first.reset_cause, ResetCause::PowerOn);
    let last_run = *station.client.last_run().expect("last run");
    assert_eq!(
        (last_run.starts, last_run.end),
        (1, End::Outside),
        "memory held anything"
    );
    station.board.press_reset();
    station.set_pings(false);
    station.run(20 * MS);
    station.greet();
    let second = station.client.hello().expect("hello").clone();
    assert_eq!(second.reset_cause, ResetCause::Pin);
    assert_ne!(first.session, second.session);
    assert_eq!(station.client.last_run().expect("last run").starts, 2);
}
