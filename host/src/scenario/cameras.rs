//! The cameras on the stage: converts the position of the target to the flow sums of a frame.

use super::file::{Cameras, ImageSource};
use crate::servo::ServoError;
use crate::servo::recording::{Takers, measurement, observers_of};
use crate::servo::visual_servo::{Measured, VisualServo};
use trinocular_core::frame::message::Sums as FrameSums;
use trinocular_core::rig::Rig;
use trinocular_core::time::Instant;
use trinocular_recording::message::Measurement;
use trinocular_rig::random::Random;
use trinocular_vision::flow::Correspondence;
use trinocular_vision::images::{FrameSet, Image, Scene, SceneSettings, Texture};
use trinocular_vision::measure::MeasureRefusal;
use trinocular_vision::sums::Estimator;

/// Half the width, height and depth of the cloud of points, mm.
const CLOUD_MM: [f64; 3] = [140.0, 120.0, 110.0];

/// Grey level of an occluder.
const OCCLUDER_GREY: f64 = 128.0;

/// Cameras that have taken their keyframe.
#[derive(Debug)]
pub struct Eyes {
    /// Visual servo that measures the frame sets.
    pub servo: VisualServo,
    rig: Rig,
    seed: u64,
    kind: Kind,
    /// Takers of the frame sets.
    takers: Takers,
    /// Capture time of the next frame set on the station's clock, and position of the stage then,
    /// mm.
    next: (Instant, [f64; 3]),
}

#[derive(Debug)]
enum Kind {
    Rendered(Box<Scene>),
    Points {
        noise_px: f64,
        /// Position in space, and pixel in each camera at the keyframe, noise included.
        points: Vec<([f64; 3], Vec<[f64; 2]>)>,
    },
}

impl Eyes {
    /// Takes the keyframe.
    ///
    /// # Errors
    /// If the scene cannot be rendered, or its images cannot serve as a keyframe.
    pub fn open(cameras: &Cameras, seed: u64) -> Result<Self, ServoError> {
        Self::open_recorded(cameras, seed, Takers::new())
    }

    /// Takes the keyframe as [`Eyes::open`] does, and gives it and all frame sets to `takers`.
    ///
    /// # Errors
    /// As [`Eyes::open`].
    pub fn open_recorded(cameras: &Cameras, seed: u64, takers: Takers) -> Result<Self, ServoError> {
        let rig = Rig::paper();
        let mut servo =
            VisualServo::new(&rig, Estimator::Midpoint).map_err(ServoError::Reference)?;
        for observer in observers_of(takers.clone(), &rig) {
            servo.add_observer(observer);
        }
        let kind = match cameras.sight {
            ImageSource::Rendered {
                texture,
                noise_grey,
            } => {
                let settings = SceneSettings {
                    depth_mm: cameras.depth_mm,
                    noise_grey,
                    ..SceneSettings::default()
                };
                let scene = Scene::new(&rig, &Texture::of_kind(texture, seed), settings)?;
                servo
                    .set_keyframe(&scene.render([0.0; 3], 0, capture_seed(seed, 0)))
                    .map_err(ServoError::Reference)?;
                Kind::Rendered(Box::new(scene))
            }
            ImageSource::Points { count, noise_px } => {
                let mut random = Random::new(capture_seed(seed, 0), 0);
                let mut point = |_| {
                    let [x, y, z] = CLOUD_MM.map(|half| random.between(-half, half));
                    let point_mm = [x, y, cameras.depth_mm + z];
                    let seen = rig.cameras.iter().map(|camera| {
                        let px = camera.project(point_mm);
                        px.map(|px| px + noise_px * random.gaussian())
                    });
                    (point_mm, seen.collect())
                };
                Kind::Points {
                    noise_px,
                    points: (0..count).map(&mut point).collect(),
                }
            }
        };
        Ok(Self {
            servo,
            rig,
            seed,
            kind,
            takers,
            next: (Instant::default(), [0.0; 3]),
        })
    }

    /// Takes note of the capture time and the stage's position of the next frame set, for the
    /// recording.
    pub fn taken(&mut self, capture: Option<Instant>, camera_mm: [f64; 3]) {
        if let Some(capture) = capture {
            self.next = (capture, camera_mm);
        }
    }

    fn measure(&mut self, mut images: FrameSet) -> Result<FrameSums, MeasureRefusal> {
        let measured = self.servo.measure(&images);
        images.time_us = self.next.0.micros();
        self.give(Some(&images), measured.as_ref());
        measured.map(|measured| measured.sums)
    }

    /// Gives a frame set and its measurement to all takers.
    fn give(&self, images: Option<&FrameSet>, measured: Result<&Measured, &MeasureRefusal>) {
        for taker in &self.takers {
            taker.take(images, self.message(measured));
        }
    }

    fn message(&self, measured: Result<&Measured, &MeasureRefusal>) -> Measurement {
        let (capture, stage_mm) = self.next;
        Measurement {
            stamp_us: capture.micros(),
            capture_us: capture.micros(),
            reference_us: self.servo.keyframe_time().micros(),
            stage_mm,
            ..measurement(&self.rig, measured)
        }
    }

    /// Measures the flow sums of frame set `number` (from 1), with the target displaced by
    /// `relative_mm` as seen from the cameras.
    ///
    /// # Errors
    /// If the measurement is refused.
    pub fn see(&mut self, number: u64, relative_mm: [f64; 3]) -> Result<FrameSums, MeasureRefusal> {
        let seed = capture_seed(self.seed, number);
        match &self.kind {
            Kind::Rendered(scene) => {
                let images = scene.render(relative_mm, number, seed);
                self.measure(images)
            }
            Kind::Points { noise_px, points } => {
                let points = Self::project(&self.rig, points, *noise_px, relative_mm, seed);
                let measured = self.servo.measure_points(&points);
                self.give(None, measured.as_ref());
                measured.map(|measured| measured.sums)
            }
        }
    }

    /// Measures a frame set with an occluder before the target.
    ///
    /// # Errors
    /// Returns the refusal, which is the expected result.
    pub fn see_occluder(&mut self, number: u64) -> Result<FrameSums, MeasureRefusal> {
        match &self.kind {
            Kind::Rendered(scene) => {
                let seed = capture_seed(self.seed, number);
                let noise = scene.settings().noise_grey;
                let images = Self::occluder(&self.rig, noise, number, seed);
                self.measure(images)
            }
            Kind::Points { .. } => Err(MeasureRefusal::NothingSeen),
        }
    }

    fn occluder(rig: &Rig, noise_grey: f64, number: u64, seed: u64) -> FrameSet {
        let [width, height] = rig.image_size_px.map(|side| side as usize);
        let view = |camera: usize| {
            let mut random = Random::new(seed, camera as u64);
            // The cast clamps to 0..=255.
            let level = |_| (OCCLUDER_GREY + noise_grey * random.gaussian()).round() as u8;
            Image {
                width,
                height,
                grey: (0..width * height).map(level).collect(),
            }
        };
        FrameSet {
            time_us: number,
            images: (0..rig.cameras.len()).map(view).collect(),
        }
    }

    /// Returns the points that lie within every camera's image.
    fn project(
        rig: &Rig,
        points: &[([f64; 3], Vec<[f64; 2]>)],
        noise_px: f64,
        relative_mm: [f64; 3],
        seed: u64,
    ) -> Vec<Correspondence> {
        let mut random = Random::new(seed, 0);
        let [width, height] = rig.image_size_px.map(f64::from);
        let inside = |[x, y]: [f64; 2]| (0.0..width).contains(&x) && (0.0..height).contains(&y);
        let mut tracks = Vec::with_capacity(points.len());
        for (point_mm, seen) in points {
            let now_mm = std::array::from_fn(|i| point_mm[i] + relative_mm[i]);
            let cameras = rig.cameras.iter().zip(seen);
            let pixels: Vec<[[f64; 2]; 2]> = cameras
                .map(|(camera, start)| {
                    let now = camera.project(now_mm);
                    [*start, now.map(|px| px + noise_px * random.gaussian())]
                })
                .collect();
            let whole = pixels.iter().flatten().all(|pixel| inside(*pixel));
            if whole && now_mm[2] > 0.0 {
                tracks.push(Correspondence::from_pixels(rig, pixels));
            }
        }
        tracks
    }
}

/// Returns the seed of a frame set's noise, which differs between frame sets and is the same in
/// every run.
fn capture_seed(seed: u64, number: u64) -> u64 {
    Random::new(seed, number.wrapping_add(1)).next_u64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_core::estimate::midpoint;
    use trinocular_vision::images::TextureKind;

    fn cameras(sight: ImageSource) -> Cameras {
        Cameras {
            sight,
            frames_per_s: 60.0,
            latency_ms: 20.0,
            depth_mm: 850.0,
        }
    }

    fn displacement_mm(sums: &FrameSums) -> [f64; 3] {
        let FrameSums::Midpoint(sums) = sums else {
            panic!("midpoint sums were asked for");
        };
        let estimate = midpoint::solve_fixed(sums).expect("usable");
        estimate.displacement_nm.map(|nm| f64::from(nm) * 1e-6)
    }

    /// Points are about as uncertain as rendered images on every axis, so a scenario is about as
    /// hard with either.
    #[test]
    fn points_match_image_uncertainty() {
        let rendered = ImageSource::Rendered {
            texture: TextureKind::Natural,
            noise_grey: 2.0,
        };
        let spread = |sight: ImageSource| -> [f64; 3] {
            let mut eyes = Eyes::open(&cameras(sight), 1).expect("a scene");
            let seen: Vec<[f64; 3]> = (1..=30)
                .map(|number| displacement_mm(&eyes.see(number, [0.3, -0.2, 0.4]).expect("seen")))
                .collect();
            std::array::from_fn(|axis| {
                let mean = seen.iter().map(|v| v[axis]).sum::<f64>() / 30.0;
                (seen.iter().map(|v| (v[axis] - mean).powi(2)).sum::<f64>() / 29.0).sqrt()
            })
        };
        let [pictures, points] = [rendered, ImageSource::POINTS].map(spread);
        println!("images {pictures:.5?} mm, points {points:.5?} mm");
        for (pictures, points) in pictures.into_iter().zip(points) {
            assert!(
                (0.6..1.7).contains(&(points / pictures)),
                "{pictures} {points}"
            );
        }
    }

    #[test]
    fn target_seen_unless_occluded() {
        let rendered = ImageSource::Rendered {
            texture: TextureKind::Natural,
            noise_grey: 2.0,
        };
        let points = ImageSource::Points {
            count: 100,
            noise_px: 0.03,
        };
        let moved_mm = [3.0, -2.0, 5.0];
        for sight in [rendered, points] {
            let mut eyes = Eyes::open(&cameras(sight), 3).expect("a scene");
            let seen = displacement_mm(&eyes.see(7, moved_mm).expect("seen"));
            for (axis, bound) in [0.01, 0.01, 0.05].into_iter().enumerate() {
                assert!((seen[axis] - moved_mm[axis]).abs() < bound, "{seen:?}");
            }
            assert_eq!(eyes.see(7, moved_mm), eyes.see(7, moved_mm));
            assert_ne!(eyes.see(7, moved_mm), eyes.see(8, moved_mm));
            assert!(eyes.see_occluder(7).is_err());
            assert!(
                eyes.see(9, [0.0, 5_000.0, 0.0]).is_err()
                    || matches!(sight, ImageSource::Rendered { .. })
            );
        }
    }
}
