//! Correlation along an epipolar line at a coarse level, for the stereo search.

use super::zncc::{OUTSIDE, ZnccPatch, ZnccPlane};

/// Rounds `count` places along a nearly straight line to whole pixels. Only every 16th place is
/// computed exactly and the others interpolated: a lens bends the line by far less than a pixel
/// between them.
pub(super) fn line(count: usize, place: impl Fn(usize) -> [f32; 2]) -> Vec<[i32; 2]> {
    const APART: usize = 16;
    const FAR: f32 = 8192.0;
    // Fixed point with 16 fractional bits, because integers round fastest.
    const PART_BITS: u32 = 16;
    let parts = |at: [f32; 2]| at.map(|c| (c.clamp(-FAR, FAR) * (1 << PART_BITS) as f32) as i32);
    let mut line = Vec::with_capacity(count + APART);
    let mut from = parts(place(0));
    for start in (0..count).step_by(APART) {
        let to = parts(place(start + APART));
        let step = [0, 1].map(|axis| (to[axis] - from[axis]) / APART as i32);
        let at = |i: i32, axis: usize| {
            (from[axis] + i * step[axis] + (1 << (PART_BITS - 1))) >> PART_BITS
        };
        line.extend((0..APART as i32).map(|i| [at(i, 0), at(i, 1)]));
        from = to;
    }
    line.truncate(count);
    line
}

/// Correlations along a line of places and one pixel to either side of it.
pub(super) struct EpipolarScores {
    line: Vec<[i32; 2]>,
    /// True if the line is nearer to horizontal: neighbours across it are above and below.
    flat: bool,
    left: i32,
    top: i32,
    width: usize,
    /// Correlations, row by row; [`OUTSIDE`] away from the line.
    zncc: Vec<f32>,
}

impl EpipolarScores {
    /// Correlates `patch` along `line`.
    pub(super) fn around(line: Vec<[i32; 2]>, plane: &ZnccPlane, patch: &ZnccPatch) -> Self {
        let [columns, rows] = plane.size().map(|s| s as i32);
        // Places outside the image need no correlation.
        let inside = line
            .iter()
            .filter(|[x, y]| (0..columns).contains(x) && (0..rows).contains(y));
        // Runs of places in one row: y, first and last x.
        let mut runs: Vec<[i32; 3]> = Vec::with_capacity(4);
        for [x, y] in inside {
            match runs.last_mut() {
                Some([row, first, last]) if row == y => {
                    (*first, *last) = ((*first).min(*x), (*last).max(*x));
                }
                _ => runs.push([*y, *x, *x]),
            }
        }
        // Bounding box of the runs, grown by one pixel across the line.
        let least = |i: usize| runs.iter().map(|run| run[i]).min().unwrap_or(0);
        let most = |i: usize| runs.iter().map(|run| run[i]).max().unwrap_or(-1);
        let flat = most(2) - least(1) >= most(0) - least(0);
        let (grow_x, grow_y) = if flat { (0, 1) } else { (1, 0) };
        let (left, top) = (least(1) - grow_x, least(0) - grow_y);
        let width = (most(2) + grow_x - left + 1) as usize;
        let height = (most(0) + grow_y - top + 1) as usize;
        // Span of every row of the box, which is correlated in one go.
        let mut spans = vec![[i32::MAX, i32::MIN]; height];
        for [y, first, last] in runs {
            for row in y - grow_y..=y + grow_y {
                let span = &mut spans[(row - top) as usize];
                *span = [span[0].min(first - grow_x), span[1].max(last + grow_x)];
            }
        }
        let mut zncc = vec![OUTSIDE; width * height];
        for (row, [first, last]) in spans.into_iter().enumerate() {
            if first <= last {
                let start = row * width + (first - left) as usize;
                let out = &mut zncc[start..][..(last - first + 1) as usize];
                let y = i64::from(top) + row as i64;
                plane.correlate(patch, i64::from(first), y, out);
            }
        }
        Self {
            line,
            flat,
            left,
            top,
            width,
            zncc,
        }
    }

    #[inline]
    fn at(&self, [x, y]: [i32; 2]) -> f32 {
        let (column, row) = (
            (x - self.left) as u32 as usize,
            (y - self.top) as u32 as usize,
        );
        if column >= self.width {
            return OUTSIDE;
        }
        let score = self.zncc.get(row * self.width + column);
        score.copied().unwrap_or(OUTSIDE)
    }

    /// Returns the unit vectors along the line and across it.
    fn units(&self) -> [[i32; 2]; 2] {
        if self.flat {
            [[1, 0], [0, 1]]
        } else {
            [[0, 1], [1, 0]]
        }
    }

    /// Returns the best score of a place and its neighbours across the line; [`OUTSIDE`] if the
    /// place itself is outside.
    #[inline]
    pub(super) fn best(&self, at: [i32; 2]) -> f32 {
        let [_, unit] = self.units();
        let here = self.at(at);
        let before = self.at([at[0] - unit[0], at[1] - unit[1]]);
        let after = self.at([at[0] + unit[0], at[1] + unit[1]]);
        if here > OUTSIDE {
            here.max(before).max(after)
        } else {
            OUTSIDE
        }
    }

    /// Adds the score of every place to its total, and counts the cameras that see it.
    pub(super) fn add_to(&self, total: &mut [f32], seen: &mut [u8]) {
        let mut last = [i32::MIN; 2];
        let mut best = OUTSIDE;
        for ((at, total), seen) in self.line.iter().zip(total).zip(seen) {
            // Steps are shorter than pixels, so consecutive places may be the same.
            if *at != last {
                (last, best) = (*at, self.best(*at));
            }
            if best > OUTSIDE {
                *total += best;
                *seen += 1;
            }
        }
    }

    /// Finds the start of the search at full resolution, px, and its score: the best place near
    /// the line's `peak`, with sub-pixel accuracy. Across the line, it is where the images
    /// correlate best, but at most `tolerance_px` off the line.
    pub(super) fn start(
        &self,
        peak: usize,
        on_line: [f64; 2],
        scale: f64,
        tolerance_px: f64,
    ) -> ([f64; 2], f32) {
        let [along, across] = self.units();
        // Climb to the best neighbour, first across, then along the line.
        let mut at = self.line[peak];
        for unit in [across, along] {
            let [before, after] = [-1, 1].map(|by| [at[0] + by * unit[0], at[1] + by * unit[1]]);
            for near in [before, after] {
                if self.at(near) > self.at(at) {
                    at = near;
                }
            }
        }
        // Sub-pixel position: vertex of a parabola along and across the line.
        let here = self.at(at);
        let [along, across] = [along, across].map(|unit| {
            let [before, after] =
                [-1, 1].map(|by| self.at([at[0] + by * unit[0], at[1] + by * unit[1]]));
            let off = vertex(&[before, here, after], 1);
            let rise = 0.25 * (after - before) * off as f32;
            (off, if rise.is_finite() { rise } else { 0.0 })
        });
        // Across the line, stay within the tolerance.
        let axis = usize::from(!self.flat);
        let mut start = on_line;
        start[axis] = scale * (f64::from(at[axis]) + along.0);
        let off = scale * (f64::from(at[1 - axis]) + across.0) - on_line[1 - axis];
        start[1 - axis] += off.clamp(-tolerance_px, tolerance_px);
        (start, here + along.1 + across.1)
    }
}

/// Returns the indices of the local maxima above `least`; of a plateau, the first.
pub(super) fn peaks(score: &[f32], least: f32) -> Vec<usize> {
    (0..score.len())
        .filter(|&i| {
            let before = i.checked_sub(1).map_or(OUTSIDE, |b| score[b]);
            let after = score.get(i + 1).copied().unwrap_or(OUTSIDE);
            // Half steps of a rounded position may repeat a value: plateaus are common.
            score[i] > least && score[i] > before && score[i] >= after
        })
        .collect()
}

/// Returns the vertex of the parabola through a peak and its neighbours, in steps from the peak.
pub(super) fn vertex(score: &[f32], peak: usize) -> f64 {
    let before = peak.checked_sub(1).map_or(OUTSIDE, |b| score[b]);
    let after = score.get(peak + 1).copied().unwrap_or(OUTSIDE);
    let bend = before - 2.0 * score[peak] + after;
    let offset = 0.5 * (before - after) / bend;
    if offset.is_finite() {
        f64::from(offset.clamp(-0.5, 0.5))
    } else {
        0.0
    }
}
