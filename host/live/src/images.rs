//! Images on their way to the pages: a slot for the latest ones, and the thread that encodes them.
//!
//! The loop copies images into the slot only if a page is open, at most [`RATE_HZ`] times a second,
//! and only if the thread has taken the ones before. All pages share the encoded message.

use crate::aids::{CELLS, aids};
use crate::overlap;
use crate::telemetry::rounded;
use axum::body::Bytes;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use serde_json::{Value, json};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use trinocular_core::rig::Rig;
use trinocular_vision::flow::{Correspondence, Measurement};
use trinocular_vision::images::{FrameSet, Image};
use trinocular_vision::matching::Reject;

/// Most frame sets per second that are sent.
pub const RATE_HZ: f64 = 20.0;

/// Quality of the JPEG, 1 to 100.
const QUALITY: u8 = 80;

/// Points of each kind that are sent per image.
const MOST_POINTS: usize = 400;

/// Frame set of one turn, with its points.
#[derive(Debug)]
pub struct Shot {
    /// Capture time, s since the first turn.
    pub at_s: f64,
    /// Images of all cameras.
    pub images: FrameSet,
    /// Points and active cameras, if there was a measurement.
    pub points: Option<Points>,
}

/// Slot for the latest images on their way from the loop to the encoder.
#[derive(Debug, Default)]
pub struct Slot {
    state: Mutex<SlotState>,
    filled: Condvar,
}

#[derive(Debug, Default)]
struct SlotState {
    shot: Option<Shot>,
    /// Instant at which the last images were due.
    last: Option<Instant>,
}

impl Slot {
    fn lock(&self) -> MutexGuard<'_, SlotState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns true if the slot is empty and images are due by [`RATE_HZ`]; the next ones are then
    /// due a period later.
    pub fn is_due(&self) -> bool {
        let period = Duration::from_secs_f64(0.9 / RATE_HZ);
        let now = Instant::now();
        let mut state = self.lock();
        let is_due = state.last.is_none_or(|last| now - last >= period);
        if state.shot.is_some() || !is_due {
            return false;
        }
        state.last = Some(now);
        true
    }

    /// Puts images into the slot.
    pub fn put(&self, shot: Shot) {
        self.lock().shot = Some(shot);
        self.filled.notify_one();
    }

    /// Waits up to 200 ms for images in the slot.
    pub fn take(&self) -> Option<Shot> {
        let wait = Duration::from_millis(200);
        let is_empty = |state: &mut SlotState| state.shot.is_none();
        let waited = self.filled.wait_timeout_while(self.lock(), wait, is_empty);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        state.shot.take()
    }
}

/// Points of a measurement.
#[derive(Debug)]
pub struct Points {
    cameras: Vec<usize>,
    inliers: Vec<Correspondence>,
    /// Places in each active camera, px, and index into [`Reject::ALL`].
    rejected: Vec<(Vec<[f64; 2]>, usize)>,
}

impl Points {
    /// Copies the points of a measurement.
    pub fn of(measurement: &Measurement) -> Self {
        let rejected = measurement.rejected_points.iter().take(MOST_POINTS);
        let inliers = measurement.correspondences.iter().take(MOST_POINTS);
        Self {
            cameras: measurement.cameras.clone(),
            inliers: inliers.cloned().collect(),
            rejected: rejected
                .map(|point| (point.pixels.clone(), point.reason as usize))
                .collect(),
        }
    }
}

/// Encoded frame set, ready to send.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// Number of the frame set, from 1.
    pub number: u64,
    /// Message: length of the header (u32, little endian), header (JSON), JPEG of every camera.
    pub message: Bytes,
    /// Capture time, s since the first turn.
    #[cfg(feature = "foxglove")]
    pub at_s: f64,
    /// JPEG of every camera; empty for a missing image.
    #[cfg(feature = "foxglove")]
    pub images: Vec<Bytes>,
}

/// Encodes frame sets of one rig.
#[derive(Debug)]
pub struct Encoder {
    rig: Rig,
    number: u64,
    /// Latest known distance of the target, mm.
    distance_mm: Option<f64>,
}

impl Encoder {
    /// Makes an encoder.
    pub fn new(rig: &Rig) -> Self {
        Self {
            rig: rig.clone(),
            number: 0,
            distance_mm: None,
        }
    }

    /// Encodes a frame set with its points, overlap and aids.
    pub fn encode(&mut self, shot: &Shot) -> Encoded {
        self.number += 1;
        if let Some(points) = &shot.points
            && let Some(found) = overlap::distance_mm(&self.rig, &points.cameras, &points.inliers)
        {
            self.distance_mm = Some(found);
        }
        let overlap = self.distance_mm.map(|mm| overlap::corners(&self.rig, mm));
        let mut bodies: Vec<Vec<u8>> = Vec::new();
        let mut cameras: Vec<Value> = Vec::new();
        for (k, image) in shot.images.images.iter().enumerate() {
            let body = jpeg(image);
            let mut camera = json!({
                "bytes": body.len(),
                "size": [image.width, image.height],
                "aids": aids(image),
            });
            if let Some(corners) = overlap.as_ref().and_then(|overlap| overlap.get(k)) {
                camera["overlap"] = json!(corners.map(tenths));
            }
            if let Some(points) = &shot.points
                && let Some(active) = points.cameras.iter().position(|camera| *camera == k)
            {
                let inliers = points.inliers.iter();
                let inliers = inliers.filter_map(|point| point.pixels.get(active));
                let inliers: Vec<_> = inliers.map(|[_, now]| tenths(*now)).collect();
                let rejected = points.rejected.iter().filter_map(|(pixels, reason)| {
                    let [x, y] = tenths(*pixels.get(active)?);
                    Some(json!([x, y, reason]))
                });
                camera["inliers"] = json!(inliers);
                camera["rejected"] = rejected.collect();
            }
            cameras.push(camera);
            bodies.push(body);
        }
        let header = json!({
            "number": self.number,
            "at_s": shot.at_s,
            "distance_mm": self.distance_mm,
            "reasons": Reject::ALL.map(Reject::name),
            "cells": CELLS,
            "cameras": cameras,
        });
        let header = header.to_string().into_bytes();
        let mut message = (header.len() as u32).to_le_bytes().to_vec();
        message.extend(header);
        message.extend(bodies.concat());
        Encoded {
            number: self.number,
            message: message.into(),
            #[cfg(feature = "foxglove")]
            at_s: shot.at_s,
            #[cfg(feature = "foxglove")]
            images: bodies.into_iter().map(Bytes::from).collect(),
        }
    }
}

/// Rounds a place in an image to tenths of a pixel.
fn tenths(pixel: [f64; 2]) -> [f64; 2] {
    pixel.map(|at| rounded(at, 10.0))
}

/// Encodes an image; empty if it is missing.
fn jpeg(image: &Image) -> Vec<u8> {
    let mut body = Vec::new();
    if !image.is_missing() {
        let encoder = JpegEncoder::new_with_quality(&mut body, QUALITY);
        let [width, height] = [image.width as u32, image.height as u32];
        if encoder
            .write_image(&image.grey, width, height, ExtendedColorType::L8)
            .is_err()
        {
            body.clear();
        }
    }
    body
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_vision::flow::{Flow, FlowSettings};
    use trinocular_vision::images::{Scene, SceneSettings, Texture};

    #[test]
    fn message_holds_points_and_images() {
        let rig = Rig::paper();
        let texture = Texture::natural(1);
        let scene = Scene::new(&rig, &texture, SceneSettings::default()).unwrap();
        let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
        flow.set_keyframe(&scene.render([0.0; 3], 0, 1)).unwrap();
        let mut images = scene.render([60.0, 0.0, 0.0], 33_333, 2);
        let measurement = flow.measure(&images).unwrap();
        images.images[2] = Image::missing();
        let shot = Shot {
            at_s: 1.5,
            points: Some(Points::of(&measurement)),
            images,
        };
        let encoded = Encoder::new(&rig).encode(&shot);
        let (length, rest) = encoded.message.split_first_chunk().unwrap();
        let (header, bodies) = rest.split_at(u32::from_le_bytes(*length) as usize);
        let header: Value = serde_json::from_slice(header).unwrap();
        let cameras = header["cameras"].as_array().unwrap();
        let inliers = cameras[0]["inliers"].as_array().unwrap();
        assert_eq!(inliers.len(), measurement.correspondences.len());
        // Points that have left the view are outside or near the border.
        let rejected = cameras[0]["rejected"].as_array().unwrap();
        assert_eq!(rejected.len(), measurement.rejected_points.len());
        assert!(!rejected.is_empty());
        assert_eq!(cameras[2]["bytes"], 0);
        let first = cameras[0]["bytes"].as_u64().unwrap() as usize;
        let image = image::load_from_memory(&bodies[..first]).unwrap();
        assert_eq!((image.width(), image.height()), (320, 240));
        let distance = header["distance_mm"].as_f64().unwrap();
        assert!((distance - 850.0).abs() < 20.0, "{distance}");
        assert!(cameras[1]["overlap"].is_array());
    }
}
