//! Pictures of several cameras, put together by time.
//!
//! A *set* is one picture of each camera, the first and the last at most a window apart. Of the
//! pictures that are there it is the nearest: if leaving out the earliest picture for its successor
//! brings them closer together, the earliest is left out. Laws, whatever the cameras do:
//!
//! * no picture is in two sets, and every camera's pictures come in their order;
//! * all pictures of a set lie within the window;
//! * a picture that can be in no set any more is dropped at once and counted; no more than
//!   [`DEPTH`] of a camera wait for the others;
//! * with a window of at most half the time between a camera's pictures, the sets do not depend on
//!   which camera's picture arrives first.
//!
//! A camera whose latest picture is [`SILENCE_US`] older than another's, of which two or more wait,
//! has *fallen silent*: until its next picture sets are made without it, as long as they have two.
//! One that has sent none yet is waited for.

use std::collections::VecDeque;

/// Number of images of one camera that wait for the other cameras': a quarter of a second at 30
/// pictures per second.
pub const DEPTH: usize = 8;

/// A camera that is so far behind has failed, µs. Short enough to go on before the station has
/// given the target up (`coast_ms`, 0.8 s).
pub const SILENCE_US: u64 = 500_000;

/// Number of one camera's images, by their fate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// That arrived.
    pub arrived: u64,
    /// That are in a set which was asked for.
    pub used: u64,
    /// That had no partners within the window.
    pub unmatched: u64,
    /// That were in a set, but there was a newer one when somebody asked.
    pub overtaken: u64,
    /// That did not come after the picture before.
    pub disordered: u64,
}

/// Pictures of one time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Set<P> {
    /// Camera by camera: when its picture was taken, µs, and the picture; `None` of one that takes
    /// no part.
    pub pictures: Vec<Option<(u64, P)>>,
}

impl<P> Set<P> {
    /// Capture time of each image, µs.
    pub fn times_us(&self) -> impl Iterator<Item = u64> + Clone {
        self.pictures.iter().flatten().map(|(time_us, _)| *time_us)
    }

    /// The mean of the times, µs.
    pub fn time_us(&self) -> u64 {
        let first = self.times_us().min().unwrap_or(0);
        let later: u64 = self.times_us().map(|time| time - first).sum();
        first + later / (self.times_us().count() as u64).max(1)
    }

    /// From the first picture to the last, µs.
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

/// The pictures that wait for their partners.
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
    /// For so many cameras; pictures at most `window_us` apart are of one time.
    pub fn new(cameras: usize, window_us: u64) -> Self {
        Self {
            window_us,
            waiting: (0..cameras).map(|_| VecDeque::new()).collect(),
            takes_part: vec![true; cameras],
            latest_us: vec![None; cameras],
            counts: vec![Counts::default(); cameras],
        }
    }

    /// A picture has arrived. One of a camera that there is not is ignored.
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
        if self.waiting[camera].len() == DEPTH {
            self.waiting[camera].pop_front();
            self.counts[camera].unmatched += 1;
        }
        self.waiting[camera].push_back((time_us, picture));
        // A single one may have come a little sooner than its partners.
        if self.waiting[camera].len() > 1 {
            self.leave_out_silent(time_us);
        }
    }

    /// Makes sets without a camera until it sends a picture again. False, and nothing is done, if
    /// fewer than two would be left.
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

    /// The oldest set.
    pub fn take(&mut self) -> Option<Set<P>> {
        let set = self.next()?;
        self.count(&set, |counts| counts.used += 1);
        Some(set)
    }

    /// The newest set; older ones are overtaken: a servo has no use for them.
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

    /// Time between the latest images of the active cameras, µs; `None` before each
    /// has sent one.
    pub fn apart_us(&self) -> Option<u64> {
        let taking_part = self.latest_us.iter().zip(&self.takes_part);
        let latest = taking_part.filter_map(|(latest, takes_part)| takes_part.then_some(*latest));
        let latest: Option<Vec<u64>> = latest.collect();
        latest.map(|latest| spread(latest.into_iter()))
    }

    fn next(&mut self) -> Option<Set<P>> {
        loop {
            // Of each camera that takes part its first picture: camera and time.
            let heads = (0..self.waiting.len()).filter(|camera| self.takes_part[*camera]);
            let heads = heads.map(|camera| Some((camera, self.waiting[camera].front()?.0)));
            let heads: Vec<(usize, u64)> = heads.collect::<Option<_>>()?;
            let (earliest, _) = heads.iter().min_by_key(|(_, time)| *time)?;
            let apart = spread(heads.iter().map(|(_, time)| *time));
            // Every picture still to come of the other cameras is later than theirs that wait: the
            // earliest gets no nearer partners.
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
