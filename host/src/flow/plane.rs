//! Grey images in floating point: filter, halving, interpolation.

use crate::images::Image;

/// Grey levels as `f32`, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values.
    pub grey: Vec<f32>,
}

impl Plane {
    /// The image as it is.
    pub fn from_image(image: &Image) -> Self {
        Self {
            width: image.width,
            height: image.height,
            grey: image.grey.iter().map(|&g| f32::from(g)).collect(),
        }
    }

    /// One row.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.grey[y * self.width..(y + 1) * self.width]
    }

    /// The paper's Gaussian pre-filter: 5 x 5 binomial, `[1 4 6 4 1] / 16` along both axes (standard deviation 1 px). Borders repeat.
    pub fn filtered(&self) -> Self {
        let (width, height) = (self.width, self.height);
        let mut across = vec![0.0f32; self.grey.len()];
        for (out, row) in across.chunks_exact_mut(width).zip(self.grey.chunks_exact(width)) {
            filter_row(row, out);
        }
        let mut grey = vec![0.0f32; self.grey.len()];
        for (y, out) in grey.chunks_exact_mut(width).enumerate() {
            let line = |offset: isize| {
                let y = y.saturating_add_signed(offset).min(height - 1);
                &across[y * width..(y + 1) * width]
            };
            let (a, b, c, d, e) = (line(-2), line(-1), line(0), line(1), line(2));
            for x in 0..width {
                out[x] = ((a[x] + e[x]) + 4.0 * (b[x] + d[x]) + 6.0 * c[x]) * (1.0 / 16.0);
            }
        }
        Self { width, height, grey }
    }

    /// Half the size: filtered, then every second pixel of every second row, from the first. A position `p` becomes `p / 2`.
    pub fn halved(&self) -> Self {
        let filtered = self.filtered();
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut grey = Vec::with_capacity(width * height);
        for y in 0..height {
            grey.extend(filtered.row(2 * y).iter().step_by(2));
        }
        Self { width, height, grey }
    }

    /// Copies the square of `2 radius + 1` pixels around `centre` (x, y), interpolated bilinearly, into `patch`.
    ///
    /// `false` if it does not lie within the image.
    pub fn sample(&self, centre: [f32; 2], radius: usize, patch: &mut [f32]) -> bool {
        let side = 2 * radius + 1;
        let [x, y] = centre;
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let reach = radius as f32;
        let inside = left >= reach
            && top >= reach
            && left + reach + 1.0 <= (self.width - 1) as f32
            && top + reach + 1.0 <= (self.height - 1) as f32;
        if !inside {
            return false;
        }
        let (x0, y0) = (left as usize - radius, top as usize - radius);
        let (w00, w10) = ((1.0 - fx) * (1.0 - fy), fx * (1.0 - fy));
        let (w01, w11) = ((1.0 - fx) * fy, fx * fy);
        for (j, out) in patch.chunks_exact_mut(side).take(side).enumerate() {
            let start = (y0 + j) * self.width + x0;
            let upper = &self.grey[start..start + side + 1];
            let lower = &self.grey[start + self.width..start + self.width + side + 1];
            for i in 0..side {
                out[i] = w00 * upper[i] + w10 * upper[i + 1] + w01 * lower[i] + w11 * lower[i + 1];
            }
        }
        true
    }
}

fn filter_row(row: &[f32], out: &mut [f32]) {
    let last = row.len() - 1;
    let at = |x: isize| row[x.clamp(0, last as isize) as usize];
    let tap = |x: isize| ((at(x - 2) + at(x + 2)) + 4.0 * (at(x - 1) + at(x + 1)) + 6.0 * at(x)) * (1.0 / 16.0);
    for x in (0..2.min(row.len())).chain(row.len().saturating_sub(2)..row.len()) {
        out[x] = tap(x as isize);
    }
    for (w, o) in row.windows(5).zip(&mut out[2.min(last)..]) {
        *o = ((w[0] + w[4]) + 4.0 * (w[1] + w[3]) + 6.0 * w[2]) * (1.0 / 16.0);
    }
}

/// An image and its halvings, finest first.
#[derive(Clone, Debug)]
pub struct Pyramid {
    /// The filtered image, its half, and so on.
    pub levels: Vec<Plane>,
}

impl Pyramid {
    /// Filters the image and halves it until there are `levels` of them, or a side would fall below 32 px.
    pub fn new(image: &Image, levels: usize) -> Self {
        let mut list = vec![Plane::from_image(image).filtered()];
        while list.len() < levels {
            let last = &list[list.len() - 1];
            if last.width.min(last.height) < 64 {
                break;
            }
            list.push(last.halved());
        }
        Self { levels: list }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filter_keeps_constants_and_has_variance_one() {
        let mut image = Image { width: 17, height: 9, grey: vec![50; 17 * 9] };
        let flat = Plane::from_image(&image).filtered();
        assert!(flat.grey.iter().all(|g| (g - 50.0).abs() < 1e-4));
        image.grey = vec![0; 17 * 9];
        image.grey[4 * 17 + 8] = 200;
        let dot = Plane::from_image(&image).filtered();
        let total: f32 = dot.grey.iter().sum();
        let variance: f32 = (0..17).map(|x| (x as f32 - 8.0).powi(2) * (0..9).map(|y| dot.row(y)[x]).sum::<f32>()).sum();
        assert!((total - 200.0).abs() < 1e-3 && (variance / total - 1.0).abs() < 1e-5);
    }

    #[test]
    fn a_ramp_is_sampled_exactly_and_borders_are_refused() {
        let grey = (0..20 * 20).map(|i| (i % 20) as f32 * 2.0 + (i / 20) as f32).collect();
        let plane = Plane { width: 20, height: 20, grey };
        let mut patch = [0.0; 9];
        assert!(plane.sample([7.25, 9.5], 1, &mut patch));
        assert!((patch[4] - (2.0 * 7.25 + 9.5)).abs() < 1e-5 && (patch[0] - (2.0 * 6.25 + 8.5)).abs() < 1e-5);
        assert!(!plane.sample([0.5, 9.5], 1, &mut patch) && !plane.sample([18.0, 9.0], 1, &mut patch));
        assert!(!plane.sample([f32::NAN, 9.0], 1, &mut patch));
    }
}
