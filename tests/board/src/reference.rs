//! Reference for the station: the twin's code, on the host, with the inputs that the board
//! reported.
//!
//! The board names the control tick at which each command took effect, and the instant of each
//! ping. A [`Replay`] gets the same inputs, tick for tick, and the two must agree in every report,
//! every edge and every microsecond.

use crate::station::{Sent, Station};
use crate::time::{Beats, MS, US};
use crate::wiring::{CAMERA_PIN, STEPPER_MASK, STEPPERS};
use trinocular_core::frame::message::{Command, Report, Triggered};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::{Board, TICK_US};
use trinocular_core::replay::{Entry, Event, Log, Replay, Station as Machine, Trace, Writer};
use trinocular_core::steps::WordRate;
use trinocular_core::time::Instant;

/// Run of the twin.
#[derive(Debug, Default)]
struct Expected {
    /// Reports of the twin, with their instants, µs of the station's clock.
    reports: Vec<(u64, Report)>,
    /// Edges of its pins: µs of the station's clock, and the levels afterwards.
    edges: Vec<(u64, u16)>,
}

/// Returns the log of the inputs: each packet at the moment of the station's clock, after the tick
/// before its effect, that answers and pongs state.
fn log(station: &mut Station, end_us: u64) -> Vec<u8> {
    let zero = station.clock_zero();
    let mut bytes = Vec::new();
    let mut writer = Writer(|part: &[u8]| bytes.extend_from_slice(part));
    let mut last = 0;
    for sent in &station.sent {
        let arrived = sent.at.saturating_sub(zero) / US;
        let at = effect_us(&station.reports, sent)
            .map_or(arrived, |(first, last)| arrived.clamp(first, last));
        last = at.max(last);
        writer.entry(Instant::from_micros(last), Entry::Bytes(&sent.bytes));
    }
    writer.entry(Instant::from_micros(end_us), Entry::Wait);
    bytes
}

/// Returns the moments between which the station had a packet, µs, by its own reports.
fn effect_us(reports: &[(Beats, Report)], sent: &Sent) -> Option<(u64, u64)> {
    // A ping is stamped on arrival, and may reach the machine after a tick that comes right then:
    // its pong follows the reports of that tick.
    let mut said_us = 0;
    for (_, report) in reports {
        match (report, sent.command) {
            (Report::Answer { sequence, tick, .. }, _) if *sequence == sent.sequence => {
                let tick_us = u64::from(*tick) * TICK_US;
                return Some((tick_us.saturating_sub(TICK_US) + 1, tick_us));
            }
            (
                Report::Pong {
                    host_us, received, ..
                },
                Command::Ping { host_us: asked },
            ) if *host_us == asked => {
                let at = received.micros().max(said_us);
                return Some((at, at));
            }
            (Report::Answer { tick, .. }, _) => said_us = u64::from(*tick) * TICK_US + 1,
            (Report::Status(status), _) => said_us = status.time.micros() + 1,
            (Report::Triggered(triggered), _) => said_us = trigger_tick_us(triggered) + 1,
            _ => {}
        }
    }
    None
}

/// Returns the moment of the control tick that reports a trigger: the first one by which the step
/// engine has certainly played it.
fn trigger_tick_us(triggered: &Triggered) -> u64 {
    let certain_us = triggered.instant.micros() + Triggered::REPORTED_AFTER_US;
    certain_us.next_multiple_of(TICK_US)
}

/// Runs the twin with the board's inputs, up to `end_us` of the station's clock.
///
/// # Panics
/// If the board never sent a hello.
fn expected(station: &mut Station, end_us: u64) -> Expected {
    let (hello, last_run) = (station.client.hello(), station.client.last_run());
    let (hello, last_run) = hello.zip(last_run).expect("it said hello");
    assert_eq!(hello.board, "olimex-h405");
    let board = Board {
        name: "olimex-h405",
        version: hello.version,
        word_rate: WordRate::MHZ_1,
        delay_us: hello.delay_us,
        session: hello.session,
        reset_cause: hello.reset_cause,
        last_run: *last_run,
        camera_pin: Some(CAMERA_PIN),
    };
    let delay_us = hello.delay_us;
    let log = log(station, end_us);
    let machine = Machine::new(board, STEPPERS, delay_us).expect("possible pins");
    let mut replay = Replay::new(machine, Log::new(&log)).expect("a whole log");
    let mut trace = Trace::new(STEPPERS);
    let mut words = [0; 2 * WordRate::MHZ_1.slots_per_segment() as usize];
    let mut expected = Expected::default();
    let mut before = 0;
    let mut receiver = Receiver::<Report>::default();
    while let Some((at, event)) = replay.step(&mut words).expect("a whole log") {
        match event {
            Event::Sent(bytes) => {
                let report = receiver.next(&mut &bytes[..]);
                let report = report.expect("a whole packet").expect("a sound packet");
                expected.reports.push((at.micros(), report));
            }
            Event::Segment(plan, filled) => {
                let first = at.micros() + u64::from(delay_us);
                trace.digest(&plan, &words[..filled], |edge| {
                    let at = first + u64::from(edge.word);
                    let levels = edge.pins & STEPPER_MASK;
                    // The camera pin changes without them.
                    if levels != before {
                        expected.edges.push((at, levels));
                    }
                    before = levels;
                });
            }
            Event::Refused(fault) => panic!("at {at:?}: {fault}"),
            Event::Idle(_) => {}
        }
    }
    expected
}

/// Returns a report without the parts that depend on the processor's speed: a pong's stamps, which
/// [`pongs_are_prompt`] checks.
fn comparable(report: &Report) -> Report {
    match report {
        Report::Pong { host_us, .. } => Report::Pong {
            host_us: *host_us,
            received: Instant::default(),
            sent: Instant::default(),
        },
        other => other.clone(),
    }
}

/// Checks that a ping is stamped within two milliseconds of its last byte, and its pong within two
/// of that.
fn pongs_are_prompt(station: &mut Station) {
    let zero = station.clock_zero();
    for (_, report) in &station.reports {
        let Report::Pong {
            host_us,
            received,
            sent,
        } = report
        else {
            continue;
        };
        let asked =
            |sent: &&Sent| matches!(sent.command, Command::Ping { host_us: us } if us == *host_us);
        let ping = station.sent.iter().find(asked).expect("a ping was sent");
        let arrived = (ping.at - zero) / US;
        let (received, sent) = (received.micros(), sent.micros());
        assert!(
            (arrived..arrived + 2_000).contains(&received),
            "{arrived} {report:?}"
        );
        assert!((received..received + 2_000).contains(&sent), "{report:?}");
    }
}

/// Longest time from a control tick to the end of its report on the line, µs.
const ON_THE_LINE_US: u64 = 3_000;

/// Checks that the twin reports and does the same as the board with the same inputs. Returns the
/// numbers of reports and edges.
///
/// # Panics
/// If anything differs, with the difference.
pub fn agreement(station: &mut Station) -> (usize, usize) {
    // Reports on their way and words in the ring still come.
    station.set_pings(false);
    station.run(3 * MS);
    let zero = station.clock_zero();
    let end_us = station.clock_us();
    let expected = expected(station, end_us);
    pongs_are_prompt(station);

    let said: Vec<Report> = station
        .reports
        .iter()
        .map(|(_, report)| comparable(report))
        .collect();
    // Reports before the first hello go nowhere.
    let unheard = |(_, report): &&(u64, Report)| !matches!(report, Report::Hello(_));
    let heard = expected.reports.iter().skip_while(unheard);
    let (due_us, should): (Vec<u64>, Vec<Report>) =
        heard.map(|(at, report)| (*at, comparable(report))).unzip();
    let differ = said.iter().zip(&should).position(|(a, b)| a != b);
    if let Some(at) = differ {
        panic!(
            "report {at}: board\n  {:?}\ntwin\n  {:?}",
            said[at], should[at]
        );
    }
    // The last reports may still be on the line.
    let missing = due_us.get(said.len()..).expect("no report is left over");
    let on_the_line_us = end_us.saturating_sub(ON_THE_LINE_US);
    assert!(
        missing.iter().all(|due_us| *due_us > on_the_line_us),
        "{} of {} reports: {missing:?} of {end_us} µs",
        said.len(),
        should.len()
    );

    let edges = station.edges();
    let levels = |edges: &[(u64, u16)]| edges.iter().map(|(_, levels)| *levels).collect::<Vec<_>>();
    // Edges of the twin after the end are not on the pins yet.
    let due = expected.edges.partition_point(|(at, _)| *at < end_us);
    let should = &expected.edges[..due];
    let differ = levels(&edges)
        .iter()
        .zip(levels(should))
        .position(|(a, b)| *a != b);
    assert_eq!(
        differ,
        None,
        "edges in another order: {:?}",
        differ.map(|at| (edges[at], should[at]))
    );
    assert_eq!(edges.len(), should.len(), "edges");
    // The delay from the word's moment to the pin is constant: less than a word, without jitter.
    let delays: Vec<Beats> = (edges.iter().zip(should))
        .map(|((at, _), (us, _))| (at - zero).wrapping_sub(us * US))
        .collect();
    if let Some(first) = delays.first() {
        println!("every edge {} ns after its microsecond", first * 1_000 / US);
        assert!(*first < US, "{first} beats late");
        assert!(
            delays.iter().all(|delay| delay == first),
            "jitter: {delays:?}"
        );
    }
    (said.len(), edges.len())
}
