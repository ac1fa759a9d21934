//! Frame sets that commands read: from a folder, from a recording, or from a ROS 2 bag.

use crate::commands::failure::Failure;
use crate::commands::warnings;
use clap::Args;
use std::path::Path;
use trinocular_recording::read::frames::{FrameSets, TOLERANCE_US, Topics};
use trinocular_recording::read::survey::{CAMERA_INFO, Survey};
use trinocular_recording::read::{Source, calibration};
use trinocular_recording::regions;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::FrameSet;

/// Options for recordings of this program and of others.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "With a recording (MCAP) or a ROS 2 bag")]
pub struct RecordingInput {
    /// Topic with the images of a camera, once per camera [default: the topic with the camera's
    /// name between two slashes, such as /left/image_raw]
    #[arg(long = "topic", value_name = "CAMERA=/TOPIC", value_parser = topic)]
    topics: Vec<(String, String)>,

    /// Largest difference of the time stamps within a frame set, ms
    #[arg(
        long,
        value_name = "MS",
        default_value_t = TOLERANCE_US as f64 * 1e-3,
        value_parser = tolerance
    )]
    tolerance: f64,
}

fn topic(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((camera, topic)) if !camera.is_empty() && !topic.is_empty() => {
            Ok((camera.to_owned(), topic.to_owned()))
        }
        _ => Err("must be CAMERA=/TOPIC, such as left=/cam0/image_raw".to_owned()),
    }
}

fn tolerance(text: &str) -> Result<f64, String> {
    let ms: f64 = text
        .parse()
        .map_err(|_| "expected a number, with a decimal point".to_owned())?;
    match (0.0..=1_000.0).contains(&ms) {
        true => Ok(ms),
        false => Err("must be 0 to 1000 ms".to_owned()),
    }
}

/// Returns the failure of a command line without a rig file where no recording can hold it.
pub fn rig_missing(usage: &str) -> Failure {
    Failure::Usage(format!(
        "--rig <RIG.toml> is missing: only a recording may hold the rig. Usage: trinocular {usage}"
    ))
}

/// Recording whose frame sets are read.
pub struct Frames {
    source: Source,
    topics: Topics,
    size_px: [u32; 2],
    tolerance_us: u64,
    /// Mean time between two frame sets, µs.
    period_us: u64,
}

/// Frame sets, and the rig that took them.
pub struct Rigged {
    /// The frame sets.
    pub frames: Frames,
    /// The rig that the user gave, or the one in the recording.
    pub rig: RigFile,
}

impl Default for RecordingInput {
    fn default() -> Self {
        Self {
            topics: Vec::new(),
            tolerance: TOLERANCE_US as f64 * 1e-3,
        }
    }
}

impl RecordingInput {
    /// Opens the recording at `path`. Without a rig, the recording must hold one: a rig file, or
    /// camera_info of all cameras.
    pub fn open(&self, path: &Path, rig: Option<RigFile>) -> Result<Rigged, Failure> {
        let (rigged, survey) = self.open_any(path, rig, true)?;
        if regions::are_in(&survey) {
            notice!("the regions of the recorded run are not used: --roi and --mask choose some");
        }
        Ok(rigged)
    }

    /// Opens the recording at `path`, which must hold a rig, with the regions of its run; prints
    /// nothing about it.
    pub fn open_view(&self, path: &Path) -> Result<(Rigged, Regions), Failure> {
        let (rigged, survey) = self.open_any(path, None, false)?;
        let RigFile { names, rig, .. } = &rigged.rig;
        let regions = regions::read(path, (names, rig.image_size_px), &survey)?;
        Ok((rigged, regions))
    }

    fn open_any(
        &self,
        path: &Path,
        rig: Option<RigFile>,
        tells: bool,
    ) -> Result<(Rigged, Survey), Failure> {
        let source = Source::open(path)?;
        let survey = Survey::of(&source)?;
        if let Some(cut) = &survey.cut {
            warnings::raise(cut.to_string());
        }
        let rig = match rig {
            Some(rig) => {
                let infos = survey
                    .topics
                    .iter()
                    .filter(|(_, topic)| topic.kind == CAMERA_INFO);
                let infos: Vec<&str> = infos.map(|(name, _)| name.as_str()).collect();
                if !infos.is_empty() {
                    let infos = infos.join(", ");
                    notice!("not used, because of --rig: the calibration on {infos}");
                }
                rig
            }
            None => match calibration::rig(&source, &survey)? {
                Some((rig, found)) => {
                    if tells {
                        notice!("calibration: {found}");
                    }
                    rig
                }
                None => {
                    let reason = "holds no calibration (rig file, or sensor_msgs/CameraInfo on \
                                  /CAMERA/camera_info): give --rig RIG.toml";
                    return Err(InputError::file(path, reason).into());
                }
            },
        };
        let topics = Topics::find(path, &survey, &rig.names, &self.topics)?;
        let first = topics
            .names()
            .first()
            .and_then(|name| survey.topics.get(name));
        let frames = Frames {
            period_us: first.map_or(0, |topic| topic.period_us()),
            source,
            topics,
            size_px: rig.rig.image_size_px,
            tolerance_us: (self.tolerance * 1e3).round() as u64,
        };
        Ok((Rigged { frames, rig }, survey))
    }
}

impl Frames {
    /// Reads the frame sets in the order of their stamps. What belongs to no frame set is counted
    /// on standard error at the end, with what is wrong with the stamps.
    pub fn frame_sets(&self) -> impl Iterator<Item = Result<FrameSet, InputError>> + '_ {
        let topics = self.topics.clone();
        let mut sets = FrameSets::new(&self.source, topics, self.size_px, self.tolerance_us);
        let mut is_over = false;
        std::iter::from_fn(move || {
            let next = sets.next();
            warnings::unread(&sets.take_warnings());
            if next.is_none() && !is_over {
                is_over = true;
                self.tell_leftover(&sets);
            }
            next
        })
    }

    fn tell_leftover(&self, sets: &FrameSets<'_>) {
        let leftover = sets.leftover();
        if leftover.alone + leftover.late > 0 {
            notice!(
                "warning: {} images without partners within {} ms, {} out of order",
                leftover.alone,
                self.tolerance_us as f64 * 1e-3,
                leftover.late
            );
        }
        let repeated = sets.repeated();
        let repeated = repeated.map(|(topic, count)| format!("{count} on {topic}"));
        let repeated: Vec<String> = repeated.collect();
        if !repeated.is_empty() {
            let repeated = repeated.join(", ");
            notice!("warning: repeated images (same topic, same stamp) dropped: {repeated}");
        }
        if let Some(doubt) = sets.doubt() {
            notice!("warning: {doubt}");
        }
    }

    /// Returns the mean time between two frame sets, µs.
    pub fn period_us(&self) -> u64 {
        self.period_us
    }
}
