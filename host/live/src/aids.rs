//! Aids for setting cameras up: sharpness for the focus, clipping for the exposure, texture per
//! cell for the place of the target.

use crate::telemetry::rounded;
use serde::Serialize;
use trinocular_vision::images::Image;

/// Columns and rows of cells.
pub const CELLS: [usize; 2] = [8, 6];

/// Grey levels that count as black and as white.
const BLACK: u8 = 4;
const WHITE: u8 = 251;

/// Figures of one image.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Aids {
    /// Brenner's focus measure over the variance, in percent: larger is sharper. Comparable only
    /// for the same view.
    pub sharpness: f64,
    /// Share of white pixels.
    pub white: f64,
    /// Share of black pixels.
    pub black: f64,
    /// Mean grey level.
    pub mean: f64,
    /// Texture of every cell, row by row, grey levels per px: square root of the smaller eigenvalue
    /// of the mean structure tensor.
    pub texture: Vec<f64>,
}

/// Computes the figures of an image.
pub fn aids(image: &Image) -> Aids {
    let (width, height) = (image.width, image.height);
    if width < 3 * CELLS[0] || height < 3 * CELLS[1] {
        return Aids::default();
    }
    let count = (width * height) as f64;
    let (mut sum, mut squares, mut white, mut black) = (0u64, 0u64, 0u64, 0u64);
    for grey in &image.grey {
        let level = u64::from(*grey);
        sum += level;
        squares += level * level;
        white += u64::from(*grey >= WHITE);
        black += u64::from(*grey <= BLACK);
    }
    let mean = sum as f64 / count;
    let variance = squares as f64 / count - mean * mean;

    // Brenner: squared difference of pixels two columns apart.
    let mut brenner = 0u64;
    for row in image.grey.chunks_exact(width) {
        for (left, right) in row.iter().zip(&row[2..]) {
            brenner += u64::from(left.abs_diff(*right)).pow(2);
        }
    }
    let brenner = brenner as f64 / ((width - 2) * height) as f64;

    let mut texture = Vec::with_capacity(CELLS[0] * CELLS[1]);
    for row in 0..CELLS[1] {
        for column in 0..CELLS[0] {
            let range = |index: usize, cells: usize, side: usize| {
                let at = |i: usize| 1 + i * (side - 2) / cells;
                at(index)..at(index + 1)
            };
            let rows = range(row, CELLS[1], height);
            let columns = range(column, CELLS[0], width);
            texture.push(cell_texture(image, rows, columns));
        }
    }
    let round = |value: f64| rounded(value, 1e3);
    Aids {
        sharpness: round(100.0 * brenner / variance.max(1.0)),
        white: round(white as f64 / count),
        black: round(black as f64 / count),
        mean: round(mean),
        texture: texture.into_iter().map(round).collect(),
    }
}

/// Computes the texture of a cell from every second row.
fn cell_texture(
    image: &Image,
    rows: std::ops::Range<usize>,
    columns: std::ops::Range<usize>,
) -> f64 {
    let (mut xx, mut xy, mut yy, mut count) = (0i64, 0i64, 0i64, 0i64);
    for y in rows.step_by(2) {
        let row = |y: usize| &image.grey[y * image.width..(y + 1) * image.width];
        let (above, here, below) = (row(y - 1), row(y), row(y + 1));
        for x in columns.clone() {
            let dx = i64::from(here[x + 1]) - i64::from(here[x - 1]);
            let dy = i64::from(below[x]) - i64::from(above[x]);
            xx += dx * dx;
            xy += dx * dy;
            yy += dy * dy;
            count += 1;
        }
    }
    // The differences span two pixels.
    let scale = 0.25 / count.max(1) as f64;
    let [xx, xy, yy] = [xx, xy, yy].map(|sum| sum as f64 * scale);
    let smaller = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
    smaller.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(grey: impl Fn(usize, usize) -> u8) -> Image {
        let (width, height) = (96, 72);
        let pixels = (0..width * height).map(|at| grey(at % width, at / width));
        Image {
            width,
            height,
            grey: pixels.collect(),
        }
    }

    /// Bright and dark squares with edges that rise over `ramp` pixels.
    fn squares(ramp: i32) -> Image {
        let wave = |at: usize| (((at as i32 + 6) % 24) - 12).abs() - 6;
        image(|x, y| {
            let height = (wave(x) * wave(y)).clamp(-ramp, ramp);
            (128 + 100 * height / ramp) as u8
        })
    }

    #[test]
    fn sharp_image_has_larger_sharpness() {
        let [sharp, blurred] = [1, 20].map(|ramp| aids(&squares(ramp)).sharpness);
        assert!(sharp > 1.5 * blurred, "{sharp} {blurred}");
    }

    #[test]
    fn clipped_share_is_counted() {
        let half = aids(&image(|x, _| if x < 48 { 255 } else { 0 }));
        assert_eq!((half.white, half.black, half.mean), (0.5, 0.5, 127.5));
    }

    #[test]
    fn stripes_have_no_texture() {
        let stripes = aids(&image(|x, _| (x * 40 % 256) as u8));
        assert!(stripes.texture.iter().all(|texture| *texture < 1e-6));
        let textured = aids(&squares(1));
        assert!(textured.texture.iter().any(|texture| *texture > 5.0));
    }

    #[test]
    fn missing_image_gives_zeros() {
        assert_eq!(aids(&Image::missing()), Aids::default());
    }
}
