//! Robust mean of the points' residuals, with its sigma: the offsets that a scene shows.
//!
//! The residual of camera `k` minus that of the reference camera, two components each, is the
//! evidence of each point. The components are fitted by `m + S (x - x̄)`, with `x` the
//! position in the reference camera: the mean `m` does not depend on the slopes `S`, which show
//! rolled cameras and unequal magnification. Weights are Tukey's biweight (A. E. Beaton and J. W.
//! Tukey, 1974) of the worst component of a point, in scatters (median absolute deviation).

use nalgebra::{Matrix3, Vector3};
use trinocular_core::rig::Rig;

use super::AlignmentRefusal;
use crate::matching::geometry::RigGeometry;

/// Scene point, seen by all cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Pixels as seen by each camera, in the rig's order.
    pub pixels: Vec<[f64; 2]>,
}

/// Residuals of one point.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Residual of each camera but the reference minus the reference's: x, y of the first, and so
    /// on; normalised.
    pub components: Vec<f64>,
    /// Position in the reference camera, normalised.
    pub at: [f64; 2],
    /// Inverse depth, 1/mm.
    pub inverse_depth: f64,
}

impl Sample {
    /// Computes the residuals of one point.
    pub fn of(geometry: &RigGeometry, point: &Point) -> Self {
        let seen = point.pixels.iter().enumerate();
        let views: Vec<[f64; 2]> = seen.map(|(k, at)| geometry.normalise(k, *at)).collect();
        let ray = geometry.fit(&views);
        let residual = |k: usize| {
            let expected = geometry.project(k, &ray);
            [0, 1].map(|i| views[k][i] - expected[i])
        };
        let reference = residual(geometry.reference);
        let others = (0..views.len()).filter(|k| *k != geometry.reference);
        Self {
            components: others
                .flat_map(|k| {
                    let own = residual(k);
                    [0, 1].map(|i| own[i] - reference[i])
                })
                .collect(),
            at: views[geometry.reference],
            inverse_depth: ray.inverse_depth,
        }
    }
}

/// Roll and magnification of a camera against the reference camera: value and standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollFit {
    /// Roll, rad, positive clockwise in the image.
    pub roll_rad: [f64; 2],
    /// Relative magnification across the line of cameras.
    pub scale: [f64; 2],
}

/// Result of the fit over all points.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Standard deviation of every camera's correction, normalised; zero for the reference.
    pub sigma: Vec<[f64; 2]>,
    /// Standard deviation of one point's worst component, normalised.
    pub scatter: f64,
    /// Number of points with a weight.
    pub used: usize,
    /// Number of points without a weight.
    pub outliers: usize,
    /// Roll and magnification per camera, for rigs in line.
    pub turns: Vec<Option<RollFit>>,
    /// Median distance of the points, mm.
    pub median_depth_mm: f64,
}

/// Error of a mean over many points that no scatter shows, px. Matching errs alike where images are
/// alike, and repeated frame sets of one scene repeat the error.
const COMMON_PX: f64 = 0.001;

/// Limit of the biweight, in scatters: residuals beyond it have no weight.
const TUKEY: f64 = 4.685;

/// Largest scatter of disparities about a plane's that is still a flat target, px.
const FLAT_PX: f64 = 0.5;

/// Corrects `rig` until its points have no mean residual. `overlap` is the variance inflation
/// factor of a mean over overlapping windows.
///
/// # Errors
/// [`AlignmentRefusal::WrongRig`]; [`AlignmentRefusal::NotFlat`] with a known depth.
pub fn settle(
    rig: &Rig,
    points: &[Point],
    overlap: f64,
    depth_mm: Option<f64>,
) -> Result<(Rig, Fit), AlignmentRefusal> {
    let mut rig = rig.clone();
    // Without lens distortion the first step is exact; with it, each leaves a small part.
    for _ in 0..6 {
        let geometry = RigGeometry::new(&rig).ok_or(AlignmentRefusal::WrongRig)?;
        let samples = samples(&geometry, points);
        let mean = Regression::new(&samples).means();
        rig = corrected(&rig, geometry.reference, &mean);
    }
    let mut along = None;
    if let Some(depth_mm) = depth_mm {
        for _ in 0..6 {
            let geometry = RigGeometry::new(&rig).ok_or(AlignmentRefusal::WrongRig)?;
            let (miss, sigma) = depth_miss(&geometry, points, overlap, depth_mm)?;
            along = Some(sigma);
            let cameras = rig.cameras.clone();
            let reference = cameras[geometry.reference].offset_mm;
            let others = (cameras.iter().enumerate()).filter(|(k, _)| *k != geometry.reference);
            let shift: Vec<f64> = others
                .flat_map(|(_, c)| [0, 1].map(|i| miss * (c.offset_mm[i] - reference[i])))
                .collect();
            rig = corrected(&rig, geometry.reference, &shift);
        }
    }
    let geometry = RigGeometry::new(&rig).ok_or(AlignmentRefusal::WrongRig)?;
    let samples = samples(&geometry, points);
    let fit = Regression::new(&samples).finish(&geometry, overlap, along);
    Ok((rig, fit))
}

fn samples(geometry: &RigGeometry, points: &[Point]) -> Vec<Sample> {
    points.iter().map(|p| Sample::of(geometry, p)).collect()
}

/// Moves the principal points of all cameras but the reference by residuals `e`: by their size on
/// the sensor, `f e` for a camera that is not rotated.
pub fn corrected(rig: &Rig, reference: usize, components: &[f64]) -> Rig {
    let mut rig = rig.clone();
    let others = rig.cameras.iter_mut().enumerate();
    let others = others.filter(|(k, _)| *k != reference);
    for ((_, camera), shift) in others.zip(components.chunks_exact(2)) {
        let (from, to) = (
            camera.denormalise([0.0; 2]),
            camera.denormalise([shift[0], shift[1]]),
        );
        for (i, principal_px) in camera.principal_px.iter_mut().enumerate() {
            *principal_px += to[i] - from[i];
        }
    }
    rig
}

/// Computes the difference of the true and the measured inverse depth of a flat target on the
/// reference camera's axis, 1/mm, with its standard deviation.
fn depth_miss(
    geometry: &RigGeometry,
    points: &[Point],
    overlap: f64,
    depth_mm: f64,
) -> Result<(f64, f64), AlignmentRefusal> {
    let mut samples = samples(geometry, points);
    for sample in &mut samples {
        // A plane's inverse depth is a linear function of the direction.
        sample.components = vec![sample.inverse_depth];
    }
    let plane = Regression::new(&samples);
    let residual_px = plane.scatter(0) * geometry.focal_px * geometry.longest_baseline_mm;
    if residual_px > FLAT_PX {
        return Err(AlignmentRefusal::NotFlat { residual_px });
    }
    let (value, sigma) = plane.at_axis(0, overlap);
    Ok((1.0 / depth_mm - value, sigma))
}

/// Robust fit of every component by a plane over the reference image.
struct Regression<'a> {
    samples: &'a [Sample],
    weights: Vec<f64>,
    /// Weighted mean of `at`.
    centre: [f64; 2],
    /// Value at the centre and slopes, per component.
    planes: Vec<Vector3<f64>>,
    /// Inverse of the normal matrix.
    inverse: Matrix3<f64>,
}

impl<'a> Regression<'a> {
    fn new(samples: &'a [Sample]) -> Self {
        let components = samples.first().map_or(0, |s| s.components.len());
        let medians = (0..components).map(|c| {
            let middle = upper_median(samples.iter().map(|s| s.components[c]).collect());
            Vector3::new(middle, 0.0, 0.0)
        });
        let mut fit = Self {
            samples,
            weights: vec![1.0; samples.len()],
            centre: [0.0; 2],
            planes: medians.collect(),
            inverse: Matrix3::identity(),
        };
        for _ in 0..12 {
            fit.weigh();
            fit.solve();
        }
        fit
    }

    fn row(&self, sample: &Sample) -> Vector3<f64> {
        let [x, y] = [0, 1].map(|i| sample.at[i] - self.centre[i]);
        Vector3::new(1.0, x, y)
    }

    fn residual(&self, sample: &Sample, c: usize) -> f64 {
        sample.components[c] - self.planes[c].dot(&self.row(sample))
    }

    /// Returns the standard deviation of a component, from its median size.
    fn scatter(&self, c: usize) -> f64 {
        let sizes = self.samples.iter().map(|s| self.residual(s, c).abs());
        (1.4826 * upper_median(sizes.collect())).max(1e-12)
    }

    /// Returns a point's worst residual in units of the rejection limit, and the index of its
    /// component.
    fn worst(&self, sample: &Sample, scatters: &[f64]) -> (f64, usize) {
        let sizes = scatters.iter().enumerate();
        sizes
            .map(|(c, scatter)| (self.residual(sample, c).abs() / (TUKEY * scatter), c))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((0.0, 0))
    }

    fn scatters(&self) -> Vec<f64> {
        (0..self.planes.len()).map(|c| self.scatter(c)).collect()
    }

    fn weigh(&mut self) {
        let scatters = self.scatters();
        let weight = |u: f64| {
            if u < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 }
        };
        self.weights = (self.samples.iter())
            .map(|s| weight(self.worst(s, &scatters).0))
            .collect();
    }

    fn solve(&mut self) {
        let weighted = || self.samples.iter().zip(&self.weights);
        let total: f64 = self.weights.iter().sum();
        let centre = [0, 1].map(|i| weighted().map(|(s, w)| w * s.at[i]).sum::<f64>() / total);
        // The planes are given at the centre, which moves.
        self.centre = centre;
        let mut normal = Matrix3::zeros();
        let mut right = vec![Vector3::zeros(); self.planes.len()];
        for (sample, weight) in self.samples.iter().zip(&self.weights) {
            let row = self.row(sample);
            normal += row * row.transpose() * *weight;
            for (right, value) in right.iter_mut().zip(&sample.components) {
                *right += row * (*weight * *value);
            }
        }
        // Points on a line do not determine one of the slopes; then both are zero.
        self.inverse = normal
            .try_inverse()
            .unwrap_or_else(|| Matrix3::from_diagonal(&Vector3::new(1.0 / total, 0.0, 0.0)));
        self.planes = right.iter().map(|right| self.inverse * right).collect();
    }

    fn means(&self) -> Vec<f64> {
        self.planes.iter().map(|plane| plane[0]).collect()
    }

    /// Computes the variance of one component per unit of the inverse normal matrix, as of an
    /// M-estimator: `Σ ψ² / (Σ ψ')²` (Huber 1964).
    fn variance(&self, c: usize, overlap: f64) -> f64 {
        let scatters = self.scatters();
        let (mut squares, mut slope, mut total) = (0.0, 0.0, 0.0);
        for (sample, weight) in self.samples.iter().zip(&self.weights) {
            squares += (weight * self.residual(sample, c)).powi(2);
            total += weight;
            // The weight follows the worst component alone: of all others, ψ is linear.
            let (u, worst) = self.worst(sample, &scatters);
            slope += match worst == c {
                true if u < 1.0 => (1.0 - u * u) * (1.0 - 5.0 * u * u),
                true => 0.0,
                false => *weight,
            };
        }
        let count = self.samples.len() as f64;
        let freedom = count / (count - 3.0).max(1.0);
        overlap * freedom * squares / (slope * slope) * total
    }

    /// Returns the value on the reference camera's axis, with its standard deviation.
    fn at_axis(&self, c: usize, overlap: f64) -> (f64, f64) {
        let row = Vector3::new(1.0, -self.centre[0], -self.centre[1]);
        let spread = row.dot(&(self.inverse * row));
        (
            self.planes[c].dot(&row),
            (self.variance(c, overlap) * spread).sqrt(),
        )
    }

    /// Assembles the result. `along` is the standard deviation of the inverse depth if it was
    /// corrected.
    fn finish(&self, geometry: &RigGeometry, overlap: f64, along: Option<f64>) -> Fit {
        let cameras = &geometry.rig.cameras;
        let reference = cameras[geometry.reference].offset_mm;
        let common = COMMON_PX / geometry.focal_px;
        let line = line(geometry);
        let mut sigma = vec![[0.0; 2]; cameras.len()];
        let mut turns = vec![None; cameras.len()];
        let others = (0..cameras.len()).filter(|k| *k != geometry.reference);
        for (index, k) in others.enumerate() {
            let way = [0, 1].map(|i| cameras[k].offset_mm[i] - reference[i]);
            sigma[k] = [0, 1].map(|i| {
                let of_mean = self.variance(2 * index + i, overlap) * self.inverse[(0, 0)];
                let of_depth = along.map_or(0.0, |s| (s * way[i]).powi(2));
                (of_mean + of_depth + common * common).sqrt()
            });
            turns[k] = line.map(|line| self.turn(2 * index, line, overlap));
        }
        let scatters = self.scatters();
        let inverse_depth = upper_median(self.samples.iter().map(|s| s.inverse_depth).collect());
        let used = self.weights.iter().filter(|w| **w > 0.0).count();
        Fit {
            sigma,
            scatter: scatters.into_iter().fold(0.0, f64::max),
            used,
            outliers: self.samples.len() - used,
            turns,
            median_depth_mm: 1.0 / inverse_depth,
        }
    }

    /// Computes roll and magnification from the slopes across the line of cameras. `first` is the
    /// index of the camera's x component.
    fn turn(&self, first: usize, [lx, ly]: [f64; 2], overlap: f64) -> RollFit {
        let (x, y) = (&self.planes[first], &self.planes[first + 1]);
        let across = y * lx - x * ly;
        let (vx, vy) = (
            self.variance(first, overlap),
            self.variance(first + 1, overlap),
        );
        let variance = vy * lx * lx + vx * ly * ly;
        let slope = |direction: Vector3<f64>| {
            let spread = direction.dot(&(self.inverse * direction));
            [across.dot(&direction), (variance * spread).sqrt()]
        };
        RollFit {
            roll_rad: slope(Vector3::new(0.0, lx, ly)),
            scale: slope(Vector3::new(0.0, -ly, lx)),
        }
    }
}

/// Returns the direction of the line of the cameras; `None` if they are not in line.
fn line(geometry: &RigGeometry) -> Option<[f64; 2]> {
    let cameras = &geometry.rig.cameras;
    let reference = cameras[geometry.reference].offset_mm;
    let ways = cameras
        .iter()
        .map(|c| [0, 1].map(|i| c.offset_mm[i] - reference[i]));
    let length = |way: &[f64; 2]| way[0].hypot(way[1]);
    let longest = ways
        .clone()
        .max_by(|a, b| length(a).total_cmp(&length(b)))?;
    // Of the two directions the one to the right, or down.
    let sign = if longest[0] + 1e-9 * longest[1] < 0.0 {
        -1.0
    } else {
        1.0
    };
    let unit = longest.map(|c| sign * c / length(&longest));
    let across = |way: [f64; 2]| (way[1] * unit[0] - way[0] * unit[1]).abs();
    ways.clone()
        .all(|way| across(way) < 1e-3 * geometry.longest_baseline_mm)
        .then_some(unit)
}

/// Returns the upper median, or 0 if there are no values.
fn upper_median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    values.get(middle).copied().unwrap_or(0.0)
}
