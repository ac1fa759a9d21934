//! A few moments of a run in pictures.

use crate::report::{Moment, View};
use trinocular_recording::export::Row;
use trinocular_recording::message::{Measurement, Outcome};
use trinocular_vision::images::Image;

/// Most moments at equal distances.
const MOST_REGULAR: usize = 6;
/// Most frame sets that were not used.
const MOST_REFUSED: usize = 2;

/// Pictures of one frame set.
#[derive(Clone, Debug)]
struct Shot {
    /// Number of the frame set.
    index: usize,
    /// `None` for a keyframe, whose capture time the measurement does not have.
    capture_us: Option<u64>,
    outcome: String,
    views: Vec<View>,
}

/// Moments at about equal distances from a run of unknown length, and the first frame sets that
/// were not used.
#[derive(Clone, Debug)]
pub(super) struct Album {
    regular: Vec<Shot>,
    refused: Vec<Shot>,
    /// Number of frame sets so far, and distance of those that are kept.
    count: usize,
    stride: usize,
    was_refused: bool,
    /// True if the coming frame set is kept as a refused one.
    is_refused_next: bool,
}

impl Default for Album {
    fn default() -> Self {
        Self {
            regular: Vec::new(),
            refused: Vec::new(),
            count: 0,
            stride: 1,
            was_refused: false,
            is_refused_next: false,
        }
    }
}

impl Album {
    /// Counts the next frame set, and returns true if its images are wanted.
    pub fn wants(&mut self, outcome: Outcome) -> bool {
        let is_regular = self.count.is_multiple_of(self.stride);
        self.count += 1;
        let is_refused = matches!(outcome, Outcome::Refused | Outcome::Unused);
        let is_first = is_refused && !self.was_refused;
        self.was_refused = is_refused;
        self.is_refused_next = is_first && self.refused.len() < MOST_REFUSED;
        is_regular || self.is_refused_next
    }

    /// Takes in the wanted frame set.
    pub fn take(&mut self, names: &[String], images: &[Image], measurement: &Measurement) {
        let views = names.iter().zip(images).enumerate();
        let views = views.map(|(camera, (name, image))| view(camera, name, image, measurement));
        let row = Row::of(measurement);
        let outcome = match measurement.outcome {
            Outcome::Keyframe => "keyframe".to_owned(),
            Outcome::Measured | Outcome::Used => format!("{} points", row.points),
            Outcome::Refused | Outcome::Unused => format!("not used: {}", row.reason),
        };
        let shot = Shot {
            index: self.count.saturating_sub(1),
            capture_us: (measurement.outcome != Outcome::Keyframe)
                .then_some(measurement.capture_us),
            outcome,
            views: views.collect(),
        };
        if self.is_refused_next {
            self.refused.push(shot);
            return;
        }
        self.regular.push(shot);
        if self.regular.len() > MOST_REGULAR {
            self.stride *= 2;
            let stride = self.stride;
            self.regular
                .retain(|shot| shot.index.is_multiple_of(stride));
        }
    }

    /// Returns the moments in their order; `time_s` computes their times.
    pub fn moments(&self, time_s: impl Fn(u64) -> f64) -> Vec<Moment> {
        let mut shots: Vec<&Shot> = self.regular.iter().chain(&self.refused).collect();
        shots.sort_by_key(|shot| shot.index);
        let moment = |shot: &Shot| Moment {
            caption: match shot.capture_us {
                Some(us) => format!("{:.3} s, {}", time_s(us), shot.outcome),
                None => shot.outcome.clone(),
            },
            views: shot.views.clone(),
        };
        let seen = |moment: &Moment| moment.views.iter().any(View::is_seen);
        shots.into_iter().map(moment).filter(seen).collect()
    }
}

fn view(camera: usize, name: &str, image: &Image, measurement: &Measurement) -> View {
    let active = &measurement.cameras;
    let place = active
        .iter()
        .position(|active| usize::from(*active) == camera);
    let points: Vec<[f64; 4]> = match place {
        Some(place) => {
            let all = measurement.pixels.as_chunks::<4>().0;
            all.iter()
                .skip(place)
                .step_by(active.len())
                .copied()
                .collect()
        }
        None => Vec::new(),
    };
    let mut absent = measurement.absent.iter();
    let reason = absent.find(|(absent, _)| usize::from(*absent) == camera);
    let note = match (reason, image.is_missing()) {
        (Some((_, reason)), _) => reason.clone(),
        (None, true) => "no image".to_owned(),
        (None, false) => String::new(),
    };
    View::new(name, image, &points).noted(note)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> Image {
        let (width, height) = (8, 8);
        Image {
            width,
            height,
            grey: vec![9; width * height],
        }
    }

    #[test]
    fn moments_stay_few_and_evenly_spaced() {
        let mut album = Album::default();
        for capture_us in 1..=1_000 {
            let outcome = match capture_us {
                // The first one is a multiple of every stride so far.
                513..=532 => Outcome::Refused,
                _ => Outcome::Used,
            };
            if album.wants(outcome) {
                let measurement = Measurement {
                    capture_us,
                    outcome,
                    ..Measurement::default()
                };
                album.take(&["left".to_owned()], &[image()], &measurement);
            }
        }
        let places: Vec<usize> = album.regular.iter().map(|shot| shot.index).collect();
        assert!((3..=MOST_REGULAR).contains(&places.len()), "{places:?}");
        let is_regular = |index: &usize| index.is_multiple_of(album.stride);
        assert!(places.iter().all(is_regular), "{places:?}");
        assert_eq!(album.refused.len(), 1);
        assert_eq!(album.refused[0].capture_us, Some(513));
    }

    #[test]
    fn points_go_to_their_camera() {
        let measurement = Measurement {
            cameras: vec![0, 2],
            pixels: (0..16).map(f64::from).collect(),
            absent: vec![(1, "covered".to_owned())],
            ..Measurement::default()
        };
        let with = |camera| view(camera, "c", &image(), &measurement);
        let points = [[4.0, 5.0, 6.0, 7.0], [12.0, 13.0, 14.0, 15.0]];
        assert_eq!(with(2), View::new("c", &image(), &points));
        assert_eq!(with(1), View::new("c", &image(), &[]).noted("covered"));
    }
}
