//! Material for the measurements: sums of a real scene, and a host that keeps a machine running.

use crate::board::SEGMENT_WORDS;
use nalgebra::{Matrix3, Matrix4x3, Vector4};
use trinocular_core::estimate::Gate;
use trinocular_core::frame::encode::{Bytes, encode};
use trinocular_core::frame::message::{
    Command, Config, Drops, EstimateReport, Frame, Mounting, Outcome, Packet, Report, StageConfig,
    Status, Sums,
};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::{Machine, Output, TICK_US};
use trinocular_core::motion::AxisConfig;
use trinocular_core::rig::Rig;
use trinocular_core::safety::{Fault, Inputs, State, Trust};
use trinocular_core::steps::DriverTiming;
use trinocular_core::sums::View;
use trinocular_core::sums::centred::{CentredSums, FixedCentredSums};
use trinocular_core::sums::pair::PairSums;
use trinocular_core::time::Instant;
use trinocular_core::track::pursuit::{Settings, Sight};

/// Returns the sums of fifty points in front of the paper's cameras, moved by (4, 4, 1) mm.
pub fn sums() -> (PairSums, CentredSums) {
    let rig = Rig::paper();
    // The paper's rig supports both kinds of sums.
    let (mut pair, mut centred) = (
        PairSums::new(&rig).unwrap(),
        CentredSums::new(&rig).unwrap(),
    );
    for k in 0..50 {
        let scatter = |times: i32, size: f64| f64::from(k * times % 50 - 25) / 25.0 * size;
        let point = [
            scatter(7, 100.0),
            scatter(11, 80.0),
            900.0 + scatter(17, 110.0),
        ];
        let moved = [point[0] + 4.0, point[1] + 4.0, point[2] + 1.0];
        let noise = scatter(23, 0.1);
        let views = core::array::from_fn::<View, 3, _>(|camera| {
            let camera = &rig.cameras[camera];
            let end = camera.project(moved).map(|px| px + noise);
            View::from_pixels(camera, camera.project(point), end)
        });
        pair.add(views);
        centred.add(&views);
    }
    (pair, centred)
}

/// Returns the paper's sums in single precision, `a1 a2 a3 b1 b2 b3 d1 d2 d3 d4`.
pub fn single(sums: &PairSums) -> [f32; 10] {
    [
        sums.a1, sums.a2, sums.a3, sums.b1, sums.b2, sums.b3, sums.d1, sums.d2, sums.d3, sums.d4,
    ]
    .map(|sum| (sum / f64::from(sums.points)) as f32)
}

/// Computes the paper's eq. 9 in single precision.
#[inline(never)]
pub fn closed_form_f32(&[a1, a2, a3, b1, b2, b3, d1, d2, d3, d4]: &[f32; 10]) -> [f32; 3] {
    let per_q = 1.0 / (a1 * b2 - a2 * b1);
    let vz = (a1 * d3 - b1 * d1) * per_q;
    let vx = (b2 * d1 - a2 * d3) * per_q;
    let vy = ((a1 * d2 + b1 * d4) - (a1 * a3 + b1 * b3) * vz) / (a1 * a1 + b1 * b1);
    [vx, vy, vz]
}

/// Computes the paper's eq. 7 in single precision with nalgebra.
#[inline(never)]
pub fn least_squares_f32(
    &[a1, a2, a3, b1, b2, b3, d1, d2, d3, d4]: &[f32; 10],
) -> Option<[f32; 3]> {
    let matrix = Matrix4x3::new(a1, 0.0, a2, 0.0, a1, a3, b1, 0.0, b2, 0.0, b1, b3);
    let normal: Matrix3<f32> = matrix.transpose() * matrix;
    let right = matrix.transpose() * Vector4::new(d1, d2, d3, d4);
    normal.cholesky().map(|factor| factor.solve(&right).into())
}

/// Returns a flow frame as it comes ten times a second.
pub fn frame(capture_us: u64, reference_us: u64) -> Command {
    // The sums above always fit.
    let sums = sums().1.quantise().unwrap();
    Command::Frame(Frame {
        capture: Instant::from_micros(capture_us),
        reference: Instant::from_micros(reference_us),
        sums: Sums::Midpoint(sums),
    })
}

/// Returns a move that lasts longer than the measurement.
pub fn setpoint() -> Command {
    Command::Setpoint {
        position_um: [30_000, -20_000, 25_000],
    }
}

/// Returns a status after a while.
pub fn status() -> Report {
    Report::Status(Status {
        time: Instant::from_micros(3_600_000_000),
        tick: 3_600_000,
        state: State::Following,
        fault: Some(Fault::Heartbeat),
        trust: Trust::Homed,
        position_steps: [123_456, -123_456, 4_567],
        target_steps: [123_789, -123_789, 4_321],
        frames_used: 100_000,
        frames_refused: 1_000,
        drops: Drops::default(),
        estimate: Some(EstimateReport {
            sequence: 65_000,
            displacement_nm: [4_000_000, -4_000_000, 1_000_000],
            sigma_nm: Some([9_000, 9_000, 80_000]),
            latency_us: 25_000,
        }),
        sight: Sight::Tracking,
        seen_ms: 25,
        faults: [Fault::Heartbeat].into_iter().collect(),
        motors: true,
    })
}

/// Returns the stage of the experiments, on the cameras' axes.
pub fn config() -> Config {
    let axis = AxisConfig {
        steps_per_m: 80_000,
        max_speed_um_s: 100_000,
        max_acceleration_um_s2: 2_000_000,
        max_jerk_um_s3: 50_000_000,
        travel_um: [-60_000, 60_000],
        invert: false,
    };
    Config {
        axes: [axis; 3],
        matrix: [[1 << 29, 0, 0], [0, 1 << 29, 0], [0, 0, 1 << 29]],
        driver: DriverTiming::TMC2209,
        gate: Gate::DEFAULT,
        heartbeat_ms: 100,
        slow_speed_um_s: 5_000,
        mounting: Mounting::OnStage,
        tracking: Settings::DEFAULT,
        stage: StageConfig {
            // Supervised, as by default, but the frames of the bench show no moving stage, so no
            // fault must result.
            unseen_um: 1_000_000,
            ..StageConfig::DEFAULT
        },
    }
}

/// The other end of the link, and the clock.
pub struct Host {
    pub machine: Machine,
    /// Instant just before the next tick.
    pub now: Instant,
    tick: u64,
    sequence: u16,
    sums: FixedCentredSums,
    reference: Option<Instant>,
    reports: Receiver<Report>,
}

impl Host {
    pub fn new(machine: Machine) -> Self {
        let mut host = Self {
            machine,
            now: Instant::default(),
            tick: 0,
            sequence: 0,
            sums: sums().1.quantise().unwrap(),
            reference: None,
            reports: Receiver::default(),
        };
        host.send(Command::Hello);
        host.tick();
        host
    }

    fn packet(&mut self, command: Command) -> Bytes {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        // Every command fits a packet.
        encode(&Packet { sequence, command }).unwrap()
    }

    pub fn send(&mut self, command: Command) {
        let bytes = self.packet(command);
        self.machine.receive(self.now, &bytes);
    }

    pub fn ping(&mut self) {
        let host_us = self.now.micros();
        self.send(Command::Ping { host_us });
    }

    /// Returns the instant `us` after the coming tick.
    pub fn after(&self, us: u64) -> Instant {
        Instant::from_micros(self.tick * TICK_US + us)
    }

    /// Takes all packets that wait at this instant.
    pub fn flush_at(&mut self, now: Instant) {
        // Without room no segment is handed out.
        while let Output::Send(_) = self.machine.poll(now, 0) {}
    }

    pub fn flush(&mut self) {
        self.flush_at(self.now);
    }

    pub fn next_tick(&mut self) {
        self.tick += 1;
        self.now = Instant::from_micros(self.tick * TICK_US - 1);
        self.machine.sense(Inputs {
            words_emitted: self.now.micros().saturating_sub(512),
            ..Inputs::default()
        });
    }

    /// Takes the remaining segments of this tick.
    pub fn rest_of_tick(&mut self) {
        for k in 1..4 {
            let now = self.after(k * TICK_US / 4);
            while let Output::Send(_) = self.machine.poll(now, SEGMENT_WORDS) {}
            self.flush_at(now);
        }
        self.next_tick();
    }

    pub fn tick(&mut self) {
        let now = self.after(0);
        while let Output::Send(_) = self.machine.poll(now, SEGMENT_WORDS) {}
        self.flush_at(now);
        self.rest_of_tick();
    }

    pub fn config_packet(&mut self) -> Bytes {
        self.packet(Command::Config(config()))
    }

    pub fn zero(&mut self) {
        self.send(Command::Zero);
        self.tick();
    }

    /// Configures and zeroes the station.
    pub fn begin(&mut self) {
        let bytes = self.config_packet();
        self.machine.receive(self.now, &bytes);
        self.tick();
        self.zero();
    }

    /// Runs until the stage is at rest.
    pub fn settle(&mut self) {
        for _ in 0..3_000 {
            if self.machine.state() == State::Idle {
                return;
            }
            self.ping();
            self.tick();
        }
    }

    /// Returns the next flow frame: the target is displaced by 4, 4, 1 mm since the keyframe.
    pub fn frame(&mut self) -> Bytes {
        let capture = Instant::from_micros(self.now.micros().saturating_sub(1_500));
        let reference = *self
            .reference
            .get_or_insert(Instant::from_micros(capture.micros().saturating_sub(500)));
        let sums = Sums::Midpoint(self.sums);
        self.packet(Command::Frame(Frame {
            capture,
            reference,
            sums,
        }))
    }

    pub fn is_accepted(&mut self, mut answer: &[u8]) -> bool {
        matches!(
            self.reports.next(&mut answer),
            Some(Ok(Report::Answer {
                outcome: Outcome::Accepted,
                ..
            }))
        )
    }
}
