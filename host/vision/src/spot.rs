//! The spot of a laser: where its ray meets the surface of a target's points.
//!
//! A plane in space, `n·P = 1`, is a plane in direction and inverse depth, too: `ρ = n_z + n_x α +
//! n_y β`. The ray is cut with the plane of all points first. Then the surface around the hit is
//! found by local regression (Cleveland 1979, LOESS): a plane through the nearest points, whose
//! weights fall with their distance from the hit and with their residual, so that a wrong match
//! does not count. The ray is cut again until the hit stays where it is.

use crate::median::median;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use trinocular_rig::rig_file::Laser;

/// Number of points around the hit that make its surface.
const NEAREST: usize = 12;
/// Largest number of cuts.
const MOST_CUTS: usize = 20;
/// Motion of the hit below which it counts as found, mm.
const FOUND_MM: f64 = 1e-6;
/// Rounds of weights by residual.
const ROBUST_ROUNDS: usize = 3;
/// Residual, in medians of all residuals, from which a point does not count.
const WRONG_MEDIANS: f64 = 4.0;
/// Strength of the plane of all points where the nearest ones lie on one line: a share of their
/// squared distance.
const RIDGE: f64 = 1e-4;
/// Narrowest strip of points that is no line, as a share of its length.
const NARROWEST: f64 = 1e-3;
/// Farthest place of a spot beside the points, as a share of their extent.
const MOST_BESIDE: f64 = 0.1;
/// Directions in which the points' extent is measured, over half a turn.
const EXTENT_DIRECTIONS: u32 = 36;
/// Farthest hit, mm: the ray is parallel to the surface beyond.
const FARTHEST_MM: f64 = 1e6;

/// Error of a ray that meets no point of the target.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the laser's ray meets no point of the target: {}; point the laser at the target, correct \
     [laser] in the rig file, or choose another pivot",
    place(*beside_mm)
)]
pub struct NoSpot {
    /// Distance of the hit from the nearest edge of the points, mm; `None` if the ray is parallel
    /// to their surface or meets it behind the cameras.
    pub beside_mm: Option<f64>,
}

fn place(beside_mm: Option<f64>) -> String {
    match beside_mm {
        Some(beside) => format!("it goes past its points at a distance of {beside:.0} mm"),
        None => "it does not cut its surface before the cameras".to_owned(),
    }
}

/// Plane of points, as the normal `n` of `n·P = 1`.
#[derive(Clone, Copy)]
struct Plane(Vector3<f64>);

impl Plane {
    /// Returns the inverse depth of the plane in a direction, 1/mm.
    fn inverse_depth(&self, [alpha, beta]: [f64; 2]) -> f64 {
        self.0.dot(&Vector3::new(alpha, beta, 1.0))
    }

    /// Returns the inverse depth of a point less that of the plane, 1/mm.
    fn residual(&self, [alpha, beta, rho]: &[f64; 3]) -> f64 {
        rho - self.inverse_depth([*alpha, *beta])
    }

    /// Returns the point that the ray cuts, mm.
    fn cut(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Vector3<f64>> {
        let along = (1.0 - self.0.dot(from)) / self.0.dot(direction);
        let hit = from + along * direction;
        let is_usable = hit.z > 0.0 && hit.amax() < FARTHEST_MM;
        is_usable.then_some(hit)
    }
}

/// Returns the place where the ray of `laser` meets the surface of points, mm from the rig's
/// origin. The points are `(α, β, ρ)` about the mean camera, which is at `centre_mm`.
///
/// # Errors
/// [`NoSpot`] if the ray meets no place at the points, or near them.
pub fn meet(points: &[[f64; 3]], centre_mm: [f64; 2], laser: &Laser) -> Result<[f64; 3], NoSpot> {
    let missed = NoSpot { beside_mm: None };
    let centre = Vector3::new(centre_mm[0], centre_mm[1], 0.0);
    let from = Vector3::from(laser.from_mm) - centre;
    let direction = Vector3::from(laser.direction).normalize();
    let whole = common_plane(points).ok_or(missed)?;
    let mut hit = whole.cut(&from, &direction).ok_or(missed)?;
    for _ in 0..MOST_CUTS {
        let at = [hit.x / hit.z, hit.y / hit.z];
        let Some(surface) = around(points, at, &whole) else {
            break;
        };
        let next = surface.cut(&from, &direction).ok_or(missed)?;
        let moved_mm = (next - hit).norm();
        hit = next;
        if moved_mm < FOUND_MM {
            break;
        }
    }
    let (beside, extent) = beside(points, [hit.x / hit.z, hit.y / hit.z]);
    if beside > MOST_BESIDE * extent {
        let beside_mm = Some(beside * hit.z);
        return Err(NoSpot { beside_mm });
    }
    Ok((hit + centre).into())
}

/// Point with its weight.
type Weighted = ([f64; 3], f64);

/// Returns the plane around a direction, or `None` if the points are so few that their common
/// plane is the best.
fn around(points: &[[f64; 3]], at: [f64; 2], whole: &Plane) -> Option<Plane> {
    let distance = |point: &[f64; 3]| (point[0] - at[0]).hypot(point[1] - at[1]);
    let mut near: Vec<Weighted> = points.iter().map(|at| (*at, distance(at))).collect();
    if near.len() <= NEAREST {
        return None;
    }
    let (_, (_, reach), _) = near.select_nth_unstable_by(NEAREST, |a, b| a.1.total_cmp(&b.1));
    let reach = *reach;
    near.truncate(NEAREST);
    for (_, weight) in &mut near {
        *weight = (1.0 - (*weight / reach).powi(3)).powi(3);
    }
    Some(local_plane(&near, at, RIDGE * reach * reach, whole))
}

/// Returns the plane through the points near `at`. It begins with the plane that is parallel to
/// that of all points and has as many points before as behind it, which no wrong match can move
/// far, and is fitted with the weights that the residuals leave. Its slope is drawn to that of all
/// points by `ridge`, a squared distance, because the nearest points may lie on one line.
fn local_plane(near: &[Weighted], at: [f64; 2], ridge: f64, whole: &Plane) -> Plane {
    let rests = near.iter().map(|(point, _)| whole.residual(point));
    let shift = median(rests.collect());
    reweighted(
        near,
        Plane(whole.0 + Vector3::new(0.0, 0.0, shift)),
        |near| fitted(near, at, ridge, whole),
    )
}

/// Returns the plane of all points, or `None` if they lie on one line.
fn common_plane(points: &[[f64; 3]]) -> Option<Plane> {
    let share = 1.0 / points.len() as f64;
    let directions = points
        .iter()
        .map(|[alpha, beta, _]| Vector2::new(*alpha, *beta));
    let middle: Vector2<f64> = share * directions.clone().sum::<Vector2<f64>>();
    let scatter = directions.map(|at| (at - middle) * (at - middle).transpose());
    let spread = scatter.sum::<Matrix2<f64>>().symmetric_eigenvalues();
    if !(spread.min() > NARROWEST * NARROWEST * spread.max()) {
        return None;
    }
    let all: Vec<Weighted> = points.iter().map(|at| (*at, 1.0)).collect();
    let fit = |all: &[Weighted]| fitted(all, middle.into(), 0.0, &Plane(Vector3::zeros()));
    Some(reweighted(&all, fit(&all)?, fit))
}

/// Fits a plane again with the weights that the residuals leave the points.
fn reweighted(
    near: &[Weighted],
    start: Plane,
    fit: impl Fn(&[Weighted]) -> Option<Plane>,
) -> Plane {
    let mut plane = start;
    for _ in 0..ROBUST_ROUNDS {
        let residual = |point: &[f64; 3]| plane.residual(point).abs();
        let wrong = WRONG_MEDIANS * median(near.iter().map(|(p, _)| residual(p)).collect());
        if wrong <= 0.0 {
            break;
        }
        let weigh = |(point, weight): &Weighted| {
            let share = (residual(point) / wrong).min(1.0);
            (*point, weight * (1.0 - share * share).powi(2))
        };
        let weighed: Vec<Weighted> = near.iter().map(weigh).collect();
        match fit(&weighed) {
            Some(fitted) => plane = fitted,
            None => break,
        }
    }
    plane
}

/// Fits the difference to the plane of all points, in directions about `at`.
fn fitted(near: &[Weighted], at: [f64; 2], ridge: f64, whole: &Plane) -> Option<Plane> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (point, weight) in near {
        let [alpha, beta, _] = point;
        let row = Vector3::new(alpha - at[0], beta - at[1], 1.0);
        normal += *weight * row * row.transpose();
        right += *weight * whole.residual(point) * row;
    }
    let drawn = ridge * normal[(2, 2)];
    normal += Matrix3::from_diagonal(&Vector3::new(drawn, drawn, 0.0));
    let rest = normal.cholesky()?.solve(&right);
    let shift = rest.z - rest.x * at[0] - rest.y * at[1];
    Some(Plane(whole.0 + Vector3::new(rest.x, rest.y, shift)))
}

/// Returns how far a direction lies outside the convex hull of the points, 0 or less inside, and
/// the largest extent of the hull.
fn beside(points: &[[f64; 3]], at: [f64; 2]) -> (f64, f64) {
    let (mut farthest, mut extent) = (f64::NEG_INFINITY, 0.0f64);
    for step in 0..EXTENT_DIRECTIONS {
        let angle = core::f64::consts::PI * f64::from(step) / f64::from(EXTENT_DIRECTIONS);
        let (sine, cosine) = angle.sin_cos();
        let along = |[x, y]: [f64; 2]| cosine * x + sine * y;
        let reach = points.iter().map(|point| along([point[0], point[1]]));
        let (low, high) = reach.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| {
            (low.min(at), high.max(at))
        });
        let at = along(at);
        farthest = farthest.max(at - high).max(low - at);
        extent = extent.max(high - low);
    }
    (farthest, extent)
}

#[cfg(test)]
mod tests;
