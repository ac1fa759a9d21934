//! Registration of a small window to a few thousandths of a pixel.
//!
//! Inverse compositional least squares (B. D. Lucas and T. Kanade, *An Iterative Image Registration
//! Technique*, 1981; S. Baker and I. Matthews, *Lucas-Kanade 20 Years On*, 2004): grey levels,
//! gradients and Hessian are those of the template, computed once and used for every image.
//! Brightness may change by a gain `a` and an offset `b`:
//!
//! ```text
//! I(x + p) = a T'(x) + b         T' = T - mean(T), g zero-mean gradients of T
//! c = Σ g T'      a = Σ T' I / Σ T' T'
//! step = (Σ g g^T - c c^T / Σ T' T')^-1 (Σ g I - a c) / a
//! ```
//!
//! The step is independent of gain and offset, and no difference image is needed.
//!
//! Template and image are both read through cubic B-splines, which smooth equally at every
//! sub-pixel phase. Plain interpolation would leave whole pixels unchanged and smooth half pixels.
//! Windows at different phases would then differ and bias each point differently, by more than
//! noise of 2 grey levels does.
//!
//! The forward-backward error (Z. Kalal, K. Mikolajczyk and J. Matas, *Forward-Backward Error*,
//! ICPR 2010) comes from one step back with the gradients of the window that was found.

mod source;
mod window;

use pulp::{Arch, NullaryFnOnce};

use super::pyramid::{Finest, Plane};
use super::{MatchSettings, Reject};
use source::WindowSource;
use window::{Grid, LeastSquares, Window, product, products};

/// Place of a template in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// Centre of the window, px of the level.
    pub at: [f32; 2],
    /// Zero-mean normalised cross-correlation there, -1 to 1.
    pub zncc: f32,
    /// Forward-backward error, px: difference between the last step and the step back. Infinite if
    /// the window that was found has no texture of its own.
    pub return_error: f32,
}

impl Registration {
    /// Applies the tests of correlation and forward-backward error.
    ///
    /// # Errors
    /// [`Reject::Dissimilar`] or [`Reject::NoReturn`].
    pub fn checked(self, settings: &MatchSettings) -> Result<Self, Reject> {
        if self.zncc < settings.min_zncc {
            return Err(Reject::Dissimilar);
        }
        // The comparison is also false for an error that is not a number.
        if !(f64::from(self.return_error) <= settings.max_return_px) {
            return Err(Reject::NoReturn);
        }
        Ok(self)
    }
}

/// Length of the last step, px. With noise of 2 grey levels each step is a hundred times shorter
/// than the one before, so the remaining error is a thousandth.
const SHORT_STEP: f32 = 0.08;
/// Longest single step, px. The linear model does not hold beyond it.
const LONG_STEP: f32 = 2.0;
/// Least mean square gradient of a template in its weakest direction, (grey level / px)².
const LEAST_GRADIENT: f32 = 0.25;

/// Projective warp of a window: the offset `d` in the turned image is the place
/// `linear d / (1 + shrink·d)` in this image, both from the window's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneWarp {
    /// Linear part.
    pub linear: [[f32; 2]; 2],
    /// Projective part, 1/px.
    pub shrink: [f32; 2],
}

impl PlaneWarp {
    /// Returns the largest difference of two warps of a window at full resolution, px: at its
    /// border, to first order.
    pub fn difference_px(&self, other: &Self) -> f64 {
        let half = (FineTemplate::SIDE / 2) as f32;
        let difference = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs() + (a[1] - b[1]).abs();
        let rows = self.linear.iter().zip(other.linear);
        let linear = rows.map(|(a, b)| difference(*a, b)).fold(0.0, f32::max);
        let shrink = difference(self.shrink, other.shrink);
        f64::from(half * linear + half * half * shrink)
    }
}

/// Square window of `N` x `N` px, odd, to be found in other images. `W >= N` is a multiple of 8, so
/// that rows fill whole vectors.
#[derive(Clone, Debug)]
pub struct Template<const N: usize, const W: usize> {
    /// Zero-mean grey levels and gradients, zero beyond column `N`.
    grey: Grid<N, W>,
    along: Grid<N, W>,
    down: Grid<N, W>,
    /// Means that were subtracted from the gradients.
    mean_gradient: [f32; 2],
    /// Hessian `Σ g g^T`: xx, xy, yy.
    matrix: [f32; 3],
    /// Moments of grey levels and gradients.
    moments: Moments,
}

/// Moments of a template's grey levels, warped or not: with themselves and with the gradients.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    /// `Σ T'²`.
    energy: f32,
    /// `Σ g T'`.
    coupling: [f32; 2],
}

impl Moments {
    #[inline(always)]
    fn of<const N: usize, const W: usize>(
        grey: &Grid<N, W>,
        along: &Grid<N, W>,
        down: &Grid<N, W>,
    ) -> Self {
        let [energy, x, y] = products(grey, [grey, along, down]);
        Self {
            energy,
            coupling: [x, y],
        }
    }
}

/// Template at full resolution.
pub type FineTemplate = Template<21, 24>;
/// Template at coarser levels.
pub type CoarseTemplate = Template<11, 16>;

impl<const N: usize, const W: usize> Template<N, W> {
    /// Least distance of a window's centre from the borders, px.
    pub const MARGIN: usize = N / 2 + 2;

    /// Side of the window, px.
    pub const SIDE: usize = N;

    /// Returns true if a window around `at` lies within `image`.
    pub fn fits<'a>(image: impl Into<Finest<'a>>, at: [f32; 2]) -> bool {
        Self::fits_size(image.into().size(), at)
    }

    #[inline(always)]
    fn fits_size(size: [usize; 2], at: [f32; 2]) -> bool {
        let inside = |at: f32, size: usize| {
            at >= Self::MARGIN as f32 && at < size as f32 - Self::MARGIN as f32
        };
        inside(at[0], size[0]) && inside(at[1], size[1])
    }

    /// Takes the window of `image` around `at`. Returns `None` if it leaves the image or has too
    /// little contrast in some direction. Boxed, because it is large and moved often.
    pub fn new<'a>(image: impl Into<Finest<'a>>, at: [f32; 2]) -> Option<Box<Self>> {
        let image = image.into();
        if !Self::fits(image, at) {
            return None;
        }
        let mut template = Self::empty();
        let out = &mut *template;
        match image {
            Finest::Whole(plane) => Arch::new().dispatch(Read {
                source: plane,
                at,
                template: out,
            }),
            Finest::Image(image) => Arch::new().dispatch(Read {
                source: image,
                at,
                template: out,
            }),
        }
        template.has_contrast().then_some(template)
    }

    fn empty() -> Box<Self> {
        let nothing = [[0.0; W]; N];
        Box::new(Self {
            grey: nothing,
            along: nothing,
            down: nothing,
            mean_gradient: [0.0; 2],
            matrix: [0.0; 3],
            moments: Moments::default(),
        })
    }

    fn has_contrast(&self) -> bool {
        let count = (N * N) as f32;
        self.moments.energy >= count * LEAST_GRADIENT
            && self.least_squares(self.moments).weakest() > count * LEAST_GRADIENT
    }

    /// Subtracts the means of grey levels and gradients that were read, and computes the sums.
    #[inline(always)]
    fn complete(&mut self) {
        let Self {
            grey, along, down, ..
        } = self;
        let [_, x, y] = [&mut *grey, &mut *along, &mut *down].map(|part| {
            let mean = window::total(part) / (N * N) as f32;
            window::centre(part, mean);
            mean
        });
        self.mean_gradient = [x, y];
        self.matrix = [
            product(along, along),
            product(along, down),
            product(down, down),
        ];
        self.moments = Moments::of(grey, along, down);
    }

    /// Takes the window around `at` of `plane` as an image of the turned surface shows it. In
    /// contrast to the warp of [`Template::find`], this one need not be near the identity. Returns
    /// `None` as [`Template::new`] does.
    pub fn turned(plane: &Plane, at: [f32; 2], warp: &PlaneWarp) -> Option<Box<Self>> {
        let half = (N / 2) as f32;
        let nearest = 1.0 - half * (warp.shrink[0].abs() + warp.shrink[1].abs());
        if !(nearest > 0.5) {
            return None;
        }
        let reach = (warp.linear).map(|[a, b]| half * (a.abs() + b.abs()) / nearest + 2.0);
        let inside = |axis: usize, size: usize| {
            at[axis] - reach[axis] >= 0.0 && at[axis] + reach[axis] < size as f32 - 1.0
        };
        if !(inside(0, plane.width) && inside(1, plane.height)) {
            return None;
        }
        let mut template = Self::empty();
        Arch::new().dispatch(ReadTurned {
            plane,
            at,
            warp,
            template: &mut template,
        });
        template.has_contrast().then_some(template)
    }

    /// Finds the template, warped by `warp` (near the identity), in `image`, from `start` on. The
    /// image at `d` from the centre shows the template's pixel at `warp d`.
    ///
    /// Returns `None` if the window leaves the image, turns into its negative, or does not converge
    /// in `steps` steps.
    pub fn find<'a>(
        &self,
        image: impl Into<Finest<'a>>,
        start: [f32; 2],
        warp: [[f32; 2]; 2],
        steps: usize,
    ) -> Option<Registration> {
        match image.into() {
            Finest::Whole(plane) => self.find_in(plane, start, warp, steps),
            Finest::Image(image) => self.find_in(image, start, warp, steps),
        }
    }

    fn find_in(
        &self,
        source: impl WindowSource,
        start: [f32; 2],
        warp: [[f32; 2]; 2],
        steps: usize,
    ) -> Option<Registration> {
        Arch::new().dispatch(Find {
            template: self,
            source,
            start,
            warp,
            steps,
        })
    }

    fn least_squares(&self, moments: Moments) -> LeastSquares {
        let [x, y] = moments.coupling;
        let [xx, xy, yy] = self.matrix;
        LeastSquares {
            xx: xx - x * x / moments.energy,
            xy: xy - x * y / moments.energy,
            yy: yy - y * y / moments.energy,
        }
    }

    /// Warps the grey levels to first order in the deviation from the identity: at 2 % and 10 px
    /// from the centre, the neglected part is a fiftieth of a grey level per unit of curvature.
    /// Returns `None` for the identity.
    #[inline(always)]
    fn warped(&self, warp: [[f32; 2]; 2]) -> Option<(Grid<N, W>, Moments)> {
        let off = [
            [warp[0][0] - 1.0, warp[0][1]],
            [warp[1][0], warp[1][1] - 1.0],
        ];
        // Three thousandths of a pixel at the border of the window, zero in its middle.
        if off.iter().flatten().all(|o| o.abs() < 3e-4) {
            return None;
        }
        let half = (N / 2) as f32;
        let mut grey = self.grey;
        for (r, row) in grey.iter_mut().enumerate() {
            let (along, down) = (&self.along[r], &self.down[r]);
            let y = r as f32 - half;
            for (c, value) in row.iter_mut().enumerate() {
                let x = c as f32 - half;
                let dx = off[0][0] * x + off[0][1] * y;
                let dy = off[1][0] * x + off[1][1] * y;
                *value += dx * (along[c] + self.mean_gradient[0])
                    + dy * (down[c] + self.mean_gradient[1]);
            }
        }
        let mean = window::total(&grey) / (N * N) as f32;
        window::centre(&mut grey, mean);
        let moments = Moments::of(&grey, &self.along, &self.down);
        Some((grey, moments))
    }
}

/// Construction of a template in place.
struct Read<'a, S, const N: usize, const W: usize> {
    source: S,
    at: [f32; 2],
    template: &'a mut Template<N, W>,
}

impl<S: WindowSource, const N: usize, const W: usize> NullaryFnOnce for Read<'_, S, N, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let template = self.template;
        let Template {
            grey, along, down, ..
        } = &mut *template;
        let mut part = S::Part::default();
        let window = Window::<N, W>::around(self.source, &mut part, self.at);
        window.read(grey, along, down);
        template.complete();
    }
}

/// Construction of a template of a turned surface in place.
struct ReadTurned<'a, const N: usize, const W: usize> {
    plane: &'a Plane,
    at: [f32; 2],
    warp: &'a PlaneWarp,
    template: &'a mut Template<N, W>,
}

impl<const N: usize, const W: usize> NullaryFnOnce for ReadTurned<'_, N, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            plane,
            at,
            warp,
            template,
        } = self;
        let [[a, b], [c, d]] = warp.linear;
        let half = (N / 2) as f32;
        let Template {
            grey, along, down, ..
        } = &mut *template;
        for row in 0..N {
            let y = row as f32 - half;
            let mut places = [[0.0_f32; W]; 2];
            let [px, py] = &mut places;
            for column in 0..W {
                let x = column as f32 - half;
                let scale = 1.0 / (1.0 + warp.shrink[0] * x + warp.shrink[1] * y);
                px[column] = at[0] + scale * (a * x + b * y);
                py[column] = at[1] + scale * (c * x + d * y);
            }
            let mut seen = [[0.0_f32; W]; 3];
            window::read_at::<N, W>(plane, &places, &mut seen);
            grey[row] = seen[0];
            // The gradient by the offset in the other image, without the projective part, which
            // changes it little: it only guides the steps.
            for column in 0..W {
                along[row][column] = a * seen[1][column] + c * seen[2][column];
                down[row][column] = b * seen[1][column] + d * seen[2][column];
            }
        }
        template.complete();
    }
}

/// Registration of a template, by Gauss-Newton steps.
struct Find<'a, S, const N: usize, const W: usize> {
    template: &'a Template<N, W>,
    source: S,
    start: [f32; 2],
    warp: [[f32; 2]; 2],
    steps: usize,
}

impl<S: WindowSource, const N: usize, const W: usize> NullaryFnOnce for Find<'_, S, N, W> {
    type Output = Option<Registration>;

    #[inline(always)]
    fn call(self) -> Option<Registration> {
        let mut part = S::Part::default();
        let size = self.source.size();
        let template = self.template;
        let warped = template.warped(self.warp);
        let (grey, moments) = match &warped {
            Some((grey, moments)) => (grey, *moments),
            None => (&template.grey, template.moments),
        };
        let least_squares = template.least_squares(moments);
        let mut at = self.start;
        let mut seen = [[0.0_f32; W]; N];
        for _ in 0..self.steps {
            if !Template::<N, W>::fits_size(size, at) {
                return None;
            }
            let window = Window::<N, W>::around(self.source, &mut part, at);
            window.sample(&mut seen);
            // Σ T' I and Σ g I of the window at the present place.
            let [common, x, y] = products(&seen, [grey, &template.along, &template.down]);
            if !(common > 0.1 * moments.energy) {
                return None;
            }
            // Gain, right-hand side and step of the normal equations.
            let gain = common / moments.energy;
            let rest = [
                x - gain * moments.coupling[0],
                y - gain * moments.coupling[1],
            ];
            let mut step = least_squares.solve(rest).map(|s| s / gain);
            let length = window::length(step);
            if length > LONG_STEP {
                step = step.map(|s| s * LONG_STEP / length);
            }
            at = [at[0] - step[0], at[1] - step[1]];
            // Converged: correlation, and one step back with the roles exchanged.
            if length < SHORT_STEP {
                let mean = window::total(&seen) / (N * N) as f32;
                window::centre(&mut seen, mean);
                let zncc = common / (moments.energy * product(&seen, &seen)).sqrt();
                let back = window::step_back(&seen, grey, gain);
                let error = window::length([back[0] - step[0], back[1] - step[1]]);
                let return_error = if error >= 0.0 { error } else { f32::INFINITY };
                return zncc.is_finite().then_some(Registration {
                    at,
                    zncc,
                    return_error,
                });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests;
