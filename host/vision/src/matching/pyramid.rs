//! Gaussian image pyramids.
//!
//! Each level is the one below it, smoothed by the 5-tap binomial `[1 4 6 4 1]/16` along x and y
//! and sampled at every second pixel (J.-Y. Bouguet, *Pyramidal Implementation of the Lucas Kanade
//! Feature Tracker*, 2000, uses `[1 2 1]/4` for this). Level 0 is the image itself, smoothed by the
//! same filter: the Gaussian of the paper's section 4.3, sigma 1 px. Pixel `(x, y)` of level `l`
//! lies at `(x 2^l, y 2^l)` of the image, without half pixels.
//!
//! [`Pyramid`] has all levels. [`FramePyramid`] has those above level 0, and smooths parts of
//! level 0 where windows are read: most of a large image is never looked at.

mod first_level;
mod frame;
mod patch;

use pulp::{Arch, NullaryFnOnce};

use crate::images::Image;

pub use frame::{Band, Finest, FramePyramid};
pub(super) use patch::Patch;

/// Columns right of the image that repeat its last one, so that vectors may read past the end of a
/// row.
const PADDING: usize = 16;

/// One pyramid level: grey levels as `f32`.
#[derive(Clone, Debug, Default)]
pub struct Plane {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Distance between rows in `grey`, at least `width + PADDING`.
    pub stride: usize,
    /// Grey levels, in rows of `stride` values; those beyond `width` repeat the last.
    pub grey: Vec<f32>,
}

impl Plane {
    /// Interpolates linearly between the grey levels; places outside are moved to the border.
    pub fn between(&self, at: [f32; 2]) -> f32 {
        let limit = [self.width, self.height].map(|size| size.saturating_sub(2));
        let corner = [0, 1].map(|i| (at[i].max(0.0) as usize).min(limit[i]));
        let [u, v] = [0, 1].map(|i| (at[i] - corner[i] as f32).clamp(0.0, 1.0));
        let row = |r: usize| &self.grey[(corner[1] + r) * self.stride + corner[0]..][..2];
        let mix = |row: &[f32]| row[0] + u * (row[1] - row[0]);
        let (above, below) = (mix(row(0)), mix(row(1)));
        above + v * (below - above)
    }

    /// Computes the standard deviation of the grey levels.
    pub fn contrast(&self) -> f64 {
        let rows = || self.grey.chunks(self.stride.max(1)).take(self.height);
        let values = || rows().flat_map(|row| &row[..self.width.min(row.len())]);
        let count = (self.width * self.height).max(1) as f64;
        let mean = values().map(|v| f64::from(*v)).sum::<f64>() / count;
        let square = |v: &f32| (f64::from(*v) - mean).powi(2);
        (values().map(square).sum::<f64>() / count).sqrt()
    }
}

/// Filters five grey levels in integers, without the division by 16. Two passes give a sum of 256
/// grey levels at most, which fits 16 bits.
#[inline(always)]
fn narrow([a, b, c, d, e]: [u16; 5]) -> u16 {
    let (outer, inner) = (a.wrapping_add(e), b.wrapping_add(d));
    let inner = inner.wrapping_add(c);
    let twice = c.wrapping_add(c);
    outer.wrapping_add(inner << 2).wrapping_add(twice)
}

/// Filters five values, without the division by 16.
#[inline(always)]
fn wide([a, b, c, d, e]: [f32; 5]) -> f32 {
    (a + e) + 4.0 * (b + d) + 6.0 * c
}

/// Filters across five rows.
#[inline(always)]
fn across<S: Copy, T>(rows: [&[S]; 5], filter: impl Fn([S; 5]) -> T, out: &mut [T]) {
    let [a, b, c, d, e] = rows.map(|row| &row[..out.len()]);
    for i in 0..out.len() {
        out[i] = filter([a[i], b[i], c[i], d[i], e[i]]);
    }
}

/// Filters along a row and divides by 256. The two first and two last values of the row lie beyond
/// the image.
#[inline(always)]
fn along(row: &[u16], out: &mut [f32]) {
    let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|i| &row[i..][..out.len()]);
    for (i, out) in out.iter_mut().enumerate() {
        *out = f32::from(narrow([a[i], b[i], c[i], d[i], e[i]])) / 256.0;
    }
}

/// Filters along a row at every second place and divides by 256. The row comes as its values with
/// even and with odd index, because vectors are read from consecutive places only.
#[inline(always)]
fn along_halved([even, odd]: [&[f32]; 2], out: &mut [f32]) {
    let [a, c, e] = [0, 1, 2].map(|i| &even[i..][..out.len()]);
    let [b, d] = [0, 1].map(|i| &odd[i..][..out.len()]);
    for (i, out) in out.iter_mut().enumerate() {
        *out = wide([a[i], b[i], c[i], d[i], e[i]]) / 256.0;
    }
}

/// Sorts the values of a row by even and odd index.
#[inline(always)]
fn split(row: &[f32], [even, odd]: [&mut [f32]; 2]) {
    let (pairs, _) = row.as_chunks::<2>();
    for ((even, odd), pair) in even.iter_mut().zip(odd).zip(pairs) {
        (*even, *odd) = (pair[0], pair[1]);
    }
}

/// Repeats the first and the last pixel of a row twice beyond the image.
#[inline(always)]
fn repeat_ends<T: Copy>(row: &mut [T]) {
    let end = row.len() - 2;
    let (first, last) = (row[2], row[end - 1]);
    row[..2].fill(first);
    row[end..].fill(last);
}

/// Returns the five rows around `centre`; beyond the border, the outermost row.
#[inline(always)]
fn rows<T>(source: &[T], centre: usize, [width, height]: [usize; 2], stride: usize) -> [&[T]; 5] {
    [0, 1, 2, 3, 4].map(|i| {
        let row = (centre + i).saturating_sub(2).min(height - 1);
        &source[row * stride..][..width]
    })
}

/// Computes row `r` of level 0 with its padding, in 16-bit integers: narrow numbers are the fastest.
#[inline(always)]
fn smooth(image: &Image, r: usize, column: &mut [u16], out: &mut [f32]) {
    let (width, height) = (image.width, image.height);
    let five = rows(&image.grey, r, [width, height], width);
    let filter = |levels: [u8; 5]| narrow(levels.map(u16::from));
    across(five, filter, &mut column[2..width + 2]);
    repeat_ends(&mut column[..width + 4]);
    let (inside, beyond) = out.split_at_mut(width);
    along(column, inside);
    beyond.fill(inside[width - 1]);
}

/// Buffers for one row of a level that is halved.
struct HalvedRow {
    column: Vec<f32>,
    /// Values of `column` with even and with odd index.
    parts: [Vec<f32>; 2],
}

impl HalvedRow {
    /// Creates buffers for levels at most `width` px wide.
    fn new(width: usize) -> Self {
        // One more than the border, so that the number of values is even.
        let count = width + 5;
        Self {
            column: vec![0.0; count],
            parts: [(); 2].map(|()| vec![0.0; count.div_ceil(2)]),
        }
    }
}

/// Computes row `r` of any other level.
#[inline(always)]
fn halve(below: &Plane, r: usize, row: &mut HalvedRow, plane: &mut Plane) {
    let size = [below.width, below.height];
    let five = rows(&below.grey, 2 * r, size, below.stride);
    let HalvedRow { column, parts } = row;
    across(five, wide, &mut column[2..size[0] + 2]);
    repeat_ends(&mut column[..size[0] + 4]);
    split(
        &column[..size[0] + 5],
        parts.each_mut().map(Vec::as_mut_slice),
    );
    let (inside, beyond) = plane.row_mut(r);
    along_halved(parts.each_ref().map(Vec::as_slice), inside);
    beyond.fill(inside[inside.len() - 1]);
}

/// Computation of all levels at once: each row as soon as its source rows exist, while they are in
/// the nearest cache.
struct Fill<'a> {
    image: &'a Image,
    levels: &'a mut [Plane],
}

impl NullaryFnOnce for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { image, levels } = self;
        let mut sums = vec![0_u16; image.width + 4];
        let mut halved = HalvedRow::new(image.width);
        // Number of complete rows, per level.
        let mut done = vec![0; levels.len()];
        for r in 0..image.height {
            let finest = &mut levels[0];
            let row = &mut finest.grey[r * finest.stride..][..finest.stride];
            smooth(image, r, &mut sums, row);
            done[0] += 1;
            for level in 1..levels.len() {
                let (below, above) = levels.split_at_mut(level);
                let (below, plane) = (&below[level - 1], &mut above[0]);
                while done[level] < plane.height
                    && (2 * done[level] + 2).min(below.height - 1) < done[level - 1]
                {
                    halve(below, done[level], &mut halved, plane);
                    done[level] += 1;
                }
            }
        }
    }
}

/// Computation of the levels above the first of `levels`.
struct Halve<'a>(&'a mut [Plane]);

impl NullaryFnOnce for Halve<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let mut row = HalvedRow::new(self.0.first().map_or(0, |plane| plane.width));
        for level in 1..self.0.len() {
            let (below, above) = self.0.split_at_mut(level);
            let (below, plane) = (&below[level - 1], &mut above[0]);
            plane.resize(below.width.div_ceil(2), below.height.div_ceil(2));
            for r in 0..plane.height {
                halve(below, r, &mut row, plane);
            }
        }
    }
}

impl Plane {
    /// Resizes the buffer for an image of this size.
    fn resize(&mut self, width: usize, height: usize) {
        let stride = width + PADDING;
        (self.width, self.height, self.stride) = (width, height, stride);
        // The last row, too, may be read past its end.
        self.grey.resize(stride * height + PADDING, 0.0);
    }

    /// Returns row `r` and its padding.
    #[inline(always)]
    fn row_mut(&mut self, r: usize) -> (&mut [f32], &mut [f32]) {
        self.grey[r * self.stride..][..self.stride].split_at_mut(self.width)
    }
}

/// Image at several scales, the finest first.
///
/// ```
/// use trinocular_vision::images::Image;
/// use trinocular_vision::matching::pyramid::Pyramid;
///
/// let image = Image { width: 64, height: 48, grey: vec![128; 64 * 48] };
/// let pyramid = Pyramid::new(&image, 3);
/// let sizes: Vec<_> = pyramid.levels.iter().map(|level| (level.width, level.height)).collect();
/// assert_eq!(sizes, [(64, 48), (32, 24), (16, 12)]);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    /// Levels: level 0 has the image's size, each further one half of the size before.
    pub levels: Vec<Plane>,
}

impl Pyramid {
    /// Builds `levels` levels of `image`, which must not be empty.
    pub fn new(image: &Image, levels: usize) -> Self {
        let mut pyramid = Self::default();
        pyramid.refill(image, levels);
        pyramid
    }

    /// Builds the pyramid of `image` in the memory of this one. See [`Pyramid::new`].
    pub fn refill(&mut self, image: &Image, levels: usize) {
        self.levels.resize_with(levels.max(1), Plane::default);
        let [mut width, mut height] = [image.width, image.height];
        for plane in &mut self.levels {
            plane.resize(width, height);
            [width, height] = [width, height].map(|side| side.div_ceil(2));
        }
        let levels = &mut self.levels;
        Arch::new().dispatch(Fill { image, levels });
    }
}

#[cfg(test)]
mod tests;
