//! Rays against surfaces of known shape.

use super::*;
use trinocular_rig::random::Random;

const CENTRE_MM: [f64; 2] = [-0.7, 3.0];

fn laser(from_mm: [f64; 3], direction: [f64; 3]) -> Laser {
    Laser { from_mm, direction }
}

/// Returns points at places of the rig, mm, as directions and inverse depths with errors of
/// inverse depth of this standard deviation, 1/mm.
fn seen(places_mm: &[[f64; 3]], sigma: f64, random: &mut Random) -> Vec<[f64; 3]> {
    let point = |[x, y, z]: &[f64; 3]| {
        let rho = 1.0 / z + sigma * random.gaussian();
        [(x - CENTRE_MM[0]) / z, (y - CENTRE_MM[1]) / z, rho]
    };
    places_mm.iter().map(point).collect()
}

/// Returns places on a surface that gives z at x and y, mm.
fn places(count: usize, random: &mut Random, surface: impl Fn(f64, f64) -> f64) -> Vec<[f64; 3]> {
    let place = |_| {
        let [x, y] = [120.0, 90.0].map(|most| random.between(-most, most));
        [x, y, surface(x, y)]
    };
    (0..count).map(place).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (Vector3::from(a) - Vector3::from(b)).norm()
}

fn tilted(x: f64, y: f64) -> f64 {
    850.0 + 0.4 * x - 0.2 * y
}

#[test]
fn spot_on_plane_is_exact() {
    let mut random = Random::seeded(3);
    for count in [3, 12, 13, 100] {
        let points = seen(&places(count, &mut random, tilted), 0.0, &mut random);
        let middle = points.iter().fold([0.0; 2], |sum, point| {
            [0, 1].map(|i| sum[i] + point[i] / count as f64)
        });
        let rho = points.iter().map(|point| point[2]).sum::<f64>() / count as f64;
        let through = [0, 1].map(|i| middle[i] / rho + CENTRE_MM[i]);
        let from = [30.0, 40.0, -20.0];
        let ray = laser(
            from,
            [through[0] - from[0], through[1] - from[1], 1.0 / rho + 20.0],
        );
        let [x, y, z] = meet(&points, CENTRE_MM, &ray).expect("it meets the plane");
        assert!((z - tilted(x, y)).abs() < 1e-8, "{count}: {z}");
        let along = (Vector3::new(x, y, z) - Vector3::from(from)).normalize();
        let off = along.cross(&Vector3::from(ray.direction).normalize());
        assert!(off.norm() < 1e-12, "{count}: {off:?}");
    }
}

/// A ball of radius 300 mm that bulges by 19 mm, noise of 0.05 px, and a tenth of wrong matches.
#[test]
fn spot_on_relief_is_near_its_surface() {
    let ball = |x: f64, y: f64| 1150.0 - (300f64.powi(2) - x * x - y * y).sqrt();
    let mut random = Random::seeded(4);
    let (mut squares, mut flat, mut farthest) = (0.0, 0.0, 0.0f64);
    for _ in 0..200 {
        let mut points = seen(&places(100, &mut random, ball), 1e-6, &mut random);
        for point in points.iter_mut().take(10) {
            point[2] *= 1.0 + 0.2 * random.between(-1.0, 1.0);
        }
        let [x, y] = [70.0, 50.0].map(|most| random.between(-most, most));
        let truth = [x, y, ball(x, y)];
        let from = [0.0, 60.0, 0.0];
        let ray = laser(from, [0, 1, 2].map(|i| truth[i] - from[i]));
        let hit = meet(&points, CENTRE_MM, &ray).expect("it meets the ball");
        farthest = farthest.max(distance(hit, truth));
        squares += distance(hit, truth).powi(2) / 200.0;
        let whole = common_plane(&points).expect("a plane");
        let depth = 1.0 / whole.inverse_depth([0, 1].map(|i| (truth[i] - CENTRE_MM[i]) / truth[2]));
        flat += (depth - truth[2]).powi(2) / 200.0;
    }
    let [spot, flat] = [squares, flat].map(f64::sqrt);
    println!("rms of the spot {spot:.2} mm, at most {farthest:.2} mm, of the plane {flat:.2} mm");
    assert!(spot < 1.2 && farthest < 6.0, "{spot} {farthest}");
    assert!(flat > 5.0 * spot, "{flat}");
}

#[test]
fn ray_beside_points_is_refused() {
    let mut random = Random::seeded(5);
    let points = seen(&places(80, &mut random, tilted), 0.0, &mut random);
    let beside = |direction| {
        let missed = meet(&points, CENTRE_MM, &laser([0.0; 3], direction));
        missed.expect_err("it meets no point")
    };
    let far = beside([0.4, 0.0, 1.0]);
    // The ray cuts the plane at x 405 mm, the points end at 120 mm.
    assert!(
        far.beside_mm.is_some_and(|mm| (200.0..300.0).contains(&mm)),
        "{far}"
    );
    assert!(far.to_string().contains("mm; point the laser"), "{far}");
    // Parallel to the plane, or towards a part of it behind the cameras.
    for direction in [[2.5, 0.0, 1.0], [4.0, 0.0, 1.0]] {
        assert_eq!(beside(direction), NoSpot { beside_mm: None });
    }
    // A little beyond the outermost points the target goes on.
    let edge = laser([0.0; 3], [125.0, 0.0, tilted(125.0, 0.0)]);
    let [x, ..] = meet(&points, CENTRE_MM, &edge).expect("it meets the border");
    assert!((x - 125.0).abs() < 1e-6);
}

#[test]
fn points_on_one_line_have_no_surface() {
    let places: Vec<[f64; 3]> = (0..20).map(|i| [f64::from(i), 0.0, 850.0]).collect();
    let points = seen(&places, 0.0, &mut Random::seeded(6));
    let ray = laser([0.0; 3], [0.0, 0.0, 1.0]);
    assert!(meet(&points, CENTRE_MM, &ray).is_err());
    assert!(meet(&[], CENTRE_MM, &ray).is_err());
}
