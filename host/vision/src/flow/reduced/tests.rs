//! Soft images, and images of half the size.

use super::*;
use crate::flow::{Flow, FlowSettings};
use crate::images::{Scene, SceneSettings, Texture, TextureKind};
use trinocular_core::estimate::midpoint;
use trinocular_core::sums::centred::CentredSums;
use trinocular_rig::pivot::Pivot;
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::Laser;

const TARGET_MM: [f64; 3] = [4.0, -3.0, 10.0];

/// Draws discs of one size and shade at random places.
fn discs(seed: u64) -> Texture {
    const SIDE: [usize; 2] = [900, 700];
    const RADIUS: f64 = 18.0;
    let mut random = Random::seeded(seed);
    let mut grey = vec![80.0; SIDE[0] * SIDE[1]];
    for _ in 0..160 {
        let centre = SIDE.map(|side| random.between(0.0, side as f64));
        for (i, level) in grey.iter_mut().enumerate() {
            let [x, y] = [i % SIDE[0], i / SIDE[0]].map(|c| c as f64);
            if (x - centre[0]).hypot(y - centre[1]) < RADIUS {
                *level = 190.0;
            }
        }
    }
    Texture {
        width: SIDE[0],
        height: SIDE[1],
        mm_per_texel: 1.0,
        grey,
    }
}

fn soft(texture: &Texture, blur_px: f64) -> Scene {
    let settings = SceneSettings {
        blur_px,
        ..SceneSettings::default()
    };
    Scene::new(&Rig::paper(), texture, settings).unwrap()
}

fn measured(scene: &Scene) -> Result<Measurement, FlowRefusal> {
    let mut flow = Flow::new(&Rig::paper(), FlowSettings::default())?;
    flow.set_keyframe(&scene.render([0.0; 3], 0, 1))?;
    flow.measure(&scene.render(TARGET_MM, 0, 2))
}

/// Returns the largest error in standard deviations, and the largest error in mm.
fn error(measurement: &Measurement) -> [f64; 2] {
    let mut sums = CentredSums::new(&Rig::paper()).unwrap();
    for point in &measurement.correspondences {
        assert!(sums.add(&point.views));
    }
    let estimate = midpoint::solve(&sums).unwrap();
    let factor = measurement.variance_inflation.factor.sqrt();
    let sigma = estimate.sigma_mm().map(|sigma| factor * sigma);
    let off = [0, 1, 2].map(|i| (estimate.displacement_mm[i] - TARGET_MM[i]).abs());
    let ratios = [0, 1, 2].map(|i| off[i] / sigma[i]);
    [ratios, off].map(|values| values.into_iter().fold(0.0, f64::max))
}

#[test]
fn soft_images_of_like_objects_are_measured() {
    for blur_px in [3.0, 5.0] {
        for seed in 1..=2 {
            let textures = [discs(seed), Texture::notes(seed), Texture::natural(seed)];
            for (kind, texture) in textures.iter().enumerate() {
                let measurement = measured(&soft(texture, blur_px))
                    .unwrap_or_else(|refusal| panic!("{kind} {blur_px} {seed}: {refusal}"));
                let [sigmas, mm] = error(&measurement);
                let right = sigmas < 4.5 && mm < 1.0;
                assert!(right, "{kind} {blur_px} {seed}: {sigmas} {mm}");
            }
        }
    }
}

/// Returns a tracker whose keyframe is refused at full resolution.
fn reduced(scene: &Scene) -> Flow {
    let mut flow = Flow::new(&Rig::paper(), FlowSettings::default()).unwrap();
    let filtered = flow.filter(&scene.render([0.0; 3], 0, 1)).unwrap();
    let refusal = FlowRefusal::FewCorners { found: 0, least: 8 };
    flow.reduced = flow.with_reduced_keyframe(&filtered, &refusal, &mut ());
    assert!(flow.reduced.is_some());
    flow
}

#[test]
fn reduced_keyframe_measures_in_whole_pixels() {
    for blur_px in [1.0, 4.0] {
        let scene = soft(&Texture::natural(2), blur_px);
        let mut flow = reduced(&scene);
        let measurement = flow.measure(&scene.render(TARGET_MM, 0, 2)).unwrap();
        let [sigmas, mm] = error(&measurement);
        assert!(sigmas < 4.5 && mm < 0.5, "{blur_px}: {sigmas} {mm}");
        for point in &measurement.correspondences {
            let again = Correspondence::from_pixels(&Rig::paper(), point.pixels.clone());
            for (a, b) in again.views.iter().zip(&point.views) {
                assert!((a.end[0] - b.end[0]).abs() < 1e-9);
                assert!((a.start[1] - b.start[1]).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn other_refusals_are_not_for_softness() {
    let scene = soft(&Texture::natural(2), 1.0);
    let mut flow = Flow::new(&Rig::paper(), FlowSettings::default()).unwrap();
    let filtered = flow.filter(&scene.render([0.0; 3], 0, 1)).unwrap();
    let refusal = FlowRefusal::FewCameras { left: 1 };
    let none = flow.with_reduced_keyframe(&filtered, &refusal, &mut ());
    assert!(none.is_none());
}

#[test]
fn soft_repetition_is_measured_or_refused() {
    for blur_px in [2.0, 3.0, 5.0, 8.0] {
        for kind in [TextureKind::Bricks, TextureKind::Grid] {
            for seed in 1..=2 {
                let scene = soft(&Texture::of_kind(kind, seed), blur_px);
                if let Ok(measurement) = measured(&scene) {
                    let [sigmas, mm] = error(&measurement);
                    assert!(
                        sigmas < 4.5 && mm < 1.0,
                        "{kind:?} {blur_px}: {sigmas} {mm}"
                    );
                }
            }
        }
    }
}

#[test]
fn pose_of_reduced_keyframe_is_measured() {
    let scene = soft(&Texture::natural(1), 4.0);
    let mut flow = reduced(&scene);
    assert!(
        flow.keyframe_centroid_mm()
            .is_some_and(|mm| (mm[2] - 850.0).abs() < 20.0)
    );
    let laser = Laser {
        from_mm: [0.0, 40.0, 0.0],
        direction: [0.0, -0.05, 1.0],
    };
    let spot = flow.keyframe_pivot_mm(Pivot::Spot(laser)).expect("a spot");
    assert!((spot[2] - 850.0).abs() < 5.0, "{spot:?}");
    assert!((spot[1] - 40.0 + 0.05 * spot[2]).abs() < 1e-6, "{spot:?}");
    let measured = flow
        .measure_pose(&scene.render([4.0, 0.0, 0.0], 0, 2))
        .unwrap();
    let there = measured.pose.displacement_of([0.0, 0.0, 850.0]);
    assert!((there.displacement_mm[0] - 4.0).abs() < 0.5, "{there:?}");
}

#[test]
fn halved_region_stays_inside() {
    let mask = Image {
        width: 5,
        height: 3,
        grey: (0..15).map(|i| if i % 5 < 3 { 255 } else { 0 }).collect(),
    };
    let region = Region {
        rectangle_px: Some([3, 0, 6, 3]),
        mask: Some(Arc::new(mask)),
    };
    let halved = region.halved();
    assert_eq!(halved.rectangle_px, Some([2, 0, 2, 1]));
    let expected = Image {
        width: 3,
        height: 2,
        grey: vec![255, 255, 0, 255, 255, 0],
    };
    assert_eq!(halved.mask.as_deref(), Some(&expected));
}
