//! Homing as the pins and the switches see it: a carriage that the step edges move, and contacts
//! that bounce.

use crate::frame::encode::encode;
use crate::frame::message::{
    Command, Config, Denial, HomeSwitch, LastRun, MATRIX_BITS, Mounting, Outcome, Packet, Report,
    ResetCause, Side, StageConfig, Status,
};
use crate::frame::receive::Receiver;
use crate::machine::Board;
use crate::motion::AxisConfig;
use crate::replay::{Event, Probe, Station};
use crate::safety::{Fault, Inputs, State, Trust};
use crate::steps::{DriverTiming, PortMap, WordRate};
use crate::time::Instant;
use proptest::prelude::*;
use std::collections::VecDeque;

const MAP: PortMap = PortMap {
    step: [0, 1, 2],
    dir: [3, 4, 5],
    invert: [false; 3],
};

/// Words queued ahead of the pins: half a millisecond.
const RING: usize = 512;

/// Steps per mm.
const SCALE: i32 = 80;

fn config(stage: StageConfig) -> Config {
    let axis = AxisConfig {
        steps_per_m: 1000 * SCALE as u32,
        max_speed_um_s: 100_000,
        max_acceleration_um_s2: 2_000_000,
        max_jerk_um_s3: 50_000_000,
        travel_um: [-20_000, 20_000],
        invert: false,
    };
    let one = 1 << MATRIX_BITS;
    Config {
        axes: [axis; 3],
        matrix: [[one, 0, 0], [0, one, 0], [0, 0, one]],
        driver: DriverTiming::TMC2209,
        gate: crate::estimate::Gate::DEFAULT,
        heartbeat_ms: 100,
        slow_speed_um_s: 5_000,
        mounting: Mounting::OnStage,
        tracking: crate::track::pursuit::Settings::DEFAULT,
        stage,
    }
}

fn switches(sides: [Side; 3]) -> StageConfig {
    StageConfig {
        home: sides.map(|side| {
            let position_um = match side {
                Side::Negative => -21_000,
                Side::Positive => 21_000,
            };
            Some(HomeSwitch { side, position_um })
        }),
        ..StageConfig::DEFAULT
    }
}

/// Contact at `place` steps that opens beyond it, and bounces on every change.
#[derive(Clone, Copy, Debug)]
struct Contact {
    side: Side,
    place: i32,
    /// Duration of a bounce, ms.
    bounce: u8,
    /// Level of a contact that never opens or never closes.
    stuck: Option<bool>,
    was: bool,
    left: u8,
}

impl Contact {
    fn new(side: Side, place: i32, bounce: u8) -> Self {
        Self {
            side,
            place,
            bounce,
            stuck: None,
            was: false,
            left: 0,
        }
    }

    fn sample(&mut self, at: i32, dice: u64) -> bool {
        let open = match self.side {
            Side::Negative => at <= self.place,
            Side::Positive => at >= self.place,
        };
        if open != self.was {
            self.was = open;
            self.left = self.bounce;
        }
        self.left = self.left.saturating_sub(1);
        match self.stuck {
            Some(stuck) => stuck,
            None if self.left > 0 => dice & 1 == 1,
            None => open,
        }
    }
}

struct Bench {
    station: Station,
    probe: Probe,
    /// Words that are queued and not on the pins yet.
    ring: VecDeque<u32>,
    reports: Receiver<Report>,
    sequence: u16,
    contacts: [Contact; 3],
    /// Load that the motors push, with its backlash, steps.
    load: [i32; 3],
    loose: [i32; 3],
    /// Position of the carriage at the start, steps from the middle of the rails.
    start: [i32; 3],
    dice: u64,
    pings: bool,
    others: Inputs,
    status: Option<Status>,
    denial: Option<Denial>,
}

impl Bench {
    fn new(stage: StageConfig, start: [i32; 3], bounce: u8) -> Self {
        let board = Board {
            name: "bench",
            version: [0, 1, 0],
            word_rate: WordRate::MHZ_1,
            delay_us: RING as u32,
            session: 1,
            reset_cause: ResetCause::PowerOn,
            last_run: LastRun::UNKNOWN,
            camera_pin: None,
        };
        let contact = |home: Option<HomeSwitch>| {
            let side = home.map_or(Side::Negative, |home| home.side);
            let place = match side {
                Side::Negative => -1_680,
                Side::Positive => 1_680,
            };
            Contact::new(side, place, bounce)
        };
        let mut bench = Self {
            station: Station::new(board, MAP, RING as u32).unwrap(),
            probe: Probe::new(MAP),
            ring: std::iter::repeat_n(0, RING).collect(),
            reports: Receiver::default(),
            sequence: 0,
            contacts: stage.home.map(contact),
            load: start,
            loose: [0; 3],
            start,
            dice: 88_172_645_463_325_252,
            pings: true,
            others: Inputs::default(),
            status: None,
            denial: None,
        };
        bench.send(Command::Hello);
        bench.send(Command::Config(config(stage)));
        bench.wait(5);
        bench
    }

    fn send(&mut self, command: Command) {
        self.sequence += 1;
        let sequence = self.sequence;
        let packet = Packet { sequence, command };
        self.station.receive(&encode(&packet).unwrap());
    }

    /// Sends a command and returns the station's denial, if any.
    fn ask(&mut self, command: Command) -> Option<Denial> {
        self.denial = None;
        self.send(command);
        self.wait(3);
        self.denial
    }

    fn home(&mut self, axes: [bool; 3]) -> Option<Denial> {
        self.ask(Command::Home { axes })
    }

    fn motor(&self) -> [i32; 3] {
        let steps = self.probe.steps();
        std::array::from_fn(|axis| self.start[axis] + steps[axis])
    }

    fn wait(&mut self, ms: u32) {
        let mut made = [0; 250];
        for tick in 0..ms {
            if self.pings && tick % 20 == 0 {
                self.send(Command::Ping { host_us: 0 });
            }
            let end = Instant::from_micros((self.station.now().micros() / 1000 + 1) * 1000);
            // The pins advance by a millisecond, in which no axis reverses twice.
            let words = self.ring.make_contiguous();
            let count = words.len().min(1000);
            self.probe.feed(&words[..count], |_, _, _| ());
            self.ring.drain(..count);
            let motor = self.motor();
            for (axis, load) in self.load.iter_mut().enumerate() {
                *load = (*load).clamp(motor[axis], motor[axis] + self.loose[axis]);
            }
            let mut limits = self.others.limits;
            for (axis, contact) in self.contacts.iter_mut().enumerate() {
                self.dice ^= self.dice << 13;
                self.dice ^= self.dice >> 7;
                self.dice ^= self.dice << 17;
                limits[axis][contact.side as usize] |=
                    contact.sample(self.load[axis], self.dice >> 20);
            }
            self.station.set_switches(Inputs {
                limits,
                ..self.others
            });
            loop {
                match self.station.run(end, &mut made) {
                    Event::Idle(_) => break,
                    Event::Refused(fault) => panic!("{fault}"),
                    Event::Segment(_, filled) => self.ring.extend(&made[..filled]),
                    Event::Sent(bytes) => self.hear(&bytes),
                }
            }
        }
    }

    fn hear(&mut self, mut bytes: &[u8]) {
        match self.reports.next(&mut bytes).unwrap().unwrap() {
            Report::Status(status) => self.status = Some(status),
            Report::Answer {
                outcome: Outcome::Denied(denial),
                ..
            } => self.denial = Some(denial),
            _ => {}
        }
    }

    fn status(&mut self) -> Status {
        self.wait(101);
        self.status.unwrap()
    }

    /// Waits for the end of the search.
    fn finish(&mut self) -> Status {
        for _ in 0..300 {
            let status = self.status();
            if !status.state.is_moving() {
                return status;
            }
        }
        panic!("it never ends: {:?}", self.status);
    }

    /// Returns the station's error, steps: its position minus that of the load.
    fn error(&mut self) -> [i32; 3] {
        let says = self.status().position_steps;
        std::array::from_fn(|axis| says[axis] - self.load[axis])
    }
}

fn sides() -> impl Strategy<Value = [Side; 3]> {
    let side = prop_oneof![Just(Side::Negative), Just(Side::Positive)];
    [side.clone(), side.clone(), side]
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: ProptestConfig::default().cases.min(48),
        ..ProptestConfig::default()
    })]

    /// From anywhere on the rails, on the switch too: the coordinate is right, with bouncing
    /// contacts and backlash as well.
    #[test]
    fn coordinate_is_the_same_from_any_start(
        sides in sides(), start in prop::array::uniform3(-1_750..1_750i32), bounce in 0..12u8,
        backlash in prop::array::uniform3(0..3u16),
    ) {
        let backlash_um = backlash.map(|b| b * 50);
        let stage = StageConfig { backlash_um, ..switches(sides) };
        let mut bench = Bench::new(stage, start, bounce);
        bench.loose = backlash_um.map(|um| i32::from(um) * SCALE / 1000);
        prop_assert_eq!(bench.home([true; 3]), None);
        prop_assert_eq!(bench.status().state, State::Homing);
        let end = bench.finish();
        prop_assert_eq!((end.state, end.fault, end.trust), (State::Idle, None, Trust::Homed));
        // 1 mm/s is 0.08 steps a tick; a bouncing contact is steady some ticks later.
        for error in bench.error() {
            prop_assert!(error.abs() <= 1 + i32::from(bounce) / 8, "{} steps off", error);
        }
        // The coordinate is right: the load moves to the middle of the rails.
        prop_assert_eq!(bench.ask(Command::Setpoint { position_um: [0, 5_000, -5_000] }), None);
        let end = bench.finish();
        prop_assert_eq!(end.position_steps, [0, 400, -400]);
        for error in bench.error() {
            prop_assert!(error.abs() <= 1 + i32::from(bounce) / 8, "{} steps off", error);
        }
    }

    /// A stop, a heartbeat timeout or the emergency stop at any moment ends the search, and no
    /// motion restarts by itself.
    #[test]
    fn homing_ends_at_any_moment(after in 0..9_000u32, how in 0..3u8) {
        let mut bench = Bench::new(switches([Side::Negative; 3]), [0; 3], 3);
        prop_assert_eq!(bench.home([true; 3]), None);
        bench.wait(after);
        prop_assume!(bench.status().state == State::Homing);
        let fault = match how {
            0 => {
                bench.send(Command::Stop);
                None
            }
            1 => {
                bench.pings = false;
                Some(Fault::Heartbeat)
            }
            _ => {
                bench.others.emergency_stop = true;
                Some(Fault::EmergencyStop)
            }
        };
        bench.wait(400);
        bench.others.emergency_stop = false;
        bench.pings = true;
        let stood = bench.motor();
        let end = bench.status();
        let state = if fault.is_some() { State::Faulted } else { State::Stopped };
        prop_assert_eq!((end.state, end.fault, end.trust), (state, fault, Trust::Unknown));
        bench.wait(1_000);
        prop_assert_eq!(bench.motor(), stood);
        prop_assert_eq!(bench.ask(Command::Reset), None);
        prop_assert_eq!(bench.home([true; 3]), None);
        prop_assert_eq!(bench.finish().trust, Trust::Homed);
        for error in bench.error() {
            prop_assert!(error.abs() <= 1, "{} steps off", error);
        }
    }
}

#[test]
fn missing_switch_is_a_fault() {
    let mut bench = Bench::new(switches([Side::Negative; 3]), [0; 3], 0);
    bench.contacts[0].stuck = Some(false);
    assert_eq!(bench.home([true, false, false]), None);
    let end = bench.finish();
    assert_eq!(
        (end.state, end.fault, end.trust),
        (State::Faulted, Some(Fault::SwitchNotFound), Trust::Unknown)
    );
    // Five quarters of 40 mm and the back-off of 2 mm.
    assert_eq!(bench.motor(), [-52 * SCALE, 0, 0]);
    assert_eq!(bench.home([true, false, false]), Some(Denial::Faulted));
}

#[test]
fn stuck_switch_is_a_fault() {
    let mut bench = Bench::new(switches([Side::Positive; 3]), [0; 3], 0);
    bench.contacts[2].stuck = Some(true);
    assert_eq!(bench.home([true, true, true]), None);
    let end = bench.finish();
    assert_eq!(
        (end.state, end.fault, end.trust),
        (State::Faulted, Some(Fault::SwitchStuck), Trust::Unknown)
    );
    // Z comes first and moves in the right direction.
    assert_eq!(bench.motor(), [0, 0, -2 * SCALE]);
}

#[test]
fn endless_bounce_is_a_fault() {
    let mut bench = Bench::new(switches([Side::Negative; 3]), [-1_700, 0, 0], u8::MAX);
    assert_eq!(bench.home([true, false, false]), None);
    assert_eq!(bench.finish().fault, Some(Fault::SwitchStuck));
    assert_eq!(bench.motor()[1..], [0, 0]);
}

#[test]
fn other_switches_stop_the_search() {
    let mut bench = Bench::new(switches([Side::Negative; 3]), [0; 3], 0);
    assert_eq!(bench.home([true; 3]), None);
    bench.wait(500);
    // Z moves backwards: its other end is behind it, and X is at rest.
    bench.others.limits = [[true, true], [false; 2], [false, true]];
    bench.wait(200);
    assert_eq!(bench.status().state, State::Homing);
    bench.others.limits = [[false; 2]; 3];
    assert_eq!(bench.finish().trust, Trust::Homed);
    // Backing off from its switch, it meets the other end.
    assert_eq!(bench.home([false, false, true]), None);
    while bench.status().position_steps[2] > -1_650 {}
    bench.others.limits[2] = [false, true];
    let end = bench.finish();
    assert_eq!(
        (end.fault, end.trust),
        (Some(Fault::Limit), Trust::Degraded)
    );
}

#[test]
fn homing_needs_switch_and_rest() {
    let stage = StageConfig {
        home: [switches([Side::Negative; 3]).home[0], None, None],
        ..StageConfig::DEFAULT
    };
    let mut bench = Bench::new(stage, [0; 3], 0);
    assert_eq!(bench.home([true, true, false]), Some(Denial::NoHomeSwitch));
    assert_eq!(bench.home([false; 3]), Some(Denial::NoHomeSwitch));
    assert_eq!(
        bench.ask(Command::Jog {
            distance_um: [5_000, 0, 0]
        }),
        None
    );
    assert_eq!(bench.home([true, false, false]), Some(Denial::Moving));
    bench.finish();
    assert_eq!(bench.home([true, false, false]), None);
    for command in [
        Command::Zero,
        Command::Jog {
            distance_um: [100; 3],
        },
        Command::Home { axes: [true; 3] },
    ] {
        assert!(bench.ask(command).is_some(), "{command:?}");
    }
    // One axis of three: the others stay unknown until they are zeroed.
    assert_eq!(bench.finish().trust, Trust::Unknown);
    assert_eq!(bench.ask(Command::Zero), None);
    assert_eq!(bench.home([true, false, false]), None);
    let end = bench.finish();
    assert_eq!((end.trust, end.fault), (Trust::Homed, None));
    assert_eq!(end.position_steps, [-19 * SCALE, 0, 0]);
    assert_eq!(bench.load[0], -19 * SCALE);
}

/// Lost steps appear as a shift of the origin when the axis is homed again.
#[test]
fn homing_again_corrects_lost_steps() {
    let mut bench = Bench::new(switches([Side::Positive; 3]), [100, 200, -300], 2);
    assert_eq!(bench.home([true; 3]), None);
    bench.finish();
    assert_eq!(bench.error(), [0; 3]);
    // An external force pushes the carriage.
    bench.start[1] += 37;
    bench.load[1] += 37;
    assert_eq!(bench.error(), [0, -37, 0]);
    assert_eq!(bench.home([false, true, false]), None);
    bench.finish();
    assert_eq!(bench.error(), [0; 3]);
}

#[test]
fn unknown_position_keeps_the_window() {
    let mut bench = Bench::new(switches([Side::Negative; 3]), [0; 3], 0);
    let jog = |x| Command::Jog {
        distance_um: [x, 0, 0],
    };
    assert_eq!(bench.ask(jog(10_010)), Some(Denial::OutsideWindow));
    assert_eq!(bench.ask(jog(6_000)), None);
    bench.finish();
    assert_eq!(bench.ask(jog(6_000)), Some(Denial::OutsideWindow));
    assert_eq!(bench.ask(jog(4_000)), None);
    bench.finish();
    assert_eq!(bench.ask(jog(-20_000)), None);
    let end = bench.finish();
    assert_eq!(end.position_steps, [-10 * SCALE, 0, 0]);
    assert_eq!(bench.ask(Command::Zero), None);
    assert_eq!(bench.ask(jog(20_000)), None);
    assert_eq!(bench.finish().position_steps, [20 * SCALE, 0, 0]);
    // An abrupt stop, and a window around its place.
    assert_eq!(bench.ask(jog(-30_000)), None);
    bench.wait(100);
    bench.others.emergency_stop = true;
    bench.wait(10);
    bench.others.emergency_stop = false;
    bench.wait(10);
    assert_eq!(bench.ask(Command::Reset), None);
    assert_eq!(bench.status().trust, Trust::Degraded);
    assert_eq!(bench.ask(jog(10_100)), Some(Denial::OutsideWindow));
    assert_eq!(bench.ask(jog(9_900)), None);
}
