//! Triggers as a logic analyser at the port sees them, beside the station's reports.

mod waiting;

use crate::frame::encode::encode;
use crate::frame::message::{
    Command, Config, ConfigField, Denial, LastRun, MATRIX_BITS, Mounting, Outcome, Packet, Report,
    ResetCause, Setting, StageConfig, Status, Trigger, Triggered,
};
use crate::frame::receive::Receiver;
use crate::machine::Board;
use crate::motion::{AxisConfig, Bound};
use crate::replay::{Event, Probe, Station};
use crate::safety::{Fault, Inputs, State};
use crate::steps::{DriverTiming, PortMap, WordRate};
use proptest::prelude::*;
use std::vec::Vec;

const MAP: PortMap = PortMap {
    step: [0, 1, 2],
    dir: [3, 4, 5],
    invert: [false; 3],
};

const CAMERA: u8 = 8;

/// Words queued ahead of the pins.
const RING: u32 = 512;

const TRIGGER: Trigger = Trigger {
    rate_hz: 60,
    pulse_us: 2_000,
    active_low: false,
    quiet_us: 0,
};

fn config() -> Config {
    let axis = AxisConfig {
        steps_per_m: 80_000,
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
        heartbeat_ms: 10_000,
        slow_speed_um_s: 5_000,
        mounting: Mounting::OnStage,
        tracking: crate::track::pursuit::Settings::DEFAULT,
        stage: StageConfig::DEFAULT,
    }
}

struct Bench {
    station: Station,
    probe: Probe,
    reports: Receiver<Report>,
    sequence: u16,
    /// Changes of the camera pin: instant, level.
    camera: Vec<(u64, bool)>,
    /// Changes of all other pins.
    others: Vec<(u64, u32)>,
    triggered: Vec<Triggered>,
    status: Option<Status>,
    outcome: Option<Outcome>,
}

impl Bench {
    fn new(camera_pin: Option<u8>) -> Self {
        let board = Board {
            name: "bench",
            version: [0, 1, 0],
            word_rate: WordRate::MHZ_1,
            delay_us: RING,
            session: 1,
            reset_cause: ResetCause::PowerOn,
            last_run: LastRun::UNKNOWN,
            camera_pin,
        };
        let mut bench = Self {
            station: Station::new(board, MAP, RING).unwrap(),
            probe: Probe::new(MAP),
            reports: Receiver::default(),
            sequence: 0,
            camera: Vec::new(),
            others: Vec::new(),
            triggered: Vec::new(),
            status: None,
            outcome: None,
        };
        bench.send(Command::Hello);
        bench.wait(5);
        bench
    }

    fn send(&mut self, command: Command) {
        self.sequence += 1;
        let sequence = self.sequence;
        let packet = Packet { sequence, command };
        self.station.receive(&encode(&packet).unwrap());
    }

    fn ask(&mut self, command: Command) -> Outcome {
        self.outcome = None;
        self.send(command);
        self.wait(3);
        self.outcome.unwrap()
    }

    fn wait(&mut self, ms: u64) {
        self.wait_us(1_000 * ms);
    }

    fn wait_us(&mut self, us: u64) {
        let end = self.station.now().plus_micros(us);
        let mut words = [0; 250];
        loop {
            match self.station.run(end, &mut words) {
                Event::Idle(_) => return,
                Event::Refused(fault) => panic!("{fault}"),
                Event::Segment(_, filled) => self.play(&words[..filled]),
                Event::Sent(bytes) => self.hear(&bytes),
            }
        }
    }

    fn play(&mut self, words: &[u32]) {
        // A segment is handed out when it is due, at a multiple of 250 µs.
        let due = self.station.now().micros() / 250 * 250;
        let first = due + u64::from(RING);
        let (camera, others) = (&mut self.camera, &mut self.others);
        self.probe.feed(words, |word, before, after| {
            let (at, mask) = (first + word as u64, 1 << CAMERA);
            if (before ^ after) & mask != 0 {
                camera.push((at, after & mask != 0));
            }
            if (before ^ after) & !mask != 0 {
                others.push((at, after & !mask));
            }
        });
    }

    fn hear(&mut self, mut bytes: &[u8]) {
        match self.reports.next(&mut bytes).unwrap().unwrap() {
            Report::Status(status) => self.status = Some(status),
            Report::Answer { outcome, .. } => self.outcome = Some(outcome),
            Report::Triggered(triggered) => self.triggered.push(triggered),
            _ => {}
        }
    }

    /// Returns the instants at which pulses began, and checks the length of each.
    fn pulses(&self, trigger: Trigger) -> Vec<u64> {
        let begins = |change: &&(u64, bool)| change.1 != trigger.active_low;
        let first = self.camera.iter().position(|change| begins(&change));
        let pulses = self.camera[first.unwrap_or(self.camera.len())..].chunks(2);
        pulses
            .map(|pulse| {
                assert!(begins(&&pulse[0]));
                if let [(begin, _), (end, _)] = pulse {
                    assert_eq!(end - begin, u64::from(trigger.pulse_us));
                }
                pulse[0].0
            })
            .collect()
    }
}

fn instants(triggered: &[Triggered]) -> Vec<u64> {
    triggered.iter().map(|t| t.instant.micros()).collect()
}

const ACCEPTED: Outcome = Outcome::Accepted;

fn refused(setting: Setting, bound: Bound) -> Outcome {
    let axis = None;
    Outcome::Denied(Denial::Config(ConfigField::Value {
        setting,
        axis,
        bound,
    }))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Every pulse is reported with its instant to the microsecond, and no rounding adds up.
    #[test]
    fn pulses_are_where_reports_say(rate_hz in 1..=1000u16, part in 0.0..1.0f64, active_low: bool) {
        let longest = 1_000_000 / u32::from(rate_hz) - 250;
        let pulse_us = (10 + ((longest - 10) as f64 * part) as u32) / 2 * 2;
        let trigger = Trigger { rate_hz, pulse_us, active_low, quiet_us: 0 };
        let mut bench = Bench::new(Some(CAMERA));
        prop_assert_eq!(bench.ask(Command::Trigger(trigger)), ACCEPTED);
        bench.wait(2_020);
        let pulses = bench.pulses(trigger);
        let triggered = core::mem::take(&mut bench.triggered);
        let reported = instants(&triggered);
        prop_assert!(pulses.len() - reported.len() <= 3);
        prop_assert_eq!(&pulses[..reported.len()], &reported[..]);
        prop_assert!(reported.len() >= 2 * usize::from(rate_hz));
        for (n, triggered) in triggered.iter().enumerate() {
            prop_assert_eq!((triggered.number, triggered.lost), (n as u32 + 1, 0));
            let due = reported[0] - 1 + n as u64 * 1_000_000 / u64::from(rate_hz);
            prop_assert!(triggered.instant.micros().abs_diff(due) <= 1, "{n}");
        }
    }

    /// Triggers of any kind change no edge of STEP and DIR.
    #[test]
    fn steps_are_the_same_with_triggers(
        rate_hz in 1..=1000u16, active_low: bool, distance_um: [i16; 3], after_ms in 0..40u64,
        quiet_us in 0..4_000u32,
    ) {
        let quiet_us = if rate_hz > 250 { 0 } else { quiet_us };
        let run = |rate_hz| {
            let mut bench = Bench::new(Some(CAMERA));
            let trigger = Trigger { rate_hz, pulse_us: 500, active_low, quiet_us };
            assert_eq!(bench.ask(Command::Config(config())), ACCEPTED);
            bench.send(Command::Ping { host_us: 0 });
            let distance_um = distance_um.map(|um| i32::from(um) / 4);
            assert_eq!(bench.ask(Command::Jog { distance_um }), ACCEPTED);
            bench.wait(after_ms);
            assert_eq!(bench.ask(Command::Trigger(trigger)), ACCEPTED);
            bench.wait(300);
            (bench.others, bench.camera.len())
        };
        let (without, none) = run(0);
        let (with, pulses) = run(rate_hz);
        prop_assert!(none <= 1 && (rate_hz < 5 || pulses > 0));
        prop_assert_eq!(without, with);
    }
}

/// Triggers move nothing: they need no configuration, and survive stop and fault.
#[test]
fn triggers_go_on_when_stopped_and_faulted() {
    let mut bench = Bench::new(Some(CAMERA));
    assert_eq!(bench.ask(Command::Trigger(TRIGGER)), ACCEPTED);
    bench.wait(200);
    assert_eq!(bench.status.unwrap().state, State::Unconfigured);
    assert_eq!(bench.ask(Command::Config(config())), ACCEPTED);
    assert_eq!(bench.ask(Command::Stop), ACCEPTED);
    bench.wait(200);
    assert_eq!(bench.status.unwrap().state, State::Stopped);
    bench.station.set_switches(Inputs {
        emergency_stop: true,
        ..Inputs::default()
    });
    bench.wait(600);
    assert_eq!(bench.status.unwrap().fault, Some(Fault::EmergencyStop));
    let reported = instants(&bench.triggered);
    assert_eq!(bench.pulses(TRIGGER)[..reported.len()], reported);
    assert!(reported.len() >= 59, "{}", reported.len());
    assert_eq!(bench.triggered.last().unwrap().lost, 0);
    // Off: the last pulse ends, and none follows.
    assert_eq!(bench.ask(Command::Trigger(Trigger::OFF)), ACCEPTED);
    let before = bench.camera.len();
    bench.wait(100);
    assert_eq!(bench.camera.len(), before);
    assert!(bench.camera.last().is_none_or(|change| !change.1));
}

#[test]
fn restarted_triggers_are_numbered_anew() {
    let mut bench = Bench::new(Some(CAMERA));
    assert_eq!(bench.ask(Command::Trigger(TRIGGER)), ACCEPTED);
    bench.wait(100);
    assert!(bench.triggered.last().unwrap().number >= 4);
    bench.triggered.clear();
    let low = Trigger {
        active_low: true,
        ..TRIGGER
    };
    assert_eq!(bench.ask(Command::Trigger(low)), ACCEPTED);
    let before = bench.camera.len();
    assert!(bench.camera.last().unwrap().1, "at rest the pin is high");
    bench.wait(40);
    assert_eq!(bench.triggered.first().unwrap().number, 1);
    let (begin, level) = bench.camera[before];
    assert_eq!((begin, level), (bench.triggered[0].instant.micros(), false));
}

#[test]
fn impossible_settings_are_refused_by_name() {
    let mut bench = Bench::new(Some(CAMERA));
    let mut ask = |rate_hz, pulse_us| {
        bench.ask(Command::Trigger(Trigger {
            rate_hz,
            pulse_us,
            active_low: false,
            quiet_us: 0,
        }))
    };
    let (rate, pulse) = (Setting::TriggerRate, Setting::TriggerPulse);
    assert_eq!(ask(1_001, 10), refused(rate, Bound::AtMost(1_000)));
    assert_eq!(ask(1_000, 9), refused(pulse, Bound::AtLeast(10)));
    assert_eq!(ask(1_000, 750), ACCEPTED);
    assert_eq!(ask(1_000, 751), refused(pulse, Bound::AtMost(750)));
    assert_eq!(ask(1, 999_750), ACCEPTED);
    assert_eq!(ask(1, u32::MAX), refused(pulse, Bound::AtMost(999_750)));
    let mut bench = Bench::new(None);
    let denied = Outcome::Denied(Denial::NoCameraPin);
    assert_eq!(bench.ask(Command::Trigger(TRIGGER)), denied);
}

/// A shell that did not poll for a while gave no triggers meanwhile.
#[test]
fn triggers_of_a_stall_are_counted_as_lost() {
    let mut bench = Bench::new(Some(CAMERA));
    assert_eq!(bench.ask(Command::Trigger(TRIGGER)), ACCEPTED);
    bench.wait(100);
    let before = *bench.triggered.last().unwrap();
    bench.station.pass(bench.station.now().plus_micros(500_000));
    bench.wait(100);
    let after = *bench.triggered.last().unwrap();
    let us = after.instant.since(before.instant);
    let due = (us * 60 + 500_000) / 1_000_000;
    let given = after.number - before.number;
    assert_eq!(u64::from(given + after.lost), due);
    assert!((29..=31).contains(&after.lost), "{after:?}");
}

#[test]
fn triggers_lost_by_the_engine_get_no_number() {
    let mut bench = Bench::new(Some(CAMERA));
    let fast = Trigger {
        rate_hz: 1_000,
        pulse_us: 100,
        active_low: false,
        quiet_us: 0,
    };
    assert_eq!(bench.ask(Command::Trigger(fast)), ACCEPTED);
    bench.wait(50);
    let before = *bench.triggered.last().unwrap();
    assert_eq!(before.lost, 0);
    bench.station.set_switches(Inputs {
        trigger_losses: 1,
        ..Inputs::default()
    });
    bench.wait(50);
    let after = *bench.triggered.last().unwrap();
    assert!((1..=3).contains(&after.lost), "{after:?}");
    let due = after.instant.since(before.instant) / 1_000;
    assert_eq!(u64::from(after.number - before.number + after.lost), due);
}

/// The engine loses what stands in the ring at any time between two control ticks.
#[test]
fn lost_trigger_is_never_reported() {
    // At every phase of the ticks.
    let fast = Trigger {
        rate_hz: 907,
        pulse_us: 100,
        active_low: false,
        quiet_us: 0,
    };
    for phase_us in (0..20_000).step_by(90) {
        let mut bench = Bench::new(Some(CAMERA));
        assert_eq!(bench.ask(Command::Trigger(fast)), ACCEPTED);
        bench.wait_us(50_000 + phase_us);
        let lost_us = bench.station.now().micros();
        bench.station.set_switches(Inputs {
            trigger_losses: 1,
            ..Inputs::default()
        });
        bench.wait(50);
        let lost_us = lost_us..=lost_us + u64::from(RING);
        let instants = bench.triggered.iter().map(|it| it.instant.micros());
        let reported: Vec<u64> = instants.filter(|at| lost_us.contains(at)).collect();
        assert!(
            reported.is_empty(),
            "{phase_us}: {reported:?} of {lost_us:?}"
        );
        assert!(bench.triggered.last().is_some_and(|it| it.lost > 0));
    }
}
