//! From captures to matched, tracked points that agree on one displacement.
//!
//! ```text
//! reference capture: filter, pyramids -> corners -> depth search in all cameras -> sub-pixel matches -> rig test
//! every capture:     filter, pyramids -> rough displacement -> sub-pixel tracks, forwards and backwards -> rig test -> consensus
//! ```
//!
//! The reference is a keyframe as long as [`Flow::set_reference`] is not called again. Nothing is known about the scene: depth is found per
//! point, the displacement may be large, lighting may change, and a scene that repeats so that several answers would do is refused.
//!
//! A point is the same point in all cameras and at both instants, or it is dropped; [`Rejected`] counts why.

mod consensus;
mod corner;
mod motion;
mod patch;
mod plane;
mod stereo;

use crate::images::Capture;
use motion::{Candidate, Mark};
use patch::{Patch, Scratch};
use plane::Pyramid;
use shared::rig::Rig;
use shared::sums::View;
use shared::sums::centred::Geometry;
use stereo::{Match, Search};

/// One scene point, followed in every camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Per camera, in the rig's order: pixel at the reference instant, pixel now (as seen, principal point and distortion not removed).
    pub pixels: Vec<[[f64; 2]; 2]>,
}

/// How points are chosen and compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Corners looked for in the reference image.
    pub corners: usize,
    /// Least distance between two corners, px.
    pub distance_px: usize,
    /// Half side of the finest square that is followed, px: 10 makes 21 x 21.
    pub radius_px: usize,
    /// Levels of the image pyramids.
    pub levels: usize,
    /// Farthest rough displacement looked for, px either way.
    pub reach_px: usize,
    /// Correlation that a match or track must reach.
    pub min_likeness: f32,
    /// How far a track followed back may miss its origin, px.
    pub max_return_px: f32,
    /// How far the views of one point may miss one scene point, px; 3 % of its largest disparity are added.
    pub max_rig_px: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            corners: 300,
            distance_px: 9,
            radius_px: 10,
            levels: 3,
            reach_px: 64,
            min_likeness: 0.8,
            max_return_px: 0.3,
            max_rig_px: 0.5,
        }
    }
}

/// Why a capture gives no displacement.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A capture does not fit the rig.
    #[error("the capture does not fit the rig: {0}")]
    Capture(String),
    /// The rig is not usable.
    #[error("the rig has fewer than two cameras, or all in one place")]
    WrongRig,
    /// There is no reference capture.
    #[error("there is no reference yet")]
    NoReference,
    /// The reference image shows nothing to follow.
    #[error("too little texture: {found} corners, {fewest} are needed")]
    Texture {
        /// Corners found.
        found: usize,
        /// Corners needed.
        fewest: usize,
    },
    /// Too few corners were found again in the other cameras.
    #[error("too few points are seen by all cameras: {matched} of {corners} corners")]
    Unmatched {
        /// Corners that were matched.
        matched: usize,
        /// Corners looked for.
        corners: usize,
    },
    /// The scene repeats: depths cannot be told apart.
    #[error("ambiguous depth: {ambiguous} of {corners} corners fit at several depths (a repeating pattern)")]
    AmbiguousDepth {
        /// Corners that fit several depths.
        ambiguous: usize,
        /// Corners looked for.
        corners: usize,
    },
    /// The scene repeats: several displacements explain it.
    #[error("ambiguous motion: displacements {px:.0} px apart fit equally well (a repeating pattern)")]
    AmbiguousMotion {
        /// How far the two best are apart, px.
        px: f32,
    },
    /// The target is not seen again.
    #[error("the target was not found again")]
    Lost,
    /// Too few points could be followed.
    #[error("too few points could be followed: {points}, {fewest} are needed")]
    TooFewPoints {
        /// Points followed.
        points: usize,
        /// Points needed.
        fewest: usize,
    },
    /// The points do not move as one.
    #[error("the points do not move as one: {agree} of {points} agree")]
    NoAgreement {
        /// Points that agree.
        agree: usize,
        /// Points followed.
        points: usize,
    },
}

/// Points that were dropped, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejected {
    /// No depth makes the views alike.
    pub unmatched: usize,
    /// Several depths do.
    pub ambiguous: usize,
    /// The views do not belong to one scene point: vertical offset or disparities (the paper's eqs. 2 and 3).
    pub rig: usize,
    /// Not found again in some camera, or unlike.
    pub lost: usize,
    /// Followed back, it did not return.
    pub no_return: usize,
    /// Moves unlike the majority.
    pub disagree: usize,
}

impl Rejected {
    /// All of them.
    pub fn total(&self) -> usize {
        self.unmatched + self.ambiguous + self.rig + self.lost + self.no_return + self.disagree
    }
}

/// What one capture shows of the target.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// The points that agree.
    pub tracks: Vec<Track>,
    /// The points that were dropped since the corners were chosen.
    pub rejected: Rejected,
    /// The displacement that the points agreed on, mm (f64 midpoint estimate over `tracks`).
    pub displacement_mm: [f64; 3],
}

/// A corner that every camera sees.
#[derive(Clone, Debug)]
struct Point {
    /// Where each camera sees it, px.
    at: Vec<[f32; 2]>,
    /// 1/mm.
    inverse_depth: f64,
    /// The home camera's squares, finest level first.
    home: Vec<Patch>,
    /// The finest square in every camera.
    patches: Vec<Patch>,
}

#[derive(Clone, Debug)]
struct Reference {
    views: Vec<Pyramid>,
    points: Vec<Point>,
    rejected: Rejected,
    corners: usize,
    /// Of the points' inverse depths, 1/mm.
    median_depth: f64,
}

/// Measures a target's flow against a reference capture.
#[derive(Clone, Debug)]
pub struct Flow {
    rig: Rig,
    geometry: Geometry,
    settings: Settings,
    search: Search,
    home: usize,
    reference: Option<Reference>,
    scratch: Scratch,
}

/// Fewest corners that are worth matching, and fewest points worth following.
const FEWEST: usize = 8;

/// A second displacement whose points are this much less alike is a different answer that fits as well.
const AMBIGUOUS_MARGIN: f32 = 0.04;

impl Flow {
    /// For a rig of 2 to 8 cameras.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] for any other.
    pub fn new(rig: &Rig, settings: Settings) -> Result<Self, Refusal> {
        let geometry = Geometry::new(rig).map_err(|_| Refusal::WrongRig)?;
        let home = most_central(rig);
        Ok(Self {
            rig: rig.clone(),
            geometry,
            settings,
            search: Search::new(rig, home),
            home,
            reference: None,
            scratch: Scratch::default(),
        })
    }

    /// Takes a capture as the reference from now on. After a refusal there is none.
    ///
    /// # Errors
    /// When too few points are seen by all cameras, or their depth is ambiguous.
    pub fn set_reference(&mut self, capture: &Capture) -> Result<(), Refusal> {
        self.reference = None;
        let views = self.pyramids(capture)?;
        self.reference = Some(self.match_points(views)?);
        Ok(())
    }

    /// Measures a capture against the reference.
    ///
    /// # Errors
    /// The reason why there is no trustworthy displacement.
    pub fn measure(&mut self, capture: &Capture) -> Result<Measurement, Refusal> {
        let views = self.pyramids(capture)?;
        let reference = self.reference.take().ok_or(Refusal::NoReference)?;
        let outcome = self.follow(&reference, &views);
        self.reference = Some(reference);
        outcome
    }

    fn pyramids(&self, capture: &Capture) -> Result<Vec<Pyramid>, Refusal> {
        let cameras = self.rig.cameras.len();
        if capture.views.len() != cameras {
            return Err(Refusal::Capture(format!("{} views for {cameras} cameras", capture.views.len())));
        }
        let [width, height] = self.rig.image_size_px.map(|side| side as usize);
        for image in &capture.views {
            if (image.width, image.height) != (width, height) || image.grey.len() != width * height {
                return Err(Refusal::Capture(format!("{} x {} px instead of {width} x {height}", image.width, image.height)));
            }
        }
        Ok(capture.views.iter().map(|image| Pyramid::new(image, self.settings.levels)).collect())
    }

    /// Corners of the home image, found in all other cameras.
    fn match_points(&mut self, views: Vec<Pyramid>) -> Result<Reference, Refusal> {
        let Settings { corners, distance_px, radius_px, .. } = self.settings;
        let corners = corner::corners(&views[self.home].levels[0], corners, distance_px, radius_px + 2);
        if corners.len() < FEWEST {
            return Err(Refusal::Texture { found: corners.len(), fewest: FEWEST });
        }
        let mut rejected = Rejected::default();
        let mut points = Vec::new();
        for (index, corner) in corners.iter().enumerate() {
            let pixel = spread_phase(index, *corner);
            match self.search.find(&views, pixel, &mut self.scratch) {
                Match::Unmatched => rejected.unmatched += 1,
                Match::Ambiguous => rejected.ambiguous += 1,
                Match::At(rho) => match self.refine(&views, pixel, rho) {
                    None => rejected.unmatched += 1,
                    Some(point) if self.misfit_px(&point.at) > self.rig_tolerance(point.inverse_depth) => rejected.rig += 1,
                    Some(point) => points.push(point),
                },
            }
        }
        let corners = corners.len();
        // What repeats along x is ambiguous nearly everywhere; the few points that seem clear are then no better.
        if rejected.ambiguous > points.len() {
            return Err(Refusal::AmbiguousDepth { ambiguous: rejected.ambiguous, corners });
        }
        if points.len() < FEWEST {
            return Err(Refusal::Unmatched { matched: points.len(), corners });
        }
        let mut depths: Vec<f64> = points.iter().map(|point| point.inverse_depth).collect();
        let middle = depths.len() / 2;
        let median_depth = *depths.select_nth_unstable_by(middle, f64::total_cmp).1;
        Ok(Reference { views, points, rejected, corners, median_depth })
    }

    /// Sub-pixel positions of a corner in all cameras, from its rough inverse depth.
    fn refine(&mut self, views: &[Pyramid], pixel: [f32; 2], rho: f64) -> Option<Point> {
        let radius = self.settings.radius_px;
        let home: Vec<Patch> = views[self.home]
            .levels
            .iter()
            .enumerate()
            .map_while(|(level, plane)| {
                let centre = pixel.map(|p| p / (1usize << level) as f32);
                Patch::new(plane, centre, radius_at(radius, level), &mut self.scratch)
            })
            .collect();
        let finest = home.first()?.clone();
        let (mut at, mut patches) = (Vec::new(), Vec::new());
        for (k, view) in views.iter().enumerate() {
            if k == self.home {
                at.push(pixel);
                patches.push(finest.clone());
                continue;
            }
            let mut guess = self.search.project(pixel, rho, k);
            for level in (0..home.len().min(2)).rev() {
                let scale = (1usize << level) as f32;
                let found = home[level].find(&view.levels[level], guess.map(|p| p / scale), 3.0, &mut self.scratch)?;
                if found.likeness < self.settings.min_likeness {
                    return None;
                }
                guess = found.at.map(|p| p * scale);
            }
            let patch = Patch::new(&view.levels[0], guess, radius, &mut self.scratch)?;
            let back = patch.find(&views[self.home].levels[0], pixel, 3.0, &mut self.scratch)?;
            if distance(back.at, pixel) > self.settings.max_return_px {
                return None;
            }
            at.push(guess);
            patches.push(patch);
        }
        let (inverse_depth, _) = self.geometry.fit(self.normalised(&at).into_iter());
        (inverse_depth > 0.0).then_some(Point { at, inverse_depth, home, patches })
    }

    fn normalised(&self, at: &[[f32; 2]]) -> Vec<[f64; 2]> {
        self.rig.cameras.iter().zip(at).map(|(camera, at)| camera.normalise(at.map(f64::from))).collect()
    }

    /// How far, at most, a camera's view of a point lies from where the other views put it, px. For three cameras on a line this is
    /// the vertical-offset test together with the paper's constraint (3): both say that the views belong to one scene point.
    fn misfit_px(&self, at: &[[f32; 2]]) -> f64 {
        let seen = self.normalised(at);
        let (inverse_depth, mean) = self.geometry.fit(seen.iter().copied());
        let focal = self.rig.mean_focal_px();
        let should = self.geometry.refit(inverse_depth, mean);
        seen.iter().zip(should).map(|(a, b)| focal * (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
    }

    fn rig_tolerance(&self, inverse_depth: f64) -> f64 {
        let widest = (0..self.rig.cameras.len())
            .flat_map(|a| (0..a).map(move |b| (a, b)))
            .map(|(a, b)| {
                let (a, b) = (self.rig.cameras[a].offset_mm, self.rig.cameras[b].offset_mm);
                (a[0] - b[0]).hypot(a[1] - b[1])
            })
            .fold(0.0, f64::max);
        self.settings.max_rig_px + 0.03 * widest * inverse_depth * self.rig.mean_focal_px()
    }

    /// All points of the reference in the present views.
    fn follow(&mut self, reference: &Reference, views: &[Pyramid]) -> Result<Measurement, Refusal> {
        let start = self.rough_flow(reference, views)?;
        let mut rejected = reference.rejected;
        let mut tracks = Vec::new();
        for point in &reference.points {
            let nearness = (point.inverse_depth / reference.median_depth) as f32;
            match self.follow_point(reference, point, views, start.map(|s| s * nearness)) {
                Followed::At(at) if self.misfit_px(&at) > self.rig_tolerance(point.inverse_depth) => rejected.rig += 1,
                Followed::At(at) => tracks.push(track(point, &at)),
                Followed::Lost => rejected.lost += 1,
                Followed::NoReturn => rejected.no_return += 1,
            }
        }
        let views: Vec<Vec<View>> = tracks.iter().map(|track| self.views(track)).collect();
        let agreement = consensus::agree(&self.rig, &views)?;
        rejected.disagree += tracks.len() - agreement.inliers.len();
        debug_assert!(reference.corners == agreement.inliers.len() + rejected.total());
        let tracks = agreement.inliers.iter().map(|&i| tracks[i].clone()).collect();
        Ok(Measurement { tracks, rejected, displacement_mm: agreement.displacement_mm })
    }

    fn views(&self, track: &Track) -> Vec<View> {
        let cameras = self.rig.cameras.iter();
        cameras.zip(&track.pixels).map(|(camera, [start, end])| View::from_pixels(camera, *start, *end)).collect()
    }

    /// The flow of a point at the median depth in the home camera, px, good to a few pixels.
    fn rough_flow(&mut self, reference: &Reference, views: &[Pyramid]) -> Result<[f32; 2], Refusal> {
        let level = reference.views[self.home].levels.len() - 1;
        let scale = (1usize << level) as f32;
        let before = &reference.views[self.home].levels[level];
        let after = &views[self.home].levels[level];
        let marks: Vec<Mark> = reference
            .points
            .iter()
            .filter_map(|point| {
                let nearness = (point.inverse_depth / reference.median_depth) as f32;
                Mark::new(before, point.at[self.home].map(|p| p / scale), nearness)
            })
            .take(100)
            .collect();
        let reach = (self.settings.reach_px as f32 / scale).ceil() as usize;
        let candidates = motion::candidates(&marks, after, reach);
        let mut tried: Vec<Trial> = candidates
            .iter()
            .map(|candidate| self.attempt(reference, views, candidate, scale))
            .filter(|trial| trial.share > 0.0)
            .collect();
        tried.sort_by(|a, b| b.worth().total_cmp(&a.worth()));
        let best = *tried.first().ok_or(Refusal::Lost)?;
        for other in &tried[1..] {
            let px = distance(other.flow, best.flow);
            let as_good = other.share > 0.7 * best.share && other.likeness > best.likeness - AMBIGUOUS_MARGIN;
            if px > 3.0 && as_good {
                return Err(Refusal::AmbiguousMotion { px });
            }
        }
        Ok(best.flow)
    }

    /// Follows some points at full resolution from a candidate.
    fn attempt(&mut self, reference: &Reference, views: &[Pyramid], candidate: &Candidate, scale: f32) -> Trial {
        let start = candidate.flow.map(|f| f * scale);
        let every = reference.points.len().div_ceil(60);
        let (mut flows, mut likeness, mut asked) = ([Vec::new(), Vec::new()], 0.0, 0);
        for point in reference.points.iter().step_by(every) {
            asked += 1;
            let nearness = (point.inverse_depth / reference.median_depth) as f32;
            let from = point.at[self.home];
            let Some(found) = self.descend(point, &views[self.home], [from[0] + start[0] * nearness, from[1] + start[1] * nearness]) else {
                continue;
            };
            likeness += found.likeness;
            for axis in 0..2 {
                flows[axis].push((found.at[axis] - from[axis]) / nearness);
            }
        }
        let found = flows[0].len();
        if found == 0 {
            return Trial { flow: start, share: 0.0, likeness: 0.0 };
        }
        let flow = flows.map(|mut f| *f.select_nth_unstable_by(found / 2, f32::total_cmp).1);
        Trial { flow, share: found as f32 / asked as f32, likeness: likeness / found as f32 }
    }

    /// Through the home camera's pyramid, coarse to fine.
    fn descend(&mut self, point: &Point, view: &Pyramid, start: [f32; 2]) -> Option<patch::Found> {
        let mut at = start;
        let mut found = None;
        for level in (0..point.home.len().min(view.levels.len())).rev() {
            let scale = (1usize << level) as f32;
            let reach = if level == 0 { 4.0 } else { 5.0 };
            match point.home[level].find(&view.levels[level], at.map(|p| p / scale), reach, &mut self.scratch) {
                Some(here) => {
                    at = here.at.map(|p| p * scale);
                    found = (level == 0).then_some(here);
                }
                // A coarse square may leave the image where the fine one does not.
                None if level > 0 => {}
                None => return None,
            }
        }
        found.filter(|found| found.likeness >= self.settings.min_likeness)
    }

    fn follow_point(&mut self, reference: &Reference, point: &Point, views: &[Pyramid], start: [f32; 2]) -> Followed {
        let from = point.at[self.home];
        let Some(found) = self.descend(point, &views[self.home], [from[0] + start[0], from[1] + start[1]]) else {
            return Followed::Lost;
        };
        let flow = [found.at[0] - from[0], found.at[1] - from[1]];
        let mut at = Vec::with_capacity(views.len());
        for (k, view) in views.iter().enumerate() {
            let here = if k == self.home {
                found.at
            } else {
                let (camera, home) = (&self.rig.cameras[k], &self.rig.cameras[self.home]);
                let guess = std::array::from_fn(|i| {
                    let zoom = camera.focal_px[i] / home.focal_px[i];
                    point.at[k][i] + flow[i] * zoom as f32
                });
                let likely = point.patches[k].find(&view.levels[0], guess, 4.0, &mut self.scratch);
                match likely.filter(|found| found.likeness >= self.settings.min_likeness) {
                    Some(found) => found.at,
                    None => return Followed::Lost,
                }
            };
            let back = Patch::new(&view.levels[0], here, self.settings.radius_px, &mut self.scratch)
                .and_then(|patch| patch.find(&reference.views[k].levels[0], point.at[k], 3.0, &mut self.scratch));
            match back {
                Some(back) if distance(back.at, point.at[k]) <= self.settings.max_return_px => at.push(here),
                _ => return Followed::NoReturn,
            }
        }
        Followed::At(at)
    }
}

enum Followed {
    At(Vec<[f32; 2]>),
    Lost,
    NoReturn,
}

/// How well a candidate displacement did at full resolution.
#[derive(Clone, Copy, Debug)]
struct Trial {
    flow: [f32; 2],
    /// Share of the points found.
    share: f32,
    /// Their mean correlation.
    likeness: f32,
}

impl Trial {
    fn worth(&self) -> f32 {
        self.share * self.likeness
    }
}

/// Moves a whole-pixel corner to another phase of the pixel grid, different for each index.
///
/// Sub-pixel tracking errs by up to 0.008 px with the phases of start and end. Corners all at phase zero would all err alike, and the displacement
/// with them; spread evenly (the plastic number's sequence) the errors cancel.
fn spread_phase(index: usize, corner: [f32; 2]) -> [f32; 2] {
    let turn = [0.754_877_67_f64, 0.569_840_29];
    std::array::from_fn(|i| corner[i] + ((index as f64 * turn[i]).fract() - 0.5) as f32)
}

fn track(point: &Point, now: &[[f32; 2]]) -> Track {
    let pixels = point.at.iter().zip(now).map(|(start, end)| [start.map(f64::from), end.map(f64::from)]);
    Track { pixels: pixels.collect() }
}

/// Half side of the square at a level of the pyramid: coarse levels see more of the scene anyway.
fn radius_at(finest: usize, level: usize) -> usize {
    (finest >> level).max(5).min(finest)
}

fn distance(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The camera nearest to the middle of all.
fn most_central(rig: &Rig) -> usize {
    let count = rig.cameras.len() as f64;
    let mean: [f64; 2] = std::array::from_fn(|i| rig.cameras.iter().map(|c| c.offset_mm[i]).sum::<f64>() / count);
    let off = |k: &usize| {
        let [x, y] = rig.cameras[*k].offset_mm;
        (x - mean[0]).hypot(y - mean[1])
    };
    (0..rig.cameras.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
}
