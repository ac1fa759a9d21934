//! Frame sets and tables: recordings, ROS 2 bags, and folders of images.

use crate::calibration::rule;
use crate::errors::value;
use crate::rig::Rig;
use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::path::{Path, PathBuf};
use std::sync::mpsc::SyncSender;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use trinocular_recording::export::{Column, Table, columns};
use trinocular_recording::read;
use trinocular_recording::read::frames::Topics;
use trinocular_recording::read::is_recording;
use trinocular_recording::read::survey::Survey;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::folder::{DEFAULT_PERIOD_US, Folder};
use trinocular_vision::images::read_ahead::{Next, ReadAhead};
use trinocular_vision::images::series::pairing::Rule;
use trinocular_vision::images::{FrameSet, Image};

/// Frame sets that are read ahead.
const AHEAD: usize = 2;
/// Time between two looks for Ctrl-C.
const LOOK: Duration = Duration::from_millis(50);

#[derive(Clone)]
enum Files {
    Recording {
        source: read::Source,
        /// Topics with images; some recordings have none.
        topics: Result<Topics, InputError>,
        tolerance_us: u64,
    },
    Folder(Box<Folder>),
}

/// Native source of frame sets.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Source {
    path: PathBuf,
    rig: RigFile,
    files: Files,
    warnings: Vec<String>,
}

type Opened = (RigFile, Files, Vec<String>);

fn open_recording(
    path: &Path,
    rig: Option<RigFile>,
    chosen: &[(String, String)],
    tolerance_us: u64,
) -> Result<Opened, InputError> {
    let source = read::Source::open(path)?;
    let survey = Survey::of(&source)?;
    let warnings = survey.cut.iter().map(ToString::to_string).collect();
    let rig = match rig {
        Some(rig) => rig,
        None => match read::calibration::rig(&source, &survey)? {
            Some((rig, _)) => rig,
            None => {
                let reason = "holds no calibration (rig file, or sensor_msgs/CameraInfo on \
                              /CAMERA/camera_info): give rig=Rig.load(...)";
                return Err(InputError::file(path, reason));
            }
        },
    };
    if let Some((camera, _)) = chosen
        .iter()
        .find(|(camera, _)| !rig.names.contains(camera))
    {
        let names = rig.names.join(", ");
        let reason = format!("topics of {camera:?}: the rig's cameras are {names}");
        return Err(InputError::file(path, reason));
    }
    let topics = Topics::find(path, &survey, &rig.names, chosen);
    let files = Files::Recording {
        source,
        topics,
        tolerance_us,
    };
    Ok((rig, files, warnings))
}

fn open_folder(
    path: &Path,
    rig: Option<RigFile>,
    pair: Option<Rule>,
) -> Result<Opened, InputError> {
    let rig = rig.ok_or_else(|| {
        let reason = "is a folder of images, which holds no rig: give rig=Rig.load(...)";
        InputError::file(path, reason)
    })?;
    let size_px = rig.rig.image_size_px;
    let folder = Folder::open_paired(path, &rig.names, size_px, DEFAULT_PERIOD_US, pair)?;
    let warnings = folder.warnings().iter().map(ToString::to_string).collect();
    Ok((rig, Files::Folder(Box::new(folder)), warnings))
}

#[pymethods]
impl Source {
    #[new]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        rig: Option<Rig>,
        topics: Vec<(String, String)>,
        tolerance_us: u64,
        pair: Option<&str>,
    ) -> PyResult<Self> {
        let pair = rule(pair)?;
        let rig = rig.map(|rig| rig.file);
        let is_folder = path.is_dir() && !is_recording(&path);
        let opened = py.detach(|| match is_folder {
            true => open_folder(&path, rig, pair),
            false => open_recording(&path, rig, &topics, tolerance_us),
        });
        let (rig, files, warnings) = opened.map_err(value)?;
        Ok(Self {
            path,
            rig,
            files,
            warnings,
        })
    }

    #[getter]
    fn rig(&self) -> Rig {
        Rig {
            file: self.rig.clone(),
        }
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    #[getter]
    fn is_folder(&self) -> bool {
        matches!(self.files, Files::Folder(_))
    }

    /// Starts to read the frame sets on a thread of its own.
    fn frames(&self) -> PyResult<FrameSets> {
        let size_px = self.rig.rig.image_size_px;
        let sets = match self.files.clone() {
            Files::Folder(folder) => {
                ReadAhead::start(AHEAD, move |sender| send_all(folder.frame_sets(), sender))
            }
            Files::Recording {
                source,
                topics,
                tolerance_us,
            } => {
                let topics = topics.map_err(value)?;
                ReadAhead::start(AHEAD, move |sender| {
                    let sets = read::frames::FrameSets::new(&source, topics, size_px, tolerance_us);
                    send_all(sets, sender);
                })
            }
        };
        Ok(FrameSets {
            sets: Mutex::new(sets),
        })
    }

    /// Reads the table of measurements: name and values of each column.
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Files::Recording { source, .. } = &self.files else {
            let error = InputError::file(
                &self.path,
                "is a folder of images, which holds no measurements: measure its frames with Flow",
            );
            return Err(value(error));
        };
        let table = py.detach(|| Table::read(source)).map_err(value)?;
        let dict = PyDict::new(py);
        for (name, column) in columns(&table.rows) {
            match column {
                Column::Whole(values) => dict.set_item(name, PyArray1::from_vec(py, values))?,
                Column::Number(values) => {
                    let values = values.into_iter().map(|cell| cell.unwrap_or(f64::NAN));
                    dict.set_item(name, PyArray1::from_vec(py, values.collect()))?;
                }
                Column::Text(values) => dict.set_item(name, PyList::new(py, values)?)?,
            }
        }
        Ok(dict)
    }
}

/// Sends frame sets until the receiver is gone.
fn send_all(
    sets: impl Iterator<Item = Result<FrameSet, InputError>>,
    sender: &SyncSender<Result<FrameSet, InputError>>,
) {
    for set in sets {
        if sender.send(set).is_err() {
            return;
        }
    }
}

/// A frame set for Python: time, images (`None` for a camera without one), and the reason why it
/// cannot be read.
type PyFrame<'py> = (u64, Vec<Option<Bound<'py, PyAny>>>, Option<String>);

/// Converts images to arrays (rows, columns).
///
/// # Errors
/// Those of Python.
pub fn arrays<'py>(
    py: Python<'py>,
    images: Vec<Image>,
) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
    let array = |image: Image| {
        if image.is_missing() {
            return Ok(None);
        }
        let shape = [image.height, image.width];
        let array = PyArray1::from_vec(py, image.grey).reshape(shape)?;
        Ok(Some(array.into_any()))
    };
    images.into_iter().map(array).collect()
}

/// Native iterator over frame sets.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct FrameSets {
    sets: Mutex<ReadAhead<Result<FrameSet, InputError>>>,
}

#[pymethods]
impl FrameSets {
    /// Returns the next frame set, or `None` at the end. A panic of the thread that reads them is
    /// an exception of Python.
    fn next<'py>(&self, py: Python<'py>) -> PyResult<Option<PyFrame<'py>>> {
        loop {
            let next = py.detach(|| {
                // A panic leaves the end of the frame sets.
                let mut sets = self.sets.lock().unwrap_or_else(PoisonError::into_inner);
                sets.next_within(LOOK)
            });
            match next {
                Next::Item(Ok(FrameSet { time_us, images })) => {
                    return Ok(Some((time_us, arrays(py, images)?, None)));
                }
                Next::Item(Err(error)) => {
                    return Ok(Some((0, Vec::new(), Some(error.to_string()))));
                }
                Next::End => return Ok(None),
                Next::NotYet => py.check_signals()?,
            }
        }
    }
}
