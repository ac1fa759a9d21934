//! Predictions of `verify` against images that are rendered, tracked and estimated like any others.

use trinocular::budget::sigma::{MARGIN_PX, Predictor};
use trinocular_core::estimate::midpoint;
use trinocular_core::rig::Rig;
use trinocular_vision::field_of_view::FieldOfView;
use trinocular_vision::flow::{Flow, FlowSettings};
use trinocular_vision::images::{Scene, SceneSettings, Texture};
use trinocular_vision::sums::Sums;

/// Compares the sigma that a measurement states, which `tests/pipeline/sigma.rs` checks against
/// true errors, with the prediction for the same number of points and the noise of the
/// measurement's own residual.
#[track_caller]
fn assert_predicted(texture: &Texture, depth_mm: f64, noise_grey: f64, least: f64) {
    let rig = Rig::paper();
    let settings = SceneSettings {
        depth_mm,
        noise_grey,
        ..SceneSettings::default()
    };
    let scene = Scene::new(&rig, texture, settings).expect("a scene");
    let mut flow = Flow::new(&rig, FlowSettings::default()).expect("a rig");
    flow.set_keyframe(&scene.render([0.0; 3], 0, 1))
        .expect("texture");
    let seen = flow.measure(&scene.render([2.0, -1.0, 1.0], 0, 2));
    let seen = seen.expect("a small move");
    let sums = Sums::of(&rig, &seen).expect("a rig");
    let stated = midpoint::solve(&sums.centred).expect("points");
    let view = FieldOfView::new(&rig, MARGIN_PX);
    let points = u32::try_from(seen.correspondences.len()).expect("a few hundred");
    let predicted = Predictor::new(&rig, &view, depth_mm, stated.sigma_px)
        .expect("a common view")
        .predict(points);
    println!(
        "{depth_mm} mm, {noise_grey} grey levels: noise {:.4} px, {points} points, sigma stated \
         {:.5?} predicted {:.5?} mm",
        stated.sigma_px,
        stated.sigma_mm(),
        predicted.sigma_mm
    );
    for (stated, predicted) in stated.sigma_mm().into_iter().zip(predicted.sigma_mm) {
        let ratio = stated / predicted;
        assert!((least..=1.12).contains(&ratio), "{depth_mm} mm: {ratio}");
    }
}

#[test]
fn predicted_sigma_matches_measured() {
    let (sharp, soft) = (Texture::natural(3), Texture::blobs(3));
    // If interpolation errors dominate, windows do not share their errors and the stated sigma is
    // smaller.
    assert_predicted(&sharp, 500.0, 2.0, 0.7);
    assert_predicted(&sharp, 850.0, 0.5, 0.5);
    assert_predicted(&sharp, 1400.0, 2.0, 0.7);
    assert_predicted(&soft, 600.0, 2.0, 0.88);
    assert_predicted(&soft, 850.0, 2.0, 0.88);
    assert_predicted(&soft, 1400.0, 2.0, 0.88);
}
