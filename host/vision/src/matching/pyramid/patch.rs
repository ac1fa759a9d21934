//! Part of level 0, smoothed for one window.

use super::narrow;
use crate::images::Image;

/// Number of rows.
const ROWS: usize = 26;
/// Number of columns.
const COLUMNS: usize = 32;
/// Number of pixels beyond each side that the filter reads.
const REACH: usize = 2;
/// Columns of the image that are read, in whole vectors.
const READ: usize = 48;

/// Part of level 0 of an image, smoothed by itself. Inside the image it has the bits of the whole
/// level.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Column and row of level 0 at which the patch begins.
    corner: [usize; 2],
    rows: [[f32; COLUMNS]; ROWS],
}

impl Patch {
    /// Distance between rows in [`Patch::grey`].
    pub const STRIDE: usize = COLUMNS;

    /// Number of pixels.
    pub const PIXELS: usize = COLUMNS * ROWS;

    /// Returns the grey levels, row by row.
    #[inline(always)]
    pub fn grey(&self) -> &[f32] {
        self.rows.as_flattened()
    }

    /// Returns the place in [`Patch::grey`] of `corner`, the first pixel of a window of `columns`
    /// by `rows` pixels, at most 30 by 24. Smooths the image around the window first if the patch
    /// does not contain it.
    #[inline(always)]
    pub fn place(
        &mut self,
        image: &Image,
        corner: [usize; 2],
        [columns, rows]: [usize; 2],
    ) -> usize {
        let offset = |patch: [usize; 2]| [0, 1].map(|i| corner[i].wrapping_sub(patch[i]));
        let [mut x, mut y] = offset(self.corner);
        if !(x <= COLUMNS - columns && y <= ROWS - rows) {
            // As much room on either side, because the window may be moved either way.
            let room = [COLUMNS - columns, ROWS - rows].map(|room| room / 2);
            self.corner = [0, 1].map(|i| corner[i].saturating_sub(room[i]));
            self.smooth(image);
            [x, y] = offset(self.corner);
        }
        y * COLUMNS + x
    }

    /// Computes all pixels.
    #[inline(always)]
    fn smooth(&mut self, image: &Image) {
        let (width, height) = (image.width, image.height);
        let [left, top] = self.corner;
        let is_inside = left >= REACH && left - REACH + READ <= width;
        let mut read = [[0_u8; READ]; ROWS + 2 * REACH];
        for (r, out) in read.iter_mut().enumerate() {
            let y = (top + r).saturating_sub(REACH).min(height - 1);
            let row = &image.grey[y * width..][..width];
            if is_inside {
                out.copy_from_slice(&row[left - REACH..][..READ]);
                continue;
            }
            // Beyond the border, the image repeats its outermost pixel.
            for (i, out) in out[..COLUMNS + 2 * REACH].iter_mut().enumerate() {
                *out = row[(left + i).saturating_sub(REACH).min(width - 1)];
            }
        }
        let mut sums = [0_u16; READ];
        for (r, out) in self.rows.iter_mut().enumerate() {
            let (a, b, c, d, e) = (
                &read[r],
                &read[r + 1],
                &read[r + 2],
                &read[r + 3],
                &read[r + 4],
            );
            for i in 0..READ {
                sums[i] = narrow([a[i], b[i], c[i], d[i], e[i]].map(u16::from));
            }
            for i in 0..COLUMNS {
                let five = [sums[i], sums[i + 1], sums[i + 2], sums[i + 3], sums[i + 4]];
                out[i] = f32::from(narrow(five)) / 256.0;
            }
        }
    }
}

impl Default for Patch {
    /// Creates a patch of no window.
    #[inline(always)]
    fn default() -> Self {
        Self {
            // Farther from any window than the patch reaches.
            corner: [usize::MAX / 2; 2],
            rows: [[0.0; COLUMNS]; ROWS],
        }
    }
}
