//! Filtered images at several scales.
//!
//! Each level is the one below it, smoothed by the 5-tap binomial `[1 4 6 4 1]/16` along x and y and taken at every
//! second pixel; the lowest is the image itself, smoothed by the same filter (the Gaussian of the paper's
//! section 4.3, sigma 1 px). Pixel `(x, y)` of level `l` lies at `(x 2^l, y 2^l)` of the image: no half pixels.

use crate::images::Image;

/// Columns right of the image that repeat its last one, so that vectors may read past the end of a row.
const PADDING: usize = 16;

/// One level: grey levels as `f32`.
#[derive(Clone, Debug, Default)]
pub struct Plane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Distance between rows in `grey`, at least `width + PADDING`.
    pub stride: usize,
    /// Rows of `stride` values; those beyond `width` repeat the last.
    pub grey: Vec<f32>,
}

impl Plane {
    /// The 5-tap filter over rows of `source`, every `step`th pixel kept.
    fn filtered<T: Copy + Into<f32>>(
        source: &[T],
        [width, height]: [usize; 2],
        source_stride: usize,
        step: usize,
    ) -> Self {
        let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
        let stride = columns + PADDING;
        let mut grey = vec![0.0_f32; stride * rows + PADDING];
        // One row, smoothed along y, with two repeated pixels on either side.
        let mut smooth = vec![0.0_f32; width + 4];
        let row = |at: isize| {
            let at = at.clamp(0, height as isize - 1) as usize;
            &source[at * source_stride..][..width]
        };
        for (r, out) in grey.chunks_exact_mut(stride).take(rows).enumerate() {
            let centre = (r * step) as isize;
            let [a, b, c, d, e] = [-2, -1, 0, 1, 2].map(|offset| row(centre + offset));
            for (i, sum) in smooth[2..width + 2].iter_mut().enumerate() {
                let (a, b, c): (f32, f32, f32) = (a[i].into(), b[i].into(), c[i].into());
                let (d, e): (f32, f32) = (d[i].into(), e[i].into());
                *sum = (a + e) + 4.0 * (b + d) + 6.0 * c;
            }
            let (first, last) = (smooth[2], smooth[width + 1]);
            smooth[..2].fill(first);
            smooth[width + 2..].fill(last);
            let tap = |w: &[f32]| ((w[0] + w[4]) + 4.0 * (w[1] + w[3]) + 6.0 * w[2]) / 256.0;
            if step == 1 {
                for (out, window) in out.iter_mut().zip(smooth.windows(5)) {
                    *out = tap(window);
                }
            } else {
                for (out, window) in out.iter_mut().zip(smooth.windows(5).step_by(step)) {
                    *out = tap(window);
                }
            }
            let last = out[columns - 1];
            out[columns..].fill(last);
        }
        Self {
            width: columns,
            height: rows,
            stride,
            grey,
        }
    }
}

/// One image at all scales, the finest first.
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    /// Level 0 has the image's size, each further one half of it.
    pub levels: Vec<Plane>,
}

impl Pyramid {
    /// Filters `image` into `levels` levels. The image must not be empty.
    pub fn new(image: &Image, levels: usize) -> Self {
        let size = [image.width, image.height];
        let mut planes = vec![Plane::filtered(&image.grey, size, image.width, 1)];
        while planes.len() < levels {
            let Some(below) = planes.last() else { break };
            let size = [below.width, below.height];
            planes.push(Plane::filtered(&below.grey, size, below.stride, 2));
        }
        Self { levels: planes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_stays_itself_at_every_level() {
        let grey = (0..64 * 48)
            .map(|i| (2 * (i % 64) + i / 64) as u8)
            .collect();
        let image = Image {
            width: 64,
            height: 48,
            grey,
        };
        let pyramid = Pyramid::new(&image, 3);
        for (level, plane) in pyramid.levels.iter().enumerate() {
            let scale = 1 << level;
            assert_eq!((plane.width, plane.height), (64 / scale, 48 / scale));
            for (x, y) in [(4, 4), (7, 5)] {
                let expected = (2 * x * scale + y * scale) as f32;
                assert_eq!(plane.grey[y * plane.stride + x], expected);
            }
        }
    }

    #[test]
    fn a_point_spreads_into_the_binomial() {
        let mut image = Image {
            width: 9,
            height: 9,
            grey: vec![0; 81],
        };
        image.grey[4 * 9 + 4] = 128;
        let plane = &Pyramid::new(&image, 1).levels[0];
        let row = |y: usize| &plane.grey[y * plane.stride..][..9];
        assert_eq!(row(4)[2..7], [3.0, 12.0, 18.0, 12.0, 3.0]);
        assert_eq!(row(2)[4], 3.0);
    }
}
