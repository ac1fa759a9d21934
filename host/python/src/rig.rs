//! `Rig`: cameras, and the stage if there is one.

use crate::errors::value;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::calibration::exchange::{self, Assembled};

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

    /// Assemble a rig from files of other programs; returns it with the doubts about it.
    #[staticmethod]
    fn assemble(
        files: Vec<PathBuf>,
        offsets_mm: Vec<(String, [f64; 2])>,
        image_size_px: Option<[u32; 2]>,
    ) -> PyResult<(Self, Vec<String>)> {
        let assembled = exchange::rig_of(&files, &offsets_mm, image_size_px);
        let Assembled { rig, doubts } = assembled.map_err(value)?;
        Ok((Self { file: rig }, doubts))
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

    /// Sentences about probable mistakes of units and names, and about the stage's settings.
    fn doubts(&self) -> Vec<String> {
        let of_stage = self.file.stage.as_ref().and_then(Stage::doubt);
        let mut doubts = self.file.doubts();
        doubts.extend(of_stage.map(str::to_owned));
        doubts
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
