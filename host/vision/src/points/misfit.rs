//! Rows of a points CSV that do not fit the others.
//!
//! Every point is triangulated from its pixels at the keyframe; one displacement of all points is
//! fitted to the pixels afterwards. The fit minimises the sum of distances instead of their squares
//! (iteratively reweighted least squares), so that a few wrong rows hardly change it. If the points
//! turn, the motion is that of a rigid target instead ([`crate::rigid`]). A row is doubtful if its
//! pixels are farther from the fit than [`DOUBTFUL`] times the typical distance.
//!
//! A rotation turns the error of a point's depth into the image: the noise is then larger along one
//! direction, and more so for points that are far away. Along that direction, distances after a
//! rotation are therefore divided by the spread of the noise.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use trinocular_core::estimate::pose::{self, Observation};
use trinocular_core::rig::Camera;
use trinocular_core::sums::View;
use trinocular_core::sums::centred::Geometry;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;

use super::{HEADER, Sighting};
use crate::rigid;

/// Least misfit of a doubtful row, in multiples of the typical misfit.
const DOUBTFUL: f64 = 5.0;
/// Least typical misfit, px: the noise of well tracked points.
const NOISE_PX: f64 = 0.05;
/// Median of the length of a vector of two normal components, over their standard deviation.
const MEDIAN_LENGTH: f64 = 1.177;
/// Least number of points: fewer cannot contradict one of them.
const LEAST_POINTS: usize = 4;
/// Distance beyond which a point counts as simply wrong in the search of a motion, in normalised
/// coordinates.
const FAR: f64 = 0.02;
/// Passes of the reweighted fit.
const PASSES: usize = 15;
/// Noise for which the effect of a wrong depth is computed, px: small enough to be linear.
const SMALL_PX: f64 = 0.01;
/// Share of the typical misfit that a rotation must leave to be the better explanation.
const TURNED: f64 = 0.5;

/// Motion of all points between the two instants.
enum Motion {
    Displacement(Vector3<f64>),
    Rigid(Box<pose::Estimate>),
}

impl Motion {
    fn apply(&self, position: Vector3<f64>) -> [f64; 3] {
        match self {
            Self::Displacement(displacement) => (position + displacement).into(),
            Self::Rigid(pose) => pose.apply(position.into()),
        }
    }
}

/// One point: its row per camera, and the position at the keyframe in the rig's axes, mm.
struct Placed<'a> {
    rows: &'a [Sighting],
    position: Vector3<f64>,
    /// Normalised image points afterwards, per camera.
    rays: Vec<[f64; 2]>,
}

/// Misfit of a row: its largest coordinate's index in the header, the distance, px, and the
/// distance with noise that is alike in all directions.
#[derive(Clone, Copy, Default)]
struct Misfit {
    column: usize,
    px: f64,
    alike_px: f64,
}

/// Returns a message for every row that does not fit the others.
pub fn doubts(file: &Path, rig: &RigFile, points: &[Vec<Sighting>]) -> Vec<InputError> {
    let cameras = &rig.rig.cameras;
    let all: Vec<usize> = (0..cameras.len()).collect();
    let placed = |rows: &[Sighting], used: &[usize]| triangulate(cameras, rows, used);
    let place = |rows: &'_ Vec<Sighting>| {
        let rays = cameras.iter().zip(rows);
        let rays = rays.map(|(camera, row)| camera.normalise(row.pixels[1]));
        Some((placed(rows, &all)?, rays.collect()))
    };
    let points = points.iter().filter_map(|rows| {
        let (position, rays) = place(rows)?;
        Some(Placed {
            rows,
            position,
            rays,
        })
    });
    let points: Vec<Placed<'_>> = points.collect();
    if points.len() < LEAST_POINTS {
        return Vec::new();
    }
    let Ok(geometry) = Geometry::new(&rig.rig) else {
        return Vec::new();
    };
    let per_px = 1.0 / (rig.rig.mean_focal_px() * geometry.arms_squared_mm2().sqrt());
    let typical = |motion: &Motion| {
        let mut lengths: Vec<f64> = (points.iter())
            .flat_map(|point| {
                let rows = cameras.iter().zip(point.rows);
                rows.map(|(camera, row)| {
                    misfit(camera, row, (point.position, per_px), motion).alike_px
                })
            })
            .collect();
        lengths.sort_by(f64::total_cmp);
        (lengths[lengths.len() / 2] / MEDIAN_LENGTH).max(NOISE_PX)
    };
    let mut motion = Motion::Displacement(displacement(cameras, &points));
    let mut typical_px = typical(&motion);
    if typical_px > NOISE_PX
        && let Some(pose) = rigid_motion(&geometry, cameras, &points)
    {
        let turned = Motion::Rigid(Box::new(pose));
        let turned_px = typical(&turned);
        if turned_px < TURNED * typical_px {
            (motion, typical_px) = (turned, turned_px);
        }
    }
    let misfit = |rows: &[Sighting], position, camera: usize| {
        misfit(&cameras[camera], &rows[camera], (position, per_px), &motion)
    };
    let limit_px = DOUBTFUL * typical_px;
    let mut doubts = Vec::new();
    for point in &points {
        let worst = |position, of: &[usize]| {
            let misfits = of.iter().map(|k| (*k, misfit(point.rows, position, *k)));
            misfits.max_by(|(_, a), (_, b)| a.alike_px.total_cmp(&b.alike_px))
        };
        let Some((mut camera, mut found)) = worst(point.position, &all) else {
            continue;
        };
        if found.alike_px <= limit_px {
            continue;
        }
        // The wrong row is the one without which the others agree best.
        let mut least_px = f64::INFINITY;
        for out in all.iter().filter(|_| all.len() > 2) {
            let others: Vec<usize> = all.iter().copied().filter(|k| k != out).collect();
            let Some(position) = placed(point.rows, &others) else {
                continue;
            };
            let rest_px = worst(position, &others).map_or(0.0, |(_, rest)| rest.alike_px);
            if rest_px < least_px {
                least_px = rest_px;
                (camera, found) = (*out, misfit(point.rows, position, *out));
            }
        }
        let name = &rig.names[camera];
        let reason = format!(
            "camera `{name}` is {:.2} px from where the other rows put this point, and \
             {typical_px:.2} px are usual in this file; correct the row or leave the point out",
            found.px
        );
        let (line, column) = (point.rows[camera].line, HEADER[found.column]);
        doubts.push(InputError::field(file, line, column, reason));
    }
    doubts.sort_by_key(|doubt| doubt.line);
    doubts
}

/// Fits one motion of all points as a rigid target.
fn rigid_motion(
    geometry: &Geometry,
    cameras: &[Camera],
    points: &[Placed<'_>],
) -> Option<pose::Estimate> {
    let observe = |point: &Placed<'_>| {
        let rows = cameras.iter().zip(point.rows);
        let view = |(camera, row): (&Camera, &Sighting)| {
            View::from_pixels(camera, row.pixels[0], row.pixels[1])
        };
        Observation::new(geometry, &rows.map(view).collect::<Vec<_>>())
    };
    let observed: Vec<Observation> = points.iter().filter_map(observe).collect();
    rigid::motion(geometry, &observed, FAR)
}

/// Returns the position of a point at the keyframe, from the cameras in `used`; none if it is not
/// in front of them.
fn triangulate(cameras: &[Camera], rows: &[Sighting], used: &[usize]) -> Option<Vector3<f64>> {
    // X - xi Z = ox and Y - eta Z = oy for every camera.
    let rays = used.iter().map(|&k| {
        let [xi, eta] = cameras[k].normalise(rows[k].pixels[0]);
        let [ox, oy] = cameras[k].offset_mm;
        [xi, eta, ox, oy]
    });
    let rays: Vec<[f64; 4]> = rays.collect();
    let count = rays.len() as f64;
    let mean: [f64; 4] =
        std::array::from_fn(|i| rays.iter().map(|ray| ray[i]).sum::<f64>() / count);
    let (mut across, mut along) = (0.0, 0.0);
    for ray in &rays {
        let [xi, eta, ox, oy]: [f64; 4] = std::array::from_fn(|i| ray[i] - mean[i]);
        across -= xi * ox + eta * oy;
        along += xi * xi + eta * eta;
    }
    let z = across / along;
    let [xi, eta, ox, oy] = mean;
    (z.is_finite() && z > 0.0).then(|| Vector3::new(ox + xi * z, oy + eta * z, z))
}

/// Fits one displacement of all points, mm.
fn displacement(cameras: &[Camera], points: &[Placed<'_>]) -> Vector3<f64> {
    let mut displacement = Vector3::zeros();
    for pass in 0..PASSES {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for Placed { position, rays, .. } in points {
            for (camera, [xi, eta]) in cameras.iter().zip(rays) {
                let [ox, oy] = camera.offset_mm;
                // dX - xi dZ = xi Z - X + ox, and the same for Y.
                let equations = [
                    (
                        Vector3::new(1.0, 0.0, -xi),
                        xi * position.z - position.x + ox,
                    ),
                    (
                        Vector3::new(0.0, 1.0, -eta),
                        eta * position.z - position.y + oy,
                    ),
                ];
                let [x, y] = equations.map(|(row, value)| row.dot(&displacement) - value);
                // In units of the image, so that far points count as much as near ones.
                let scale = camera.focal_px[0] / position.z;
                let distance_px = (scale * x.hypot(y)).max(0.1 * NOISE_PX);
                let weight = scale * scale / if pass == 0 { 1.0 } else { distance_px };
                for (row, value) in equations {
                    normal += weight * row * row.transpose();
                    right += weight * value * row;
                }
            }
        }
        match normal.lu().solve(&right) {
            Some(solved) => displacement = solved,
            None => return displacement,
        }
    }
    displacement
}

/// Returns the misfit of a row, at the keyframe or afterwards, whichever is larger. `per_px` is the
/// error of inverse depth per px of noise, 1/mm.
fn misfit(
    camera: &Camera,
    row: &Sighting,
    (position, per_px): (Vector3<f64>, f64),
    motion: &Motion,
) -> Misfit {
    let mut worst = Misfit::default();
    let after = motion.apply(position);
    for (instant, at) in [position.into(), after].into_iter().enumerate() {
        let seen = camera.project(at);
        let [dx, dy] = [0, 1].map(|i| row.pixels[instant][i] - seen[i]);
        let px = dx.hypot(dy);
        let alike_px = match (instant, motion) {
            (1, Motion::Rigid(_)) => {
                // Along the spread (u, v) the noise is larger by √(1 + u² + v²).
                let deeper = position * (1.0 + SMALL_PX * per_px * position.z);
                let deeper = camera.project(motion.apply(deeper));
                let [u, v] = [0, 1].map(|i| (deeper[i] - seen[i]) / SMALL_PX);
                let spread = u.hypot(v).max(f64::MIN_POSITIVE);
                let along = (dx * u + dy * v) / spread / 1f64.hypot(spread);
                along.hypot((dx * v - dy * u) / spread)
            }
            _ => px,
        };
        if alike_px > worst.alike_px {
            let column = 2 + 2 * instant + usize::from(dy.abs() > dx.abs());
            worst = Misfit {
                column,
                px,
                alike_px,
            };
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::parse;
    use trinocular_core::rig::Rotation;
    use trinocular_rig::random::Random;

    /// Returns a file of points that moved alike, with noise, whose line 2 + 3 * point + camera is
    /// off by `off_px`.
    fn doubts(noise_px: f64, wrong: &[(usize, [f64; 4])]) -> Vec<InputError> {
        doubts_of_turn([0.0; 3], noise_px, wrong)
    }

    /// Returns the doubts about points that also turned.
    fn doubts_of_turn(
        degrees: [f64; 3],
        noise_px: f64,
        wrong: &[(usize, [f64; 4])],
    ) -> Vec<InputError> {
        doubts_of(200.0, degrees, noise_px, wrong)
    }

    /// Returns the doubts about points from 800 mm to `depth_mm` beyond that also turned.
    fn doubts_of(
        depth_mm: f64,
        degrees: [f64; 3],
        noise_px: f64,
        wrong: &[(usize, [f64; 4])],
    ) -> Vec<InputError> {
        let turn = Rotation::from_degrees(degrees).rows();
        let rig = RigFile::paper();
        let mut random = Random::seeded(7);
        let mut text = format!("{}\n", HEADER.join(","));
        for id in 0..80 {
            let place = [-60.0, -40.0, 800.0];
            let span = [120.0, 80.0, depth_mm];
            let p: [f64; 3] =
                std::array::from_fn(|i| place[i] + span[i] * random.between(0.0, 1.0));
            for (name, camera) in rig.names.iter().zip(&rig.rig.cameras) {
                let line = 1 + text.lines().count();
                let off = wrong.iter().find(|(at, _)| *at == line);
                let [x0, y0] = camera.project(p);
                let arm = [p[0], p[1], p[2] - 900.0];
                let after = turn.map(|row| row[0] * arm[0] + row[1] * arm[1] + row[2] * arm[2]);
                let [x1, y1] = camera.project([after[0] + 3.0, after[1] - 2.0, after[2] + 904.0]);
                let noisy: [f64; 4] = std::array::from_fn(|i| {
                    let noise = noise_px * random.gaussian();
                    [x0, y0, x1, y1][i] + noise + off.map_or(0.0, |(_, off)| off[i])
                });
                text += &format!("{id},{name},{}\n", noisy.map(|v| v.to_string()).join(","));
            }
        }
        parse(Path::new("p.csv"), text.as_bytes(), &rig)
            .expect("a good file")
            .doubts
    }

    #[test]
    fn noise_alone_leaves_no_doubt() {
        for noise_px in [0.0, 0.05, 0.5] {
            assert_eq!(doubts(noise_px, &[]), [], "{noise_px} px");
        }
    }

    #[test]
    fn wrong_rows_are_named_with_line_and_camera() {
        let wrong = [
            (5, [0.0, 0.0, 6.0, 0.0]),
            (12, [0.0, 5.0, 0.0, 4.0]),
            (31, [0.0, 0.0, 0.0, -2.0]),
            (49, [8.0, 0.0, 0.0, 0.0]),
        ];
        let found = doubts(0.05, &wrong);
        let lines: Vec<_> = found.iter().filter_map(|doubt| doubt.line).collect();
        assert_eq!(lines, [5, 12, 31, 49], "{found:?}");
        let fields: Vec<_> = found
            .iter()
            .filter_map(|doubt| doubt.field.as_deref())
            .collect();
        assert_eq!(fields[..3], ["x1", "y0", "y1"], "{found:?}");
        // Line 5 is the first camera of the second point.
        assert!(
            found[0].reason.contains("camera `left` is 5.9"),
            "{found:?}"
        );
    }

    #[test]
    fn deep_target_that_turns_leaves_no_doubt() {
        for degrees in [[0.0, 12.0, 0.0], [10.0, 10.0, 0.0], [-20.0, 5.0, 10.0]] {
            for noise_px in [0.02, 0.1, 0.3] {
                let found = doubts_of(1200.0, degrees, noise_px, &[]);
                assert_eq!(found, [], "{degrees:?}, {noise_px} px");
            }
        }
    }

    #[test]
    fn turned_points_leave_no_doubt() {
        for degrees in [[0.0, 0.0, 1.0], [0.0, 8.0, 0.0], [20.0, -5.0, 30.0]] {
            for noise_px in [0.0, 0.05, 0.5] {
                let found = doubts_of_turn(degrees, noise_px, &[]);
                assert_eq!(found, [], "{degrees:?}, {noise_px} px");
            }
        }
    }

    #[test]
    fn wrong_rows_of_turned_points_are_named() {
        let wrong = [
            (5, [0.0, 0.0, 9.0, 0.0]),
            (12, [0.0, 8.0, 0.0, 8.0]),
            (49, [12.0, 0.0, 0.0, 0.0]),
        ];
        for degrees in [[0.0, 0.0, 3.0], [4.0, 8.0, 2.0], [10.0, -12.0, 30.0]] {
            let found = doubts_of_turn(degrees, 0.05, &wrong);
            let lines: Vec<_> = found.iter().filter_map(|doubt| doubt.line).collect();
            assert_eq!(lines, [5, 12, 49], "{degrees:?}: {found:?}");
        }
    }
}
