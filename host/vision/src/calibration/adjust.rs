//! Bundle adjustment: lenses, camera poses and board poses with the least squares of residuals in
//! px.
//!
//! Unknowns are, per camera `k`, its [`Lens`] (9) and the motion from the reference camera's axes
//! to its own (6); per view, the motion from the board's axes to the reference camera's (6).
//! Motions change by a small rotation before their rotation and a shift after it: `R <- exp(δ) R, t
//! <- t + ε`. Views are independent of each other, so they are eliminated one by one (Schur's
//! complement), which leaves 15 unknowns per camera. The caller states which of them are free:
//!
//! ```text
//! [U  W] [c]   [a]
//! [Wᵀ V] [v] = [b]      (U - W V⁻¹ Wᵀ) c = a - W V⁻¹ b
//! ```
//!
//! The damping of Levenberg and Marquardt, `V + λ diag V` and `U + λ diag U`, makes it converge
//! from a distant start. At the solution `σ² (U - W V⁻¹ Wᵀ)⁻¹` is the covariance of the cameras'
//! unknowns for any views.

use nalgebra::{
    DMatrix, DVector, Isometry3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3,
};

use super::lens::{Lens, PARAMETERS};

/// Number of unknowns per camera: lens, then rotation and translation of its motion.
pub const PER_CAMERA: usize = PARAMETERS + 6;

const MOST_ITERATIONS: usize = 200;
/// Relative decrease of the sum of squares at which iterations end.
const CONVERGED: f64 = 1e-12;
/// Largest damping of a step.
const MOST_DAMPING: f64 = 1e12;

/// Image of the board by one camera.
#[derive(Clone, Debug)]
pub struct BoardImage {
    /// Index of the camera.
    pub camera: usize,
    /// Pixels of all corners, in the board's order.
    pub corners: Vec<[f64; 2]>,
}

/// Pose of the board at one instant, with its images.
#[derive(Clone, Debug)]
pub struct BoardView {
    /// Motion from the board's axes to the reference camera's, mm.
    pub pose: Isometry3<f64>,
    /// Images of the board, at most one per camera.
    pub sights: Vec<BoardImage>,
}

/// Bundle: all unknowns and observations of an adjustment.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// Corners of the board, mm.
    pub board_mm: Vec<[f64; 2]>,
    /// Lens of each camera.
    pub lenses: Vec<Lens>,
    /// Motion from the reference camera's axes to those of each camera. The motion of the reference
    /// camera is the identity.
    pub motions: Vec<Isometry3<f64>>,
    /// Poses of the board.
    pub views: Vec<BoardView>,
}

/// Solution of an adjustment.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Standard deviation of one coordinate of a corner, px.
    pub sigma_px: f64,
    /// Covariance of the free unknowns, in the order they were given.
    pub covariance: DMatrix<f64>,
    /// Derivatives of the free unknowns by all unknowns of the cameras (rows: free; columns: all).
    pub response: DMatrix<f64>,
}

/// Reason why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsolved {
    /// The images do not determine some unknown.
    #[error(
        "the views of the board are too alike to tell lens and distance apart; tilt it more, in \
         more directions"
    )]
    Open,
    /// Some corner would lie behind a camera.
    #[error("the views of the board contradict each other")]
    Behind,
}

/// Normal equations before the elimination of the board poses.
struct Normal {
    squares: f64,
    residuals: usize,
    cameras: DMatrix<f64>,
    cameras_right: DVector<f64>,
    views: Vec<ViewBlock>,
}

struct ViewBlock {
    own: SMatrix<f64, 6, 6>,
    right: SVector<f64, 6>,
    /// Camera and block of each image.
    mixed: Vec<(usize, SMatrix<f64, PER_CAMERA, 6>)>,
}

impl Bundle {
    /// Computes the residuals of one image: seen minus expected, px. Returns `None` if a corner is
    /// behind the camera.
    pub fn residuals(&self, view: &BoardView, sight: &BoardImage) -> Option<Vec<[f64; 2]>> {
        let motion = self.motions[sight.camera] * view.pose;
        let lens = &self.lenses[sight.camera];
        let pairs = self.board_mm.iter().zip(&sight.corners);
        pairs
            .map(|(point, seen)| {
                let at = motion * nalgebra::Point3::new(point[0], point[1], 0.0);
                let expected = lens.project(at.coords)?.pixel;
                Some([seen[0] - expected[0], seen[1] - expected[1]])
            })
            .collect()
    }

    /// Computes the root mean square residual of one image, px.
    pub fn rms_px(&self, view: &BoardView, sight: &BoardImage) -> f64 {
        match self.residuals(view, sight) {
            Some(residuals) => {
                let squares: f64 = residuals.iter().map(|r| r[0] * r[0] + r[1] * r[1]).sum();
                (squares / residuals.len() as f64).sqrt()
            }
            None => f64::INFINITY,
        }
    }

    fn squares(&self) -> Option<f64> {
        let mut sum = 0.0;
        for view in &self.views {
            for sight in &view.sights {
                let residuals = self.residuals(view, sight)?;
                sum += residuals
                    .iter()
                    .map(|r| r[0] * r[0] + r[1] * r[1])
                    .sum::<f64>();
            }
        }
        sum.is_finite().then_some(sum)
    }

    /// Minimises the sum of squares (Levenberg-Marquardt). `free` holds indices of the cameras'
    /// unknowns, [`PER_CAMERA`] each; the poses of the board are always free.
    ///
    /// # Errors
    /// [`Unsolved`], with the reason.
    pub fn adjust(&mut self, free: &[usize]) -> Result<Solution, Unsolved> {
        let mut damping = 1e-3;
        let mut normal = self.normal().ok_or(Unsolved::Behind)?;
        for _ in 0..MOST_ITERATIONS {
            let Some(trial) = self.step(&normal, free, damping) else {
                damping *= 10.0;
                if damping > MOST_DAMPING {
                    return Err(Unsolved::Open);
                }
                continue;
            };
            match trial.squares() {
                Some(squares) if squares <= normal.squares => {
                    let fall = normal.squares - squares;
                    let is_done = fall <= CONVERGED * normal.squares && damping <= 1e-3;
                    *self = trial;
                    damping = (damping / 10.0).max(1e-12);
                    normal = self.normal().ok_or(Unsolved::Behind)?;
                    if is_done {
                        break;
                    }
                }
                _ => {
                    damping *= 10.0;
                    // No step decreases the sum: it is minimal up to rounding.
                    if damping > MOST_DAMPING {
                        break;
                    }
                }
            }
        }
        self.solution(&normal, free)
    }

    fn normal(&self) -> Option<Normal> {
        let size = PER_CAMERA * self.lenses.len();
        let mut cameras = DMatrix::zeros(size, size);
        let mut cameras_right = DVector::zeros(size);
        let (mut squares, mut residuals) = (0.0, 0);
        let mut views = Vec::with_capacity(self.views.len());
        for view in &self.views {
            let mut block = ViewBlock {
                own: SMatrix::zeros(),
                right: SVector::zeros(),
                mixed: Vec::new(),
            };
            for sight in &view.sights {
                let first = PER_CAMERA * sight.camera;
                let mut own = SMatrix::<f64, PER_CAMERA, PER_CAMERA>::zeros();
                let mut right = SVector::<f64, PER_CAMERA>::zeros();
                let mut mixed = SMatrix::<f64, PER_CAMERA, 6>::zeros();
                for (point, seen) in self.board_mm.iter().zip(&sight.corners) {
                    let row = self.row(view, sight.camera, *point, *seen)?;
                    squares += row.residual.norm_squared();
                    residuals += 2;
                    own += row.by_camera.transpose() * row.by_camera;
                    right += row.by_camera.transpose() * row.residual;
                    mixed += row.by_camera.transpose() * row.by_view;
                    block.own += row.by_view.transpose() * row.by_view;
                    block.right += row.by_view.transpose() * row.residual;
                }
                let mut place = cameras.view_mut((first, first), (PER_CAMERA, PER_CAMERA));
                place += own;
                let mut place = cameras_right.rows_mut(first, PER_CAMERA);
                place += right;
                block.mixed.push((sight.camera, mixed));
            }
            views.push(block);
        }
        Some(Normal {
            squares,
            residuals,
            cameras,
            cameras_right,
            views,
        })
    }

    fn row(&self, view: &BoardView, camera: usize, point: [f64; 2], seen: [f64; 2]) -> Option<Row> {
        let motion = &self.motions[camera];
        let turned = view.pose.rotation * Vector3::new(point[0], point[1], 0.0);
        let before = turned + view.pose.translation.vector;
        let swung = motion.rotation * before;
        let projection = self.lenses[camera].project(swung + motion.translation.vector)?;
        let by_point = projection.by_point;
        let by_before = by_point * motion.rotation.to_rotation_matrix().matrix();
        let mut by_camera = SMatrix::<f64, 2, PER_CAMERA>::zeros();
        by_camera
            .fixed_view_mut::<2, PARAMETERS>(0, 0)
            .copy_from(&projection.by_lens);
        by_camera
            .fixed_view_mut::<2, 3>(0, PARAMETERS)
            .copy_from(&(-by_point * swung.cross_matrix()));
        by_camera
            .fixed_view_mut::<2, 3>(0, PARAMETERS + 3)
            .copy_from(&by_point);
        let mut by_view = SMatrix::<f64, 2, 6>::zeros();
        by_view
            .fixed_view_mut::<2, 3>(0, 0)
            .copy_from(&(-by_before * turned.cross_matrix()));
        by_view.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_before);
        let residual = [0, 1].map(|i| seen[i] - projection.pixel[i]);
        Some(Row {
            residual: residual.into(),
            by_camera,
            by_view,
        })
    }

    /// Returns the bundle after one damped step; `None` if the equations have no solution.
    fn step(&self, normal: &Normal, free: &[usize], damping: f64) -> Option<Self> {
        let (reduced, right) = normal.reduced(damping)?;
        let reduced = reduced.select_rows(free).select_columns(free);
        let change = reduced.cholesky()?.solve(&right.select_rows(free));
        let mut cameras = DVector::zeros(right.len());
        for (value, index) in change.iter().zip(free) {
            cameras[*index] = *value;
        }
        let mut next = self.clone();
        for (k, (lens, motion)) in next.lenses.iter_mut().zip(&mut next.motions).enumerate() {
            let own = cameras.rows(PER_CAMERA * k, PER_CAMERA);
            for (parameter, step) in lens.0.iter_mut().zip(own.iter()) {
                *parameter += step;
            }
            *motion = moved(motion, own.fixed_rows::<6>(PARAMETERS).into_owned());
        }
        for (view, block) in next.views.iter_mut().zip(&normal.views) {
            let mut right = block.right;
            for (camera, mixed) in &block.mixed {
                right -= mixed.transpose() * cameras.fixed_rows::<PER_CAMERA>(PER_CAMERA * camera);
            }
            view.pose = moved(&view.pose, block.damped(damping).cholesky()?.solve(&right));
        }
        Some(next)
    }

    fn solution(&self, normal: &Normal, free: &[usize]) -> Result<Solution, Unsolved> {
        let unknowns = free.len() + 6 * self.views.len();
        let freedom = normal.residuals.saturating_sub(unknowns).max(1);
        let sigma_px = (normal.squares / freedom as f64).sqrt();
        let (reduced, _) = normal.reduced(0.0).ok_or(Unsolved::Open)?;
        let rows = reduced.select_rows(free);
        let inverse = rows
            .select_columns(free)
            .cholesky()
            .ok_or(Unsolved::Open)?
            .inverse();
        Ok(Solution {
            sigma_px,
            covariance: &inverse * (sigma_px * sigma_px),
            response: -&inverse * rows,
        })
    }
}

struct Row {
    residual: SVector<f64, 2>,
    by_camera: SMatrix<f64, 2, PER_CAMERA>,
    by_view: SMatrix<f64, 2, 6>,
}

impl ViewBlock {
    fn damped(&self, damping: f64) -> SMatrix<f64, 6, 6> {
        self.own + SMatrix::from_diagonal(&(self.own.diagonal() * damping))
    }
}

impl Normal {
    /// Eliminates the board poses (Schur complement) and returns the equations of the cameras.
    fn reduced(&self, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let mut matrix = self.cameras.clone();
        for i in 0..matrix.nrows() {
            matrix[(i, i)] *= 1.0 + damping;
        }
        let mut right = self.cameras_right.clone();
        for view in &self.views {
            let inverse = view.damped(damping).cholesky()?.inverse();
            for (k, a) in &view.mixed {
                let half = a * inverse;
                let mut place = right.rows_mut(PER_CAMERA * k, PER_CAMERA);
                place -= half * view.right;
                for (l, b) in &view.mixed {
                    let at = (PER_CAMERA * k, PER_CAMERA * l);
                    let mut place = matrix.view_mut(at, (PER_CAMERA, PER_CAMERA));
                    place -= half * b.transpose();
                }
            }
        }
        Some((matrix, right))
    }
}

/// Applies a small change to a motion: rotation, then shift.
pub fn moved(motion: &Isometry3<f64>, change: SVector<f64, 6>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(change.fixed_rows::<3>(0).into_owned());
    let shift = change.fixed_rows::<3>(3).into_owned();
    Isometry3::from_parts(
        Translation3::from(motion.translation.vector + shift),
        turn * motion.rotation,
    )
}
