//! Pictures of several cameras, put together by time.
//!
//! A *set* is one picture of each camera, the first and the last at most a window apart. Of the pictures that are there it is the nearest: if leaving
//! out the earliest picture for its successor brings them closer together, the earliest is left out. Laws, whatever the cameras do:
//!
//! * no picture is in two sets, and every camera's pictures come in their order;
//! * all pictures of a set lie within the window;
//! * a picture that can be in no set any more is dropped at once and counted; no more than [`DEPTH`] of a camera wait for the others;
//! * with a window of at most half the time between a camera's pictures, the sets do not depend on which camera's picture arrives first.

use std::collections::VecDeque;

/// How many pictures of one camera wait for the other cameras': a quarter of a second at 30 pictures per second.
pub const DEPTH: usize = 8;

/// What became of one camera's pictures.
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

/// One picture of each camera, all at one time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Set<P> {
    /// When each was taken, µs.
    pub times_us: Vec<u64>,
    /// The pictures, camera by camera.
    pub pictures: Vec<P>,
}

impl<P> Set<P> {
    /// The mean of the times, µs.
    pub fn time_us(&self) -> u64 {
        let first = self.times_us.iter().min().copied().unwrap_or(0);
        let later: u64 = self.times_us.iter().map(|time| time - first).sum();
        first + later / (self.times_us.len() as u64).max(1)
    }

    /// From the first picture to the last, µs.
    pub fn spread_us(&self) -> u64 {
        spread(self.times_us.iter().copied())
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
    latest_us: Vec<Option<u64>>,
    counts: Vec<Counts>,
}

impl<P> Matching<P> {
    /// For so many cameras; pictures at most `window_us` apart are of one time.
    pub fn new(cameras: usize, window_us: u64) -> Self {
        Self {
            window_us,
            waiting: (0..cameras).map(|_| VecDeque::new()).collect(),
            latest_us: vec![None; cameras],
            counts: vec![Counts::default(); cameras],
        }
    }

    /// A picture has arrived. One of a camera that there is not is ignored.
    pub fn push(&mut self, camera: usize, time_us: u64, picture: P) {
        let (Some(waiting), Some(latest), Some(counts)) = (
            self.waiting.get_mut(camera),
            self.latest_us.get_mut(camera),
            self.counts.get_mut(camera),
        ) else {
            return;
        };
        counts.arrived += 1;
        if latest.is_some_and(|latest| time_us <= latest) {
            counts.disordered += 1;
            return;
        }
        *latest = Some(time_us);
        if waiting.len() == DEPTH {
            waiting.pop_front();
            counts.unmatched += 1;
        }
        waiting.push_back((time_us, picture));
    }

    /// The oldest set.
    pub fn take(&mut self) -> Option<Set<P>> {
        let set = self.next()?;
        for counts in &mut self.counts {
            counts.used += 1;
        }
        Some(set)
    }

    /// The newest set; older ones are overtaken: a servo has no use for them.
    pub fn take_newest(&mut self) -> Option<Set<P>> {
        let mut newest = self.take()?;
        while let Some(newer) = self.take() {
            for counts in &mut self.counts {
                counts.used -= 1;
                counts.overtaken += 1;
            }
            newest = newer;
        }
        Some(newest)
    }

    /// What became of the pictures, camera by camera.
    pub fn counts(&self) -> &[Counts] {
        &self.counts
    }

    /// How far the cameras' latest pictures are apart, µs; `None` before each has sent one.
    pub fn apart_us(&self) -> Option<u64> {
        let latest: Option<Vec<u64>> = self.latest_us.iter().copied().collect();
        latest.map(|latest| spread(latest.into_iter()))
    }

    fn next(&mut self) -> Option<Set<P>> {
        loop {
            let heads: Option<Vec<u64>> = self
                .waiting
                .iter()
                .map(|waiting| waiting.front().map(|(time_us, _)| *time_us))
                .collect();
            let heads = heads?;
            let (earliest, _) = heads.iter().enumerate().min_by_key(|(_, time)| **time)?;
            let apart = spread(heads.iter().copied());
            // Every picture still to come of the other cameras is later than theirs that wait: the earliest gets no nearer partners.
            if apart > self.window_us || self.successor_is_nearer(&heads, earliest, apart) {
                self.waiting[earliest].pop_front();
                self.counts[earliest].unmatched += 1;
                continue;
            }
            let first = self.waiting.iter_mut().map(VecDeque::pop_front);
            let first: Option<Vec<(u64, P)>> = first.collect();
            let (times_us, pictures) = first?.into_iter().unzip();
            return Some(Set { times_us, pictures });
        }
    }

    fn successor_is_nearer(&self, heads: &[u64], earliest: usize, apart: u64) -> bool {
        let Some((successor, _)) = self.waiting[earliest].get(1) else {
            return false;
        };
        let with_successor = heads.iter().enumerate().map(|(camera, time)| {
            if camera == earliest {
                *successor
            } else {
                *time
            }
        });
        spread(with_successor) < apart
    }
}

#[cfg(test)]
mod tests;
