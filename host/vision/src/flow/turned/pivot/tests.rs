//! Lasers on rendered targets.

use super::*;
use crate::estimation::{Rotation, Rule};
use crate::flow::FlowSettings;
use crate::images::{Exposure, FrameSet, Pose, Scene, SceneSettings, Texture};
use nalgebra::{Rotation3, Vector3};
use trinocular_core::rig::Rig;

const FROM_MM: [f64; 3] = [15.0, 60.0, 10.0];

/// Returns a laser at [`FROM_MM`] that shines on a place, mm.
fn laser_on(place_mm: [f64; 3]) -> Laser {
    Laser {
        from_mm: FROM_MM,
        direction: [0, 1, 2].map(|i| 0.7 * (place_mm[i] - FROM_MM[i])),
    }
}

fn scene(seed: u64, depth_mm: f64, tilt_rad: [f64; 2]) -> Scene {
    let settings = SceneSettings {
        depth_mm,
        tilt_rad,
        ..SceneSettings::default()
    };
    Scene::new(&Rig::paper(), &Texture::natural(seed), settings).expect("a scene")
}

fn flow_at(keyframe: &FrameSet) -> Flow {
    let mut flow = Flow::new(&Rig::paper(), FlowSettings::default()).expect("the paper's rig");
    flow.set_keyframe(keyframe).expect("a keyframe");
    flow
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (Vector3::from(a) - Vector3::from(b)).norm()
}

#[test]
fn spot_on_tilted_poster_is_followed() {
    let scene = scene(1, 850.0, [0.2, -0.15]);
    let place_mm = scene.point_mm([60.0, -40.0], [0.0; 3]);
    let mut flow = flow_at(&scene.render([0.0; 3], 0, 1));
    flow.set_pivot(Some(Pivot::Spot(laser_on(place_mm))));
    let (relative_mm, turned_deg) = ([4.0, -3.0, 6.0], [1.0, -4.0, 3.0]);
    let pose = Pose {
        relative_mm,
        turned_deg,
    };
    let exposures = vec![Exposure::of(pose, scene.settings().noise_grey); scene.cameras()];
    let now = scene.render_exposures(&exposures, 33_333, 2);
    let seen = flow.measure_target(&now).expect("a measurement");
    let turn = seen.turn.expect("a rotation");
    assert!(distance(turn.pivot_mm, place_mm) < 0.5, "{turn:?}");
    // The poster turns about its origin.
    let arm = Vector3::from(place_mm) - Vector3::new(0.0, 0.0, 850.0);
    let turned = Rotation3::new(Vector3::from(turned_deg.map(f64::to_radians)));
    let truth = Vector3::from(relative_mm) + turned * arm - arm;
    let off = distance(seen.displacement_mm, truth.into());
    assert!(off < 0.06, "{off}");
}

/// A near poster left of x = 0 covers a far one.
#[test]
fn spot_is_on_the_surface_that_the_ray_meets() {
    let [near, far] = [scene(1, 780.0, [0.0; 2]), scene(2, 950.0, [0.0; 2])];
    let mut seen = near.render([0.0; 3], 0, 1);
    let behind = far.render([0.0; 3], 0, 2);
    for ((image, other), camera) in
        (seen.images.iter_mut().zip(&behind.images)).zip(&Rig::paper().cameras)
    {
        let [edge_px, _] = camera.project([0.0, 0.0, 780.0]);
        for (i, grey) in image.grey.iter_mut().enumerate() {
            if (i % image.width) as f64 > edge_px {
                *grey = other.grey[i];
            }
        }
    }
    let flow = flow_at(&seen);
    for (x, y, z) in [
        (-90.0, 20.0, 780.0),
        (-60.0, -50.0, 780.0),
        (100.0, 30.0, 950.0),
    ] {
        let place_mm = [x, y, z];
        let spot = flow.keyframe_pivot_mm(Pivot::Spot(laser_on(place_mm)));
        let spot = spot.expect("it meets the target");
        assert!(distance(spot, place_mm) < 2.0, "{spot:?} {place_mm:?}");
    }
}

#[test]
fn laser_beside_target_is_refused() {
    let scene = scene(1, 850.0, [0.0; 2]);
    let keyframe = scene.render([0.0; 3], 0, 1);
    let mut flow = flow_at(&keyframe);
    let pivot = Pivot::Spot(laser_on([600.0, 0.0, 850.0]));
    flow.set_pivot(Some(pivot));
    let refusal = flow.measure_target(&keyframe).expect_err("no spot");
    assert!(matches!(refusal, FlowRefusal::NoSpot(_)), "{refusal}");
    assert!(refusal.to_string().contains("[laser]"), "{refusal}");
    let rule = Rule {
        rotation: Some(Rotation::Estimate),
        pivot,
        ..Rule::default()
    };
    let reason = rule.of_images(&mut flow, &Rig::paper(), &keyframe);
    assert_eq!(reason.err(), Some(refusal.to_string()));
    let flow = Flow::new(&Rig::paper(), FlowSettings::default()).expect("the paper's rig");
    assert_eq!(flow.keyframe_pivot_mm(pivot), Err(FlowRefusal::NoKeyframe));
}
