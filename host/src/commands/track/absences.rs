//! Notes and warnings about cameras that did not take part.

use serde_json::{Value, json};
use std::collections::HashSet;
use std::mem::{Discriminant, discriminant};
use trinocular_rig::notice;
use trinocular_vision::flow::{CameraRefusal, remarks};

/// Names of the cameras, and the warnings printed so far.
pub struct Absences {
    names: Vec<String>,
    said: HashSet<(usize, Discriminant<CameraRefusal>)>,
}

impl Absences {
    /// Starts without any warning printed.
    pub fn new(names: &[String]) -> Self {
        Self {
            names: names.to_vec(),
            said: HashSet::new(),
        }
    }

    /// Warns of each camera and kind of failure once: a camera that failed stays so.
    pub fn warn(&mut self, absent: &[(usize, CameraRefusal)]) {
        for (each, remark) in absent.iter().zip(remarks(absent, &self.names)) {
            if self.said.insert((each.0, discriminant(&each.1))) {
                notice!("warning: {remark}");
            }
        }
    }

    /// Adds the absent cameras to a JSON row, if there are any.
    pub fn note(&self, absent: &[(usize, CameraRefusal)], row: &mut Value) {
        if !absent.is_empty() {
            row["warnings"] = json!(remarks(absent, &self.names));
        }
    }

    /// Returns the end of a row's outcome: `, without right`.
    pub fn without(&self, absent: &[(usize, CameraRefusal)]) -> String {
        let names: Vec<&str> = absent
            .iter()
            .filter_map(|(k, _)| self.names.get(*k).map(String::as_str))
            .collect();
        match names.as_slice() {
            [] => String::new(),
            names => format!(", without {}", names.join(" and ")),
        }
    }
}
