//! A simulated station in real time: the board's own code on this computer's clock, with a
//! simulated stage on rails at its pins, switches at the rails' ends, and a button.

use super::{Exposure, Hardware};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use trinocular_core::frame::message::Side;
use trinocular_core::safety::Inputs;
use trinocular_core::time::Instant as StationInstant;
use trinocular_rig::rig_file::Stage;

/// Name that the simulated board reports.
const NAME: &str = "twin";

/// Longest time that passes at once. When this computer is busy for longer, the simulated station's
/// time stands still with it, because no real board would miss a heartbeat then.
const LONGEST_TURN: Duration = Duration::from_millis(20);

/// Distance from the end of the travel to the rail's limit switch, mm.
const BEYOND_TRAVEL_MM: f64 = 5.0;

/// Switches and lines that a person at the stage can change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Switches {
    /// True while the emergency stop is pressed.
    pub emergency_stop: bool,
    /// True while a motor driver reports a fault.
    pub driver_fault: bool,
}

/// A simulated station in real time.
#[derive(Debug)]
pub struct RealTimeTwin {
    hardware: Hardware,
    stage: Stage,
    /// Steps at which the limit switches of each axis trip, negative end first.
    ends_steps: [[i64; 2]; 3],
    switches: Switches,
    session: u32,
    last: Instant,
    /// Time that has passed for the station since it was first switched on.
    passed: Duration,
}

/// Images that a station has triggered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedExposure {
    /// Instant of this computer.
    pub at: Instant,
    /// [`RealTimeTwin::passed`] then.
    pub passed: Duration,
    /// Position of the stage then, mm.
    pub stage_mm: [f64; 3],
}

impl RealTimeTwin {
    /// Switches a station on, with its stage at zero. The limit switches stand 5 mm beyond the
    /// stage's travel; one that is a home switch stands where the rig file says.
    pub fn power_on(stage: &Stage) -> Self {
        // Differs from that of a twin before, as the board's does.
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        let session = since_1970.map_or(1, |since| since.as_micros() as u32);
        let end_steps = |axis: usize, end: usize| {
            let side = [Side::Negative, Side::Positive][end];
            let home = stage.care.home[axis].filter(|home| home.side == side);
            let limit_mm = stage.travel_mm[axis][end] + [-1.0, 1.0][end] * BEYOND_TRAVEL_MM;
            let mm = home.map_or(limit_mm, |home| home.position_mm);
            (mm * stage.steps_per_mm[axis]).round() as i64
        };
        Self {
            hardware: Hardware::new(stage, NAME, session),
            stage: stage.clone(),
            ends_steps: std::array::from_fn(|axis| [end_steps(axis, 0), end_steps(axis, 1)]),
            switches: Switches::default(),
            session,
            last: Instant::now(),
            passed: Duration::ZERO,
        }
    }

    /// Lets the time since the last call pass, takes the bytes that have arrived, and returns the
    /// bytes for the host. Call it every millisecond or two.
    pub fn turn(&mut self, received: &[u8]) -> Vec<u8> {
        let hardware = &mut self.hardware;
        let steps = hardware.plant.steps();
        hardware.set_switches(Inputs {
            limits: std::array::from_fn(|axis| {
                let [low, high] = self.ends_steps[axis];
                [steps[axis] <= low, steps[axis] >= high]
            }),
            emergency_stop: self.switches.emergency_stop,
            driver_fault: self.switches.driver_fault,
            words_emitted: 0,
            trigger_losses: 0,
        });
        // Whole microseconds pass, and the rest counts in the next turn: the clock keeps its rate.
        let now = Instant::now();
        let late = now.duration_since(self.last);
        let passed_us = late.min(LONGEST_TURN).as_micros() as u64;
        self.last = match late > LONGEST_TURN {
            true => now,
            false => self.last + Duration::from_micros(passed_us),
        };
        let end_us = hardware.station.now().micros() + passed_us;
        hardware.run_until(StationInstant::from_micros(end_us));
        self.passed += Duration::from_micros(passed_us);
        // No earlier: they may have been sent a moment ago.
        if !received.is_empty() {
            hardware.receive(received);
            hardware.run_until(StationInstant::from_micros(end_us));
        }
        let packets = hardware.to_host.drain(..);
        packets.flat_map(|(_, bytes)| bytes).collect()
    }

    /// Returns the instant up to which time has passed for the station.
    pub fn now(&self) -> Instant {
        self.last
    }

    /// Returns the time that has passed for the station since it was first switched on. It stands
    /// still while this computer is busy.
    pub fn passed(&self) -> Duration {
        self.passed
    }

    /// Returns true while the station triggers the cameras.
    pub fn is_triggering(&self) -> bool {
        self.hardware.station.machine().is_triggering()
    }

    /// Takes the triggers since the last call.
    pub fn exposures(&mut self) -> Vec<TimedExposure> {
        let (now, passed, station) = (self.last, self.passed, self.hardware.station.now());
        let exposures = self.hardware.exposures.drain(..);
        exposures
            .map(|Exposure { at, stage_mm }| {
                let ago = Duration::from_micros(station.since(at));
                TimedExposure {
                    at: now.checked_sub(ago).unwrap_or(now),
                    passed: passed.saturating_sub(ago),
                    stage_mm,
                }
            })
            .collect()
    }

    /// Returns the state of the switches.
    pub fn switches(&self) -> Switches {
        self.switches
    }

    /// Changes the state of the switches.
    pub fn set_switches(&mut self, switches: Switches) {
        self.switches = switches;
    }

    /// Cuts the power and switches it on again. The stage stays where it is, and the switches as
    /// they are.
    pub fn power_cycle(&mut self) {
        self.session = self.session.wrapping_add(1);
        let mut hardware = Hardware::new(&self.stage, NAME, self.session);
        hardware.plant.put(self.hardware.plant.steps());
        self.hardware = hardware;
    }

    /// Returns the position of the stage, mm from where it stood first, by the edges at the pins.
    pub fn position_mm(&self) -> [f64; 3] {
        self.hardware.plant.position_mm()
    }

    /// Returns the steps that the pins made, backward ones subtracted.
    pub fn steps(&self) -> [i64; 3] {
        self.hardware.plant.steps()
    }
}
