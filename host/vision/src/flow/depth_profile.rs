//! Depth profile of the image as a whole, which decides between the depths of ambiguous corners.
//!
//! In an image of like objects (coins, letters, discs), the window of a single corner correlates at
//! several depths. The corners vote together: a *profile* gives every place of the image its inverse
//! depth,
//!
//! ```text
//! ρ(ξ, η) = a + b ξ + c η        exact for a plane
//! ```
//!
//! and each corner votes for a profile with the correlation of its match there, if it has one. The
//! profiles tried are those of constant depth through each match, and those through the matches of
//! three random corners (M. A. Fischler and R. C. Bolles, *Random Sample Consensus*, 1981). The best
//! profile decides if most corners vote for it and no other profile has nearly as many votes.
//! Texture that repeats has another one: all corners vote alike for the depths of its repetitions.

use crate::matching::stereo::RefinedMatch;
use nalgebra::{Matrix3, Vector3};
use trinocular_rig::random::Random;

/// Largest distance of a match from the profile, px of disparity to the farthest camera.
const TOLERANCE_PX: f64 = 1.5;
/// Least distance between two profiles that count as different, px of disparity, at most corners.
const DISTINCT_PX: f64 = 2.0 * TOLERANCE_PX;
/// Correlation of a match that is worth no vote. One of 1 is worth a whole vote.
const WORTHLESS_ZNCC: f32 = 0.8;
/// Least share of the corners' whole votes that the best profile needs.
const LEAST_SHARE: f64 = 0.5;
/// Largest votes of another profile, as a share of those of the best.
const MOST_RIVAL: f64 = 0.7;
/// Number of profiles through three random corners.
const TRIPLES: usize = 600;
/// Largest slope of a profile per unit of its inverse depth: a surface tilted by 63 degrees.
const MOST_SLOPE: f64 = 2.0;

/// Corner with all of its matches.
pub(super) struct AmbiguousCorner {
    /// Normalised coordinates in the reference camera.
    pub(super) at: [f64; 2],
    /// Matches at different depths, at least one.
    pub(super) matches: Vec<RefinedMatch>,
}

/// Inverse depth at normalised coordinates: `[a, b, c]` of `a + b ξ + c η`.
type Profile = [f64; 3];

fn depth([a, b, c]: Profile, [x, y]: [f64; 2]) -> f64 {
    a + b * x + c * y
}

impl AmbiguousCorner {
    /// Returns the match on the profile, with its votes. `tolerance` is of inverse depth.
    fn on(&self, profile: Profile, tolerance: f64) -> Option<(&RefinedMatch, f64)> {
        let expected = depth(profile, self.at);
        let off = |m: &&RefinedMatch| (m.matched.ray.inverse_depth - expected).abs();
        let near = self.matches.iter().filter(|m| off(m) < tolerance);
        let best = near.max_by(|a, b| a.zncc.total_cmp(&b.zncc))?;
        let votes = (best.zncc - WORTHLESS_ZNCC) / (1.0 - WORTHLESS_ZNCC);
        Some((best, f64::from(votes.clamp(0.0, 1.0))))
    }
}

/// Returns the index of each corner that votes for the one profile on which most corners agree,
/// with the corner's match on it. Returns nothing if there is no such profile, or more than one.
/// `px_per_inverse_mm` is the disparity to the farthest camera per unit of inverse depth.
pub(super) fn agreed(
    corners: &[AmbiguousCorner],
    px_per_inverse_mm: f64,
) -> Vec<(usize, RefinedMatch)> {
    if corners.is_empty() {
        return Vec::new();
    }
    let tolerance = TOLERANCE_PX / px_per_inverse_mm;
    let votes = |profile: &Profile| -> f64 {
        let of_corner = |corner: &AmbiguousCorner| corner.on(*profile, tolerance).map(|(_, v)| v);
        corners.iter().filter_map(of_corner).sum()
    };
    let counted = profiles(corners).map(|profile| (votes(&profile), profile));
    let counted: Vec<(f64, Profile)> = counted.collect();
    let Some((most, best)) = counted.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return Vec::new();
    };
    let is_rival = |other: &Profile| {
        let apart = |corner: &&AmbiguousCorner| {
            let off = depth(*other, corner.at) - depth(*best, corner.at);
            off.abs() * px_per_inverse_mm > DISTINCT_PX
        };
        2 * corners.iter().filter(apart).count() > corners.len()
    };
    let rivals = counted.iter().filter(|(_, other)| is_rival(other));
    let rival = rivals.map(|(votes, _)| *votes).fold(0.0, f64::max);
    if *most < LEAST_SHARE * corners.len() as f64 || rival > MOST_RIVAL * most {
        return Vec::new();
    }
    let chosen = |(index, corner): (usize, &AmbiguousCorner)| {
        let (found, _) = corner.on(*best, tolerance)?;
        Some((index, found.clone()))
    };
    corners.iter().enumerate().filter_map(chosen).collect()
}

/// Returns the profiles to try.
fn profiles(corners: &[AmbiguousCorner]) -> impl Iterator<Item = Profile> {
    let matches = corners.iter().flat_map(|corner| &corner.matches);
    let constant = matches.map(|m| [m.matched.ray.inverse_depth, 0.0, 0.0]);
    let mut random = Random::seeded(0);
    let triples = (0..TRIPLES).filter_map(move |_| through_three(corners, &mut random));
    constant.chain(triples)
}

/// Returns the profile through the matches of three random corners; `None` if they are in line, or
/// if the profile is too steep.
fn through_three(corners: &[AmbiguousCorner], random: &mut Random) -> Option<Profile> {
    let chosen = [(); 3].map(|()| {
        let corner = &corners[random.below(corners.len())];
        let found = &corner.matches[random.below(corner.matches.len())];
        (corner.at, found.matched.ray.inverse_depth)
    });
    let places = Matrix3::from_fn(|i, j| match j {
        0 => 1.0,
        _ => chosen[i].0[j - 1],
    });
    let depths = Vector3::from_fn(|i, _| chosen[i].1);
    let [a, b, c]: Profile = places.try_inverse().map(|inverse| inverse * depths)?.into();
    (a > 0.0 && b.hypot(c) < MOST_SLOPE * a).then_some([a, b, c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matching::geometry::Ray;
    use crate::matching::stereo::StereoMatch;

    const PX_PER_INVERSE_MM: f64 = 500.0 * 60.0;

    fn found(inverse_depth: f64, zncc: f32) -> RefinedMatch {
        let ray = Ray {
            direction: [0.0; 2],
            inverse_depth,
        };
        let matched = StereoMatch {
            pixels: Vec::new(),
            normalised: Vec::new(),
            ray,
            templates: Vec::new(),
        };
        RefinedMatch { matched, zncc }
    }

    /// Returns 80 corners of a plane tilted by 45 degrees, with the inverse depth of each, and with
    /// matches at other depths that `others` adds.
    fn corners(
        mut others: impl FnMut(f64, &mut Random) -> Vec<RefinedMatch>,
    ) -> (Vec<AmbiguousCorner>, Vec<f64>) {
        let mut random = Random::seeded(5);
        let corner = |_| {
            let at = [0.3, 0.2].map(|reach| random.between(-reach, reach));
            let right = depth([1.0 / 800.0, 1.0 / 800.0, 0.0], at);
            let noise = 0.2 / PX_PER_INVERSE_MM * random.gaussian();
            let mut matches = others(right, &mut random);
            let place = random.below(matches.len() + 1);
            matches.insert(place, found(right + noise, 0.99));
            (AmbiguousCorner { at, matches }, right)
        };
        (0..80).map(corner).unzip()
    }

    #[test]
    fn one_profile_decides_for_all_corners() {
        // Three other depths, at random, correlate nearly as well.
        let (corners, right) = corners(|right, random| {
            let off = |_| random.between(-20.0, 20.0) / PX_PER_INVERSE_MM;
            (0..3)
                .map(off)
                .map(|off| found(right + off, 0.96))
                .collect()
        });
        let agreed = agreed(&corners, PX_PER_INVERSE_MM);
        assert!(agreed.len() > 75, "{}", agreed.len());
        for (index, chosen) in agreed {
            let off = chosen.matched.ray.inverse_depth - right[index];
            assert!((off * PX_PER_INVERSE_MM).abs() < 2.0 * TOLERANCE_PX);
        }
    }

    #[test]
    fn repetition_has_no_single_profile() {
        for (apart_px, zncc) in [(12.0, 0.99), (12.0, 0.96), (-7.0, 0.95)] {
            let (corners, _) =
                corners(|right, _| vec![found(right + apart_px / PX_PER_INVERSE_MM, zncc)]);
            assert!(agreed(&corners, PX_PER_INVERSE_MM).is_empty());
        }
    }

    #[test]
    fn scattered_depths_have_no_profile() {
        let (mut corners, _) = corners(|_, _| Vec::new());
        let mut random = Random::seeded(9);
        for corner in &mut corners {
            let anywhere = random.between(1.0 / 2000.0, 1.0 / 400.0);
            corner.matches = vec![found(anywhere, 0.99)];
        }
        assert!(agreed(&corners, PX_PER_INVERSE_MM).is_empty());
        assert!(agreed(&[], PX_PER_INVERSE_MM).is_empty());
    }
}
