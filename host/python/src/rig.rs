//! `Rig`: cameras, and the stage if there is one.

use crate::errors::value;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::calibration::exchange::{self, Assembled, CameraFile, Member};

/// Native rig; `trinocular.Rig` wraps and documents it.
#[pyclass(frozen, eq, from_py_object, module = "trinocular._trinocular")]
#[derive(Clone, PartialEq)]
pub struct Rig {
    pub file: RigFile,
}

/// Reads and checks the text of a rig file.
fn parse(text: &str) -> PyResult<Rig> {
    let file = RigFile::parse(Path::new("rig"), text).map_err(value)?;
    Ok(Rig { file })
}

#[pymethods]
impl Rig {
    /// Read a rig file (TOML).
    ///
    /// Raises ValueError with file, line and field if the file breaks a rule, FileNotFoundError if
    /// there is none.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let file = RigFile::read(&path).map_err(value)?;
        Ok(Self { file })
    }

    /// Assemble a rig from the files of its cameras. The file's name is the camera's name.
    #[staticmethod]
    fn assemble(files: Vec<PathBuf>, offsets_mm: Vec<(String, [f64; 2])>) -> PyResult<Self> {
        let names: Vec<String> = files
            .iter()
            .map(|file| exchange::camera_name(file))
            .collect();
        if let Some((unknown, _)) = offsets_mm.iter().find(|(name, _)| !names.contains(name)) {
            let names = names.join(", ");
            return Err(value(format!(
                "offsets_mm of {unknown:?}: the files are those of {names}"
            )));
        }
        let mut members = Vec::new();
        for (path, name) in files.iter().zip(&names) {
            let given = offsets_mm.iter().rev().find(|(camera, _)| camera == name);
            members.push(Member {
                path: path.clone(),
                name: name.clone(),
                file: CameraFile::read(path).map_err(value)?,
                offset_mm: given.map(|(_, offset_mm)| *offset_mm),
            });
        }
        let Assembled { rig, .. } = exchange::assemble(&members).map_err(value)?;
        // It obeys every rule of a rig file.
        parse(&rig.to_toml())
    }

    /// Return the rig of the paper: three cameras in line, 320 x 240 px, no stage.
    #[staticmethod]
    fn paper() -> Self {
        Self {
            file: RigFile::paper(),
        }
    }

    /// Read the text of a rig file. Raises ValueError with line and field.
    #[staticmethod]
    fn from_toml(text: &str) -> PyResult<Self> {
        parse(text)
    }

    /// Read a rig in JSON.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        let object: serde_json::Value = serde_json::from_str(text).map_err(value)?;
        parse(&toml::to_string(&object).map_err(value)?)
    }

    /// Return the text of the rig file, which from_toml reads back bit for bit.
    fn to_toml(&self) -> String {
        self.file.to_toml()
    }

    /// Return the rig in JSON.
    fn to_json(&self) -> PyResult<String> {
        let mut table: toml::Table = self.file.to_toml().parse().map_err(value)?;
        let cameras = table.get_mut("camera").and_then(toml::Value::as_array_mut);
        for camera in cameras.into_iter().flatten() {
            let Some(camera) = camera.as_table_mut() else {
                continue;
            };
            for (field, count) in [("distortion", 5), ("rotation_deg", 3)] {
                let zeros = vec![toml::Value::Float(0.0); count];
                camera.entry(field).or_insert(toml::Value::Array(zeros));
            }
        }
        serde_json::to_string(&table).map_err(value)
    }

    /// Write the rig file, whole or not at all; replaces an existing file. Raises ValueError if it
    /// cannot be written.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        self.file.write(&path).map_err(value)
    }

    /// Names of the cameras, in the order of all arrays.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.file.names.clone()
    }

    /// Width and height of every image, px. Arrays are (height, width).
    #[getter]
    fn image_size_px(&self) -> (u32, u32) {
        self.file.rig.image_size_px.into()
    }

    /// True if the rig describes the stage that moves it.
    #[getter]
    fn has_stage(&self) -> bool {
        self.file.stage.is_some()
    }

    /// Return the pixels (one [x, y] per camera) at which the cameras see a place (x, y, z), mm.
    fn project(&self, place_mm: [f64; 3]) -> PyResult<Vec<[f64; 2]>> {
        let seen = place_mm.iter().all(|mm| mm.is_finite()) && place_mm[2] > 0.0;
        if !seen {
            return Err(value(format!(
                "place_mm {place_mm:?} is not before the cameras: z must be greater than 0 mm"
            )));
        }
        let cameras = self.file.rig.cameras.iter();
        Ok(cameras.map(|camera| camera.project(place_mm)).collect())
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.file.rig.image_size_px;
        let names = self.file.names.join(", ");
        let stage = if self.has_stage() {
            ", with a stage"
        } else {
            ""
        };
        format!("<Rig {names}: {width} x {height} px{stage}>")
    }
}
