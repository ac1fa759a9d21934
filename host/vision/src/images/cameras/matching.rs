//! Matching of images of several cameras by their capture times.
//!
//! A *set* is one image of each camera, the first and the last at most a window apart. Among the
//! waiting images it is the closest set: if replacing the earliest image by its successor brings
//! them closer together, the earliest is left out. Invariants, for any behaviour of the cameras:
//!
//! * no image is in two sets, and every camera's images come in their order;
//! * all images of a set lie within the window;
//! * an image that cannot be in a set any more is dropped at once and counted; at most [`DEPTH`]
//!   images of a camera wait for the others;
//! * with a window of at most half the time between a camera's images, the sets do not depend on
//!   the order in which images of different cameras arrive.
//!
//! A camera has *fallen silent* if its latest image is [`SILENCE_US`] older than another camera's,
//! and two or more images of the other one wait. Until its next image, sets are made without it, as
//! long as two cameras are left. The sets wait for a camera that has sent no image yet.

use std::collections::VecDeque;

/// Number of images of one camera that wait for the other cameras': a quarter of a second at 30
/// images per second.
pub const DEPTH: usize = 8;

/// Lag after which a camera has failed, µs. It is shorter than the time after which the station
/// gives the target up (`coast_ms`, 0.8 s).
pub const SILENCE_US: u64 = 500_000;

/// Number of one camera's images, by their fate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Number of images that arrived.
    pub arrived: u64,
    /// Number of images in sets that were taken.
    pub used: u64,
    /// Number of images without partners within the window.
    pub unmatched: u64,
    /// Number of images in sets that were dropped for a newer set, or that no call has taken in
    /// time.
    pub overtaken: u64,
    /// Number of images that were not later than the image before.
    pub disordered: u64,
}

/// Simultaneous images of the cameras.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Set<P> {
    /// Capture time in µs and image of each camera; `None` for a camera that is left out.
    pub pictures: Vec<Option<(u64, P)>>,
}

impl<P> Set<P> {
    /// Returns the capture time of each image, µs.
    pub fn times_us(&self) -> impl Iterator<Item = u64> + Clone {
        self.pictures.iter().flatten().map(|(time_us, _)| *time_us)
    }

    /// Returns the mean of the capture times, µs.
    pub fn time_us(&self) -> u64 {
        let first = self.times_us().min().unwrap_or(0);
        let later: u64 = self.times_us().map(|time| time - first).sum();
        first + later / (self.times_us().count() as u64).max(1)
    }

    /// Returns the time from the first image to the last, µs.
    pub fn spread_us(&self) -> u64 {
        spread(self.times_us())
    }
}

fn spread(times_us: impl Iterator<Item = u64>) -> u64 {
    let (first, last) = times_us.fold((u64::MAX, 0), |(first, last), time| {
        (first.min(time), last.max(time))
    });
    last.saturating_sub(first)
}

/// Images that wait for their partners.
#[derive(Clone, Debug)]
pub struct Matching<P> {
    window_us: u64,
    waiting: Vec<VecDeque<(u64, P)>>,
    /// True if a set needs an image of the camera.
    takes_part: Vec<bool>,
    latest_us: Vec<Option<u64>>,
    counts: Vec<Counts>,
}

impl<P> Matching<P> {
    /// Creates the matching of `cameras` cameras; images at most `window_us` apart are
    /// simultaneous.
    pub fn new(cameras: usize, window_us: u64) -> Self {
        Self {
            window_us,
            waiting: (0..cameras).map(|_| VecDeque::new()).collect(),
            takes_part: vec![true; cameras],
            latest_us: vec![None; cameras],
            counts: vec![Counts::default(); cameras],
        }
    }

    /// Takes times from now on that may be earlier than those so far. The images that wait are
    /// dropped as ones without partners.
    pub fn begin_anew(&mut self) {
        for (waiting, counts) in self.waiting.iter_mut().zip(&mut self.counts) {
            counts.unmatched += waiting.len() as u64;
            waiting.clear();
        }
        self.latest_us.fill(None);
    }

    /// Adds an image that has arrived. The image of a camera that does not exist is ignored.
    pub fn push(&mut self, camera: usize, time_us: u64, picture: P) {
        let (Some(latest), Some(counts)) =
            (self.latest_us.get_mut(camera), self.counts.get_mut(camera))
        else {
            return;
        };
        counts.arrived += 1;
        if latest.is_some_and(|latest| time_us <= latest) {
            counts.disordered += 1;
            return;
        }
        *latest = Some(time_us);
        self.takes_part[camera] = true;
        self.make_room(camera);
        self.waiting[camera].push_back((time_us, picture));
        // A single image may have come a little sooner than its partners.
        if self.waiting[camera].len() > 1 {
            self.leave_out_silent(time_us);
        }
    }

    /// Drops the camera's oldest image if too many wait: with its set, which no call has taken, or
    /// alone if it has no partners.
    fn make_room(&mut self, camera: usize) {
        if self.waiting[camera].len() < DEPTH {
            return;
        }
        if let Some(set) = self.next() {
            self.count(&set, |counts| counts.overtaken += 1);
        }
        if self.waiting[camera].len() == DEPTH {
            self.waiting[camera].pop_front();
            self.counts[camera].unmatched += 1;
        }
    }

    /// Makes sets without a camera until it sends an image again. Returns false, and does nothing,
    /// if fewer than two cameras would be left.
    pub fn leave_out(&mut self, camera: usize) -> bool {
        let others = self.takes_part.iter().enumerate();
        let others = others.filter(|(k, takes_part)| *k != camera && **takes_part);
        if others.count() < 2 {
            return false;
        }
        if let Some(takes_part) = self.takes_part.get_mut(camera) {
            *takes_part = false;
        }
        true
    }

    /// Returns true if a set takes an image of the camera.
    pub fn needs(&self, camera: usize) -> bool {
        self.takes_part.get(camera) == Some(&true)
    }

    fn leave_out_silent(&mut self, now_us: u64) {
        for camera in 0..self.waiting.len() {
            let latest_us = self.latest_us[camera].unwrap_or(now_us);
            if now_us.saturating_sub(latest_us) >= SILENCE_US {
                self.leave_out(camera);
            }
        }
    }

    /// Takes the oldest set.
    pub fn take(&mut self) -> Option<Set<P>> {
        let set = self.next()?;
        self.count(&set, |counts| counts.used += 1);
        Some(set)
    }

    /// Takes the newest set and drops the older ones as overtaken, because a servo needs only the
    /// newest.
    pub fn take_newest(&mut self) -> Option<Set<P>> {
        let mut newest = self.take()?;
        while let Some(newer) = self.take() {
            self.count(&newest, |counts| {
                counts.used -= 1;
                counts.overtaken += 1;
            });
            newest = newer;
        }
        Some(newest)
    }

    fn count(&mut self, set: &Set<P>, change: impl Fn(&mut Counts)) {
        let cameras = self.counts.iter_mut().zip(&set.pictures);
        cameras
            .filter(|(_, picture)| picture.is_some())
            .for_each(|(counts, _)| change(counts));
    }

    /// Returns the fate of the images, camera by camera.
    pub fn counts(&self) -> &[Counts] {
        &self.counts
    }

    /// Returns the time between the latest images of the active cameras, µs; `None` until each has
    /// sent one.
    pub fn apart_us(&self) -> Option<u64> {
        let taking_part = self.latest_us.iter().zip(&self.takes_part);
        let latest = taking_part.filter_map(|(latest, takes_part)| takes_part.then_some(*latest));
        let latest: Option<Vec<u64>> = latest.collect();
        latest.map(|latest| spread(latest.into_iter()))
    }

    fn next(&mut self) -> Option<Set<P>> {
        loop {
            // First image of each active camera: camera and time.
            let heads = (0..self.waiting.len()).filter(|camera| self.takes_part[*camera]);
            let heads = heads.map(|camera| Some((camera, self.waiting[camera].front()?.0)));
            let heads: Vec<(usize, u64)> = heads.collect::<Option<_>>()?;
            let (earliest, _) = heads.iter().min_by_key(|(_, time)| *time)?;
            let apart = spread(heads.iter().map(|(_, time)| *time));
            // Every later image of the other cameras is newer than their waiting ones, so the
            // earliest image gets no closer partners.
            if apart > self.window_us || self.successor_is_nearer(&heads, *earliest, apart) {
                self.waiting[*earliest].pop_front();
                self.counts[*earliest].unmatched += 1;
                continue;
            }
            let pictures = self.waiting.iter_mut().zip(&self.takes_part);
            let pictures = pictures
                .map(|(waiting, takes_part)| takes_part.then(|| waiting.pop_front()).flatten());
            return Some(Set {
                pictures: pictures.collect(),
            });
        }
    }

    fn successor_is_nearer(&self, heads: &[(usize, u64)], earliest: usize, apart: u64) -> bool {
        let Some((successor, _)) = self.waiting[earliest].get(1) else {
            return false;
        };
        let with_successor = heads
            .iter()
            .map(|(camera, time)| match *camera == earliest {
                true => *successor,
                false => *time,
            });
        spread(with_successor) < apart
    }
}

#[cfg(test)]
mod tests;
