//! `--record`: a recording of the run, for every command that runs the loop.

use crate::commands::failure::Failure;
use clap::{Args, ValueEnum};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};
use trinocular::run_report::Provenance;
use trinocular_client::owner;
use trinocular_core::frame::{PROTOCOL, SCHEMA_HASH};
use trinocular_recording::queue::Pace;
use trinocular_recording::recorder::{ImageForm, Recorder, Settings, Tap};
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::output::{Output, OwnFile, Replace};
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::sums::Estimator;

/// Recording of the run.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Recording")]
pub struct RecordOption {
    /// Record the run in this MCAP file: images, measurements, all packets, status and events
    ///
    /// `trinocular replay` runs it again, `export` writes tables and images; ROS 2, Foxglove and
    /// Rerun read it, too. It replaces an earlier recording of this program when the run begins,
    /// but no other file without --force. After a crash, or if the disk is full, the file is read
    /// up to its last whole chunk, a second at most before the end. In real time the run never
    /// waits for the disk: what does not fit the memory is dropped and counted.
    #[arg(long, value_name = "RUN.mcap")]
    record: Option<PathBuf>,

    /// Form of the recorded images
    #[arg(
        long,
        value_name = "FORM",
        value_enum,
        requires = "record",
        default_value_t = Form::Raw
    )]
    record_images: Form,
}

/// Forms of recorded images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Form {
    /// Uncompressed: some 16 MB/s in all for 60 frame sets of 3 x 320x240 per second
    Raw,
    /// Compressed without loss: smaller, as the noise allows, for 10 % of a core with these images
    Png,
    /// No images: a replay runs the station, but not the measurements
    None,
}

impl From<Form> for ImageForm {
    fn from(form: Form) -> Self {
        match form {
            Form::Raw => Self::Raw,
            Form::Png => Self::Png,
            Form::None => Self::None,
        }
    }
}

/// Origin of a recording: rig, estimator, station and seed.
#[derive(Clone, Debug)]
pub struct Origin {
    /// The rig, with the stage that the station moves.
    pub rig: RigFile,
    /// Text of the rig file, if the user gave one.
    pub rig_text: Option<String>,
    /// The station's estimator.
    pub estimator: Estimator,
    /// Name of the twin's board; `None` for a station on a line.
    pub twin: Option<&'static str>,
    /// True if time is real: for live images, a folder that grows, or a station on a line.
    pub is_real: bool,
    /// Seed of the simulation, if the run is one.
    pub seed: Option<u64>,
    /// Regions of interest of the cameras.
    pub regions: Regions,
}

impl Origin {
    /// Returns the texts by which recordings and reports name their origin. The run begins now.
    pub fn texts(&self) -> BTreeMap<&'static str, String> {
        let mut texts = here();
        texts.insert("command", owner::this_program().command);
        texts.insert("begun_unix_s", (now_us() / 1_000_000).to_string());
        let estimator = match self.estimator {
            Estimator::Midpoint => "midpoint",
            Estimator::ClosedForm => "closed-form",
        };
        texts.insert("estimator", estimator.to_owned());
        texts.insert("cameras", self.rig.names.join(","));
        texts.insert("station", self.twin.map_or("line", |_| "twin").to_owned());
        let optional = [
            ("twin", self.twin.map(str::to_owned)),
            ("seed", self.seed.map(|seed| seed.to_string())),
            (
                "pivot",
                self.rig.estimated_pivot().map(|pivot| pivot.to_string()),
            ),
        ];
        for (name, text) in optional {
            texts.extend(text.map(|text| (name, text)));
        }
        texts
    }

    /// Returns the text of the rig file.
    pub fn rig_toml(&self) -> String {
        let text = self.rig_text.clone();
        text.unwrap_or_else(|| self.rig.to_toml())
    }

    /// Returns the provenance of a report of this run.
    pub fn provenance(&self) -> Provenance {
        Provenance::new(self.texts(), Some(self.rig_toml()))
    }
}

/// Returns the present instant, µs since 1970.
fn now_us() -> u64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.map_or(0, |since| since.as_micros() as u64)
}

/// Recording under way, and its file, if one was requested.
#[derive(Debug)]
pub struct Recording(Option<(Recorder, PathBuf)>);

impl RecordOption {
    /// Returns true if a recording was requested.
    pub fn is_given(&self) -> bool {
        self.record.is_some()
    }

    /// Opens the file without changing it, so that an unwritable place is refused before the run.
    pub fn open(&self, force: bool) -> Result<Opened, InputError> {
        let replace = Replace::Own(OwnFile::Recording).or_forced(force);
        let open = |path: &PathBuf| Output::open(path, replace);
        Ok(Opened {
            output: self.record.as_ref().map(open).transpose()?,
            images: self.record_images.into(),
        })
    }
}

/// File of the recording.
pub struct Opened {
    output: Option<Output>,
    images: ImageForm,
}

impl Opened {
    /// Opens a new file for raw images at `path`; an existing file stays as it is.
    pub fn new(path: &Path) -> Result<Self, InputError> {
        Ok(Self {
            output: Some(Output::open(path, Replace::Nothing)?),
            images: ImageForm::Raw,
        })
    }

    /// Returns true if the file is that of `other`.
    pub fn is_same_file(&self, other: &Output) -> bool {
        let output = self.output.as_ref();
        output.is_some_and(|output| output.is_same_file(other))
    }

    /// Begins the recording, just before the station is started.
    pub fn start(self, origin: &Origin) -> Result<Recording, Failure> {
        let Some(output) = self.output else {
            return Ok(Recording(None));
        };
        let now_us = now_us();
        let texts = origin.texts().into_iter();
        let settings = Settings {
            images: self.images,
            pace: if origin.is_real {
                Pace::Real
            } else {
                Pace::Virtual
            },
            cameras: origin.rig.names.clone(),
            epoch_us: if origin.is_real { now_us } else { 0 },
            rig: origin.rig_toml(),
            regions: origin.regions.clone(),
            origin: texts.map(|(name, text)| (name.to_owned(), text)).collect(),
        };
        let path = output.path().to_owned();
        Ok(Recording(Some((Recorder::start(output, settings)?, path))))
    }
}

impl Recording {
    /// Returns the taps of the run.
    pub fn tap(&self) -> Option<Arc<Tap>> {
        self.0.as_ref().map(|(recorder, _)| recorder.tap())
    }

    /// Ends the file; returns its size and what was dropped, in words.
    pub fn finish(self) -> Result<Option<String>, InputError> {
        let Some((recorder, path)) = self.0 else {
            return Ok(None);
        };
        let account = recorder.finish()?;
        let dropped = account.dropped;
        let lost = match dropped.frame_sets + dropped.messages {
            0 => String::new(),
            _ => format!(
                "; dropped because the disk was too slow: {} frame sets, {} other messages",
                dropped.frame_sets, dropped.messages
            ),
        };
        let (messages, kilobytes) = (account.messages, account.bytes / 1_000);
        let path = printable(path.display());
        Ok(Some(format!(
            "recorded {messages} messages, {kilobytes} kB, in {path}{lost}"
        )))
    }

    /// Ends the file after a run whose results are yet to be written: they are whole without it, so
    /// that a failure is for the end of the command.
    pub fn end(self) -> Result<(), InputError> {
        if let Some(account) = self.finish()? {
            notice!("{account}");
        }
        Ok(())
    }

    /// Ends the file after a run whose results are written: the run's own failure comes first.
    pub fn close<T>(self, run: Result<T, Failure>) -> Result<T, Failure> {
        let ended = self.end();
        let value = run?;
        ended?;
        Ok(value)
    }
}

/// Returns the program and the machine, by the names that a recording has for them.
pub fn here() -> BTreeMap<&'static str, String> {
    let commit = option_env!("TRINOCULAR_COMMIT").unwrap_or("unknown");
    let machine = [std::env::consts::ARCH, std::env::consts::OS].join(" ");
    BTreeMap::from([
        ("program", "trinocular".to_owned()),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("commit", commit.to_owned()),
        ("protocol", PROTOCOL.to_string()),
        ("schema", format!("{SCHEMA_HASH:08x}")),
        ("machine", machine),
    ])
}
