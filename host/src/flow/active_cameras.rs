//! The cameras that take part. One that gives no picture, or none of use, is left out, and the
//! others carry on.

use crate::images::Image;
use crate::matching::geometry::Geometry;
use shared::rig::Rig;
use std::sync::Mutex;

/// Why a camera is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Absence {
    /// It gave no picture.
    Missing,
    /// Its picture shows nothing, while another camera's does.
    Blank,
    /// Its picture is the very one it gave before, to the last bit of its noise, while another
    /// camera's has changed.
    Frozen,
    /// It saw this share more of the motion than the others, negative for less: its shutter opens
    /// later or earlier.
    OutOfStep {
        /// 0.05 if it saw a twentieth more.
        share: f64,
    },
}

impl std::fmt::Display for Absence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Missing => write!(f, "gave no picture"),
            Self::Blank => write!(f, "shows nothing: dark, covered or out of light"),
            Self::Frozen => write!(f, "is frozen: it gave the same picture again"),
            Self::OutOfStep { share } => {
                let (percent, more) = (100.0 * share.abs(), share > &0.0);
                let (amount, when) = if more {
                    ("more", "later")
                } else {
                    ("less", "earlier")
                };
                write!(
                    f,
                    "sees {percent:.1} % {amount} of the motion than the others: it takes its pictures {when}"
                )
            }
        }
    }
}

/// What is to be said of cameras that did not take part, by name.
pub fn remarks(absent: &[(usize, Absence)], names: &[String]) -> Vec<String> {
    let remark = |(k, absence): &(usize, Absence)| {
        let name = names.get(*k).map_or("?", String::as_str);
        format!("camera {name} {absence}; measured without it")
    };
    absent.iter().map(remark).collect()
}

/// A picture that shows less than this share of the contrast of the one that shows most is blank.
const BLANK: f64 = 0.2;

/// Cameras of a rig, in its order.
#[derive(Clone, Debug)]
pub struct Team {
    /// Which of the rig's, from 0.
    pub cameras: Vec<usize>,
    /// Of these alone.
    pub geometry: Geometry,
}

impl Team {
    /// The cameras of `rig` for which `takes_part`. `None` unless they are two in different places.
    pub fn of(rig: &Rig, takes_part: impl Fn(usize) -> bool) -> Option<Self> {
        let cameras: Vec<usize> = (0..rig.cameras.len()).filter(|k| takes_part(*k)).collect();
        let geometry = Geometry::new(&subset(rig, &cameras))?;
        Some(Self { cameras, geometry })
    }

    /// What the team has of something that there is one of per camera of the rig.
    pub fn select<'a, T>(&self, all: &'a [T]) -> Vec<&'a T> {
        self.cameras.iter().filter_map(|k| all.get(*k)).collect()
    }
}

/// A rig of some cameras of another.
pub fn subset(rig: &Rig, cameras: &[usize]) -> Rig {
    Rig {
        image_size_px: rig.image_size_px,
        cameras: (cameras.iter())
            .filter_map(|k| rig.cameras.get(*k).copied())
            .collect(),
    }
}

/// Which pictures are missing or blank, given each one's contrast; none is blank if fewer than two
/// would be left.
pub fn absences(views: &[Image], contrasts: &[f64]) -> Vec<Option<Absence>> {
    let most = contrasts.iter().copied().fold(0.0, f64::max);
    let missing = |view: &Image| view.is_missing().then_some(Absence::Missing);
    let absent: Vec<Option<Absence>> = (views.iter().zip(contrasts))
        .map(|(view, contrast)| {
            missing(view).or((*contrast < BLANK * most).then_some(Absence::Blank))
        })
        .collect();
    if absent.iter().filter(|a| a.is_none()).count() >= 2 {
        absent
    } else {
        views.iter().map(missing).collect()
    }
}

/// Marks as frozen what equals its `last` fingerprint, if something else does not.
pub fn mark_frozen(absences: &mut [Option<Absence>], prints: &[u64], last: &[u64]) {
    if prints.len() != last.len() {
        return;
    }
    let present = |k: &usize| absences[*k].is_none();
    let (same, changed): (Vec<usize>, Vec<usize>) = (0..absences.len())
        .filter(present)
        .partition(|k| prints[*k] == last[*k]);
    // A camera that gave no picture before has none that could have changed.
    let none = fingerprint(&Image::missing());
    if changed.iter().any(|k| last[*k] != none) {
        for k in same {
            absences[k] = Some(Absence::Frozen);
        }
    }
}

/// Fingerprints of the pictures seen last, and which of them were frozen.
#[derive(Debug, Default)]
pub struct Last(Mutex<(Vec<u64>, Vec<bool>)>);

impl Clone for Last {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Last {
    /// Marks what is frozen against the pictures before. The same capture seen again is judged as
    /// it was.
    pub fn judge(&self, absences: &mut [Option<Absence>], prints: &[u64]) {
        let Ok(mut last) = self.0.lock() else { return };
        let (before, frozen) = &*last;
        if before == prints {
            let frozen = absences
                .iter_mut()
                .zip(frozen)
                .filter(|(_, frozen)| **frozen);
            frozen.for_each(|(absence, _)| *absence = absence.or(Some(Absence::Frozen)));
            return;
        }
        mark_frozen(absences, prints, before);
        let is_frozen = |absence: &Option<Absence>| *absence == Some(Absence::Frozen);
        *last = (prints.to_vec(), absences.iter().map(is_frozen).collect());
    }
}

/// A number that changes whenever a picture does: Fowler, Noll and Vo's hash over eight bytes at a
/// time, four times side by side.
pub fn fingerprint(view: &Image) -> u64 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let mut lanes = [0xcbf2_9ce4_8422_2325_u64; 4];
    let (blocks, rest) = view.grey.as_chunks::<32>();
    for block in blocks {
        let (words, _) = block.as_chunks::<8>();
        for (lane, word) in lanes.iter_mut().zip(words) {
            *lane = (*lane ^ u64::from_le_bytes(*word))
                .wrapping_mul(PRIME)
                .rotate_left(29);
        }
    }
    let mix = |hash: u64, word: u64| (hash ^ word).wrapping_mul(PRIME);
    let bytes = rest.iter().map(|byte| u64::from(*byte));
    lanes.into_iter().chain(bytes).fold(PRIME, mix)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(grey: u8) -> Image {
        Image {
            width: 7,
            height: 5,
            grey: vec![grey; 35],
        }
    }

    #[test]
    fn pictures_that_are_missing_or_show_nothing_are_left_out_but_never_down_to_one() {
        let views = [image(1), Image::missing(), image(2), image(3)];
        let out = absences(&views, &[40.0, 0.0, 0.5, 35.0]);
        assert_eq!(
            out,
            [None, Some(Absence::Missing), Some(Absence::Blank), None]
        );
        // All are in the dark: nothing is wrong with any single one.
        let views = [image(1), image(2), image(3)];
        assert_eq!(absences(&views, &[0.4, 0.5, 0.6]), [None; 3]);
        assert_eq!(absences(&views, &[0.0; 3]), [None; 3]);
        assert_eq!(absences(&views, &[40.0, 0.1, 0.2]), [None; 3]);
    }

    #[test]
    fn a_picture_that_comes_again_is_frozen_only_while_another_changes() {
        let mut out = [None; 3];
        mark_frozen(&mut out, &[1, 2, 3], &[1, 9, 8]);
        assert_eq!(out, [Some(Absence::Frozen), None, None]);
        let mut out = [None; 3];
        mark_frozen(&mut out, &[1, 2, 3], &[1, 2, 3]);
        assert_eq!(out, [None; 3]);
        // A missing camera's change is no change.
        let mut out = [None, None, Some(Absence::Missing)];
        mark_frozen(&mut out, &[1, 2, 0], &[1, 2, 3]);
        assert_eq!(out, [None, None, Some(Absence::Missing)]);
        // Nor is that of one that has come back.
        let none = fingerprint(&Image::missing());
        let mut out = [None; 3];
        mark_frozen(&mut out, &[1, 2, 3], &[1, 2, none]);
        assert_eq!(out, [None; 3]);
        mark_frozen(&mut out, &[1, 5, 3], &[1, 2, none]);
        assert_eq!(out, [Some(Absence::Frozen), None, None]);
        let mut out = [None; 3];
        mark_frozen(&mut out, &[1, 2, 3], &[]);
        assert_eq!(out, [None; 3]);
    }

    #[test]
    fn a_capture_seen_twice_is_judged_the_same_twice() {
        let last = Last::default();
        let judged = |prints: &[u64]| {
            let mut out = [None; 3];
            last.judge(&mut out, prints);
            out
        };
        assert_eq!(judged(&[1, 2, 3]), [None; 3]);
        let frozen = [None, Some(Absence::Frozen), None];
        assert_eq!(judged(&[4, 2, 5]), frozen);
        assert_eq!(judged(&[4, 2, 5]), frozen);
        assert_eq!(judged(&[6, 7, 8]), [None; 3]);
    }

    #[test]
    fn any_pixel_changes_the_fingerprint() {
        let first = image(100);
        for i in 0..first.grey.len() {
            let mut other = first.clone();
            other.grey[i] ^= 1;
            assert_ne!(fingerprint(&first), fingerprint(&other), "{i}");
        }
        assert_eq!(fingerprint(&first), fingerprint(&first.clone()));
    }

    #[test]
    fn a_team_is_two_cameras_in_different_places_or_none() {
        let rig = Rig::paper();
        let team = Team::of(&rig, |k| k != 1).unwrap();
        assert_eq!(team.cameras, [0, 2]);
        assert_eq!(
            team.select(&["left", "middle", "right"]),
            [&"left", &"right"]
        );
        assert!(Team::of(&rig, |k| k == 1).is_none());
    }

    #[test]
    fn remarks_say_what_is_wrong_in_words() {
        let late = Absence::OutOfStep { share: 0.05 };
        assert!(late.to_string().contains("5.0 % more") && late.to_string().contains("later"));
        let early = Absence::OutOfStep { share: -0.05 };
        assert!(early.to_string().contains("5.0 % less") && early.to_string().contains("earlier"));
    }
}
