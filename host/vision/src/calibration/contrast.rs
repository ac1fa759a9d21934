//! Contrast of a photograph, stretched for the search of a board.
//!
//! The search takes corners of at least a dozen grey levels, so that noise makes none. Photographs
//! in little light have fewer levels, and less noise in proportion.

use std::borrow::Cow;

use crate::images::Image;

/// Share of the pixels that may be darker than the darkest level, or brighter than the brightest.
const SHARE: f64 = 0.02;
/// Grey levels between darkest and brightest from which an image stays as it is.
const ENOUGH: u8 = 100;
/// Largest factor, at which a step of one grey level is just too small for a corner.
const MOST: f64 = 10.0;

/// Returns the image with its grey levels stretched to the whole range; unchanged if they use most of
/// it.
pub fn stretched(image: &Image) -> Cow<'_, Image> {
    let mut counts = [0_usize; 256];
    for level in &image.grey {
        counts[usize::from(*level)] += 1;
    }
    let few = (SHARE * image.grey.len() as f64) as usize;
    let low = first_beyond(&counts, few, 0..256);
    let high = first_beyond(&counts, few, (0..256).rev());
    let (Some(low), Some(high)) = (low, high) else {
        return Cow::Borrowed(image);
    };
    if high >= low + usize::from(ENOUGH) || high <= low {
        return Cow::Borrowed(image);
    }
    let factor = (255.0 / (high - low) as f64).min(MOST);
    let levels: [u8; 256] =
        std::array::from_fn(|level| (factor * (level as f64 - low as f64)).clamp(0.0, 255.0) as u8);
    Cow::Owned(Image {
        width: image.width,
        height: image.height,
        grey: (image.grey.iter())
            .map(|level| levels[usize::from(*level)])
            .collect(),
    })
}

/// Returns the first of `levels` up to which, itself included, there are more than `few` pixels.
fn first_beyond(
    counts: &[usize; 256],
    few: usize,
    mut levels: impl Iterator<Item = usize>,
) -> Option<usize> {
    let mut sum = 0;
    levels.find(|level| {
        sum += counts[*level];
        sum > few
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(grey: Vec<u8>) -> Image {
        Image {
            width: grey.len(),
            height: 1,
            grey,
        }
    }

    #[test]
    fn narrow_range_is_stretched() {
        // A lamp and a dead pixel do not count.
        let mut grey: Vec<u8> = (0..400).map(|i| 100 + (i % 50) as u8).collect();
        grey[0] = 255;
        grey[1] = 0;
        let image = image(grey);
        let found = stretched(&image);
        assert_eq!((found.grey[0], found.grey[1]), (255, 0));
        let [low, high] = [110, 139].map(|i| found.grey[i]);
        assert!(low > 40 && low < 60 && high > 190, "{low} {high}");
    }

    #[test]
    fn wide_range_and_even_grey_stay() {
        for grey in [(0..=255).collect(), vec![7; 100], Vec::new()] {
            let image = image(grey);
            assert_eq!(*stretched(&image), image);
        }
    }
}
