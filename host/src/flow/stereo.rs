//! Which pixel of every camera shows the same point, without any idea of its depth.
//!
//! One inverse depth predicts a point's place in all cameras at once. So every corner of the reference image is tried at all inverse
//! depths, in steps of half a pixel of a coarse level, and the likenesses in all cameras are averaged: what looks
//! right to one camera by chance looks wrong to the others. Every depth that is nearly as good as the best is refined by Lucas and
//! Kanade at full resolution; if two survive that are alike, the texture repeats and the corner is dropped as ambiguous.

use super::geometry::{Geometry, Ray};
use super::likeness::{Field, OUTSIDE, Probe};
use super::lucas_kanade::{Large, Small};
use super::pyramid::Pyramid;
use super::{Reason, Settings};

/// Disparities below zero that are tried, px: principal points are not known better.
const BEYOND_INFINITY_PX: f64 = 3.0;
/// The largest disparity to the farthest camera, in image widths: nearer points are outside some camera anyway.
const LARGEST_DISPARITY: f64 = 0.5;
/// The least disparity of a point that is of use, px: depth is not known beyond.
const LEAST_DISPARITY_PX: f64 = 1.0;
/// Depths whose mean likeness at the coarse level is this close to the best are tried at full resolution. Large,
/// since a coarse pixel may hit one repetition squarely and the other by half.
const RIVAL: f32 = 0.25;
/// As [`RIVAL`], for depths at which some camera would not see the point: they cannot be tried, only feared.
const HIDDEN_RIVAL: f32 = 0.12;
/// The same, of likenesses interpolated between coarse pixels: what is left is noise and fine detail.
const CLOSE_RIVAL: f32 = 0.15;
/// A corner with more rivals than this is ambiguous without trying them.
const MOST_RIVALS: usize = 5;
/// Steps of the iteration at each level.
const STEPS: usize = 12;

/// A point matched in all cameras at one instant.
#[derive(Clone, Debug)]
pub struct Match {
    /// Per camera, px as seen.
    pub pixels: Vec<[f64; 2]>,
    /// The same, normalised.
    pub views: Vec<[f64; 2]>,
    /// The point that fits them.
    pub ray: Ray,
    /// Per camera: what is followed from there.
    pub templates: Vec<Box<Large>>,
}

/// All cameras' images at one instant, and the rig.
#[derive(Debug)]
pub struct Stereo<'a> {
    /// The rig.
    pub geometry: &'a Geometry,
    /// Thresholds.
    pub settings: &'a Settings,
    /// Per camera.
    pub pyramids: &'a [Pyramid],
    /// Per camera: the level that is searched.
    pub fields: &'a [Field],
    /// Which level that is.
    pub level: usize,
}

/// A depth that explains the coarse images.
#[derive(Clone, Debug)]
struct Candidate {
    inverse_depth: f64,
    /// Mean likeness at the coarse level, between its pixels.
    score: f32,
    /// Per camera: where to look, px.
    starts: Vec<[f64; 2]>,
}

impl Candidate {
    /// Whether the search would begin at nearly the same places.
    fn leads_to(&self, starts: &[[f64; 2]]) -> bool {
        (self.starts.iter().zip(starts))
            .all(|(a, b)| (a[0] - b[0]).abs() < 1.0 && (a[1] - b[1]).abs() < 1.0)
    }
}

/// A corner of the reference image, ready to be looked for in the others.
struct Corner {
    at: [f64; 2],
    /// From level 1 to the one below that which is searched.
    coarse: Vec<Small>,
    template: Box<Large>,
}

/// A candidate at full resolution.
struct Refined {
    matched: Match,
    likeness: f32,
}

impl Stereo<'_> {
    /// The views of what the reference camera sees at `corner`.
    ///
    /// # Errors
    /// Why there are none that can be trusted.
    pub fn find(&self, corner: [f64; 2]) -> Result<Match, Reason> {
        let candidates = self.candidates(corner)?;
        let corner = self.corner(corner).ok_or(Reason::Flat)?;
        let mut best: Option<(Refined, f32)> = None;
        let mut second = f32::NEG_INFINITY;
        let mut failed: Option<(f32, Reason)> = None;
        for candidate in candidates {
            match self.refine(&corner, &candidate) {
                Err(reason) => {
                    if failed.is_none_or(|(score, _)| candidate.score > score) {
                        failed = Some((candidate.score, reason));
                    }
                }
                Ok(refined) => match &mut best {
                    Some((found, score)) => {
                        // Two candidates may lead to the same place.
                        let apart = (found.matched.ray.inverse_depth
                            - refined.matched.ray.inverse_depth)
                            * self.px_per_inverse_mm();
                        if apart.abs() < 1.0 {
                            continue;
                        }
                        second = second.max(found.likeness.min(refined.likeness));
                        if refined.likeness > found.likeness {
                            (*found, *score) = (refined, candidate.score);
                        }
                    }
                    None => best = Some((refined, candidate.score)),
                },
            }
        }
        match (best, failed) {
            (None, failed) => Err(failed.map_or(Reason::Unlike, |(_, reason)| reason)),
            (Some((found, _)), _) if second > found.likeness - self.settings.rival_likeness => {
                Err(Reason::Ambiguous)
            }
            // A better one that could not be refined: an occlusion, not a match.
            (Some((_, score)), Some((better, reason))) if better > score + 0.05 => Err(reason),
            (Some((found, _)), _) => self.complete(corner, found.matched),
        }
    }

    /// `None` if it cannot be looked for.
    fn corner(&self, at: [f64; 2]) -> Option<Corner> {
        let levels = &self.pyramids[self.geometry.reference].levels;
        let coarse = (1..self.level).map(|level| {
            let scale = (1 << level) as f64;
            Small::new(&levels[level], at.map(|c| (c / scale) as f32)).map(|template| *template)
        });
        Some(Corner {
            at,
            coarse: coarse.collect::<Option<_>>()?,
            template: Large::new(&levels[0], at.map(|c| c as f32))?,
        })
    }

    /// Takes the templates that will be followed.
    fn complete(&self, corner: Corner, mut matched: Match) -> Result<Match, Reason> {
        let mut own = Some(corner.template);
        for (k, pixel) in matched.pixels.iter().enumerate() {
            let template = if k == self.geometry.reference {
                own.take()
            } else {
                Large::new(&self.pyramids[k].levels[0], pixel.map(|p| p as f32))
            };
            matched.templates.push(template.ok_or(Reason::Flat)?);
        }
        Ok(matched)
    }

    /// Disparity to the farthest camera per unit of inverse depth.
    fn px_per_inverse_mm(&self) -> f64 {
        self.geometry.focal_px * self.geometry.reach_mm
    }

    /// All inverse depths that explain the coarse images nearly as well as the best one.
    fn candidates(&self, corner: [f64; 2]) -> Result<Vec<Candidate>, Reason> {
        let scale = (1 << self.level) as f64;
        let reference = self.geometry.reference;
        let coarse = corner.map(|c| (c / scale).round());
        let probe = self.fields[reference]
            .probe(coarse[0] as i64, coarse[1] as i64)
            .ok_or(Reason::Unlike)?;
        let at = self
            .geometry
            .normalise(reference, coarse.map(|c| c * scale));
        let step = 0.5 * scale / self.px_per_inverse_mm();
        let first = -BEYOND_INFINITY_PX / self.px_per_inverse_mm();
        let width =
            f64::from(self.geometry.rig.image_size_px[0].max(self.geometry.rig.image_size_px[1]));
        let last = LARGEST_DISPARITY * width / self.px_per_inverse_mm();
        let count = ((last - first) / step).ceil() as usize + 1;

        let cameras = self.geometry.cameras();
        let mut total = vec![0.0_f32; count];
        let mut seen = vec![0_u8; count];
        let mut strips = Vec::with_capacity(cameras);
        for k in (0..cameras).filter(|k| *k != reference) {
            let place = |h: usize| {
                let pixel = self.geometry.transfer(k, at, first + step * h as f64);
                pixel.map(|p| (p / scale) as f32)
            };
            let strip = Strip::around(line(count, place), &self.fields[k], &probe);
            strip.add_to(&mut total, &mut seen);
            strips.push((k, strip));
        }
        let others = self.geometry.cameras() as u8 - 1;
        let score: Vec<f32> = (total.iter().zip(&seen))
            .map(|(sum, n)| {
                if *n == 0 {
                    OUTSIDE
                } else {
                    sum / f32::from(*n)
                }
            })
            .collect();
        let complete = |h: &usize| seen[*h] == others;
        let best = (0..count)
            .filter(complete)
            .max_by(|a, b| score[*a].total_cmp(&score[*b]))
            .ok_or(Reason::OutOfView)?;
        if score[best] < self.settings.least_likeness - 0.15 {
            return Err(Reason::Unlike);
        }
        let mut found = Vec::new();
        for peak in peaks(&score, score[best] - RIVAL) {
            if complete(&peak) {
                let inverse_depth = first + step * (peak as f64 + vertex(&score, peak));
                let mut starts = vec![corner; cameras];
                let mut likeness = 0.0;
                for (k, strip) in &strips {
                    let on_line = self.geometry.transfer(*k, at, inverse_depth);
                    let (start, there) =
                        strip.start(peak, on_line, scale, self.settings.view_residual_px);
                    // From the probe's whole pixel to the corner itself.
                    starts[*k] = [0, 1].map(|i| start[i] + corner[i] - scale * coarse[i]);
                    likeness += there / f32::from(others);
                }
                // Half steps of a rounded line may show one place as two peaks.
                if !found.iter().any(|c: &Candidate| c.leads_to(&starts)) {
                    found.push(Candidate {
                        inverse_depth,
                        score: likeness,
                        starts,
                    });
                }
            } else if score[peak] > score[best] - HIDDEN_RIVAL {
                return Err(Reason::Ambiguous);
            }
        }
        let likest = found.iter().map(|c| c.score).fold(OUTSIDE, f32::max);
        found.retain(|c| c.score > likest - CLOSE_RIVAL);
        if found.len() > MOST_RIVALS {
            return Err(Reason::Ambiguous);
        }
        Ok(found)
    }

    /// The match at full resolution, checked by every test there is.
    fn refine(&self, corner: &Corner, candidate: &Candidate) -> Result<Refined, Reason> {
        let geometry = self.geometry;
        let reference = geometry.reference;
        let at = geometry.normalise(reference, corner.at);
        let mut pixels = vec![corner.at; geometry.cameras()];
        let mut views = vec![at; geometry.cameras()];
        let mut likeness = 0.0;
        for k in (0..geometry.cameras()).filter(|k| *k != reference) {
            let warp = geometry.stretch(k, corner.at, candidate.inverse_depth);
            let mut place = candidate.starts[k].map(|p| p as f32);
            let levels = &self.pyramids[k].levels;
            for (level, template) in (1..self.level).zip(&corner.coarse).rev() {
                let scale = (1 << level) as f32;
                let start = place.map(|p| p / scale);
                let found = template.find(&levels[level], start, warp, STEPS);
                place = found.ok_or(Reason::Unlike)?.at.map(|p| p * scale);
            }
            let found = corner.template.find(&levels[0], place, warp, STEPS);
            let found = found.ok_or(Reason::Unlike)?;
            if found.likeness < self.settings.least_likeness {
                return Err(Reason::Unlike);
            }
            if !(f64::from(found.miss) <= self.settings.return_px) {
                return Err(Reason::NoReturn);
            }
            likeness += found.likeness / (geometry.cameras() - 1) as f32;
            pixels[k] = found.at.map(f64::from);
            views[k] = geometry.normalise(k, pixels[k]);
        }
        check(geometry, self.settings, &views)?;
        let ray = geometry.fit(&views);
        if ray.inverse_depth * self.px_per_inverse_mm() < LEAST_DISPARITY_PX {
            return Err(Reason::TooFar);
        }
        let templates = Vec::with_capacity(geometry.cameras());
        Ok(Refined {
            matched: Match {
                pixels,
                views,
                ray,
                templates,
            },
            likeness,
        })
    }
}

/// Constraint (3) and the vertical test on one point's views.
///
/// # Errors
/// Which of the two failed.
pub fn check(geometry: &Geometry, settings: &Settings, views: &[[f64; 2]]) -> Result<(), Reason> {
    if geometry.vertical_offset_px(views) > settings.view_residual_px {
        return Err(Reason::Vertical);
    }
    if geometry.disparity_disagreement_px(views) > settings.view_residual_px {
        return Err(Reason::Disparity);
    }
    Ok(())
}

/// `count` places along a line that is nearly straight, each to the nearest pixel. Only every so many are asked for: a lens bends the line by
/// far less than a pixel between them.
fn line(count: usize, place: impl Fn(usize) -> [f32; 2]) -> Vec<[i32; 2]> {
    const APART: usize = 16;
    // Positive before it is truncated, which rounds faster than rounding does.
    const FAR: f32 = 16384.0;
    let mut line = Vec::with_capacity(count + APART);
    let mut from = place(0);
    for start in (0..count).step_by(APART) {
        let to = place(start + APART);
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]].map(|d| d / APART as f32);
        let round = |at: f32| (at.clamp(-FAR, FAR) + (FAR + 0.5)) as i32 - FAR as i32;
        for i in 0..APART {
            let i = i as f32;
            line.push([round(from[0] + i * dx), round(from[1] + i * dy)]);
        }
        from = to;
    }
    line.truncate(count);
    line
}

/// Likenesses along a line of places and one pixel to either side of it.
struct Strip {
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
    fn around(line: Vec<[i32; 2]>, field: &Field, probe: &Probe) -> Self {
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
    fn best(&self, at: [i32; 2]) -> f32 {
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
    fn add_to(&self, total: &mut [f32], seen: &mut [u8]) {
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

    /// Where to look at full resolution, px, and the likeness there: the best place near the line's `peak`, between the pixels. Across the
    /// line, it is where the images put it, but no more than `tolerance_px` off the line itself.
    fn start(
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
fn peaks(score: &[f32], least: f32) -> Vec<usize> {
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
fn vertex(score: &[f32], peak: usize) -> f64 {
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
