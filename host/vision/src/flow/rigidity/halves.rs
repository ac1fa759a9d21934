//! Division of the inliers into halves, in several directions of the image.

use crate::flow::Correspondence;
use crate::matching::geometry::RigGeometry;

/// Coordinates along which the inliers are ordered: across, down, along both diagonals, and away
/// from their middle.
const DIRECTIONS: [fn([f64; 2]) -> f64; 5] = [
    |[x, _]| x,
    |[_, y]| y,
    |[x, y]| x + y,
    |[x, y]| x - y,
    |[x, y]| x.hypot(y),
];

/// Divides `inliers` in the middle of each direction of the reference image. Returns their numbers.
pub(super) fn halves(geometry: &RigGeometry, inliers: &[Correspondence]) -> [[Vec<usize>; 2]; 5] {
    let places: Vec<[f64; 2]> = (inliers.iter())
        .map(|inlier| inlier.pixels[geometry.reference][0])
        .collect();
    let count = places.len().max(1) as f64;
    let middle = [0, 1].map(|i| places.iter().map(|place| place[i]).sum::<f64>() / count);
    DIRECTIONS.map(|along| {
        let key = |i: &usize| along([0, 1].map(|axis| places[*i][axis] - middle[axis]));
        let mut ordered: Vec<usize> = (0..places.len()).collect();
        ordered.sort_by(|a, b| key(a).total_cmp(&key(b)));
        let far = ordered.split_off(ordered.len() / 2);
        [ordered, far]
    })
}
