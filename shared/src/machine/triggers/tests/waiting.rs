//! Triggers that wait for a time without steps.

use super::*;

/// Period of the triggers, µs, and the longest wait.
const PERIOD_US: u64 = 50_000;
const WAIT_US: u64 = PERIOD_US / 16;

const WAITING: Trigger = Trigger {
    rate_hz: 20,
    pulse_us: 1_000,
    active_low: false,
    quiet_us: 1_500,
};

/// Returns a bench whose X axis goes 12 mm at this speed, with triggers.
fn moving(speed_um_s: u32, trigger: Trigger) -> Bench {
    let mut bench = Bench::new(Some(CAMERA));
    let mut config = config();
    config.axes[0].max_speed_um_s = speed_um_s;
    config.slow_speed_um_s = speed_um_s.min(5_000);
    assert_eq!(bench.ask(Command::Config(config)), ACCEPTED);
    bench.send(Command::Ping { host_us: 0 });
    assert_eq!(bench.ask(Command::Zero), ACCEPTED);
    assert_eq!(bench.ask(Command::Trigger(trigger)), ACCEPTED);
    let distance_um = [12_000, 0, 0];
    // The first trigger comes before the stage moves.
    bench.wait(20);
    assert_eq!(bench.ask(Command::Jog { distance_um }), ACCEPTED);
    bench
}

/// Returns the instants at which STEP of X rises.
fn steps(bench: &Bench) -> Vec<u64> {
    let mut before = 0;
    let mut steps = Vec::new();
    for (at, levels) in &bench.others {
        if levels & !before & 1 != 0 {
            steps.push(*at);
        }
        before = *levels;
    }
    steps
}

/// Returns the time by which each reported trigger came after it was due, and checks the reports.
fn waits_us(bench: &Bench, trigger: Trigger) -> Vec<u64> {
    let reported = instants(&bench.triggered);
    assert_eq!(bench.pulses(trigger)[..reported.len()], reported);
    assert!(reported.len() > 20);
    // The first did not wait.
    let waits = reported
        .iter()
        .zip(0..)
        .map(|(at, n)| at - reported[0] - n * PERIOD_US);
    for (n, triggered) in bench.triggered.iter().enumerate() {
        assert_eq!((triggered.number, triggered.lost), (n as u32 + 1, 0));
    }
    waits.collect()
}

fn exposures_with_steps(bench: &Bench, from_us: u64) -> usize {
    let steps = steps(bench);
    let (begin_us, end_us) = (steps[0] + from_us, steps[steps.len() - 1] - from_us);
    let in_motion = bench.triggered.iter().map(|it| it.instant.micros());
    let in_motion = in_motion.filter(|at| (begin_us..end_us).contains(at));
    let quiet_us = u64::from(WAITING.quiet_us);
    let disturbed = in_motion.filter(|at| {
        steps
            .iter()
            .any(|step| (*at..=at + quiet_us).contains(step))
    });
    disturbed.count()
}

/// At 4 mm/s and 80 steps/mm a step comes every 3.1 ms.
#[test]
fn exposures_of_slow_stage_have_no_step() {
    let mut waiting = moving(4_000, WAITING);
    waiting.wait(3_200);
    assert_eq!(exposures_with_steps(&waiting, 100_000), 0);
    let waits = waits_us(&waiting, WAITING);
    assert!(waits.iter().all(|wait| *wait <= WAIT_US), "{waits:?}");
    assert!(waits.iter().any(|wait| *wait > 0));
    let mut plain = moving(
        4_000,
        Trigger {
            quiet_us: 0,
            ..WAITING
        },
    );
    plain.wait(3_200);
    assert!(exposures_with_steps(&plain, 100_000) >= 10);
    assert!(waits_us(&plain, WAITING).iter().all(|wait| *wait == 0));
    assert_eq!(waiting.others, plain.others, "steps are the same");
}

/// At 40 mm/s there is no time without a step: each trigger comes at the end of its longest wait.
#[test]
fn triggers_of_fast_stage_come_late() {
    let mut bench = moving(40_000, WAITING);
    bench.wait(1_200);
    let steps = steps(&bench);
    let (begin, end) = (steps[0] + 20_000, steps[steps.len() - 1] - 20_000);
    let waits = waits_us(&bench, WAITING);
    let mut late = 0;
    for (triggered, wait_us) in bench.triggered.iter().zip(waits) {
        let at = triggered.instant.micros();
        if (begin..end).contains(&at) {
            assert!(wait_us.abs_diff(WAIT_US) <= 2, "{wait_us}");
            late += 1;
        } else if at < steps[0] - 20_000 || at > steps[steps.len() - 1] + 20_000 {
            assert_eq!(wait_us, 0);
        }
    }
    assert!(late >= 4, "{late}");
}

/// A shell that did not poll while a trigger waited did not give it.
#[test]
fn waiting_trigger_of_a_stall_is_lost() {
    for phase_us in (0..PERIOD_US).step_by(500) {
        let mut bench = moving(40_000, WAITING);
        bench.wait_us(100_000 + phase_us);
        let before = *bench.triggered.last().unwrap();
        bench.station.pass(bench.station.now().plus_micros(500_000));
        bench.wait(200);
        let after = *bench.triggered.last().unwrap();
        // Without steps behind the stall none waits.
        let due = (after.instant.since(before.instant) + WAIT_US + 4) / PERIOD_US;
        assert_eq!(
            u64::from(after.number - before.number + after.lost),
            due,
            "{phase_us}"
        );
        assert!((8..=12).contains(&after.lost), "{after:?}");
    }
}

#[test]
fn impossible_waits_are_refused_by_name() {
    let mut bench = Bench::new(Some(CAMERA));
    let mut ask = |rate_hz, pulse_us, quiet_us| {
        bench.ask(Command::Trigger(Trigger {
            rate_hz,
            pulse_us,
            active_low: false,
            quiet_us,
        }))
    };
    let (rate, pulse) = (Setting::TriggerRate, Setting::TriggerPulse);
    assert_eq!(ask(251, 100, 1), refused(rate, Bound::AtMost(250)));
    assert_eq!(ask(250, 3_500, 1), ACCEPTED);
    assert_eq!(ask(250, 3_501, 1), refused(pulse, Bound::AtMost(3_500)));
    assert_eq!(ask(1, 100, 50_000), ACCEPTED);
    let quiet = Setting::TriggerQuiet;
    assert_eq!(ask(1, 100, 50_001), refused(quiet, Bound::AtMost(50_000)));
}
