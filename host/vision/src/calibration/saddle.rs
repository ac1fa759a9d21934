//! Candidates for a chessboard's inner corners: saddles of the grey levels whose surroundings
//! change colour four times.
//!
//! A corner of four squares is a saddle: the determinant of the second derivatives is negative, for
//! any orientation of the board. The ring test then walks a circle around each saddle. The circle
//! must cross four edges, opposite ones opposite each other, so the saddle gets its two edge lines
//! and its four colours: enough to predict places and colours of its neighbours.

use std::f64::consts::{PI, TAU};

use crate::matching::pyramid::Plane;

/// Radius of the ring, px.
const RING_PX: f64 = 4.5;
/// Number of places on the ring, one bit of [`Saddle::bright`] each.
const RING: usize = 32;
/// Least difference of the brightest and the darkest place on a ring, grey levels.
const LEAST_CONTRAST: f64 = 12.0;
/// Least response of a saddle: that of a corner with [`LEAST_CONTRAST`].
const LEAST_RESPONSE: f32 = 1.0;
/// Largest number of saddles; the strongest are kept.
const MOST: usize = 4000;
/// Largest deviation of opposite crossings, rad.
const OPPOSITE: f64 = 0.6;

/// Saddle point that passed the ring test.
#[derive(Clone, Debug)]
pub struct Saddle {
    /// Pixel of the plane.
    pub at: [f64; 2],
    /// Directions of its two edge lines, rad from x towards y, ascending, in 0 to π.
    pub edges: [f64; 2],
    /// Bit `i` is set if the ring is bright at the angle `i / RING` turns.
    bright: u32,
    /// Brightest minus darkest place on the ring.
    pub contrast: f64,
}

impl Saddle {
    /// Returns true if the ring is bright in this direction, rad.
    pub fn is_bright(&self, angle: f64) -> bool {
        let place = (angle.rem_euclid(TAU) / TAU * RING as f64).round() as usize % RING;
        self.bright >> place & 1 == 1
    }
}

/// Finds all saddles of `plane`, the strongest first.
pub fn saddles(plane: &Plane) -> Vec<Saddle> {
    let margin = RING_PX.ceil() as usize + 1;
    let (width, height) = (plane.width, plane.height);
    if width <= 2 * margin || height <= 2 * margin {
        return Vec::new();
    }
    let response = response(plane);
    let mut peaks: Vec<(f32, usize, usize)> = Vec::new();
    for y in margin..height - margin {
        for x in margin..width - margin {
            let here = response[y * width + x];
            if here > LEAST_RESPONSE && is_peak(&response, width, x, y) {
                peaks.push((here, x, y));
            }
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let strongest = peaks.into_iter().take(MOST);
    strongest
        .filter_map(|(_, x, y)| ring(plane, [x as f64, y as f64]))
        .collect()
}

/// Computes the response of a saddle: minus the determinant of the Hessian, over steps of two
/// pixels.
fn response(plane: &Plane) -> Vec<f32> {
    let mut out = vec![0.0; plane.width * plane.height];
    for y in 2..plane.height.saturating_sub(2) {
        for x in 2..plane.width.saturating_sub(2) {
            let level = |dx: isize, dy: isize| {
                let at = (y as isize + dy) * plane.stride as isize + x as isize + dx;
                plane.grey[at as usize]
            };
            let here = level(0, 0);
            let xx = (level(2, 0) + level(-2, 0) - 2.0 * here) / 4.0;
            let yy = (level(0, 2) + level(0, -2) - 2.0 * here) / 4.0;
            let xy = (level(2, 2) + level(-2, -2) - level(2, -2) - level(-2, 2)) / 16.0;
            out[y * plane.width + x] = xy * xy - xx * yy;
        }
    }
    out
}

/// Returns true for a maximum within 3 px. Of equal values the last counts.
fn is_peak(response: &[f32], width: usize, x: usize, y: usize) -> bool {
    let here = response[y * width + x];
    (y - 3..=y + 3).all(|row| {
        let cells = &response[row * width + x - 3..][..7];
        cells
            .iter()
            .zip(x - 3..)
            .all(|(&other, column)| other < here || (other == here && (row, column) <= (y, x)))
    })
}

/// Interpolates the grey level at a place inside the plane.
pub fn level(plane: &Plane, [x, y]: [f64; 2]) -> f64 {
    let x = x.clamp(0.0, plane.width as f64 - 1.001);
    let y = y.clamp(0.0, plane.height as f64 - 1.001);
    let (fx, fy) = (x.fract(), y.fract());
    let corner = y as usize * plane.stride + x as usize;
    let grey = |offset: usize| f64::from(plane.grey[corner + offset]);
    let upper = (1.0 - fx) * grey(0) + fx * grey(1);
    let lower = (1.0 - fx) * grey(plane.stride) + fx * grey(plane.stride + 1);
    (1.0 - fy) * upper + fy * lower
}

fn ring(plane: &Plane, at: [f64; 2]) -> Option<Saddle> {
    let turn = TAU / RING as f64;
    let mut levels = [0.0; RING];
    for (i, out) in levels.iter_mut().enumerate() {
        let (sine, cosine) = (i as f64 * turn).sin_cos();
        *out = level(plane, [at[0] + RING_PX * cosine, at[1] + RING_PX * sine]);
    }
    let high = levels.iter().copied().fold(f64::MIN, f64::max);
    let low = levels.iter().copied().fold(f64::MAX, f64::min);
    let contrast = high - low;
    if contrast < LEAST_CONTRAST {
        return None;
    }
    let middle = (high + low) / 2.0;
    let mut crossings = [0.0; 4];
    let mut count = 0;
    let mut bright = 0;
    for i in 0..RING {
        let (here, next) = (levels[i] - middle, levels[(i + 1) % RING] - middle);
        bright |= u32::from(here > 0.0) << i;
        if (here > 0.0) != (next > 0.0) {
            *crossings.get_mut(count)? = (i as f64 + here / (here - next)) * turn;
            count += 1;
        }
    }
    let opposite = |a: f64, b: f64| (b - a - PI).abs() < OPPOSITE;
    let [a, b, c, d] = crossings;
    if count != 4 || !opposite(a, c) || !opposite(b, d) {
        return None;
    }
    // The mean of a direction and its opposite, back in 0 to π.
    let mut edges = [(a + c - PI) / 2.0, (b + d - PI) / 2.0].map(|angle| angle.rem_euclid(PI));
    edges.sort_by(f64::total_cmp);
    Some(Saddle {
        at,
        edges,
        bright,
        contrast,
    })
}
