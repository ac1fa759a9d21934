//! An eventful life of a station: a few thousand flow frames with every kind of fault and
//! disturbance.

use trinocular_client::stage::{configuration, default_stage};
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Frame, Mounting, Side, Sums};
use trinocular_core::rig::Rig;
use trinocular_core::safety::{Inputs, State};
use trinocular_core::sums::View;
use trinocular_core::sums::centred::CentredSums;
use trinocular_core::sums::pair::PairSums;
use trinocular_core::time::Instant;
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::HomeSwitch;

/// Number of frames between two events.
const FRAMES: usize = 60;

/// Number of times that each event occurs.
pub const ROUNDS: usize = 3;

/// A life as far as it has been simulated.
pub struct Life {
    pub twin: Twin,
    random: Random,
    rig: Rig,
    points_mm: Vec<[f64; 3]>,
    /// A packet that may come again much later.
    old: Vec<u8>,
    /// Number of frames written to the link, delivered or not.
    pub frames: usize,
}

/// Instant at which images were taken, with the positions of target and stage.
#[derive(Clone, Copy)]
struct Picture {
    at: Instant,
    /// Target position minus camera position, mm.
    view_mm: [f64; 3],
}

impl Life {
    /// Simulates the whole life.
    pub fn new(board: &'static str) -> Self {
        let twin = Twin::power_on_recorded(&default_stage(), board).expect("the twin answers");
        let mut random = Random::seeded(20_260_101);
        let points_mm = (0..12)
            .map(|_| {
                [
                    random.between(-120.0, 120.0),
                    random.between(-90.0, 90.0),
                    random.between(780.0, 1_000.0),
                ]
            })
            .collect();
        let mut life = Self {
            twin,
            random,
            rig: Rig::paper(),
            points_mm,
            old: Vec::new(),
            frames: 0,
        };
        life.begin();
        for _ in 0..ROUNDS {
            for event in EVENTS {
                life.follow(FRAMES);
                event(&mut life);
                life.recover();
            }
        }
        life.wait(500_000);
        life
    }

    fn wait(&mut self, us: usize) {
        self.twin.advance(self.twin.now().plus_micros(us as u64));
    }

    /// Sends a command and runs the station for a short time that is not a whole number of ticks.
    fn send(&mut self, command: Command) {
        self.twin.send(command);
        let us = 500 + self.random.below(2_000);
        self.wait(us);
    }

    /// Checks that every command is refused at first, then configures and zeroes the stage.
    fn begin(&mut self) {
        self.send(Command::Zero);
        self.send(jog(1_000));
        self.follow(20);
        let good = configuration(&default_stage(), Mounting::OnStage).expect("the default fits");
        let mut bad = good;
        bad.matrix[1] = bad.matrix[0];
        self.send(Command::Config(bad));
        self.send(Command::Config(good));
        self.follow(20);
        self.send(jog(-700));
        self.wait(600_000);
        self.send(Command::Zero);
    }

    /// Brings the stage to rest at a known position from any state.
    fn recover(&mut self) {
        self.twin.set_switches(Inputs::default());
        self.twin.set_pings(true);
        self.wait(400_000);
        self.send(Command::Reset);
        self.wait(100_000);
        self.send(Command::Zero);
    }

    fn picture(&self) -> Picture {
        let at = self.twin.now();
        let s = at.micros() as f64 * 1e-6;
        let target = [
            14.0 * (1.7 * s).sin(),
            9.0 * (2.9 * s).cos(),
            7.0 * (1.1 * s).sin(),
        ];
        let camera = self.twin.position_mm();
        Picture {
            at,
            view_mm: std::array::from_fn(|i| target[i] - camera[i]),
        }
    }

    /// Returns the flow sums of the target's motion between two images.
    fn sums(&mut self, from: Picture, to: Picture, noise: f64) -> Sums {
        let shift: [f64; 3] = std::array::from_fn(|i| to.view_mm[i] - from.view_mm[i]);
        let mut centred = CentredSums::new(&self.rig).expect("the paper's rig");
        let mut pair = PairSums::new(&self.rig).expect("the paper's rig");
        for point in &self.points_mm {
            let views: Vec<View> = (self.rig.cameras.iter())
                .map(|camera| {
                    let see = |p: [f64; 3]| {
                        let [x, y] = camera.project(p);
                        (x, y)
                    };
                    let start = see(*point);
                    let end = see(std::array::from_fn(|i| point[i] + shift[i]));
                    let px = [
                        end.0 + self.random.between(-noise, noise),
                        end.1 + self.random.between(-noise, noise),
                    ];
                    View::from_pixels(camera, [start.0, start.1], px)
                })
                .collect();
            centred.add(&views);
            pair.add([views[0], views[1], views[2]]);
        }
        if self.random.below(4) == 0 {
            Sums::ClosedForm(pair.quantise().expect("in range"))
        } else {
            Sums::Midpoint(centred.quantise().expect("in range"))
        }
    }

    /// Configures a short stage with backlash and home switches.
    fn become_loose(&mut self) {
        self.send(Command::Stop);
        self.wait(400_000);
        self.send(Command::Reset);
        let mut stage = default_stage();
        stage.travel_mm = [[-12.0, 12.0]; 3];
        stage.care.backlash_mm = [0.05, 0.3, 0.0];
        stage.care.home = [Side::Negative, Side::Positive, Side::Negative].map(|side| {
            let position_mm = 0.5;
            Some(HomeSwitch { side, position_mm })
        });
        stage.care.home_speed_mm_s = [40.0, 8.0];
        stage.care.back_off_mm = 0.7;
        let config = configuration(&stage, Mounting::OnStage).expect("it fits");
        self.send(Command::Config(config));
    }

    /// Homes all axes on bouncing switches 3 mm from here, over at most `looks` polls of the
    /// switches.
    fn find_home(&mut self, looks: usize) {
        let start = self.twin.steps();
        self.send(Command::Home { axes: [true; 3] });
        for _ in 0..looks.min(4_000) {
            let at = self.twin.steps();
            let limits = std::array::from_fn(|axis| {
                let bounce = self.random.below(3) as i64;
                let way = at[axis] - start[axis];
                [way <= bounce - 240, way >= 240 - bounce]
            });
            self.twin.set_switches(Inputs {
                limits,
                ..Inputs::default()
            });
            self.wait(1_000);
            let state = self.twin.status().map(|status| status.state);
            if looks == usize::MAX && state == Some(State::Idle) {
                break;
            }
        }
        self.twin.set_switches(Inputs::default());
    }

    /// Sends `count` frames, some of them bad, over a faulty line.
    fn follow(&mut self, count: usize) {
        let mut keyframe = self.picture();
        let mut last = (keyframe, None);
        for _ in 0..count {
            let pause = 1_000 + self.random.below(4_000);
            self.wait(pause);
            // Mostly the keyframe stays. Sometimes the previous image becomes the new one, which
            // the station knows if it used it.
            let status = self.twin.status();
            let used = status.and_then(|status| status.estimate.map(|e| e.sequence));
            if (used == last.1 && self.random.below(5) == 0) || self.random.below(400) == 0 {
                keyframe = last.0;
            }
            let now = self.picture();
            let noise = if self.random.below(20) == 0 {
                40.0
            } else {
                0.2
            };
            let sums = self.sums(keyframe, now, noise);
            let mut frame = Frame {
                capture: now.at,
                reference: keyframe.at,
                sums,
            };
            self.spoil(&mut frame);
            let latency = 300 + self.random.below(4_000);
            self.wait(latency);
            last = (now, Some(self.write(frame)));
        }
    }

    /// Spoils one frame in six.
    fn spoil(&mut self, frame: &mut Frame) {
        let kind = self.random.below(48);
        match (kind, &mut frame.sums) {
            (0, _) => frame.capture = frame.capture.plus_micros(50_000),
            (1, _) => frame.capture = frame.reference,
            (2, _) => frame.reference = frame.reference.plus_micros(1),
            (3, _) => frame.capture = Instant::from_micros(17),
            (4, Sums::Midpoint(sums)) => sums.points = 3,
            (4, Sums::ClosedForm(sums)) => sums.points = 3,
            (5, Sums::Midpoint(sums)) => sums.spread = 7,
            (5, Sums::ClosedForm(sums)) => sums.a1 = 0,
            (6, Sums::Midpoint(sums)) => sums.mean_nm[1] = i32::MIN,
            (6, Sums::ClosedForm(sums)) => sums.d2 = i32::MAX,
            (7, Sums::Midpoint(sums)) => sums.residual_nm = u32::MAX,
            (7, Sums::ClosedForm(sums)) => sums.b2 = -sums.b2,
            _ => {}
        }
    }

    /// Writes the frame on a line that repeats, cuts, flips and mixes; returns its sequence number.
    fn write(&mut self, frame: Frame) -> u16 {
        self.frames += 1;
        let kind = self.random.below(40);
        let (sequence, packet) = self.twin.packet(Command::Frame(frame));
        let mut bytes = packet.to_vec();
        let at = self.random.below(bytes.len());
        match kind {
            0 => bytes.extend_from_within(..),
            1 => bytes[at] ^= 1 << self.random.below(8),
            2 => bytes.truncate(at),
            3 => {
                let noise = [self.random.next_u64().to_le_bytes(); 40];
                self.twin.write(noise.as_flattened());
            }
            4 => {
                // Send two halves with a pause between them.
                self.twin.write(&bytes[..at]);
                self.wait(1_300);
                bytes.drain(..at);
            }
            5 => {
                let old = self.old.clone();
                self.twin.write(&old);
            }
            6 => self.old = bytes.clone(),
            _ => {}
        }
        self.twin.write(&bytes);
        sequence
    }
}

fn jog(um: i32) -> Command {
    Command::Jog {
        distance_um: [um, -um, um / 2],
    }
}

/// Events between the frames.
const EVENTS: [fn(&mut Life); 20] = [
    |life| life.send(Command::Stop),
    |life| {
        // Frames continue after a stop and are refused.
        life.send(Command::Stop);
        life.follow(15);
    },
    |life| {
        life.twin.set_switches(Inputs {
            emergency_stop: true,
            ..Inputs::default()
        });
        life.wait(3_000);
        life.send(Command::Reset);
    },
    |life| {
        life.twin.set_switches(Inputs {
            limits: [[true, true], [false, true], [true, false]],
            ..Inputs::default()
        });
        life.follow(10);
    },
    |life| {
        life.twin.set_switches(Inputs {
            driver_fault: true,
            ..Inputs::default()
        });
        life.wait(20_000);
    },
    |life| {
        life.twin.set_pings(false);
        life.follow(40);
    },
    |life| {
        // Change the whole stage: another scale, one axis inverted, fixed cameras.
        life.send(Command::Stop);
        life.wait(400_000);
        life.send(Command::Reset);
        let mut stage = default_stage();
        stage.steps_per_mm = [100.0, 64.0, 200.0];
        stage.invert = [false, true, false];
        stage.matrix = [[0.0, 1.0, 0.0], [-0.9, 0.1, 0.0], [0.0, 0.2, 1.1]];
        let config = configuration(&stage, Mounting::Fixed).expect("it fits");
        life.send(Command::Config(config));
        life.send(Command::Zero);
        life.follow(20);
    },
    |life| {
        life.send(Command::Stop);
        life.wait(400_000);
        let config = configuration(&default_stage(), Mounting::OnStage).expect("it fits");
        life.send(Command::Config(config));
        life.send(Command::Reset);
        life.send(Command::Zero);
    },
    |life| {
        // Send setpoints in mid-move.
        for k in 0..20 {
            let um = 1_000 * (k % 7) - 2_500;
            life.send(Command::Setpoint {
                position_um: [um, 2 * um, -um],
            });
            life.wait(7_000);
        }
    },
    |life| {
        // Send more commands than one tick takes.
        for _ in 0..14 {
            life.twin.send(jog(100));
        }
        life.wait(50_000);
    },
    |life| {
        // Move onto a tripped limit switch, from rest.
        life.send(Command::Stop);
        life.wait(400_000);
        life.send(Command::Reset);
        life.twin.set_switches(Inputs {
            limits: [[true; 2]; 3],
            ..Inputs::default()
        });
        life.send(jog(500));
    },
    |life| life.twin.write(&[0x55; 700]),
    |life| {
        // The host reconnects with any sequence number.
        life.twin.send(Command::Hello);
        life.follow(5);
    },
    |life| {
        // Backlash, and homing on switches.
        life.become_loose();
        life.find_home(usize::MAX);
        life.follow(20);
        for um in [700, -300, 10, -10] {
            life.send(jog(um));
            life.wait(50_000);
        }
        life.follow(40);
    },
    |life| {
        // A stop during homing must end the homing state.
        life.become_loose();
        life.find_home(700);
        life.send(Command::Stop);
        life.follow(5);
    },
    |life| {
        // Homing without any switch.
        life.become_loose();
        life.send(Command::Home {
            axes: [false, true, false],
        });
        life.wait(1_500_000);
    },
    |life| {
        // A stop drops the commands before it in the same write.
        life.send(Command::Stop);
        life.wait(400_000);
        for command in [Command::Reset, jog(9_000), Command::Zero, Command::Stop] {
            life.twin.send(command);
        }
        life.wait(100_000);
    },
    |life| {
        // The emergency stop is pressed during a heartbeat fault; noise follows; a reset must be
        // denied.
        life.twin.send(jog(9_000));
        life.twin.set_pings(false);
        life.wait(300_000);
        life.twin.set_switches(Inputs {
            emergency_stop: true,
            ..Inputs::default()
        });
        life.wait(5_000);
        life.twin.write(&[0x55]);
        life.send(Command::Reset);
    },
    |life| {
        // An axis outside its travel: others move, and it moves inwards only.
        life.send(Command::Stop);
        life.wait(400_000);
        life.send(Command::Reset);
        let mut stage = default_stage();
        stage.travel_mm[1] = [3.0, 90.0];
        let config = configuration(&stage, Mounting::OnStage).expect("it fits");
        life.send(Command::Config(config));
        life.send(Command::Zero);
        for distance_um in [[400, 0, 0], [0, -100, 0], [0, 500, 300]] {
            life.send(Command::Jog { distance_um });
            life.wait(200_000);
        }
        life.follow(5);
    },
    |life| {
        // Switch the motors off, by command and after a rest.
        life.send(Command::Stop);
        life.wait(400_000);
        life.send(Command::Reset);
        let mut stage = default_stage();
        stage.care.motors_off_after_s = 1;
        let config = configuration(&stage, Mounting::OnStage).expect("it fits");
        life.send(Command::Config(config));
        life.send(Command::Motors { on: false });
        life.send(jog(100));
        life.send(Command::Motors { on: true });
        life.wait(1_200_000);
        life.send(Command::Motors { on: true });
        let config = configuration(&default_stage(), Mounting::OnStage).expect("it fits");
        life.send(Command::Config(config));
    },
];
