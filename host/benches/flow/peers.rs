//! Frame sets tracked by other crates.

use image::GrayImage;
use optical_flow_lk::{DetectorContext, TrackParams, TrackStatus, TrackerContext};
use trinocular_vision::images::{FrameSet, Image};
use trinocular_vision::matching::pyramid::Pyramid;

use crate::accuracy::Quality;
use crate::scene::{Scene, WINDOW_PX};

const LEVELS: usize = 4;
const PARAMS: TrackParams = TrackParams {
    window_size: WINDOW_PX,
    max_iterations: 30,
    min_eigen_threshold: optical_flow_lk::DEFAULT_MIN_EIGEN_THRESHOLD,
};

/// Converts an image to the crate's own type.
pub fn gray(image: &Image) -> GrayImage {
    let (width, height) = (image.width as u32, image.height as u32);
    GrayImage::from_raw(width, height, image.grey.clone()).expect("as many pixels as its size says")
}

/// Applies this project's filter and converts to 8 bits.
fn smooth(image: &Image) -> GrayImage {
    let plane = Pyramid::new(image, 1).levels.remove(0);
    let level = |x: u32, y: u32| plane.grey[y as usize * plane.stride + x as usize];
    GrayImage::from_fn(image.width as u32, image.height as u32, |x, y| {
        image::Luma([level(x, y).round() as u8])
    })
}

/// Frame set of optical-flow-lk on filtered images: left, middle, right at both instants. The crate
/// has no filter of its own.
pub struct OpticalFlowLk {
    images: [Vec<GrayImage>; 2],
    corners: usize,
    detector: DetectorContext,
    temporal: Vec<TrackerContext>,
    spatial: TrackerContext,
}

/// Positions of one camera at one instant, each with a flag that is true if the tracker trusts it.
type Tracked = Vec<((f32, f32), bool)>;

impl OpticalFlowLk {
    pub fn new(frame_sets: &[FrameSet; 2], corners: usize) -> Self {
        let images = [0, 1].map(|i| frame_sets[i].images.iter().map(smooth).collect());
        let temporal = (0..3).map(|_| TrackerContext::new()).collect();
        let (detector, spatial) = (DetectorContext::new(), TrackerContext::new());
        Self {
            images,
            corners,
            detector,
            temporal,
            spatial,
        }
    }

    /// Tracks the first instant, because the temporal contexts keep the pyramids of its images.
    pub fn prepare(&mut self) {
        for (context, image) in self.temporal.iter_mut().zip(&self.images[0]) {
            context.advance(image, LEVELS);
        }
    }

    /// Tracks the frame set. Returns the points of each camera at both instants.
    pub fn run(&mut self) -> [[Tracked; 3]; 2] {
        let [before, now] = &self.images;
        let corners = self.detector.detect(&before[1], 0.01, 7);
        let points: Vec<(f32, f32)> = corners
            .iter()
            .take(self.corners)
            .map(|c| (c.x as f32, c.y as f32))
            .collect();
        let trusted = |r: &optical_flow_lk::TrackResult| (r.pos, r.status == TrackStatus::Tracked);
        let mut places: [Tracked; 3] = [
            Vec::new(),
            points.iter().map(|p| (*p, true)).collect(),
            Vec::new(),
        ];
        for k in [0, 2] {
            self.spatial.prepare(&before[1], &before[k], LEVELS);
            let found = self.spatial.track(&points, None, PARAMS);
            places[k] = found.iter().map(trusted).collect();
        }
        let mut after = [Vec::new(), Vec::new(), Vec::new()];
        for k in 0..3 {
            self.temporal[k].advance(&now[k], LEVELS);
            let from: Vec<(f32, f32)> = places[k].iter().map(|(at, _)| *at).collect();
            let found = self.temporal[k].track(&from, None, PARAMS);
            after[k] = found.iter().map(trusted).collect();
        }
        [places, after]
    }

    pub fn quality(
        scene: &Scene,
        [before, after]: &[[Tracked; 3]; 2],
        (points, quality): &mut (usize, Quality),
    ) {
        let between = |a: (f32, f32), b: (f32, f32)| [b.0 - a.0, b.1 - a.1].map(f64::from);
        for i in 0..before[1].len() {
            let all = (0..3).all(|k| before[k][i].1 && after[k][i].1);
            if !all {
                continue;
            }
            let inside = [before, after].iter().all(|instant| {
                let holds = |((x, y), _): ((f32, f32), bool)| scene.holds([x, y].map(f64::from));
                instant.iter().all(|places| holds(places[i]))
            });
            *points += usize::from(inside);
            for (k, shift) in [(0, scene.disparity_px[0]), (2, scene.disparity_px[1])] {
                let found = between(before[1][i].0, before[k][i].0);
                quality.spatial.add(found, [shift, 0.0], inside);
            }
            for k in 0..3 {
                let found = between(before[k][i].0, after[k][i].0);
                quality.temporal.add(found, scene.flow_px, inside);
            }
        }
    }
}

/// Applies imageproc's Gaussian of the same width to three images.
pub fn imageproc_filters(images: &[GrayImage]) -> Vec<GrayImage> {
    images
        .iter()
        .map(|image| imageproc::filter::gaussian_blur_f32(image, 1.0))
        .collect()
}

/// Applies this project's filter to three images.
pub fn our_filters(frame_set: &FrameSet) -> Vec<Pyramid> {
    frame_set
        .images
        .iter()
        .map(|view| Pyramid::new(view, 1))
        .collect()
}
