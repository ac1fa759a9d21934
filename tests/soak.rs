//! The station and its host for a long time, on virtual time: memory and latency do not grow.
//!
//! A target is followed at 60 frames per second while faults occur at random: silence, stops,
//! emergency stops, limit switches, noise on the line, occlusions. Each fault is cleared as an
//! operator would clear it. `SOAK_MINUTES` sets the duration; `tests/run` runs an hour.

use std::collections::VecDeque;
use std::f64::consts::TAU;
use trinocular_client::stage::default_stage;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Frame, Mounting, Sums};
use trinocular_core::safety::{Inputs, State};
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::time::Instant;
use trinocular_rig::random::Random;

/// Delay from the capture time to the arrival of its sums, µs.
const LATENCY_US: u64 = 20_000;

/// Interval between two frame sets, µs.
const FRAME_US: u64 = 16_667;

/// Growth of the resident set that an allocator may show without any leak, KiB.
const GROWTH_KIB: u64 = 256;

/// Returns the resident memory of this process, KiB; `None` if the system does not state it.
fn resident_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// Returns the midpoint's sums of a target displaced by `mm`, with a spread of 2^-5.
fn displaced(mm: [f64; 3]) -> Sums {
    let nm = |mm: f64| (mm * 1e6).round() as i32;
    Sums::Midpoint(FixedCentredSums {
        points: 200,
        freedom: 1_000,
        mean_nm: [nm(mm[0]), nm(mm[1])],
        centroid: [0, 0],
        spread: 1 << 31,
        exponent: -4,
        coupling: nm(4.0 * mm[2]),
        residual_nm: 150_000,
    })
}

/// Returns the position of the target, mm.
fn target_mm(us: u64) -> [f64; 3] {
    let s = us as f64 / 1e6;
    [0.31, 0.23, 0.11].map(|hz| 5.0 * (TAU * hz * s).sin())
}

struct Soak {
    twin: Twin,
    random: Random,
    /// Keyframe: its instant, and the target's position minus the stage's, mm.
    reference: Option<(Instant, [f64; 3])>,
    /// Frames whose sums are being computed.
    waiting: VecDeque<Frame>,
    latencies_us: Vec<u32>,
    faults: u32,
    used: u32,
}

impl Soak {
    fn distance_mm(&self) -> [f64; 3] {
        let (target, stage) = (target_mm(self.twin.now().micros()), self.twin.position_mm());
        std::array::from_fn(|axis| target[axis] - stage[axis])
    }

    /// Takes one capture and delivers the previous one, because the computation takes longer than a
    /// frame.
    fn frame(&mut self) {
        let capture = self.twin.now();
        let (reference, kept) = *self.reference.get_or_insert((
            Instant::from_micros(capture.micros() - 1),
            self.distance_mm(),
        ));
        let now = self.distance_mm();
        let seen: [f64; 3] = std::array::from_fn(|axis| {
            let sigma = if axis == 2 { 0.028 } else { 0.005 };
            now[axis] - kept[axis] + sigma * self.random.gaussian()
        });
        self.waiting.push_back(Frame {
            capture,
            reference,
            sums: displaced(seen),
        });
        let next = capture.plus_micros(FRAME_US);
        while let Some(frame) = self.waiting.front().copied()
            && frame.capture.plus_micros(LATENCY_US) <= next
        {
            self.waiting.pop_front();
            self.twin.advance(frame.capture.plus_micros(LATENCY_US));
            self.twin.send(Command::Frame(frame));
        }
        self.twin.advance(next);
        let Some(status) = self.twin.status() else {
            return;
        };
        if let Some(estimate) = status.estimate
            && status.frames_used != self.used
        {
            self.used = status.frames_used;
            self.latencies_us.push(estimate.latency_us);
        }
    }

    fn pass(&mut self, us: u64) {
        self.twin.advance(self.twin.now().plus_micros(us));
    }

    /// Causes a random fault and recovers from it.
    fn trouble(&mut self) {
        let open = Inputs {
            emergency_stop: self.random.below(2) == 0,
            driver_fault: self.random.below(2) == 0,
            limits: [[self.random.below(2) == 0, self.random.below(2) == 0]; 3],
            ..Inputs::default()
        };
        match self.random.below(5) {
            0 => {
                self.twin.set_pings(false);
                self.pass(300_000);
                self.twin.set_pings(true);
            }
            1 => self.twin.set_switches(open),
            2 => {
                let noise: Vec<u8> = (0..200).map(|_| self.random.next_u64() as u8).collect();
                self.twin.write(&noise);
            }
            3 => {
                self.twin.send(Command::Stop);
            }
            // The target is hidden for a while.
            _ => self.pass(700_000),
        }
        // Frame sets in progress are lost.
        self.waiting.clear();
        self.pass(50_000);
        self.twin.set_switches(Inputs::default());
        self.pass(300_000);
        let state = self.twin.status().map(|status| status.state);
        if matches!(state, Some(State::Faulted | State::Stopped)) {
            self.faults += 1;
            self.twin
                .command("reset", Command::Reset)
                .expect("the cause is gone");
            self.twin.zero().expect("it stands");
            self.reference = None;
        }
    }
}

#[test]
fn memory_and_latency_hold_for_an_hour() {
    let minutes: u64 = match std::env::var("SOAK_MINUTES") {
        Ok(text) => text.parse().expect("SOAK_MINUTES is a number of minutes"),
        Err(_) => 5,
    };
    let twin = Twin::start(&default_stage(), "soak", Mounting::OnStage).expect("it starts");
    let mut soak = Soak {
        twin,
        random: Random::new(20_261_128, 0),
        reference: None,
        waiting: VecDeque::new(),
        latencies_us: Vec::with_capacity(1 << 20),
        faults: 0,
        used: 0,
    };
    // Touch the memory for the latencies once; zeros would not allocate it.
    soak.latencies_us.resize(1 << 20, 1);
    soak.latencies_us.clear();
    let mut marks = Vec::new();
    for minute in 1..=minutes {
        let first = soak.latencies_us.len();
        let end = Instant::from_micros(minute * 60_000_000);
        let mut trouble = soak.twin.now().plus_micros(5_000_000);
        while soak.twin.now() < end {
            soak.frame();
            if soak.twin.now() > trouble {
                soak.trouble();
                trouble = soak.twin.now().plus_micros(10_000_000);
            }
        }
        let of_minute = &mut soak.latencies_us[first..];
        of_minute.sort_unstable();
        let at = |share: usize| of_minute.get(of_minute.len() * share / 100).copied();
        marks.push((resident_kib(), at(50), at(99), of_minute.last().copied()));
    }
    let used = soak.latencies_us.len();
    println!(
        "{minutes} minutes, {used} frames used, {} faults mended",
        soak.faults
    );
    for (minute, (kib, median, most, last)) in (1..).zip(&marks) {
        if minute == 1 || minute % 10 == 0 || minute == marks.len() {
            println!("minute {minute}: {kib:?} KiB, latency {median:?} {most:?} {last:?} us");
        }
    }
    assert!(soak.faults as u64 >= minutes, "{} faults", soak.faults);
    assert!(used as u64 > minutes * 2_000, "{used} frames used");
    // In the first minute buffers reach their size.
    let (settled, end) = (&marks[marks.len() / 12], &marks[marks.len() - 1]);
    if let (Some(before), Some(after)) = (settled.0, end.0) {
        assert!(
            after <= before + GROWTH_KIB,
            "{before} KiB become {after} KiB"
        );
    }
    // A frame waits for one control tick at most, however long the run.
    let (first, last) = (marks[0].3, end.3);
    let within = |a: Option<u32>, b: Option<u32>| a.zip(b).is_some_and(|(a, b)| b <= a + 1_000);
    assert!(
        within(first, last),
        "latency was {first:?} us, becomes {last:?} us"
    );
}
