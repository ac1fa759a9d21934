//! Frozen cameras: images that repeat the one before, to the last bit of noise.

use super::CameraRefusal;
use crate::images::Image;

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
    let none = fingerprint(&Image::missing());
    if changed.iter().any(|k| last[*k] != none) {
        for k in same {
            refusals[k] = Some(CameraRefusal::Frozen);
        }
    }
}

/// Computes a number that changes with any change of the image: Fowler, Noll and Vo's hash over
/// eight bytes at a time, in four lanes.
pub fn fingerprint(image: &Image) -> u64 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let mut lanes = [0xcbf2_9ce4_8422_2325_u64; 4];
    let (blocks, rest) = image.grey.as_chunks::<32>();
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
        let none = fingerprint(&Image::missing());
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
        let first = Image {
            width: 7,
            height: 5,
            grey: vec![100; 35],
        };
        for i in 0..first.grey.len() {
            let mut other = first.clone();
            other.grey[i] ^= 1;
            assert_ne!(fingerprint(&first), fingerprint(&other), "{i}");
        }
        assert_eq!(fingerprint(&first), fingerprint(&first.clone()));
    }
}
