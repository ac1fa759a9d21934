//! Passes of the stage, as the cameras saw them.

use crate::commands::failure::Failure;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::hand_eye::delay::Path;
use trinocular_vision::hand_eye::latency::{Latency, Look, Passage, latency};
use trinocular_vision::hand_eye::pixel_motion::PixelMotion;
use trinocular_vision::images::Image;

/// One pass of the stage.
struct Pass {
    axis: usize,
    /// Path of the stage and the bound of its clock's error, ms; `None` if the station's clock jumped
    /// meanwhile.
    path: Option<(Path, f64)>,
}

/// Moment of an image whose points were followed.
enum Moment {
    AtRest,
    Passing { pass: usize, stamp_s: f64 },
}

/// One camera: its points, and the moments of the images that showed them.
struct Camera {
    name: String,
    motion: PixelMotion,
    moments: Vec<Moment>,
    /// Stamps of all images on the passes, s.
    stamps_s: Vec<f64>,
}

impl Camera {
    fn failed(&self, reason: impl std::fmt::Display) -> Failure {
        Failure::Images(format!("camera `{}`: {reason}", self.name))
    }
}

/// Passes of the stage, and the cameras that saw them.
pub struct Observed {
    passes: Vec<Pass>,
    cameras: Vec<Camera>,
}

impl Observed {
    /// Takes the keyframes of the cameras.
    pub fn start(rig: &RigFile, keyframes: &[Image]) -> Result<Self, Failure> {
        let cameras = rig.names.iter().zip(keyframes).map(|(name, keyframe)| {
            let motion = PixelMotion::start(keyframe);
            let motion =
                motion.map_err(|refusal| Failure::Images(format!("camera `{name}`: {refusal}")))?;
            Ok(Camera {
                name: name.clone(),
                motion,
                moments: Vec::new(),
                stamps_s: Vec::new(),
            })
        });
        Ok(Self {
            passes: Vec::new(),
            cameras: cameras.collect::<Result<_, Failure>>()?,
        })
    }

    /// Follows a camera's points into an image at rest.
    pub fn at_rest(&mut self, camera: usize, image: &Image) {
        let camera = &mut self.cameras[camera];
        if camera.motion.look(image) {
            camera.moments.push(Moment::AtRest);
        }
    }

    /// Begins a pass along an axis; returns its number. It counts once it has ended.
    pub fn begin_pass(&mut self, axis: usize) -> usize {
        self.passes.push(Pass { axis, path: None });
        self.passes.len() - 1
    }

    /// Follows a camera's points into an image of a pass.
    pub fn passing(&mut self, camera: usize, pass: usize, stamp_s: f64, image: &Image) {
        let camera = &mut self.cameras[camera];
        camera.stamps_s.push(stamp_s);
        if camera.motion.look(image) {
            camera.moments.push(Moment::Passing { pass, stamp_s });
        }
    }

    /// Ends a pass with the path of the stage and the bound of its clock's error, ms; with `None` if
    /// the station's clock jumped meanwhile.
    pub fn end_pass(&mut self, pass: usize, path: Option<(Path, f64)>) {
        self.passes[pass].path = path;
    }

    /// Refuses passes in most of which the station's clock jumped.
    pub fn check_clock(&self) -> Result<(), Failure> {
        let all = self.passes.len();
        let jumped = self.passes.iter().filter(|pass| pass.path.is_none());
        match jumped.count() {
            jumped if 2 * jumped > all => Err(Failure::Images(format!(
                "the station's clock jumped in {jumped} of {all} passes of the stage, because the \
                 station or this computer was held up: end what keeps it busy, and run the command \
                 again"
            ))),
            _ => Ok(()),
        }
    }

    /// Returns the bound of the error of the station's clock, ms.
    pub fn clock_ms(&self) -> f64 {
        let paths = self.passes.iter().filter_map(|pass| pass.path.as_ref());
        paths.map(|(_, bound_ms)| *bound_ms).fold(0.0, f64::max)
    }

    /// Returns the stamps of all images of a camera on the passes, s.
    pub fn stamps_s(&self, camera: usize) -> &[f64] {
        &self.cameras[camera].stamps_s
    }

    /// Fits the delay of each camera's stamps.
    ///
    /// # Errors
    /// If the delay of a camera cannot be found, with its name and the reason.
    pub fn latencies(&self) -> Result<Vec<Latency>, Failure> {
        self.cameras.iter().map(|it| self.latency(it)).collect()
    }

    fn latency(&self, camera: &Camera) -> Result<Latency, Failure> {
        let means_px = camera.motion.means();
        let means_px = means_px.map_err(|refusal| camera.failed(refusal))?;
        let nowhere = Path::default();
        let passages = self.passes.iter().map(|pass| Passage {
            axis: pass.axis,
            path: pass.path.as_ref().map_or(&nowhere, |(path, _)| path),
            looks: Vec::new(),
        });
        let mut passages: Vec<Passage<'_>> = passages.collect();
        let mut rest_px = Vec::new();
        for (moment, moved_px) in camera.moments.iter().zip(means_px) {
            match *moment {
                Moment::AtRest => rest_px.push(moved_px),
                Moment::Passing { pass, .. } if self.passes[pass].path.is_none() => {}
                Moment::Passing { pass, stamp_s } => {
                    passages[pass].looks.push(Look { stamp_s, moved_px });
                }
            }
        }
        let found = latency(&passages, scatter_px(&rest_px), self.clock_ms());
        found.map_err(|refusal| camera.failed(refusal))
    }
}

/// Returns the standard deviation of places about their mean, px.
fn scatter_px(places_px: &[[f64; 2]]) -> f64 {
    let count = places_px.len() as f64;
    let squares = [0, 1].map(|axis| {
        let mean = places_px.iter().map(|px| px[axis]).sum::<f64>() / count;
        let off = places_px.iter().map(|px| (px[axis] - mean).powi(2));
        off.sum::<f64>()
    });
    match places_px.len() {
        0 | 1 => 0.0,
        _ => ((squares[0] + squares[1]) / (2.0 * (count - 1.0))).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_may_jump_in_half_of_the_passes() {
        for (steady, is_used) in [(8, true), (4, true), (3, false), (0, false)] {
            let Ok(mut observed) = Observed::start(&RigFile::paper(), &[]) else {
                panic!("a keyframe is refused though there is no camera");
            };
            for number in 0..8 {
                let pass = observed.begin_pass(0);
                observed.end_pass(pass, (number < steady).then(|| (Path::default(), 0.1)));
            }
            assert_eq!(observed.check_clock().is_ok(), is_used, "{steady}");
        }
    }
}
