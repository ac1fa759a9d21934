//! A run of the loop with rendered images, refusals, faults and changes of the configuration,
//! recorded as the commands do it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use trinocular::servo::frame_sets::{CaptureClock, FrameSetServo};
use trinocular::servo::observer::{ServoEvent, ServoObserver};
use trinocular::servo::recording::RecordingObserver;
use trinocular::servo::station_link::StationLink;
use trinocular::servo::visual_servo::ServoOutcome;
use trinocular_client::observer::StationObserver;
use trinocular_client::stage::{configuration, default_stage};
use trinocular_client::twin::Twin;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Command, Frame, Mounting, Packet, Sums};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::rig::Rig;
use trinocular_core::safety::Inputs;
use trinocular_core::steps::Segment;
use trinocular_core::time::Instant;
use trinocular_recording::queue::Pace;
use trinocular_recording::recorder::{ImageForm, Recorder, Settings, Tap};
use trinocular_recording::replay;
use trinocular_rig::output::{Output, OwnFile, Replace};
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::replaying::BOARD;
use trinocular_vision::images::{FrameSet, Image, Scene, SceneSettings, Texture};
use trinocular_vision::sums::Estimator;

/// Time between two frame sets, µs.
const PERIOD_US: u64 = 33_333;

/// One change between what happened and what is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alteration {
    /// One grey level of one pixel.
    Pixel,
    /// One bit of a packet from the station.
    Packet,
    /// One port word, delayed by one.
    Word,
    /// One nanometre in the sums of one frame.
    Sums,
}

/// Account of a run.
pub struct Run {
    /// Frame sets that the images refused.
    pub refused: usize,
    /// Frames that the station did not use.
    pub unused: usize,
    /// Faults that the station latched.
    pub faults: usize,
    /// Configurations that the station got.
    pub configurations: usize,
    /// Steps at the pins.
    pub steps: [i64; 3],
}

/// Returns the settings of a replay.
pub fn settings(twin: Option<&str>) -> replay::Settings {
    let rig = RigFile::paper();
    replay::Settings {
        rig: rig.rig,
        names: rig.names,
        estimator: Estimator::Midpoint,
        pivot: None,
        regions: Default::default(),
        twin: twin.map(str::to_owned),
    }
}

/// Observer of the station that records with an alteration.
struct Altering {
    tap: Arc<Tap>,
    alteration: Option<Alteration>,
    /// Calls so far, of the kind that is altered.
    calls: AtomicU32,
}

impl Altering {
    /// Returns true for one call of the kind, in the midst of the run.
    fn is_due(&self, alteration: Alteration, is_fit: bool) -> bool {
        self.alteration == Some(alteration)
            && is_fit
            && self.calls.fetch_add(1, Ordering::Relaxed) == 20
    }
}

fn with_other_sums(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut packet: Packet = Receiver::default().next(&mut &bytes[..])?.ok()?;
    let Command::Frame(Frame {
        sums: Sums::Midpoint(sums),
        ..
    }) = &mut packet.command
    else {
        return None;
    };
    sums.mean_nm[0] += 1;
    Some(encode(&packet).expect("it was a packet").to_vec())
}

impl StationObserver for Altering {
    fn sent(&self, at_us: u64, bytes: &[u8]) {
        let other = with_other_sums(bytes);
        let is_due = self.is_due(Alteration::Sums, other.is_some());
        let bytes = other.as_deref().filter(|_| is_due).unwrap_or(bytes);
        self.tap.sent(at_us, bytes);
    }

    fn received(&self, at_us: u64, bytes: &[u8]) {
        let mut bytes = bytes.to_vec();
        if self.is_due(Alteration::Packet, bytes.len() > 8) {
            bytes[5] ^= 0x40;
        }
        self.tap.received(at_us, &bytes);
    }

    fn segment(&self, at: Instant, segment: &Segment, words: &[u32]) {
        let mut words = words.to_vec();
        let moves = words.iter().any(|word| *word != 0) && words.last() == Some(&0);
        if self.is_due(Alteration::Word, moves) {
            words.rotate_right(1);
        }
        self.tap.segment(at, segment, &words);
    }

    fn switches(&self, at: Instant, inputs: &Inputs) {
        self.tap.switches(at, inputs);
    }
}

/// Observer of the loop that records with an alteration.
#[derive(Debug)]
struct AlteringImages {
    inner: RecordingObserver,
    is_due: bool,
    calls: u32,
}

impl ServoObserver for AlteringImages {
    fn observe(&mut self, event: &ServoEvent<'_>) {
        let mut event = *event;
        let mut other = None;
        if let ServoEvent::Step { images, .. } = &event {
            self.calls += 1;
            let mut set: FrameSet = (*images).clone();
            let middle = set.images[0].grey.len() / 2 + 160;
            set.images[0].grey[middle] ^= 0x80;
            other = Some(set);
        }
        if let (ServoEvent::Step { images, .. }, Some(other), true) =
            (&mut event, &other, self.is_due && self.calls == 20)
        {
            *images = other;
        }
        self.inner.observe(&event);
    }
}

/// The world of a run: a poster that wanders, and a stage that copies its motion.
struct World {
    scene: Scene,
    servo: FrameSetServo,
    run: Run,
}

impl Run {
    /// Records a run of this many frame sets after the keyframe.
    pub fn record(path: &Path, frames: usize, alteration: Option<Alteration>) -> Self {
        let rig = RigFile::paper();
        let output =
            Output::open(path, Replace::Own(OwnFile::Recording)).expect("a writable place");
        let settings = Settings {
            images: ImageForm::Raw,
            pace: Pace::Virtual,
            cameras: rig.names.clone(),
            epoch_us: 0,
            rig: rig.to_toml(),
            regions: Default::default(),
            origin: BTreeMap::from([("program".to_owned(), "trinocular".to_owned())]),
        };
        let recorder = Recorder::start(output, settings).expect("it begins");
        let observer = Arc::new(Altering {
            tap: recorder.tap(),
            alteration,
            calls: AtomicU32::new(0),
        });
        let mut stage = default_stage();
        stage.tracking.prediction = false;
        let twin = Twin::start_observed(&stage, BOARD.name, Mounting::Fixed, Some(observer));
        let station = StationLink::Twin(Box::new(twin.expect("the twin answers")));
        let clock = CaptureClock::Virtual {
            latency_us: 20_000,
            period_us: PERIOD_US,
        };
        let servo = FrameSetServo::new(&Rig::paper(), Estimator::Midpoint, clock, station);
        let mut servo = servo.expect("a rig");
        servo.add_observer(Box::new(AlteringImages {
            inner: RecordingObserver::new(recorder.tap(), &rig.rig),
            is_due: alteration == Some(Alteration::Pixel),
            calls: 0,
        }));
        let scene = Scene::new(&rig.rig, &Texture::natural(7), SceneSettings::default());
        let mut world = World {
            scene: scene.expect("a scene"),
            servo,
            run: Self {
                refused: 0,
                unused: 0,
                faults: 0,
                configurations: 1,
                steps: [0; 3],
            },
        };
        for number in 0..=frames {
            world.turn(number);
        }
        world.servo.rest().expect("it comes to rest");
        let station = world.servo.station();
        recorder.tap().end(station.now().micros());
        world.run.steps = station.twin().expect("a twin").steps();
        let account = recorder.finish().expect("it is written");
        assert_eq!(account.dropped.frame_sets + account.dropped.messages, 0);
        world.run
    }
}

impl World {
    fn images(&self, number: usize) -> FrameSet {
        let s = number as f64 * PERIOD_US as f64 * 1e-6;
        let target_mm = [
            6.0 * (1.3 * s).sin(),
            4.0 * (1.9 * s).sin(),
            5.0 * (0.7 * s).sin(),
        ];
        let time_us = number as u64 * PERIOD_US;
        let mut set = self.scene.render(target_mm, time_us, number as u64);
        let size = |image: &Image| image.width * image.height;
        match number % 40 {
            // An occluder, a lost image, a frozen camera and an outlier.
            9..=12 => {
                let grey = |image: &mut Image| image.grey = vec![128; size(image)];
                set.images.iter_mut().for_each(grey);
            }
            20 => set.images[2] = Image::missing(),
            24 if number > 0 => {
                set.images[1] = self.scene.render([0.0; 3], 0, 99).images[1].clone()
            }
            30 => {
                set = self
                    .scene
                    .render([target_mm[0] + 18.0, 0.0, 0.0], time_us, 5)
            }
            _ => {}
        }
        set
    }

    /// Disturbs the station between two frame sets, as labs do.
    fn disturb(&mut self, number: usize) {
        let Some(twin) = self.servo.station_mut().twin_mut() else {
            return;
        };
        let now = twin.now();
        match number % 60 {
            15 => {
                twin.set_switches(Inputs {
                    emergency_stop: true,
                    ..Inputs::default()
                });
                twin.advance(now.plus_micros(3_000));
            }
            16 => {
                twin.set_switches(Inputs::default());
                twin.send(Command::Reset);
                twin.send(Command::Zero);
            }
            35 => drop(twin.send(Command::Stop)),
            40 => {
                let mut stage = default_stage();
                stage.steps_per_mm = [100.0, 64.0, 200.0];
                stage.invert = [false, true, false];
                stage.tracking.prediction = number.is_multiple_of(120);
                twin.send(Command::Reset);
                let config = configuration(&stage, Mounting::Fixed).expect("it fits");
                twin.send(Command::Config(config));
                twin.send(Command::Zero);
                self.run.configurations += 1;
            }
            50 => twin.write(&[0x55; 70]),
            _ => {}
        }
    }

    fn turn(&mut self, number: usize) {
        self.disturb(number);
        let set = self.images(number);
        let faulted = self.servo.follow(&set);
        let followed = match faulted {
            Ok(followed) => followed,
            // A fault is reported with the frame set during which it was latched.
            Err(_) => {
                self.run.faults += 1;
                self.run.unused += 1;
                return;
            }
        };
        match followed.map(|followed| followed.turn.outcome) {
            Some(ServoOutcome::Refused(_)) => self.run.refused += 1,
            Some(ServoOutcome::Unused(_)) => self.run.unused += 1,
            Some(ServoOutcome::Used(_)) | None => {}
        }
    }
}
