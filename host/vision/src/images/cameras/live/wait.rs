//! Wait for a frame set, and the reason why none came.

use super::{State, Tally};
use std::path::PathBuf;
use std::time::Duration;
use trinocular_rig::error::InputError;

/// Wait for a frame set.
pub struct Wait {
    /// Number of images of each camera that had arrived before.
    arrived_before: Vec<u64>,
    pub waited: Duration,
}

impl Wait {
    pub fn begin(state: &State) -> Self {
        let counts = state.matching.counts().iter();
        Self {
            arrived_before: counts.map(|counts| counts.arrived).collect(),
            waited: Duration::ZERO,
        }
    }

    /// Returns the reason why no frame set came for this time, with the camera that is at fault.
    pub fn silence(&self, state: &State, paths: &[PathBuf], waited: Duration) -> InputError {
        let waited = waited.as_secs();
        let silent = (state.matching.counts().iter())
            .zip(&self.arrived_before)
            .enumerate()
            .filter(|(camera, (counts, before))| {
                counts.arrived == **before && state.matching.needs(*camera)
            })
            .min_by_key(|(_, (counts, _))| counts.arrived);
        let (path, reason) = match (silent, paths.first()) {
            (Some((camera, _)), _) => {
                let Tally {
                    stale,
                    damaged,
                    incomplete,
                    doubtful,
                    unreported,
                    ..
                } = state.tallies[camera];
                let reason = match (stale + damaged, incomplete) {
                    (0, 0) if unreported > doubtful => format!(
                        "no image whose trigger the station has reported for {waited} s, of \
                         {unreported} images so far: see to the line to the station"
                    ),
                    (0, 0) if doubtful > 0 => format!(
                        "no image whose trigger is certain for {waited} s, of {doubtful} images \
                         so far: keep the exposure constant, or lower rate_hz"
                    ),
                    (0, 0) => format!("no image for {waited} s: is the camera still there?"),
                    (0, _) => format!(
                        "no whole image for {waited} s; so far {incomplete} had missing packets \
                         (set packet_size_bytes and packet_delay_us in the rig file, and the \
                         system's receive buffer)"
                    ),
                    _ => format!(
                        "no image that can be used for {waited} s; so far {damaged} were \
                         damaged, and {stale} came faster than they were fetched \
                         (lower --fps, or do less on this computer)"
                    ),
                };
                (paths[camera].clone(), reason)
            }
            (None, first) => {
                let apart_ms = state.matching.apart_us().unwrap_or(0) as f64 * 1e-3;
                (
                    first.cloned().unwrap_or_default(),
                    format!(
                        "no image within the window of the other cameras' for {waited} s, the \
                         latest are {apart_ms:.1} ms apart: trigger the cameras together, \
                         or raise --window"
                    ),
                )
            }
        };
        InputError::file(&path, reason)
    }
}
