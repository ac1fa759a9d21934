//! The stated sigma against true errors: errors of many frame sets, each divided by its own sigma.

use trinocular_core::rig::Rig;
use trinocular_rig::random::Random;
use trinocular_vision::images::{SceneSettings, Texture, TextureKind};

use super::bench::{Bench, Watch};

/// Returns the mean square per axis of error over sigma: 1 if sigma is right, above 1 if it is too
/// small. Every displacement has its own keyframe, because the noise of a shared one would be in
/// all of them.
fn normalised_errors(kind: TextureKind, noise_grey: f64) -> [f64; 3] {
    let (posters, pairs) = (2, 20);
    let (mut squares, mut random) = ([0.0; 3], Random::seeded(21));
    for poster in 0..posters {
        let settings = SceneSettings {
            noise_grey,
            ..SceneSettings::default()
        };
        let bench = Bench::new(&Texture::of_kind(kind, 30 + poster), settings);
        for pair in 0..pairs {
            let mut place = |most: [f64; 3]| most.map(|m| random.between(-m, m));
            let from = place([20.0, 20.0, 3.0]);
            let moved = place([20.0, 20.0, 7.0]);
            let to = std::array::from_fn(|i| from[i] + moved[i]);
            let seed = 100 * poster + 2 * pair;
            let mut watch = Watch::new(&bench.rig, &bench.scene.render(from, 0, seed)).unwrap();
            let got = watch.measure(&bench.scene.render(to, 1, seed + 1)).unwrap();
            let error = got.error_mm(moved);
            for axis in 0..3 {
                squares[axis] += (error[axis] / got.sigma_mm[axis]).powi(2);
            }
        }
    }
    squares.map(|sum| sum / (posters * pairs) as f64)
}

/// 40 pairs leave the mean square uncertain by 22 % (one standard deviation), which is enough to
/// distinguish 1 from 0.5 and 1.65. `trinocular bench robustness` measures many more pairs.
#[test]
fn sigma_is_true_for_noise() {
    for noise_grey in [2.0, 6.0] {
        let mean_squares = normalised_errors(TextureKind::Blobs, noise_grey);
        for square in mean_squares {
            assert!(
                (0.5..=1.65).contains(&square),
                "{noise_grey}: {mean_squares:?}"
            );
        }
    }
}

/// With sharp texture and little noise the points scatter because their sub-pixel positions differ.
/// Overlapping windows do not share this error, so it averages out better than noise does, and
/// sigma is smaller.
#[test]
fn sigma_is_true_for_interpolation() {
    for noise_grey in [0.5, 2.0] {
        let mean_squares = normalised_errors(TextureKind::Natural, noise_grey);
        for square in mean_squares {
            assert!(
                (0.3..=1.65).contains(&square),
                "{noise_grey}: {mean_squares:?}"
            );
        }
    }
}

/// The wire carries the same sigma: the station computes from the integers the value that the host
/// computes.
#[test]
fn station_gets_same_sigma() {
    use trinocular_core::estimate::midpoint;
    use trinocular_vision::flow::{Flow, FlowSettings};
    use trinocular_vision::sums::Sums;

    let rig = Rig::paper();
    let bench = Bench::new(&Texture::blobs(40), SceneSettings::default());
    let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
    flow.set_keyframe(&bench.scene.render([0.0; 3], 0, 1))
        .unwrap();
    let seen = flow
        .measure(&bench.scene.render([4.0, 4.0, 1.0], 1, 2))
        .unwrap();
    let honest = Sums::of(&rig, &seen).unwrap();
    let white = Sums::new(&rig, &seen.correspondences).unwrap();
    let sigma = |sums: &Sums| midpoint::solve(&sums.centred).unwrap().sigma_mm();
    let station = midpoint::solve_fixed(&honest.centred.quantise().unwrap()).unwrap();
    for axis in 0..3 {
        let told = f64::from(station.sigma_nm()[axis]) * 1e-6;
        let (honest, white) = (sigma(&honest)[axis], sigma(&white)[axis]);
        assert!(
            (told - honest).abs() <= 0.01 * honest,
            "axis {axis}: {told} mm, not {honest}"
        );
        assert!(
            honest > 1.2 * white,
            "axis {axis}: windows overlap, {honest} over {white}"
        );
    }
}
