//! How far the whole target moved, roughly: what sub-pixel tracking starts from.
//!
//! One displacement `(Tx, Ty)` predicts the flow of every point from its inverse depth `ρ`: `f ρ T`. So the search tries displacements, not
//! flows, and judges each by the mean correlation over many points; what repeats around one point does not repeat around all of them, unless the
//! whole scene repeats. Every separate peak comes back, so that the caller can tell an ambiguous scene from a clear one.

use super::patch::dot;
use super::plane::Plane;

/// Half side of the squares compared, px of the level searched.
const RADIUS: usize = 4;
const SIDE: usize = 2 * RADIUS + 1;

/// Peaks lower than the best by more than this are not candidates.
const MARGIN: f32 = 0.25;

/// Most candidates returned.
const MOST: usize = 6;

/// A displacement that may be the right one, as the flow of a point at the reference depth, px of the level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Flow along x and y.
    pub flow: [f32; 2],
    /// Mean correlation.
    pub likeness: f32,
}

/// A point to be followed: whole pixels of the level, and its inverse depth relative to the reference depth.
#[derive(Clone, Debug)]
pub struct Mark {
    at: [isize; 2],
    nearness: f32,
    /// Mean removed, length one.
    template: Vec<f32>,
}

impl Mark {
    /// The square around `at`, px of the level. `None` at the border or without texture.
    pub fn new(plane: &Plane, at: [f32; 2], nearness: f32) -> Option<Self> {
        let at = at.map(|p| p.round() as isize);
        let mut template = square(plane, at)?;
        let mean = template.iter().sum::<f32>() / template.len() as f32;
        template.iter_mut().for_each(|t| *t -= mean);
        let length = dot(&template, &template).sqrt();
        if length < 2.0 * SIDE as f32 {
            return None; // less than two grey levels of contrast
        }
        template.iter_mut().for_each(|t| *t /= length);
        Some(Self {
            at,
            nearness,
            template,
        })
    }
}

fn square(plane: &Plane, at: [isize; 2]) -> Option<Vec<f32>> {
    let [x, y] = corner(plane, at)?;
    let rows = (y..y + SIDE).map(|row| &plane.row(row)[x..x + SIDE]);
    Some(rows.flatten().copied().collect())
}

/// The top left pixel of the square around `at`, if all of it lies within the image.
fn corner(plane: &Plane, [x, y]: [isize; 2]) -> Option<[usize; 2]> {
    let left = usize::try_from(x - RADIUS as isize).ok()?;
    let top = usize::try_from(y - RADIUS as isize).ok()?;
    (left + SIDE <= plane.width && top + SIDE <= plane.height).then_some([left, top])
}

/// Displacements of up to `reach` px (of the level) that make the marks look alike, best first.
pub fn candidates(marks: &[Mark], plane: &Plane, reach: usize) -> Vec<Candidate> {
    let contrast = contrasts(plane);
    let reach = reach as isize;
    let span = (2 * reach + 1) as usize;
    let mut scores = vec![-1.0f32; span * span];
    for (i, score) in scores.iter_mut().enumerate() {
        let flow = [(i % span) as isize - reach, (i / span) as isize - reach];
        *score = likeness(marks, plane, &contrast, flow);
    }
    let mut peaks: Vec<Candidate> = (0..scores.len())
        .filter(|&i| is_peak(&scores, span, i))
        .map(|i| Candidate {
            flow: [
                ((i % span) as isize - reach) as f32,
                ((i / span) as isize - reach) as f32,
            ],
            likeness: scores[i],
        })
        .collect();
    peaks.sort_by(|a, b| b.likeness.total_cmp(&a.likeness));
    let best = peaks.first().map_or(0.0, |peak| peak.likeness);
    peaks.retain(|peak| peak.likeness > best - MARGIN && peak.likeness > 0.2);
    peaks.truncate(MOST);
    peaks
}

fn is_peak(scores: &[f32], span: usize, i: usize) -> bool {
    let (x, y) = (i % span, i / span);
    (y.saturating_sub(1)..(y + 2).min(span)).all(|v| {
        (x.saturating_sub(1)..(x + 2).min(span))
            .all(|u| v * span + u == i || scores[v * span + u] < scores[i])
    })
}

/// Mean correlation at one displacement. Marks that leave the image do not count, but too few left count as unlike.
fn likeness(marks: &[Mark], plane: &Plane, contrast: &[f32], flow: [isize; 2]) -> f32 {
    let (mut total, mut seen) = (0.0f32, 0usize);
    for mark in marks {
        let shift = flow.map(|f| (f as f32 * mark.nearness).round() as isize);
        let at = [mark.at[0] + shift[0], mark.at[1] + shift[1]];
        let Some([x, y]) = corner(plane, at) else {
            continue;
        };
        let mut product = 0.0f32;
        for (row, template) in mark.template.chunks_exact(SIDE).enumerate() {
            let start = (y + row) * plane.width + x;
            let line = &plane.grey[start..start + SIDE];
            product += line.iter().zip(template).map(|(a, b)| a * b).sum::<f32>();
        }
        let spread = contrast[at[1] as usize * plane.width + at[0] as usize];
        total += product / spread.max(2.0 * SIDE as f32);
        seen += 1;
    }
    let enough = marks.len().div_ceil(3).max(4);
    total / seen.max(enough) as f32
}

/// Root of the summed squared deviation from the mean, of the square around every pixel; zero near the border.
fn contrasts(plane: &Plane) -> Vec<f32> {
    let mut out = vec![0.0; plane.grey.len()];
    let (width, height) = (plane.width, plane.height);
    if width < SIDE || height < SIDE {
        return out;
    }
    // Sums down the columns slide along the rows.
    for y in RADIUS..height - RADIUS {
        let column = |x: usize| {
            let cells = (y - RADIUS..=y + RADIUS).map(|v| plane.grey[v * width + x]);
            cells.fold((0.0f64, 0.0f64), |(s, q), g| {
                (s + f64::from(g), q + f64::from(g) * f64::from(g))
            })
        };
        let columns: Vec<(f64, f64)> = (0..width).map(column).collect();
        let (mut sum, mut squares) = columns[..SIDE]
            .iter()
            .fold((0.0, 0.0), |a, c| (a.0 + c.0, a.1 + c.1));
        for x in RADIUS..width - RADIUS {
            let count = (SIDE * SIDE) as f64;
            out[y * width + x] = (squares - sum * sum / count).max(0.0).sqrt() as f32;
            if x + RADIUS + 1 < width {
                sum += columns[x + RADIUS + 1].0 - columns[x - RADIUS].0;
                squares += columns[x + RADIUS + 1].1 - columns[x - RADIUS].1;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn textured(dx: isize, dy: isize, period: isize) -> Plane {
        let value = |x: isize, y: isize| {
            let (x, y) = (x.rem_euclid(period) as u64, y.rem_euclid(period) as u64);
            let mut h =
                (x * 0x9E37_79B9 + y * 0x85EB_CA6B + 17).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
            h ^= h >> 29;
            (h.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as f32
        };
        let grey = (0..80 * 60)
            .map(|i| value((i % 80) as isize - dx, (i / 80) as isize - dy))
            .collect();
        Plane {
            width: 80,
            height: 60,
            grey,
        }
    }

    fn marks(plane: &Plane) -> Vec<Mark> {
        let at = (0..40).map(|i| [12.0 + 8.0 * (i % 8) as f32, 10.0 + 9.0 * (i / 8) as f32]);
        at.filter_map(|at| Mark::new(plane, at, 1.0)).collect()
    }

    #[test]
    fn finds_large_displacements() {
        let before = textured(0, 0, 1000);
        for (dx, dy) in [(0, 0), (13, -9), (-15, 15)] {
            let found = candidates(&marks(&before), &textured(dx, dy, 1000), 16);
            assert_eq!(found.len(), 1);
            assert_eq!(found[0].flow, [dx as f32, dy as f32]);
            assert!(found[0].likeness > 0.9);
        }
    }

    #[test]
    fn a_repeating_scene_gives_several_candidates() {
        let found = candidates(&marks(&textured(0, 0, 11)), &textured(3, 0, 11), 16);
        assert!(found.len() >= 4, "{found:?}");
        assert!(
            found.iter().any(|c| c.flow == [3.0, 0.0])
                && found.iter().any(|c| c.flow == [-8.0, 0.0])
        );
    }
}
