//! Life of a station, and its laws.

use crate::command::{Order, Settings};
use arbitrary::Arbitrary;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{
    Command, Config, LastRun, Outcome, Packet, Report, ResetCause,
};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::{Board, SEGMENT_US};
use trinocular_core::replay::{Event as Did, Probe, Station};
use trinocular_core::safety::{Fault, Inputs, State};
use trinocular_core::steps::{PortMap, WordRate};
use trinocular_core::time::Instant;

/// State of the station at the start.
#[derive(Arbitrary, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Just switched on.
    Off,
    /// With a usual configuration and a known position, the most frequent state.
    Ready,
}

/// Event in the life of the station.
#[derive(Arbitrary, Clone, Debug)]
pub enum Event {
    /// A valid packet, with the next sequence number.
    Order(Order),
    /// Any bytes.
    Bytes(Vec<u8>),
    /// Time passes, with a ping every 20 ms; unit 100 µs.
    Wait(u8),
    /// Time passes in silence, ms.
    Silence(u8),
    /// Switches change: limits as bits 0 to 5, driver fault bit 6, emergency stop bit 7.
    Switches(u8),
}

const MAP: PortMap = PortMap {
    step: [0, 1, 2],
    dir: [3, 4, 5],
    invert: [false; 3],
};
const RATE: WordRate = WordRate::MHZ_1;
const RING_WORDS: u32 = 512;

struct Life {
    station: Station,
    probe: Probe,
    reports: Receiver<Report>,
    sequence: u16,
    last_capture: Instant,
    /// Configurations that were sent and not answered yet.
    sent: Vec<(u16, Config)>,
    config: Option<Config>,
    /// Motor position minus the steps of the pins: changes only with the origin.
    origin: [i64; 3],
    pressed: bool,
}

/// Runs a station through `events`.
///
/// # Panics
/// If a law does not hold.
pub fn live(start: Start, events: &[Event]) {
    let board = Board {
        name: "fuzz",
        version: [0, 1, 0],
        word_rate: RATE,
        delay_us: RING_WORDS,
        session: 1,
        reset_cause: ResetCause::PowerOn,
        last_run: LastRun::UNKNOWN,
        camera_pin: Some(8),
    };
    let mut life = Life {
        station: Station::new(board, MAP, RING_WORDS).expect("the pins are possible"),
        probe: Probe::new(MAP),
        reports: Receiver::default(),
        sequence: 0,
        last_capture: Instant::default(),
        sent: Vec::new(),
        config: None,
        origin: [0; 3],
        pressed: false,
    };
    life.send(Command::Hello);
    if start == Start::Ready {
        life.send(Command::Config(Settings::default().config()));
        life.send(Command::Zero);
        life.pass(20_000);
        assert_eq!(life.station.machine().state(), State::Idle);
    }
    for event in events {
        life.meet(event);
    }
    life.pass(20_000);
}

impl Life {
    fn meet(&mut self, event: &Event) {
        match event {
            Event::Order(order) => {
                let now = self.station.now();
                let command = order.command(now, &mut self.last_capture);
                self.send(command);
            }
            Event::Bytes(bytes) => self.station.receive(bytes),
            Event::Wait(tenths) => {
                let mut left = u64::from(*tenths) * 100;
                while left > 0 {
                    let part = left.min(20_000);
                    self.send(Command::Ping { host_us: left });
                    self.pass(part);
                    left -= part;
                }
            }
            Event::Silence(ms) => self.pass(u64::from(*ms) * 1000),
            Event::Switches(bits) => {
                let bit = |n: u8| bits >> n & 1 == 1;
                self.pressed = bit(7);
                self.station.set_switches(Inputs {
                    limits: [[bit(0), bit(1)], [bit(2), bit(3)], [bit(4), bit(5)]],
                    driver_fault: bit(6),
                    emergency_stop: bit(7),
                    words_emitted: 0,
                    trigger_losses: 0,
                });
            }
        }
    }

    fn send(&mut self, command: Command) {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        if let Command::Config(config) = command {
            self.sent.push((sequence, config));
        }
        let bytes = encode(&Packet { sequence, command }).expect("every packet fits");
        self.station.receive(&bytes);
    }

    fn pass(&mut self, us: u64) {
        let end = self.station.now().plus_micros(us);
        let mut words = [0; 250];
        loop {
            match self.station.run(end, &mut words) {
                Did::Idle(_) => break,
                Did::Refused(fault) => panic!("a segment was refused: {fault}"),
                Did::Sent(bytes) => self.hear(&bytes),
                Did::Segment(_, filled) => self.judge(&words[..filled]),
            }
        }
    }

    fn hear(&mut self, bytes: &[u8]) {
        let mut left = bytes;
        let outcome = self.reports.next(&mut left);
        let report = outcome.expect("a whole packet").expect("a report");
        assert!(left.is_empty());
        if let Report::Answer {
            sequence, outcome, ..
        } = report
        {
            let known = self.sent.iter().position(|(sent, _)| *sent == sequence);
            if let Some(index) = known {
                let (_, config) = self.sent.remove(index);
                if outcome == Outcome::Accepted {
                    self.config = Some(config);
                }
            }
        }
    }

    fn judge(&mut self, words: &[u32]) {
        let before = self.probe.steps();
        let edges = self.probe.feed(words, |_, _, _| ());
        let machine = self.station.machine();
        let inverted = machine.inverted();
        let after = self.probe.steps();
        let made: [i64; 3] = core::array::from_fn(|axis| {
            let made = i64::from(after[axis].wrapping_sub(before[axis]));
            if inverted[axis] { -made } else { made }
        });
        let stands = machine.state() == State::Unconfigured
            || machine.fault() == Some(Fault::EmergencyStop) && self.pressed;
        if stands && machine.state() != State::Stopping {
            assert_eq!(edges.rises, [0; 3], "steps in {:?}", machine.state());
        }
        // Resting positions are whole numbers in the machine's position and half steps in the
        // motor's.
        let motor = machine.motors().map(|fine| (fine + (1 << 31)) >> 32);
        let origin = core::array::from_fn(|axis| motor[axis] - made[axis]);
        if made != [0; 3] {
            assert_eq!(
                origin, self.origin,
                "pins and plan differ by {made:?} steps"
            );
        }
        self.origin = motor;
        if let Some(config) = self.config {
            for (axis, steps) in config.axes.iter().zip(made) {
                let most = u64::from(axis.max_speed_um_s) * u64::from(axis.steps_per_m) / 1_000_000
                    * SEGMENT_US
                    / 1_000_000
                    + 2;
                assert!(
                    steps.unsigned_abs() <= most,
                    "{steps} steps, at most {most}"
                );
            }
        }
    }
}
