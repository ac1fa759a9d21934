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

    /// Copies the square of `2 radius + 1` pixels around `centre` (x, y) into `patch`, interpolated by Keys' cubic convolution (1981,
    /// a = -1/2): linear interpolation would pull sub-pixel positions towards the pixel grid by a few hundredths.
    ///
    /// `false` if the 4 x 4 pixels behind some sample do not all lie within the image.
    pub fn sample(&self, centre: [f32; 2], radius: usize, patch: &mut [f32]) -> bool {
        let side = 2 * radius + 1;
        let [x, y] = centre;
        let (left, top) = (x.floor(), y.floor());
        let reach = radius as f32;
        let inside = left > reach
            && top > reach
            && left + reach + 2.0 < self.width as f32
            && top + reach + 2.0 < self.height as f32
            && side <= LONGEST_SIDE;
        if !inside {
            return false;
        }
        let (x0, y0) = (left as usize - radius - 1, top as usize - radius - 1);
        let [a, b, c, d] = cubic(x - left);
        let across = |row: usize| {
            let start = (y0 + row) * self.width + x0;
            let line = &self.grey[start..start + side + 3];
            let mut out = [0.0f32; LONGEST_SIDE];
            for i in 0..side {
                out[i] = a * line[i] + b * line[i + 1] + c * line[i + 2] + d * line[i + 3];
            }
            out
        };
        let down = cubic(y - top);
        let mut rows = [across(0), across(1), across(2), [0.0; LONGEST_SIDE]];
        for (j, out) in patch.chunks_exact_mut(side).take(side).enumerate() {
            // The newest row replaces the oldest; `j` says which is which.
            rows[(j + 3) % 4] = across(j + 3);
            let [p, q, r, s] = [&rows[j % 4], &rows[(j + 1) % 4], &rows[(j + 2) % 4], &rows[(j + 3) % 4]];
            for i in 0..side {
                out[i] = down[0] * p[i] + down[1] * q[i] + down[2] * r[i] + down[3] * s[i];
            }
        }
        true
    }
}

/// Longest side of a square that is sampled, px.
const LONGEST_SIDE: usize = 40;

/// Weights of the samples at -1, 0, 1, 2 for a position `t` of 0 to 1.
fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (2.0 * t2 - t3 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (4.0 * t2 - 3.0 * t3 + t),
        0.5 * (t3 - t2),
    ]
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
        assert!(!plane.sample([1.5, 9.5], 1, &mut patch) && !plane.sample([17.0, 9.0], 1, &mut patch));
        assert!(!plane.sample([f32::NAN, 9.0], 1, &mut patch));
    }
}
