//! Frozen cameras: images that repeat the one before, to the last bit of noise.

use pulp::{Arch, NullaryFnOnce};

use super::CameraRefusal;

/// Memory of the last images, and of the cameras that were frozen then.
#[derive(Clone, Debug, Default)]
pub(super) struct FrozenCameras {
    fingerprints: Vec<u64>,
    was_frozen: Vec<bool>,
}

impl FrozenCameras {
    /// Marks cameras whose image equals the one before. The same frame set seen again gets the same
    /// result as the first time.
    pub(super) fn judge(&mut self, refusals: &mut [Option<CameraRefusal>], fingerprints: &[u64]) {
        if self.fingerprints == fingerprints {
            for (refusal, was_frozen) in refusals.iter_mut().zip(&self.was_frozen) {
                if *was_frozen {
                    *refusal = refusal.or(Some(CameraRefusal::Frozen));
                }
            }
            return;
        }
        mark_frozen(refusals, fingerprints, &self.fingerprints);
        let is_frozen = |refusal: &Option<CameraRefusal>| *refusal == Some(CameraRefusal::Frozen);
        self.fingerprints = fingerprints.to_vec();
        self.was_frozen = refusals.iter().map(is_frozen).collect();
    }
}

/// Marks cameras whose image equals its `last` fingerprint, if another camera's image has changed.
pub(super) fn mark_frozen(
    refusals: &mut [Option<CameraRefusal>],
    fingerprints: &[u64],
    last: &[u64],
) {
    if fingerprints.len() != last.len() {
        return;
    }
    let is_usable = |k: &usize| refusals[*k].is_none();
    let (same, changed): (Vec<usize>, Vec<usize>) = (0..refusals.len())
        .filter(is_usable)
        .partition(|k| fingerprints[*k] == last[*k]);
    // A camera that gave no image before has none that could have changed.
    let Fingerprint(none) = Fingerprint::default();
    if changed.iter().any(|k| last[*k] != none) {
        for k in same {
            refusals[k] = Some(CameraRefusal::Frozen);
        }
    }
}

/// Number that changes with any change of an image, made of those of its bands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint(pub u64);

impl Default for Fingerprint {
    /// Returns the fingerprint of a missing image.
    fn default() -> Self {
        Self(PRIME)
    }
}

impl Fingerprint {
    /// Adds the [`fingerprint`] of the next band.
    pub fn add(&mut self, part: u64) {
        self.0 = mix(self.0, part).rotate_left(29);
    }
}

const PRIME: u64 = 0x0000_0100_0000_01b3;
/// Number of words that are hashed together: vectors of any processor are filled, and none waits for
/// the one before.
const LANES: usize = 32;

fn mix(hash: u64, word: u64) -> u64 {
    (hash ^ word).wrapping_mul(PRIME)
}

/// Computes a number that changes with any change of the grey levels: Fowler, Noll and Vo's hash
/// over four bytes at a time, in 32 lanes, which are then hashed themselves.
pub fn fingerprint(grey: &[u8]) -> u64 {
    let mut lanes = [0x811c_9dc5_u32; LANES];
    Arch::new().dispatch(Hash {
        grey,
        lanes: &mut lanes,
    });
    let (_, rest) = grey.as_chunks::<{ 4 * LANES }>();
    let bytes = rest.iter().map(|byte| u64::from(*byte));
    let (pairs, _) = lanes.as_chunks::<2>();
    let words = pairs
        .iter()
        .map(|[a, b]| u64::from(*a) << 32 | u64::from(*b));
    let length = grey.len() as u64;
    words.chain(bytes).fold(length, mix)
}

/// Hash of all whole blocks of words.
struct Hash<'a> {
    grey: &'a [u8],
    lanes: &'a mut [u32; LANES],
}

impl NullaryFnOnce for Hash<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        const PRIME: u32 = 0x0100_0193;
        let mut lanes = *self.lanes;
        let (blocks, _) = self.grey.as_chunks::<{ 4 * LANES }>();
        for block in blocks {
            let (words, _) = block.as_chunks::<4>();
            for (lane, word) in lanes.iter_mut().zip(words) {
                let hash = (*lane ^ u32::from_le_bytes(*word)).wrapping_mul(PRIME);
                *lane = hash.rotate_left(15);
            }
        }
        *self.lanes = lanes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marked(fingerprints: &[u64], last: &[u64]) -> [Option<CameraRefusal>; 3] {
        let mut refusals = [None; 3];
        mark_frozen(&mut refusals, fingerprints, last);
        refusals
    }

    #[test]
    fn repeat_is_frozen_only_if_others_change() {
        let frozen = [Some(CameraRefusal::Frozen), None, None];
        assert_eq!(marked(&[1, 2, 3], &[1, 9, 8]), frozen);
        assert_eq!(marked(&[1, 2, 3], &[1, 2, 3]), [None; 3]);
        assert_eq!(marked(&[1, 2, 3], &[]), [None; 3]);
    }

    #[test]
    fn missing_images_are_no_change() {
        let mut refusals = [None, None, Some(CameraRefusal::Missing)];
        mark_frozen(&mut refusals, &[1, 2, 0], &[1, 2, 3]);
        assert_eq!(refusals, [None, None, Some(CameraRefusal::Missing)]);
        let Fingerprint(none) = Fingerprint::default();
        assert_eq!(marked(&[1, 2, 3], &[1, 2, none]), [None; 3]);
        let frozen = [Some(CameraRefusal::Frozen), None, None];
        assert_eq!(marked(&[1, 5, 3], &[1, 2, none]), frozen);
    }

    #[test]
    fn repeated_frame_set_gets_same_result() {
        let mut memory = FrozenCameras::default();
        let mut judged = |fingerprints: &[u64]| {
            let mut refusals = [None; 3];
            memory.judge(&mut refusals, fingerprints);
            refusals
        };
        assert_eq!(judged(&[1, 2, 3]), [None; 3]);
        let frozen = [None, Some(CameraRefusal::Frozen), None];
        assert_eq!(judged(&[4, 2, 5]), frozen);
        assert_eq!(judged(&[4, 2, 5]), frozen);
        assert_eq!(judged(&[6, 7, 8]), [None; 3]);
    }

    #[test]
    fn any_pixel_changes_fingerprint() {
        // Whole blocks, and a rest.
        let first: Vec<u8> = (0..3 * 4 * LANES + 35).map(|i| (i * 7) as u8).collect();
        let mut seen = vec![fingerprint(&first)];
        for i in 0..first.len() {
            for bit in [0, 7] {
                let mut other = first.clone();
                other[i] ^= 1 << bit;
                seen.push(fingerprint(&other));
            }
        }
        seen.extend([0, 1, 128].map(|length| fingerprint(&vec![0; length])));
        let of_bands = |parts: &[u64]| {
            let mut all = Fingerprint::default();
            parts.iter().for_each(|part| all.add(*part));
            all.0
        };
        seen.extend([&[1, 2][..], &[2, 1], &[1, 2, 0], &[]].map(of_bands));
        let count = seen.len();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), count);
    }
}
