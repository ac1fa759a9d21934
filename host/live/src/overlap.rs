//! Working overlap: the part of each image that all cameras see, at the distance of the target.

use trinocular_core::rig::Rig;
use trinocular_core::sums::View;
use trinocular_vision::field_of_view::FieldOfView;
use trinocular_vision::flow::Correspondence;

/// Border of an image in which no point can be followed, px.
const MARGIN_PX: f64 = 12.0;

/// Computes the distance of the target from matched points, mm: the median over the points, from
/// the two active `cameras` that stand farthest apart.
pub fn distance_mm(rig: &Rig, cameras: &[usize], points: &[Correspondence]) -> Option<f64> {
    let offset = |k: usize| rig.cameras.get(cameras[k]).map(|camera| camera.offset_mm);
    let mut widest = (0.0, 0, 0, [0.0; 2]);
    for a in 0..cameras.len() {
        for b in a + 1..cameras.len() {
            let ([ax, ay], [bx, by]) = (offset(a)?, offset(b)?);
            let across = [bx - ax, by - ay];
            let length = across[0].hypot(across[1]);
            if length > widest.0 {
                widest = (length, a, b, across);
            }
        }
    }
    let (length, a, b, across) = widest;
    // A camera farther right sees a point at distance Z farther left, by the baseline over Z.
    let distance = |point: &Correspondence| {
        let ends: [[f64; 2]; 2] = [view(point, a)?.end, view(point, b)?.end];
        let shift = [0, 1].map(|i| ends[0][i] - ends[1][i]);
        let along = (shift[0] * across[0] + shift[1] * across[1]) / length;
        (along > 0.0).then(|| length / along)
    };
    let mut distances: Vec<f64> = points.iter().filter_map(distance).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied()
}

fn view(point: &Correspondence, k: usize) -> Option<&View> {
    point.views.get(k)
}

/// Returns the corners of the common field of view at this distance in every camera's image, px.
/// Empty if there is none.
pub fn corners(rig: &Rig, distance_mm: f64) -> Vec<[[f64; 2]; 4]> {
    let Some(common) = FieldOfView::new(rig, MARGIN_PX).common(distance_mm) else {
        return Vec::new();
    };
    let [[left, top], [right, bottom]] = [common.low, common.high];
    let corners = [[left, top], [right, top], [right, bottom], [left, bottom]];
    let cameras = rig.cameras.iter();
    cameras
        .map(|camera| corners.map(|[x, y]| camera.project([x, y, distance_mm])))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_of_projected_points_is_found() {
        let rig = Rig::paper();
        let points: Vec<Correspondence> = [[10.0, 5.0], [-30.0, 20.0], [0.0, -10.0]]
            .iter()
            .map(|[x, y]| {
                let pixels = rig.cameras.iter();
                let pixels = pixels.map(|camera| [camera.project([*x, *y, 850.0]); 2]);
                Correspondence::from_pixels(&rig, pixels.collect())
            })
            .collect();
        let found = distance_mm(&rig, &[0, 1, 2], &points).unwrap();
        assert!((found - 850.0).abs() < 1e-6, "{found}");
        assert_eq!(distance_mm(&rig, &[0, 1, 2], &[]), None);
        assert_eq!(distance_mm(&rig, &[1], &points), None);
    }

    #[test]
    fn overlap_lies_within_every_image() {
        let rig = Rig::paper();
        let all = corners(&rig, 850.0);
        assert_eq!(all.len(), 3);
        for [x, y] in all.iter().flatten() {
            assert!((11.0..309.0).contains(x) && (11.0..229.0).contains(y));
        }
        // Nearer than the outer cameras' views meet.
        assert!(corners(&rig, 100.0).is_empty());
    }
}
