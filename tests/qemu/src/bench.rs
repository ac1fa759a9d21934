//! Cost of the run path: instructions and stack, as a table.
//!
//! Rows with a limit fail the run when they exceed it. Counts vary a little with inlining: the
//! limits are those of the project, not of the last run.

mod sample;

use crate::board::{BOARD, PORT, SEGMENT_WORDS};
use crate::count::{Counter, Sum};
use crate::{Failure, stack};
use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use sample::Host;
use semihosting::println;
use trinocular_core::estimate::{closed_form, midpoint};
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Command, Packet, Report};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::{Machine, Output, TICK_US};
use trinocular_core::motion::{Limits, Planner};
use trinocular_core::steps::{AxisMotion, Generator, Position, Segment};
use trinocular_core::time::Instant;
use trinocular_core::track::filter::KinematicLimits;
use trinocular_core::track::history::History;
use trinocular_core::track::pursuit::{Measurement, Pursuit, Settings};
use trinocular_core::track::watch::{Bounds, Sample, Watch};

/// Number of control ticks over which each kind of tick is measured.
const TICKS: u64 = 100;

/// Table that prints rows and records whether all were within their limits.
struct Table {
    good: bool,
}

impl Table {
    fn row(&mut self, name: &str, instructions: u64, limit: Option<u64>) {
        match limit {
            Some(limit) => println!("| {name} | {instructions} | {limit} |"),
            None => println!("| {name} | {instructions} | |"),
        }
        self.good &= limit.is_none_or(|limit| instructions <= limit);
    }

    fn row_tenths(&mut self, name: &str, tenths: u64, limit: Option<u64>) {
        let (whole, part) = (tenths / 10, tenths % 10);
        match limit {
            Some(limit) => println!("| {name} | {whole}.{part} | {limit} |"),
            None => println!("| {name} | {whole}.{part} | |"),
        }
        self.good &= limit.is_none_or(|limit| tenths <= 10 * limit);
    }
}

/// Runs all measurements.
pub fn run() -> Result<(), Failure> {
    let core = cortex_m::Peripherals::take().ok_or(Failure("the core's peripherals are taken"))?;
    let mut counter = Counter::new(core.SYST);
    let mut table = Table { good: true };
    println!("| what | instructions | limit |");
    println!("|---|---:|---:|");
    estimators(&mut counter, &mut table);
    wire(&mut counter, &mut table);
    tracking(&mut counter, &mut table);
    swinging(&mut counter, &mut table)?;
    watching(&mut counter, &mut table);
    let word = generator(&mut counter, &mut table)?;
    planner(&mut counter, &mut table)?;
    let (tick, segment, frame, reports) = control(&mut counter, &mut table)?;
    // Four segments a tick, the first with the control in it; words at 1 MHz; a hundred frames a
    // second.
    let million = |instructions_per_s: u64| instructions_per_s.div_ceil(1_000_000);
    let words = million(word * 1_000_000 / 10);
    let ticks = million((tick + 3 * segment) * 1_000);
    let link = million((frame + reports) * 100);
    println!();
    println!("| per second, in millions | instructions |");
    println!("|---|---:|");
    println!("| 1 M port words, three axes stepping | {words} |");
    println!("| 1,000 control ticks of four segments, following | {ticks} |");
    println!("| 100 frames and their reports | {link} |");
    let sum = words + ticks + link;
    println!("| sum | {sum} |");
    println!("| of 168 | {} % |", sum * 100 / 168);
    println!();
    stacks()?;
    match table.good {
        true => Ok(()),
        false => Err(Failure("a limit is exceeded")),
    }
}

fn estimators(counter: &mut Counter, table: &mut Table) {
    let (pair, centred) = sample::sums();
    let (Ok(fixed_pair), Ok(fixed)) = (pair.quantise(), centred.quantise()) else {
        return;
    };
    let closed = counter.calls(|| closed_form::solve_fixed(black_box(&fixed_pair)));
    table.row(
        "closed form, fixed point: displacement",
        closed.per(1),
        Some(400),
    );
    let short = counter.calls(|| midpoint::displacement_fixed(black_box(&fixed)));
    table.row(
        "midpoint, fixed point: displacement",
        short.per(1),
        Some(400),
    );
    let long = counter.calls(|| midpoint::solve_fixed(black_box(&fixed)));
    table.row(
        "midpoint, fixed point: displacement and variances",
        long.per(1),
        Some(1_000),
    );
    let sigma = counter
        .calls(|| midpoint::solve_fixed(black_box(&fixed)).map(|estimate| estimate.sigma_nm()));
    table.row(
        "midpoint, fixed point: displacement and sigmas",
        sigma.per(1),
        None,
    );
    let sums = sample::single(&pair);
    let ours = counter.calls(|| sample::closed_form_f32(black_box(&sums)));
    table.row(
        "for comparison, built for size: closed form, f32",
        ours.per(1),
        None,
    );
    let theirs = counter.calls(|| sample::least_squares_f32(black_box(&sums)));
    table.row(
        "for comparison, built for size: least squares, f32, nalgebra's Cholesky",
        theirs.per(1),
        None,
    );
}

fn wire(counter: &mut Counter, table: &mut Table) {
    let packet = Packet {
        sequence: 7,
        command: sample::frame(1_000_000, 900_000),
    };
    let Ok(bytes) = encode(&packet) else { return };
    let mut receiver = Receiver::<Packet>::default();
    let decoding = counter.calls(|| receiver.next(&mut black_box(&bytes[..])));
    table.row("decode a flow frame", decoding.per(1), None);
    let encoding = counter.calls(|| encode(black_box(&packet)));
    table.row("encode a flow frame", encoding.per(1), None);
    let status = sample::status();
    let encoding = counter.calls(|| encode(black_box(&status)));
    table.row("encode a status", encoding.per(1), None);
}

/// Measures a target at 50 mm/s, seen 60 times a second.
fn tracking(counter: &mut Counter, table: &mut Table) {
    let reach = KinematicLimits {
        speed: 8.0,
        acceleration: 0.16,
        jerk: 0.004,
    };
    let (settings, mut pursuit) = (Settings::DEFAULT, Pursuit::default());
    let mut seen = Measurement {
        capture: Instant::from_micros(0),
        position: [0; 3],
        variance: [0.2, 0.2, 5.0],
    };
    let (mut measured, mut aimed) = (Sum::default(), Sum::default());
    for frame in 0..2 * TICKS {
        seen.capture = seen.capture.plus_micros(16_667);
        // 4 steps/ms, plus or minus a step.
        let steps = 67 * frame + frame * 7 % 3;
        seen.position = [(steps as i64) << 32; 3];
        let at = seen.capture.plus_micros(20_000);
        if frame < TICKS {
            // Until the filter is steady.
            let _ = pursuit.measure(at, &seen, &[reach; 3], &settings);
            pursuit.aim(at, &[reach; 3], &settings);
            (0..3).for_each(|_| pursuit.work(&[reach; 3]));
            continue;
        }
        let _ = counter.add(&mut measured, || {
            pursuit.measure(at, black_box(&seen), &[reach; 3], &settings)
        });
        counter.add(&mut aimed, || pursuit.aim(at, &[reach; 3], &settings));
        (0..3).for_each(|_| pursuit.work(&[reach; 3]));
    }
    table.row("filter: a measurement of three axes", measured.per(1), None);
    table.row("filter: where to go by now, three axes", aimed.per(1), None);
}

/// Measures the ticks after a frame of a target that swings by 40 steps, fifteen frames a period:
/// the one in which an oscillator learns, and those in which three oscillators lead.
fn swinging(counter: &mut Counter, table: &mut Table) -> Result<(), Failure> {
    // Sines of a fifteenth of a turn, steps.
    const SWING: [i64; 15] = [
        0, 16, 30, 38, 40, 35, 24, 8, -8, -24, -35, -40, -38, -30, -16,
    ];
    let reach = [KinematicLimits {
        speed: 8.0,
        acceleration: 0.16,
        jerk: 0.004,
    }; 3];
    let (settings, mut pursuit) = (Settings::DEFAULT, Pursuit::default());
    let (mut learned, mut led, mut most) = (Sum::default(), Sum::default(), 0);
    for (frame, swing) in SWING.iter().cycle().take(400).enumerate() {
        let capture = Instant::from_micros(16_000 * frame as u64);
        let position = [swing << 32; 3];
        let seen = Measurement {
            capture,
            position,
            variance: [0.2, 0.2, 5.0],
        };
        let arrived = capture.plus_micros(20_000);
        let _ = pursuit.measure(arrived, &seen, &reach, &settings);
        pursuit.aim(arrived, &reach, &settings);
        for tick in 1..16 {
            let at = arrived.plus_micros(1_000 * tick);
            let mut one = Sum::default();
            counter.add(&mut one, || pursuit.work(black_box(&reach)));
            if tick <= 3 {
                most = most.max(one.per(1));
                learned += one;
            }
            let mut one = Sum::default();
            let aims = counter.add(&mut one, || {
                pursuit.swing(at, black_box(position), &reach, &settings)
            });
            if aims.iter().all(Option::is_some) {
                led += one;
            }
        }
    }
    if led.per(1) == 0 {
        return Err(Failure("no oscillator leads"));
    }
    let rows = [
        (
            "oscillator: a measurement of one axis",
            learned.per(1),
            None,
        ),
        ("oscillator: a measurement, at most", most, Some(1_500)),
        (
            "oscillator: where to go in a tick, three axes",
            led.per(1),
            Some(1_500),
        ),
    ];
    for (name, instructions, limit) in rows {
        table.row(name, instructions, limit);
    }
    Ok(())
}

/// Cost of the supervision of a target.
#[derive(Default)]
struct Supervision {
    seen: Sum,
    seen_at_most: u64,
    worked: u64,
    worked_at_most: u64,
}

/// Measures the supervision of a hundred frames. Each is followed by the work that the watch leaves
/// for the ticks after it. `at` gives the positions of stage and apparent target, steps.
fn supervised(counter: &mut Counter, at: impl Fn(i64) -> [i64; 2]) -> Supervision {
    let bounds = Bounds {
        unseen: [800 << 32; 3],
        ..Bounds::default()
    };
    let (mut watch, mut history) = (Watch::default(), History::default());
    let (mut cost, mut tick) = (Supervision::default(), 0);
    for frame in 0..TICKS as i64 {
        let capture = Instant::from_micros(16_667 * frame as u64);
        let [stage, target] = at(frame);
        let sample = Sample {
            capture,
            stage: [stage << 32; 3],
            error: [(target - stage) << 32; 3],
            variance: [0.2, 0.2, 5.0],
        };
        let mut one = Sum::default();
        counter.add(&mut one, || watch.see(black_box(&sample), true, &bounds));
        cost.seen_at_most = cost.seen_at_most.max(one.per(1));
        cost.seen += one;
        while 1_000 * tick <= capture.micros() + 36_667 {
            let stage = (4 * tick as i64) << 32;
            history.record(Instant::from_micros(1_000 * tick), [stage; 3]);
            let mut one = Sum::default();
            counter.add(&mut one, || watch.work(black_box(&history)));
            cost.worked_at_most = cost.worked_at_most.max(one.per(1));
            cost.worked += one.per(1);
            tick += 1;
        }
    }
    cost
}

/// Measures the same target followed well: the supervision has no reason for a trial. The most that
/// it takes is also that of a target that swings more than the stage, which is a reason to look for
/// wrong stamps. Neither leads to a trial, so that the look for a wrong mount is not measured.
fn watching(counter: &mut Counter, table: &mut Table) {
    let well = supervised(counter, |frame| {
        let stage = 67 * frame + frame % 2;
        [stage, stage + frame * 7 % 3]
    });
    let swings = |frame: i64| (frame % 30).min(30 - frame % 30);
    let ill = supervised(counter, |frame| {
        [12 * swings(frame), 40 * swings(frame + 4)]
    });
    table.row("watch: a frame of three axes", well.seen.per(1), None);
    let seen_at_most = well.seen_at_most.max(ill.seen_at_most);
    table.row("watch: a frame, at most", seen_at_most, Some(3_000));
    table.row(
        "watch: in the ticks after a frame, together",
        well.worked / TICKS,
        None,
    );
    let worked_at_most = well.worked_at_most.max(ill.worked_at_most);
    table.row("watch: in a tick, at most", worked_at_most, Some(1_500));
}

/// Measures words as the board's image makes them, into its ring. Also returns the tenths of
/// instructions per word with three axes stepping in every slot.
fn generator(counter: &mut Counter, table: &mut Table) -> Result<u64, Failure> {
    let slots = BOARD.word_rate.slots_per_segment();
    let moving = AxisMotion {
        first: 0xf000_0000,
        change: 1 << 20,
        backward: false,
    };
    let fast = Segment::new(slots, [moving; 3]).map_err(|_| Failure("too fast"))?;
    let mut generator = Generator::new(PORT).map_err(|_| Failure("impossible pins"))?;
    static RING: [AtomicU32; SEGMENT_WORDS] = [const { AtomicU32::new(0) }; SEGMENT_WORDS];
    let mut measure = |segment: &Segment| -> Result<Sum, Failure> {
        let silent = segment.axes().iter().all(AxisMotion::is_rest);
        let mut sum = Sum::default();
        for _ in 0..TICKS {
            // The board's DMA does this.
            for word in &RING {
                word.store(0, Relaxed);
            }
            let loaded = counter.add(&mut sum, || {
                generator.load(segment).map(|()| match silent {
                    true => generator.skip(),
                    false => generator.play(&RING),
                })
            });
            if loaded.is_err() || !generator.is_idle() {
                return Err(Failure("the generator refused a segment"));
            }
        }
        Ok(sum)
    };
    let rest = measure(&Segment::pause(slots))?;
    // Slow enough to reverse: writes the DIR pins.
    let slow = AxisMotion {
        first: 1 << 30,
        change: 0,
        backward: false,
    };
    measure(&Segment::new(slots, [slow; 3]).map_err(|_| Failure("too fast"))?)?;
    // 8,000 steps/s of 500,000 slots/s, all axes together 24,000: the default stage at its full
    // speed.
    let default_stage = AxisMotion {
        first: 68_719_476,
        change: 1 << 8,
        backward: false,
    };
    let usual =
        measure(&Segment::new(slots, [default_stage; 3]).map_err(|_| Failure("too fast"))?)?;
    let busy = measure(&fast)?;
    let words = SEGMENT_WORDS as u64;
    table.row_tenths("a port word, at rest", rest.tenths_per(words), Some(12));
    table.row_tenths(
        "a port word, three axes accelerating at 8,000 steps/s",
        usual.tenths_per(words),
        Some(12),
    );
    let busy = busy.tenths_per(words);
    table.row_tenths(
        "a port word, three axes accelerating at up to 500 kHz",
        busy,
        Some(12),
    );
    Ok(busy)
}

/// Measures an axis of the samples' stage that gets another target in every tick: anywhere or near
/// the last one, at rest or moving. The cost of the same tick with all axes at rest is subtracted.
fn planner(counter: &mut Counter, table: &mut Table) -> Result<(), Failure> {
    let limits = Limits::new(&sample::config().axes, BOARD.word_rate)
        .map_err(|_| Failure("impossible limits"))?;
    let rest = Position::centre(0);
    let mut planner = Planner::new(limits, [rest; 3]);
    let idle = counter.calls(|| {
        planner.follow([rest; 3], [0; 3]);
        planner.plan_tick()
    });
    table.row("a planner's tick, three axes at rest", idle.per(1), None);
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        i64::from(state.cast_signed())
    };
    let (mut all, mut worst, mut place) = (Sum::default(), 0, 0);
    for tick in 0..10_000u32 {
        if tick % 256 == 0 {
            place = 9_600 * random(); // within 60 mm
        }
        // Within two steps; 24 mm/s are 2⁻⁸ step per slot.
        let target = Position::from_fine(place + 4 * random());
        let speed = if tick / 16 % 2 == 1 { random() >> 7 } else { 0 };
        let mut one = Sum::default();
        counter.add(&mut one, || {
            planner.follow([target, rest, rest], [speed, 0, 0]);
            planner.plan_tick()
        });
        worst = worst.max(one.per(1));
        all += one;
    }
    let more = |instructions: u64| instructions.saturating_sub(idle.per(1));
    table.row("a new target of one axis, on top", more(all.per(1)), None);
    table.row("at most, of 10,000", more(worst), Some(5_000));
    Ok(())
}

/// Returns the instructions of a tick's first segment and of each further one while following, of a
/// frame from bytes to segment, and of its reports.
fn control(counter: &mut Counter, table: &mut Table) -> Result<(u64, u64, u64, u64), Failure> {
    let mut host = Host::new(Machine::new(BOARD));
    let idle = ticks(counter, &mut host, |_| {})?;
    table.row(
        "control tick with its first segment, unconfigured",
        idle.0.per(1),
        None,
    );
    host.begin();
    let ready = ticks(counter, &mut host, |_| {})?;
    table.row(
        "control tick with its first segment, at rest",
        ready.0.per(1),
        None,
    );
    table.row(
        "each of its three other segments, at rest",
        ready.1.per(1),
        None,
    );
    host.send(sample::setpoint());
    host.tick();
    let moving = ticks(counter, &mut host, |_| {})?;
    table.row(
        "control tick with its first segment, moving on three axes",
        moving.0.per(1),
        None,
    );
    table.row(
        "each of its three other segments, moving",
        moving.1.per(1),
        None,
    );
    host.settle();
    let (received, polled, reported, worst) = frames(counter, &mut host)?;
    table.row("take in a frame's bytes", received.per(1), None);
    table.row(
        "the tick that uses it, up to its first segment",
        polled.per(1),
        None,
    );
    let whole = received.per(1) + polled.per(1);
    table.row("whole frame, from bytes to segment", whole, Some(20_000));
    table.row("whole frame, at most", worst, Some(27_000));
    table.row("its answer and status, encoded", reported.per(1), None);
    Ok((
        moving.0.per(1),
        moving.1.per(1),
        received.per(1) + polled.per(1) - moving.0.per(1),
        reported.per(1),
    ))
}

/// Measures a hundred ticks: the first segment of each, and the others. Packets that go out between
/// them are not counted.
fn ticks(
    counter: &mut Counter,
    host: &mut Host,
    mut before: impl FnMut(&mut Host),
) -> Result<(Sum, Sum), Failure> {
    let (mut first, mut others) = (Sum::default(), Sum::default());
    for _ in 0..TICKS {
        host.ping();
        before(host);
        host.flush();
        for k in 0..4 {
            let now = host.after(k * TICK_US / 4);
            let sum = if k == 0 { &mut first } else { &mut others };
            let machine = &mut host.machine;
            let output = counter.add(sum, || machine.poll(now, SEGMENT_WORDS));
            let Output::Segment(_) = output else {
                return Err(Failure("a segment was due"));
            };
            host.flush_at(now);
        }
        host.next_tick();
    }
    Ok((first, others))
}

/// Measures a hundred frames: decoding, the tick, the reports, and the most that a frame takes.
fn frames(counter: &mut Counter, host: &mut Host) -> Result<(Sum, Sum, Sum, u64), Failure> {
    let (mut received, mut polled, mut reported) = (Sum::default(), Sum::default(), Sum::default());
    let mut worst = 0;
    for _ in 0..TICKS {
        host.ping();
        host.tick();
        host.flush();
        let bytes = host.frame();
        let (machine, before) = (&mut host.machine, host.now);
        let (mut taken, mut used) = (Sum::default(), Sum::default());
        counter.add(&mut taken, || machine.receive(before, &bytes));
        let now = host.after(0);
        let machine = &mut host.machine;
        let output = counter.add(&mut used, || machine.poll(now, SEGMENT_WORDS));
        worst = worst.max(taken.per(1) + used.per(1));
        received += taken;
        polled += used;
        let Output::Segment(_) = output else {
            return Err(Failure("a segment was due"));
        };
        let machine = &mut host.machine;
        let reports = counter.add(&mut reported, || {
            (
                machine.poll(now, SEGMENT_WORDS),
                machine.poll(now, SEGMENT_WORDS),
            )
        });
        let (Output::Send(answer), Output::Send(_)) = reports else {
            return Err(Failure("answer and status were due"));
        };
        if !host.is_accepted(&answer) {
            return Err(Failure("the frame was refused"));
        }
        host.rest_of_tick();
    }
    Ok((received, polled, reported, worst))
}

fn stacks() -> Result<(), Failure> {
    let mut host = Host::new(Machine::new(BOARD));
    host.begin();
    let bytes = host.frame();
    println!("| what | bytes of stack |");
    println!("|---|---:|");
    let config = host.config_packet();
    let taken = stack::used(|| host.machine.receive(host.now, &config));
    println!("| take in a configuration, the largest packet | {taken} |");
    let now = host.after(0);
    let applied = stack::used(|| drop(host.machine.poll(now, SEGMENT_WORDS)));
    println!("| the tick that uses it | {applied} |");
    host.rest_of_tick();
    host.zero();
    host.machine.receive(host.now, &bytes);
    let now = host.after(0);
    let followed = stack::used(|| drop(host.machine.poll(now, SEGMENT_WORDS)));
    println!("| the tick that uses a frame | {followed} |");
    let status = sample::status();
    let encoded = stack::used(|| drop(encode::<Report>(&status)));
    println!("| encode a status | {encoded} |");
    println!(
        "| worst | {} |",
        taken.max(applied).max(followed).max(encoded)
    );
    println!();
    println!("| what | bytes |");
    println!("|---|---:|");
    println!("| the machine | {} |", size_of::<Machine>());
    println!("| the generator | {} |", size_of::<Generator>());
    println!("| a command as it waits | {} |", size_of::<Command>());
    Ok(())
}
