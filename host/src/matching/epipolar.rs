//! Likenesses along an epipolar line at the coarse level: where to look more closely.

use super::zncc::{Field, OUTSIDE, Probe};

/// `count` places along a line that is nearly straight, each to the nearest pixel. Only every so
/// many are asked for: a lens bends the line by far less than a pixel between them.
pub(super) fn line(count: usize, place: impl Fn(usize) -> [f32; 2]) -> Vec<[i32; 2]> {
    const APART: usize = 16;
    const FAR: f32 = 8192.0;
    // In parts of a pixel that are small enough, and whole numbers: these are the fastest to round.
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

/// Likenesses along a line of places and one pixel to either side of it.
pub(super) struct Strip {
    line: Vec<[i32; 2]>,
    /// Whether neighbours across the line are above and below.
    flat: bool,
    left: i32,
    top: i32,
    width: usize,
    /// Row by row; [`OUTSIDE`] where nothing was asked for.
    likeness: Vec<f32>,
}

impl Strip {
    pub(super) fn around(line: Vec<[i32; 2]>, field: &Field, probe: &Probe) -> Self {
        let [columns, rows] = field.size().map(|s| s as i32);
        // Places outside the image are known to be so without looking.
        let inside = line
            .iter()
            .filter(|[x, y]| (0..columns).contains(x) && (0..rows).contains(y));
        // Along the line, what lies in one row: y, first and last x.
        let mut runs: Vec<[i32; 3]> = Vec::with_capacity(4);
        for [x, y] in inside {
            match runs.last_mut() {
                Some([row, first, last]) if row == y => {
                    (*first, *last) = ((*first).min(*x), (*last).max(*x));
                }
                _ => runs.push([*y, *x, *x]),
            }
        }
        let least = |i: usize| runs.iter().map(|run| run[i]).min().unwrap_or(0);
        let most = |i: usize| runs.iter().map(|run| run[i]).max().unwrap_or(-1);
        let flat = most(2) - least(1) >= most(0) - least(0);
        let (grow_x, grow_y) = if flat { (0, 1) } else { (1, 0) };
        let (left, top) = (least(1) - grow_x, least(0) - grow_y);
        let width = (most(2) + grow_x - left + 1) as usize;
        let height = (most(0) + grow_y - top + 1) as usize;
        let mut spans = vec![[i32::MAX, i32::MIN]; height];
        for [y, first, last] in runs {
            for row in y - grow_y..=y + grow_y {
                let span = &mut spans[(row - top) as usize];
                *span = [span[0].min(first - grow_x), span[1].max(last + grow_x)];
            }
        }
        let mut likeness = vec![OUTSIDE; width * height];
        for (row, [first, last]) in spans.into_iter().enumerate() {
            if first <= last {
                let start = row * width + (first - left) as usize;
                let out = &mut likeness[start..][..(last - first + 1) as usize];
                let y = i64::from(top) + row as i64;
                field.compare(probe, i64::from(first), y, out);
            }
        }
        Self {
            line,
            flat,
            left,
            top,
            width,
            likeness,
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
        let place = self.likeness.get(row * self.width + column);
        place.copied().unwrap_or(OUTSIDE)
    }

    /// One pixel along the line and one across it.
    fn units(&self) -> [[i32; 2]; 2] {
        if self.flat {
            [[1, 0], [0, 1]]
        } else {
            [[0, 1], [1, 0]]
        }
    }

    /// The best of a place and its neighbours across the line. [`OUTSIDE`] if the place itself is.
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

    /// Adds to every place's sum what is seen there, and counts it.
    pub(super) fn add_to(&self, total: &mut [f32], seen: &mut [u8]) {
        let mut last = [i32::MIN; 2];
        let mut best = OUTSIDE;
        for ((at, total), seen) in self.line.iter().zip(total).zip(seen) {
            // Steps are shorter than pixels.
            if *at != last {
                (last, best) = (*at, self.best(*at));
            }
            if best > OUTSIDE {
                *total += best;
                *seen += 1;
            }
        }
    }

    /// Where to look at full resolution, px, and the likeness there: the best place near the line's
    /// `peak`, between the pixels. Across the line, it is where the images put it, but no more than
    /// `tolerance_px` off the line itself.
    pub(super) fn start(
        &self,
        peak: usize,
        on_line: [f64; 2],
        scale: f64,
        tolerance_px: f64,
    ) -> ([f64; 2], f32) {
        let [along, across] = self.units();
        let mut at = self.line[peak];
        for unit in [across, along] {
            let [before, after] = [-1, 1].map(|by| [at[0] + by * unit[0], at[1] + by * unit[1]]);
            for near in [before, after] {
                if self.at(near) > self.at(at) {
                    at = near;
                }
            }
        }
        let here = self.at(at);
        let [along, across] = [along, across].map(|unit| {
            let [before, after] =
                [-1, 1].map(|by| self.at([at[0] + by * unit[0], at[1] + by * unit[1]]));
            let off = vertex(&[before, here, after], 1);
            let rise = 0.25 * (after - before) * off as f32;
            (off, if rise.is_finite() { rise } else { 0.0 })
        });
        let axis = usize::from(!self.flat);
        let mut start = on_line;
        start[axis] = scale * (f64::from(at[axis]) + along.0);
        let off = scale * (f64::from(at[1 - axis]) + across.0) - on_line[1 - axis];
        start[1 - axis] += off.clamp(-tolerance_px, tolerance_px);
        (start, here + along.1 + across.1)
    }
}

/// Indices of the local maxima above `least`. Of a plateau, the first.
pub(super) fn peaks(score: &[f32], least: f32) -> Vec<usize> {
    (0..score.len())
        .filter(|&i| {
            let before = i.checked_sub(1).map_or(OUTSIDE, |b| score[b]);
            let after = score.get(i + 1).copied().unwrap_or(OUTSIDE);
            // Half steps of a rounded position may repeat a value.
            score[i] > least && score[i] > before && score[i] >= after
        })
        .collect()
}

/// Where the parabola through a peak and its neighbours has its vertex, in steps from the peak.
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
