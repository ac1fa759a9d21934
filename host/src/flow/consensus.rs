//! Which points move as one.
//!
//! Least median of squares (Rousseeuw 1984): displacements are proposed by pairs of points drawn with a fixed seed; the one whose median
//! squared residual is smallest wins, which up to half of the points being wrong cannot prevent. The median gives the noise level, and points
//! beyond 2.5 standard deviations are dropped; the fit is then repeated over those that remain until none changes sides.

use super::Refusal;
use shared::estimate::midpoint;
use shared::rig::Rig;
use shared::sums::View;
use shared::sums::centred::{CentredSums, Geometry, PointFit};

/// Pairs tried: one hits two good points with probability 1 - 1e-9 when 60 % are good.
const TRIES: usize = 64;

/// Residuals below this are never an outlier's, px root mean square.
const FLOOR_PX: f64 = 0.15;

/// Points whose noise level is above this do not move as one, px.
const LARGEST_SCALE_PX: f64 = 2.0;

/// Fewest points that must agree.
const FEWEST: usize = 8;

/// The smallest share of the points that must agree.
const SMALLEST_SHARE: f64 = 0.5;

/// The points that agree on one displacement.
#[derive(Clone, Debug)]
pub struct Agreement {
    /// Their indices, ascending.
    pub inliers: Vec<usize>,
    /// The displacement they agree on, mm.
    pub displacement_mm: [f64; 3],
}

struct Point {
    fit: PointFit,
    flows: Vec<[f64; 2]>,
    index: usize,
}

/// The points of `views` (one entry per point, one view per camera) that move as one rigid target without rotation.
///
/// # Errors
/// [`Refusal::TooFewPoints`] if fewer than 8 points are usable, [`Refusal::NoAgreement`] if fewer than half of them agree.
pub fn agree(rig: &Rig, views: &[Vec<View>]) -> Result<Agreement, Refusal> {
    let geometry = Geometry::new(rig).map_err(|_| Refusal::WrongRig)?;
    let points: Vec<Point> = views
        .iter()
        .enumerate()
        .filter_map(|(index, views)| {
            let flows = views.iter().map(View::flow).collect();
            Some(Point {
                fit: geometry.point(views)?,
                flows,
                index,
            })
        })
        .collect();
    if points.len() < FEWEST {
        return Err(Refusal::TooFewPoints {
            points: points.len(),
            fewest: FEWEST,
        });
    }
    let focal = rig.mean_focal_px();
    let residuals =
        |t: [f64; 3]| -> Vec<f64> { points.iter().map(|p| focal * residual(p, t)).collect() };
    let solve = |chosen: &[usize]| -> Option<[f64; 3]> {
        let mut sums = CentredSums::new(rig).ok()?;
        for &i in chosen {
            sums.add(&views[points[i].index]);
        }
        midpoint::solve(&sums)
            .ok()
            .map(|estimate| estimate.displacement_mm)
    };

    let mut random = 0x7472_696e_6f63_u64;
    let mut best: Option<(f64, [f64; 3])> = None;
    for _ in 0..TRIES {
        let pair = [
            draw(&mut random, points.len()),
            draw(&mut random, points.len()),
        ];
        if pair[0] == pair[1] {
            continue;
        }
        let Some(t) = solve(&pair) else { continue };
        let median = median(residuals(t));
        if best.is_none_or(|(smallest, _)| median < smallest) {
            best = Some((median, t));
        }
    }
    let (_, mut displacement_mm) = best.ok_or(Refusal::NoAgreement {
        agree: 0,
        points: points.len(),
    })?;

    let mut inliers: Vec<usize> = Vec::new();
    for _ in 0..12 {
        let all = residuals(displacement_mm);
        // A residual is a root mean square over 2K components, so its median is near the standard deviation itself.
        let scale = median(all.clone());
        if scale > LARGEST_SCALE_PX {
            return Err(Refusal::NoAgreement {
                agree: 0,
                points: points.len(),
            });
        }
        let limit = (2.5 * scale).max(FLOOR_PX);
        let now: Vec<usize> = (0..points.len()).filter(|&i| all[i] <= limit).collect();
        if now == inliers {
            break;
        }
        inliers = now;
        displacement_mm = solve(&inliers).ok_or(Refusal::NoAgreement {
            agree: inliers.len(),
            points: points.len(),
        })?;
    }
    if inliers.len() < FEWEST || (inliers.len() as f64) < SMALLEST_SHARE * points.len() as f64 {
        return Err(Refusal::NoAgreement {
            agree: inliers.len(),
            points: points.len(),
        });
    }
    let inliers = inliers.into_iter().map(|i| points[i].index).collect();
    Ok(Agreement {
        inliers,
        displacement_mm,
    })
}

/// Root mean square over cameras and axes of what the displacement does not explain, normalised.
fn residual(point: &Point, displacement_mm: [f64; 3]) -> f64 {
    let squares: f64 = point
        .flows
        .iter()
        .enumerate()
        .map(|(k, [vx, vy])| {
            let [mx, my] = point.fit.flow(k, displacement_mm);
            (vx - mx).powi(2) + (vy - my).powi(2)
        })
        .sum();
    (squares / (2.0 * point.flows.len() as f64)).sqrt()
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// splitmix64: the next index below `count`.
fn draw(state: &mut u64, count: usize) -> usize {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) % count as u64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `good` points that move by `a`, the others by `b`; a little deterministic jitter.
    fn views(rig: &Rig, good: usize, all: usize, a: [f64; 3], b: [f64; 3]) -> Vec<Vec<View>> {
        let mut state = 1;
        let mut uniform = |low: f64, high: f64| {
            low + (high - low) * draw(&mut state, 1 << 30) as f64 / f64::from(1 << 30)
        };
        (0..all)
            .map(|i| {
                let start = [
                    uniform(-150.0, 150.0),
                    uniform(-100.0, 100.0),
                    uniform(750.0, 900.0),
                ];
                let t = if i < good { a } else { b };
                let end = std::array::from_fn(|j| start[j] + t[j]);
                let mut jitter = |p: [f64; 2]| p.map(|c| c + uniform(-0.05, 0.05));
                rig.cameras
                    .iter()
                    .map(|c| View::from_pixels(c, jitter(c.project(start)), jitter(c.project(end))))
                    .collect()
            })
            .collect()
    }

    #[test]
    fn forty_per_cent_moving_differently_are_left_out() {
        let rig = Rig::paper();
        let t = [5.0, -3.0, 2.0];
        let got = agree(&rig, &views(&rig, 60, 100, t, [-8.0, 6.0, 0.0])).unwrap();
        assert!(
            got.inliers.iter().all(|&i| i < 60) && got.inliers.len() > 50,
            "{:?}",
            got.inliers.len()
        );
        for i in 0..3 {
            assert!(
                (got.displacement_mm[i] - t[i]).abs() < [0.03, 0.03, 0.2][i],
                "{:?}",
                got.displacement_mm
            );
        }
        let again = agree(&rig, &views(&rig, 60, 100, t, [-8.0, 6.0, 0.0])).unwrap();
        assert_eq!(got.inliers, again.inliers);
    }

    #[test]
    fn too_few_or_too_divided_points_are_refused() {
        let rig = Rig::paper();
        let few = views(&rig, 7, 7, [1.0; 3], [1.0; 3]);
        assert!(matches!(
            agree(&rig, &few),
            Err(Refusal::TooFewPoints { points: 7, .. })
        ));
        let mut divided = Vec::new();
        for k in 0..5 {
            divided.extend(views(
                &rig,
                20,
                20,
                [f64::from(k) * 6.0 - 12.0, f64::from(k * k) * 2.0, 0.0],
                [0.0; 3],
            ));
        }
        assert!(matches!(
            agree(&rig, &divided),
            Err(Refusal::NoAgreement { .. })
        ));
    }
}
