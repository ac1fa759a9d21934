//! Laws that hold without noise, and refusals.

use super::scene::{LINE, PIVOT_MM, POSTER, RELIEF, Scene};
use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use trinocular_core::estimate::midpoint;
use trinocular_core::estimate::pose::{self, Estimate, Noise, Observation, Parts, Point, Refusal};
use trinocular_core::sums::centred::CentredSums;
use trinocular_rig::random::Random;
use trinocular_tests::points::ideal_rig;

const PAIR: &[[f64; 2]] = &[[-35.0, 0.0], [35.0, 0.0]];
const CROSS: &[[f64; 2]] = &[
    [0.0, 70.0],
    [-57.0, 72.0],
    [-30.0, -12.0],
    [52.0, -15.0],
    [8.0, -76.0],
];

fn largest(values: [f64; 3], wanted: [f64; 3]) -> f64 {
    let off = values.iter().zip(wanted).map(|(a, b)| (a - b).abs());
    off.fold(0.0, f64::max)
}

fn axis() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-1.0..1.0f64).prop_filter("a direction", |axis: &[f64; 3]| {
        axis.iter().map(|a| a * a).sum::<f64>() > 0.01
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Any rotation to 170 degrees and any displacement: the errors are those of rounding. The
    /// largest of 20,000 cases were 9e-11 mm and 3e-12 rad.
    #[test]
    fn pose_is_exact_at_any_rotation(
        seed in 0u64..1_000_000,
        cameras in prop::sample::select(vec![PAIR, &LINE[..], CROSS]),
        shape in prop::sample::select(vec![POSTER, RELIEF]),
        moved in prop::array::uniform3(-150.0..150.0f64),
        axis in axis(),
        degrees in 0.0..170.0f64,
    ) {
        let random = &mut Random::seeded(seed);
        let scene = Scene::new(cameras, shape, 20, random).moved(moved, axis, degrees);
        let observations = scene.exact();
        for noise in [Noise::independent(0.0), Noise::of(&scene.geometry, &observations)] {
            let pose = pose::reweighted(&scene.geometry, &observations, &noise).unwrap();
            let off = largest(pose.displacement_of(PIVOT_MM).displacement_mm, moved);
            prop_assert!(off < 1e-9, "{off} mm");
            let off = largest(pose.rotation_rad(), scene.rotation_rad);
            prop_assert!(off < 1e-11, "{off} rad");
        }
    }

    /// Any rotation about z, half a turn included, and about axes up to 25 degrees beside it.
    #[test]
    fn turn_about_z_is_exact_at_any_angle(
        seed in 0u64..1_000_000,
        cameras in prop::sample::select(vec![PAIR, &LINE[..], CROSS]),
        moved in prop::array::uniform3(-150.0..150.0f64),
        tilt in prop::array::uniform2(-0.33..0.33f64),
        degrees in prop_oneof![-360.0..360.0f64, Just(90.0), Just(180.0), Just(-120.0)],
    ) {
        let random = &mut Random::seeded(seed);
        let axis = [tilt[0], tilt[1], 1.0];
        let scene = Scene::new(cameras, RELIEF, 20, random).moved(moved, axis, degrees);
        let pose = pose::solve(&scene.geometry, &scene.exact()).unwrap();
        let off = largest(pose.displacement_of(PIVOT_MM).displacement_mm, moved);
        prop_assert!(off < 1e-9, "{off} mm");
        // Rotation vectors of half a turn have two signs; matrices do not.
        let (got, wanted) = (pose.rotation(), scene.rotation());
        let vector = Rotation3::new(Vector3::from(pose.rotation_rad()));
        for (i, row) in got.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                prop_assert!((value - wanted[(i, j)]).abs() < 1e-11, "{got:?}");
                prop_assert!((value - vector[(i, j)]).abs() < 1e-11, "{vector}");
            }
        }
        let place = scene.points_mm[0];
        let off = largest(pose.apply(place), scene.after(place));
        prop_assert!(off < 1e-9, "{off} mm");
    }

    /// The order of the cameras does not matter, and a displaced rig sees the same motion.
    #[test]
    fn pose_does_not_depend_on_labels(seed in 0u64..1_000_000, axis in axis()) {
        let random = &mut Random::seeded(seed);
        let scene = Scene::new(&LINE, RELIEF, 20, random).moved([4.0, -3.0, 6.0], axis, 12.0);
        let views = scene.views(|| std::array::from_fn(|_| 0.05 * random.gaussian()));
        let solve = |cameras: &[[f64; 2]], order: [usize; 3]| {
            let rig = ideal_rig(530.0, cameras);
            let geometry = trinocular_core::sums::centred::Geometry::new(&rig);
            let geometry = geometry.unwrap();
            let points = views.iter().map(|views| order.map(|k| views[k]));
            let points = points.filter_map(|views| Observation::new(&geometry, &views));
            pose::solve(&geometry, &points.collect::<Vec<_>>()).unwrap()
        };
        let plain = solve(&LINE, [0, 1, 2]);
        let turned = solve(&[LINE[2], LINE[0], LINE[1]], [2, 0, 1]);
        let aside = solve(&LINE.map(|[x, y]| [x + 30.0, y - 9.0]), [0, 1, 2]);
        let displaced = plain.displacement_of(PIVOT_MM).displacement_mm;
        for (other, pivot_mm) in [
            (turned, PIVOT_MM),
            (aside, [PIVOT_MM[0] + 30.0, PIVOT_MM[1] - 9.0, PIVOT_MM[2]]),
        ] {
            let off = largest(other.displacement_of(pivot_mm).displacement_mm, displaced);
            prop_assert!(off < 1e-9, "{off} mm");
            prop_assert!(largest(other.rotation_rad(), plain.rotation_rad()) < 1e-11);
        }
    }

    /// Displacements of two points of the target differ by the rotation of their distance, and all
    /// pivots describe one motion.
    #[test]
    fn pivots_describe_one_motion(seed in 0u64..1_000_000, axis in axis()) {
        let random = &mut Random::seeded(seed);
        let scene = Scene::new(&LINE, RELIEF, 20, random).moved([4.0, -3.0, 6.0], axis, 40.0);
        let pose = pose::solve(&scene.geometry, &scene.noisy(0.05, random)).unwrap();
        let rotation = nalgebra::Matrix3::from_fn(|i, j| pose.rotation()[i][j]);
        let translation = Vector3::from(pose.translation_mm());
        for at in [PIVOT_MM, pose.centroid_mm, [300.0, -200.0, 500.0], [0.0; 3]] {
            let moved = Vector3::from(pose.displacement_of(at).displacement_mm);
            let wanted = rotation * Vector3::from(at) + translation - Vector3::from(at);
            prop_assert!((moved - wanted).norm() < 1e-9, "{moved} {wanted}");
        }
    }
}

/// A pose before and one after: what a search does with a displacement, and with a further turn.
#[test]
fn poses_are_composed() {
    let random = &mut Random::seeded(7);
    for degrees in [12.0, 80.0, 175.0] {
        let scene = Scene::new(&LINE, RELIEF, 20, random);
        let scene = scene.moved([9.0, -30.0, 20.0], [0.2, -0.1, 1.0], degrees);
        let pose = pose::solve(&scene.geometry, &scene.exact()).unwrap();
        let place = [40.0, -25.0, 870.0];
        let shifted = pose.preceded_by([3.0, 4.0, -5.0]);
        let wanted = pose.apply([43.0, -21.0, 865.0]);
        assert!(largest(shifted.apply(place), wanted) < 1e-9);
        let (about, omega) = ([5.0, -8.0, 0.0], [0.1, 0.05, -0.2]);
        let [pivot, moved] = [PIVOT_MM, scene.displacement_mm];
        let exact = Estimate::turned(&scene.geometry, scene.rotation_rad, pivot, moved).unwrap();
        assert!(largest(exact.apply(place), pose.apply(place)) < 1e-9);
        let then = Estimate::exact(omega, about, [0.0; 3]);
        let both = pose.followed_by(omega, about);
        assert_eq!(both.centroid_mm, pose.centroid_mm);
        assert!(largest(both.apply(place), then.apply(pose.apply(place))) < 1e-9);
    }
}

/// A target that does not turn: the pose differs from the midpoint by less than 0.75 sigma with
/// noise, and by less than 1e-9 mm without.
#[test]
fn still_target_agrees_with_midpoint() {
    let random = &mut Random::seeded(5);
    for shape in [POSTER, RELIEF] {
        let (mut off_squares, mut worst) = ([0.0; 3], 0.0f64);
        for _ in 0..100 {
            let scene = Scene::new(&LINE, shape, 100, random);
            let scene = scene.moved([12.0, -8.0, 10.0], [1.0, 0.0, 0.0], 0.0);
            let views = scene.views(|| std::array::from_fn(|_| 0.05 * random.gaussian()));
            let mut sums = CentredSums::new(&scene.rig).unwrap();
            assert!(views.iter().all(|views| sums.add(views)));
            let plain = midpoint::solve(&sums).unwrap();
            let points = views.iter();
            let points = points.filter_map(|views| Observation::new(&scene.geometry, views));
            let pose = pose::solve(&scene.geometry, &points.collect::<Vec<_>>()).unwrap();
            let there = pose.displacement_of(pose.centroid_mm);
            for (axis, off_square) in off_squares.iter_mut().enumerate() {
                let off = there.displacement_mm[axis] - plain.displacement_mm[axis];
                *off_square += (off / plain.sigma_mm()[axis]).powi(2) / 100.0;
                worst = worst.max((off / there.sigma_mm()[axis]).abs());
            }
        }
        // A price of 1.2 in sigma is a difference of sqrt(1.2² - 1) = 0.66 sigma.
        assert!(
            off_squares.iter().all(|square| square.sqrt() < 0.75),
            "{off_squares:?}"
        );
        assert!(worst < 3.0, "{worst}");
    }
    let scene = Scene::new(&LINE, POSTER, 40, random);
    let scene = scene.moved([12.0, -8.0, 10.0], [1.0, 0.0, 0.0], 0.0);
    let pose = pose::solve(&scene.geometry, &scene.exact()).unwrap();
    let mut sums = CentredSums::new(&scene.rig).unwrap();
    assert!(scene.views(|| [0.0; 4]).iter().all(|views| sums.add(views)));
    let plain = midpoint::solve(&sums).unwrap().displacement_mm;
    assert!(largest(pose.displacement_of(PIVOT_MM).displacement_mm, plain) < 1e-9);
}

/// Points on one line leave the rotation about it open, however noisy.
#[test]
fn points_on_one_line_are_refused() {
    for seed in 0..300 {
        let random = &mut Random::seeded(seed);
        let mut scene = Scene::new(&LINE, RELIEF, 3 + seed as usize % 60, random);
        let along = Vector3::new(
            random.gaussian(),
            random.gaussian(),
            0.5 * random.gaussian(),
        );
        for at in &mut scene.points_mm {
            let place = along.normalize() * 80.0 * random.between(-1.0, 1.0);
            *at = (Vector3::from(PIVOT_MM) + place).into();
        }
        let scene = scene.moved([3.0, -2.0, 5.0], [0.3, 0.5, 1.0], 8.0);
        for sigma_px in [0.0, 0.02, 0.1] {
            let seen = scene.noisy(sigma_px, random);
            let refused = pose::solve(&scene.geometry, &seen);
            assert_eq!(
                refused.err(),
                Some(Refusal::Degenerate),
                "{seed}, {sigma_px} px"
            );
        }
    }
}

#[test]
fn undetermined_rotations_are_refused() {
    let random = &mut Random::seeded(8);
    let scene = Scene::new(&LINE, RELIEF, 20, random);
    let seen = scene.exact();
    let solve = |seen: &[Observation]| pose::solve(&scene.geometry, seen).err();
    assert_eq!(solve(&[]), Some(Refusal::TooFewPoints));
    assert_eq!(solve(&seen[..2]), Some(Refusal::TooFewPoints));
    assert_eq!(solve(&seen[..3]), None);
    assert_eq!(solve(&[seen[0]; 20]), Some(Refusal::Degenerate));
    let mut wrong = seen.clone();
    wrong[3].end[2] = f64::NAN;
    assert_eq!(solve(&wrong), Some(Refusal::OutOfRange));
    // A half turn about an axis across z has no Cayley vector, whatever quarter turn comes first.
    let half = Scene::new(&LINE, RELIEF, 20, random).moved([1.0; 3], [0.3, 1.0, 0.0], 180.0);
    assert_eq!(solve(&half.exact()), Some(Refusal::Degenerate));
}

/// The pose of all parts together is that of all points, and each part has the exact one.
#[test]
fn parts_have_pose_of_the_whole() {
    for (axis, degrees) in [([0.2, -0.7, 0.4], 12.0), ([0.1, 0.1, 1.0], 130.0)] {
        let random = &mut Random::seeded(5);
        let moved = [3.0, -8.0, 20.0];
        let scene = Scene::new(&LINE, RELIEF, 40, random).moved(moved, axis, degrees);
        let observations = scene.exact();
        let whole = pose::solve(&scene.geometry, &observations).unwrap();
        let parts = Parts::of(whole.first, &scene.geometry, &observations).unwrap();
        let points: Option<Vec<Point>> = observations.iter().map(|o| parts.point(o)).collect();
        let points = points.unwrap();
        let together = parts.solve(points.iter()).unwrap();
        for part in [&points[..], &points[..20], &points[20..]] {
            let pose = parts.solve(part.iter()).unwrap();
            let off = largest(pose.displacement_of(PIVOT_MM).displacement_mm, moved);
            assert!(off < 1e-8, "{off} mm");
            let off = largest(pose.rotation_rad(), whole.rotation_rad());
            assert!(off < 1e-10, "{off} rad");
        }
        assert!(largest(together.centroid_mm, whole.centroid_mm) < 1e-9);
        assert!(parts.solve(points[..2].iter()).is_err());
    }
}

/// With noise, the covariance of all parts together is that of all points.
#[test]
fn parts_have_covariance_of_the_whole() {
    let random = &mut Random::seeded(6);
    let scene = Scene::new(&LINE, RELIEF, 60, random).moved([1.0, 2.0, 3.0], [0.3, 0.5, 0.4], 9.0);
    let observations = scene.noisy(0.05, random);
    let whole = pose::solve(&scene.geometry, &observations).unwrap();
    let parts = Parts::of(whole.first, &scene.geometry, &observations).unwrap();
    let points: Vec<Point> = observations.iter().filter_map(|o| parts.point(o)).collect();
    let together = parts.solve(points.iter()).unwrap();
    for (row, wanted) in together.covariance.iter().zip(whole.covariance) {
        for (value, wanted) in row.iter().zip(wanted) {
            assert!(
                (value - wanted).abs() <= 1e-9 * wanted.abs(),
                "{value} {wanted}"
            );
        }
    }
    // Half of the points have twice the variance, roughly.
    let half = parts.solve(points[..30].iter()).unwrap();
    let ratio = half.covariance[2][2] / whole.covariance[2][2];
    assert!(ratio > 1.3 && ratio < 4.0, "{ratio}");
}
