//! Grey levels at the depth of their file, and the scale from them to 8 bits.
//!
//! Cameras of 10, 12 and 14 bits store their values in 16-bit files, whose upper bits are then
//! zero. The scale follows the bits in use, so that such images are not black.

use super::super::Image;

/// Widths of the values of cameras, bits.
const DEPTHS: [u32; 5] = [8, 10, 12, 14, 16];
/// Steps of 16 bits that count as full scale: 12-bit values may be stored in the upper bits.
const FULL_SCALE: u16 = u16::MAX - 63;

/// Grey image of 8 or 16 bits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Picture {
    /// Values of 8 bits.
    Eight(Image),
    /// Values of 16 bits, of which the upper ones may be unused.
    Sixteen {
        /// Number of columns.
        width: usize,
        /// Number of rows.
        height: usize,
        /// `width * height` grey levels, row by row.
        levels: Vec<u16>,
    },
}

impl Picture {
    /// Returns width and height, px.
    pub fn size_px(&self) -> [u32; 2] {
        let (width, height) = match self {
            Self::Eight(image) => (image.width, image.height),
            Self::Sixteen { width, height, .. } => (*width, *height),
        };
        [width as u32, height as u32]
    }

    /// Returns the number of bits in use: 8, 10, 12, 14 or 16. An 8-bit image uses 8.
    pub fn bits_in_use(&self) -> u32 {
        let Self::Sixteen { levels, .. } = self else {
            return DEPTHS[0];
        };
        let highest = levels.iter().fold(0, |all, level| all | level);
        let bits = u16::BITS - highest.leading_zeros();
        let depth = DEPTHS.into_iter().find(|depth| *depth >= bits);
        depth.unwrap_or(u16::BITS)
    }

    /// Returns the share of pixels at the end of the scale of `bits` bits; 0 for an 8-bit image.
    pub fn saturated(&self, bits: u32) -> f64 {
        let Self::Sixteen { levels, .. } = self else {
            return 0.0;
        };
        let end = match bits {
            16.. => FULL_SCALE,
            bits => (1 << bits) - 1,
        };
        let count = levels.iter().filter(|level| **level >= end).count();
        count as f64 / levels.len().max(1) as f64
    }

    /// Returns the image with 16-bit values divided by `2^(bits - 8)`. Values beyond `bits` bits
    /// become 255.
    ///
    /// The quotient is rounded down: so 8-bit values that were widened in any usual way (times 16,
    /// 256, 257 or 4095/255, rounded) come back as they were.
    pub fn scaled(self, bits: u32) -> Image {
        match self {
            Self::Eight(image) => image,
            Self::Sixteen {
                width,
                height,
                levels,
            } => {
                let shift = bits.clamp(8, 16) - 8;
                let narrow = |level: &u16| (*level >> shift).min(255) as u8;
                let grey = levels.iter().map(narrow).collect();
                Image {
                    width,
                    height,
                    grey,
                }
            }
        }
    }
}

/// Returns the most bits in use in the images of a frame set, `so_far` or more.
pub fn bits_in_use(views: &[Picture], so_far: u32) -> u32 {
    let bits = views.iter().map(Picture::bits_in_use);
    bits.fold(so_far, u32::max)
}

/// Describes the scale of 16-bit images that use `bits` bits, 8 to 16.
pub fn scale(bits: u32) -> String {
    let divisor = 1 << (bits.clamp(8, 16) - 8);
    format!("16-bit images that use {bits} bits; values are divided by {divisor}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(levels: Vec<u16>) -> Picture {
        Picture::Sixteen {
            width: levels.len(),
            height: 1,
            levels,
        }
    }

    #[test]
    fn bits_in_use_follow_highest_value() {
        for (highest, bits) in [
            (0, 8),
            (255, 8),
            (256, 10),
            (1023, 10),
            (4095, 12),
            (4096, 14),
            (16_384, 16),
            (65_535, 16),
        ] {
            assert_eq!(picture(vec![0, highest]).bits_in_use(), bits, "{highest}");
        }
    }

    #[test]
    fn scaled_values_equal_those_of_8_bits() {
        let eight: Vec<u16> = (0..=255).collect();
        for bits in [10, 12, 14, 16] {
            let steps = 1_u32 << (bits - 8);
            let deep = eight.iter().map(|grey| (u32::from(*grey) * steps) as u16);
            let scaled = picture(deep.collect()).scaled(bits);
            let same = scaled.grey.iter().zip(&eight);
            assert!(same.into_iter().all(|(a, b)| u16::from(*a) == *b), "{bits}");
        }
        assert_eq!(picture(vec![5000]).scaled(12).grey, [255]);
        for (bits, factor) in [
            (16, 257.0),
            (16, 256.0),
            (12, 4095.0 / 255.0),
            (10, 1023.0 / 255.0),
        ] {
            let wide = eight
                .iter()
                .map(|grey| (f64::from(*grey) * factor).round() as u16);
            let scaled = picture(wide.collect()).scaled(bits);
            assert!(
                scaled.grey.iter().copied().eq(0..=255),
                "{bits} bits, times {factor}"
            );
        }
    }

    #[test]
    fn saturated_share_is_counted() {
        let picture = picture(vec![4095, 0, 100, 4095]);
        assert_eq!(picture.saturated(12), 0.5);
        assert_eq!(picture.saturated(14), 0.0);
    }
}
