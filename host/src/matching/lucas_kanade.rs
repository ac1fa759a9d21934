//! Where a small window of one image is in another, to a few thousandths of a pixel.
//!
//! Lucas and Kanade's least squares, inverse compositional (Baker and Matthews 2004): grey levels,
//! gradients and gradient matrix are those of the template, made once and used for every image it
//! is looked for in. Brightness may change by a factor `a` and an offset:
//!
//! ```text
//! I(x + p) = a T'(x) + b         T' = T - mean(T), g zero-mean gradients of T
//! c = Σ g T'      a = Σ T' I / Σ T' T'
//! step = (Σ g g^T - c c^T / Σ T' T')^-1 (Σ g I - a c) / a
//! ```
//!
//! so that neither factor nor offset shows in the step, and no difference image is needed.
//!
//! Template and image are both read through cubic B-splines, which smooth a little more and so
//! alike wherever between two pixels a window lies. Interpolation proper would leave the grey
//! levels as they are at whole pixels and smooth them at half ones: windows read at different
//! phases then differ, and each pulls its point its own way, by more than noise of 2 grey levels
//! does.
//!
//! What was found is asked the same question in return: with gradients of its own, it must lie as
//! far from the template as the last step says.

mod window;

use pulp::{Arch, NullaryFnOnce};

use super::pyramid::Plane;
use window::{Grid, LeastSquares, Window, product, products};

/// What a search for a template found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Where its centre is, px of the level.
    pub at: [f32; 2],
    /// Zero-mean normalised cross-correlation there, -1 to 1.
    pub likeness: f32,
    /// By how much the step to there differs from the step back, px. Infinite if what was found has
    /// no texture of its own.
    pub miss: f32,
}

/// Stops when a step is shorter than this, px. Noise of 2 grey levels lets steps shrink a
/// hundredfold and more, so the rest is a thousandth.
const SHORT_STEP: f32 = 0.08;
/// Longest single step, px: beyond it the linear model says nothing.
const LONG_STEP: f32 = 2.0;
/// The least mean square gradient of a template in its weakest direction, (grey level / px)².
const LEAST_GRADIENT: f32 = 0.25;

/// A square window of `N` x `N` px, odd. `W >= N` is a multiple of 8: rows as the processor likes
/// them.
#[derive(Clone, Debug)]
pub struct Template<const N: usize, const W: usize> {
    /// Zero-mean grey levels and gradients, zero beyond column `N`.
    grey: Grid<N, W>,
    along: Grid<N, W>,
    down: Grid<N, W>,
    /// Means of the gradients before they were made zero-mean.
    mean_gradient: [f32; 2],
    /// `Σ g g^T`: xx, xy, yy.
    matrix: [f32; 3],
    /// What grey levels and gradients have in common.
    share: Share,
}

/// Of a template's grey levels, bent or not.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    /// `Σ T'²`.
    energy: f32,
    /// `Σ g T'`.
    coupling: [f32; 2],
}

impl Share {
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

/// The window at level 0.
pub type Large = Template<21, 24>;
/// The window at coarser levels.
pub type Small = Template<11, 16>;

impl<const N: usize, const W: usize> Template<N, W> {
    /// How far the centre of a window must stay from the borders, px.
    pub const MARGIN: usize = N / 2 + 2;

    /// Side of the window, px.
    pub const SIDE: usize = N;

    /// Whether a window around `at` lies within `plane`.
    pub fn fits(plane: &Plane, at: [f32; 2]) -> bool {
        let inside = |at: f32, size: usize| {
            at >= Self::MARGIN as f32 && at < size as f32 - Self::MARGIN as f32
        };
        inside(at[0], plane.width) && inside(at[1], plane.height)
    }

    /// The window of `plane` around `at`. `None` if it leaves the image or has too little contrast
    /// in some direction. Boxed, since it is large and goes from hand to hand.
    pub fn new(plane: &Plane, at: [f32; 2]) -> Option<Box<Self>> {
        if !Self::fits(plane, at) {
            return None;
        }
        let nothing = [[0.0; W]; N];
        let mut template = Box::new(Self {
            grey: nothing,
            along: nothing,
            down: nothing,
            mean_gradient: [0.0; 2],
            matrix: [0.0; 3],
            share: Share::default(),
        });
        Arch::new().dispatch(Read {
            window: Window::<N, W>::around(plane, at),
            template: &mut template,
        });
        let count = (N * N) as f32;
        let enough = template.share.energy >= count * LEAST_GRADIENT
            && template.least_squares(template.share).weakest() > count * LEAST_GRADIENT;
        enough.then_some(template)
    }

    /// Looks for the template, bent by `warp` (near the identity), in `plane`, from `start` on: the
    /// template's pixel at `d` from the centre is that of its image at `warp d`.
    ///
    /// `None` if it leaves the image, turns into its negative, or does not settle in `steps` steps.
    pub fn find(
        &self,
        plane: &Plane,
        start: [f32; 2],
        warp: [[f32; 2]; 2],
        steps: usize,
    ) -> Option<Found> {
        Arch::new().dispatch(Find {
            template: self,
            plane,
            start,
            warp,
            steps,
        })
    }

    fn least_squares(&self, share: Share) -> LeastSquares {
        let [x, y] = share.coupling;
        let [xx, xy, yy] = self.matrix;
        LeastSquares {
            xx: xx - x * x / share.energy,
            xy: xy - x * y / share.energy,
            yy: yy - y * y / share.energy,
        }
    }

    /// First order in the deviation from the identity: at 2 % and 10 px from the centre, the
    /// neglected part is a fiftieth of a grey level per unit of curvature. `None` if there is
    /// nothing to bend.
    #[inline(always)]
    fn bent(&self, warp: [[f32; 2]; 2]) -> Option<(Grid<N, W>, Share)> {
        let off = [
            [warp[0][0] - 1.0, warp[0][1]],
            [warp[1][0], warp[1][1] - 1.0],
        ];
        // Three thousandths of a pixel at the border of the window, and nothing in its middle.
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
        let share = Share::of(&grey, &self.along, &self.down);
        Some((grey, share))
    }
}

/// The making of a template, where it is to stay.
struct Read<'a, const N: usize, const W: usize> {
    window: Window<'a, N, W>,
    template: &'a mut Template<N, W>,
}

impl<const N: usize, const W: usize> NullaryFnOnce for Read<'_, N, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let template = self.template;
        let Template {
            grey, along, down, ..
        } = template;
        self.window.read(grey, along, down);
        let [_, x, y] = [&mut *grey, &mut *along, &mut *down].map(|part| {
            let mean = window::total(part) / (N * N) as f32;
            window::centre(part, mean);
            mean
        });
        template.mean_gradient = [x, y];
        template.matrix = [
            product(along, along),
            product(along, down),
            product(down, down),
        ];
        template.share = Share::of(grey, along, down);
    }
}

/// The search for a template.
struct Find<'a, const N: usize, const W: usize> {
    template: &'a Template<N, W>,
    plane: &'a Plane,
    start: [f32; 2],
    warp: [[f32; 2]; 2],
    steps: usize,
}

impl<const N: usize, const W: usize> NullaryFnOnce for Find<'_, N, W> {
    type Output = Option<Found>;

    #[inline(always)]
    fn call(self) -> Option<Found> {
        let template = self.template;
        let bent = template.bent(self.warp);
        let (grey, share) = match &bent {
            Some((grey, share)) => (grey, *share),
            None => (&template.grey, template.share),
        };
        let least_squares = template.least_squares(share);
        let mut at = self.start;
        let mut seen = [[0.0_f32; W]; N];
        for _ in 0..self.steps {
            if !Template::<N, W>::fits(self.plane, at) {
                return None;
            }
            let window = Window::<N, W>::around(self.plane, at);
            window.sample(&mut seen);
            let [common, x, y] = products(&seen, [grey, &template.along, &template.down]);
            if !(common > 0.1 * share.energy) {
                return None;
            }
            let factor = common / share.energy;
            let rest = [
                x - factor * share.coupling[0],
                y - factor * share.coupling[1],
            ];
            let mut step = least_squares.solve(rest).map(|s| s / factor);
            let length = window::length(step);
            if length > LONG_STEP {
                step = step.map(|s| s * LONG_STEP / length);
            }
            at = [at[0] - step[0], at[1] - step[1]];
            if length < SHORT_STEP {
                let mean = window::total(&seen) / (N * N) as f32;
                window::centre(&mut seen, mean);
                let likeness = common / (share.energy * product(&seen, &seen)).sqrt();
                let back = window::step_back(&seen, grey, factor);
                let miss = window::length([back[0] - step[0], back[1] - step[1]]);
                let miss = if miss >= 0.0 { miss } else { f32::INFINITY };
                return likeness.is_finite().then_some(Found { at, likeness, miss });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests;
