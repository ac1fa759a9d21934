//! Grey pixel formats of GenICam cameras, unpacked to their full depth.
//!
//! The names and layouts are those of GenICam's Pixel Format Naming Convention (PFNC):
//!
//! | format | layout |
//! |---|---|
//! | `Mono8` | one byte per pixel |
//! | `Mono10`, `Mono12`, `Mono16` | two bytes per pixel, little-endian, value in the low bits |
//! | `Mono10Packed`, `Mono12Packed` | GigE Vision's: two pixels in three bytes, high bits first |
//! | `Mono10p`, `Mono12p` | a stream of bits, low bits first, without gaps |
//!
//! The three bytes of the GigE Vision formats are the high eight bits of the first pixel, the low
//! bits of both (the first pixel's from bit 0, the second pixel's from bit 4), and the high eight
//! bits of the second pixel.

use super::grey::{Unreadable, rows};
use crate::images::Image;

/// Grey pixel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mono {
    /// 8 bits in a byte.
    Mono8,
    /// 10 bits in two bytes.
    Mono10,
    /// 12 bits in two bytes.
    Mono12,
    /// 16 bits in two bytes.
    Mono16,
    /// Two pixels of 10 bits in three bytes.
    Mono10Packed,
    /// Two pixels of 12 bits in three bytes.
    Mono12Packed,
    /// Stream of 10 bits per pixel.
    Mono10p,
    /// Stream of 12 bits per pixel.
    Mono12p,
}

impl Mono {
    /// All formats, those with the fewest bytes first: the images are compared in 8 bits.
    pub const ALL: [Self; 8] = [
        Self::Mono8,
        Self::Mono10p,
        Self::Mono10Packed,
        Self::Mono12p,
        Self::Mono12Packed,
        Self::Mono10,
        Self::Mono12,
        Self::Mono16,
    ];

    /// Returns the PFNC name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::Mono10 => "Mono10",
            Self::Mono12 => "Mono12",
            Self::Mono16 => "Mono16",
            Self::Mono10Packed => "Mono10Packed",
            Self::Mono12Packed => "Mono12Packed",
            Self::Mono10p => "Mono10p",
            Self::Mono12p => "Mono12p",
        }
    }

    /// Returns the format with this PFNC name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// Returns the number of bits of a pixel's value.
    pub const fn depth(self) -> u32 {
        match self {
            Self::Mono8 => 8,
            Self::Mono10 | Self::Mono10Packed | Self::Mono10p => 10,
            Self::Mono12 | Self::Mono12Packed | Self::Mono12p => 12,
            Self::Mono16 => 16,
        }
    }

    /// Returns the number of bytes that hold `pixels` pixels.
    const fn bytes(self, pixels: usize) -> usize {
        match self {
            Self::Mono8 => pixels,
            Self::Mono10 | Self::Mono12 | Self::Mono16 => pixels.saturating_mul(2),
            Self::Mono10Packed | Self::Mono12Packed | Self::Mono12p => {
                pixels.saturating_mul(3).div_ceil(2)
            }
            Self::Mono10p => pixels.saturating_mul(5).div_ceil(4),
        }
    }

    /// Returns the values of an image of `width` by `height` pixels, at full depth. `gap` bytes
    /// follow each row; without a gap, a packed row may begin within a byte.
    ///
    /// # Errors
    /// [`Unreadable::Short`] if bytes are missing.
    pub fn levels(
        self,
        bytes: &[u8],
        size: [usize; 2],
        gap: usize,
    ) -> Result<Vec<u16>, Unreadable> {
        self.pixels(bytes, size, gap, |level| level)
    }

    /// Converts an image to the 8 bits in which images are compared: the high bits of each value.
    ///
    /// # Errors
    /// As [`Mono::levels`].
    pub fn to_grey(
        self,
        bytes: &[u8],
        [width, height]: [usize; 2],
        gap: usize,
    ) -> Result<Image, Unreadable> {
        let shift = self.depth() - 8;
        let grey = self.pixels(bytes, [width, height], gap, |level| (level >> shift) as u8)?;
        Ok(Image {
            width,
            height,
            grey,
        })
    }

    /// Returns what `convert` makes of each value.
    fn pixels<T>(
        self,
        bytes: &[u8],
        [width, height]: [usize; 2],
        gap: usize,
        convert: impl Fn(u16) -> T,
    ) -> Result<Vec<T>, Unreadable> {
        // Rows without gaps are one long row.
        let (row, count) = match gap {
            0 => (width.saturating_mul(height), 1),
            _ => (width, height),
        };
        let row_bytes = self.bytes(row);
        let rows = rows(bytes, row_bytes, row_bytes.saturating_add(gap), count)?;
        let mut pixels = Vec::with_capacity(row.saturating_mul(count));
        for bytes in rows {
            let end = pixels.len() + row;
            self.unpack(bytes, |level| pixels.push(convert(level)));
            // The last byte may hold a second pixel that is none.
            pixels.truncate(end);
        }
        Ok(pixels)
    }

    fn unpack(self, bytes: &[u8], mut push: impl FnMut(u16)) {
        let pair = |low: u8, high: u8| u16::from_le_bytes([low, high]);
        match self {
            Self::Mono8 => bytes.iter().for_each(|byte| push(u16::from(*byte))),
            Self::Mono10 | Self::Mono12 | Self::Mono16 => {
                let mask = u16::MAX >> (16 - self.depth());
                let values = bytes.chunks_exact(2).map(|two| pair(two[0], two[1]) & mask);
                values.for_each(push);
            }
            Self::Mono10Packed | Self::Mono12Packed => {
                let low = self.depth() - 8;
                let mask = (1 << low) - 1;
                for group in bytes.chunks(3) {
                    let byte = |k: usize| u16::from(group.get(k).copied().unwrap_or(0));
                    push(byte(0) << low | byte(1) & mask);
                    push(byte(2) << low | byte(1) >> 4 & mask);
                }
            }
            Self::Mono10p | Self::Mono12p => {
                let (mut bits, mut count) = (0u32, 0);
                for byte in bytes {
                    bits |= u32::from(*byte) << count;
                    count += 8;
                    if count >= self.depth() {
                        push((bits & ((1 << self.depth()) - 1)) as u16);
                        bits >>= self.depth();
                        count -= self.depth();
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes and values by hand from the PFNC's figures of each layout. The bits of a value are
    /// named from high to low: 0x2AB of 10 bits is 10 1010 1011.
    const VECTORS: [(Mono, &[u8], &[u16]); 8] = [
        (Mono::Mono8, &[0x00, 0x7F, 0xFF], &[0x00, 0x7F, 0xFF]),
        (
            Mono::Mono10,
            &[0xAB, 0x02, 0x54, 0x01, 0xFF, 0x03],
            &[0x2AB, 0x154, 0x3FF],
        ),
        (
            Mono::Mono12,
            &[0xBC, 0x0A, 0x23, 0x01, 0xFF, 0x0F],
            &[0xABC, 0x123, 0xFFF],
        ),
        (
            Mono::Mono16,
            &[0xCD, 0xAB, 0x34, 0x12, 0xFF, 0xFF],
            &[0xABCD, 0x1234, 0xFFFF],
        ),
        // 0x2AB: high byte 0xAA, low bits 3; 0x155: high byte 0x55, low bits 1, at bit 4.
        (
            Mono::Mono10Packed,
            &[0xAA, 0x13, 0x55, 0xFF, 0x03],
            &[0x2AB, 0x155, 0x3FF],
        ),
        // 0xABC: high byte 0xAB, low bits 0xC; 0x123: high byte 0x12, low bits 3, at bit 4.
        (
            Mono::Mono12Packed,
            &[0xAB, 0x3C, 0x12, 0xFE, 0x0D],
            &[0xABC, 0x123, 0xFED],
        ),
        // Five bytes hold four values: 0x2AB, 0x154, 0x3FF, 0x001 from the lowest bit on.
        (
            Mono::Mono10p,
            &[0xAB, 0x52, 0xF5, 0x7F, 0x00],
            &[0x2AB, 0x154, 0x3FF, 0x001],
        ),
        // Three bytes hold two values: low byte of the first, its high and the second's low four
        // bits, high byte of the second.
        (
            Mono::Mono12p,
            &[0xBC, 0x3A, 0x12, 0xED, 0x0F],
            &[0xABC, 0x123, 0xFED],
        ),
    ];

    #[test]
    fn layouts_give_full_depth() {
        for (format, bytes, values) in VECTORS {
            let levels = format.levels(bytes, [values.len(), 1], 0);
            assert_eq!(levels.as_deref(), Ok(values), "{format:?}");
            let grey = format.to_grey(bytes, [values.len(), 1], 0).unwrap().grey;
            let high = values.iter().map(|value| value >> (format.depth() - 8));
            assert!(high.eq(grey.into_iter().map(u16::from)), "{format:?}");
            let short = &bytes[..bytes.len() - 1];
            let [given, needed] = [short.len(), bytes.len()];
            assert_eq!(
                format.levels(short, [values.len(), 1], 0),
                Err(Unreadable::Short { given, needed }),
                "{format:?}"
            );
        }
    }

    /// Packs by the definition: each value's bits one by one.
    fn packed(format: Mono, values: &[u16]) -> Vec<u8> {
        let mut bytes = vec![0; format.bytes(values.len())];
        for (index, value) in values.iter().enumerate() {
            for bit in 0..format.depth() {
                let is_set = value >> bit & 1;
                let low = format.depth().saturating_sub(8);
                let place = match format {
                    Mono::Mono10Packed | Mono::Mono12Packed => {
                        let second = index as u32 % 2;
                        let group = index as u32 / 2 * 24;
                        match bit < low {
                            true => group + 8 + 4 * second + bit,
                            false => group + 16 * second + bit - low,
                        }
                    }
                    Mono::Mono10p | Mono::Mono12p => index as u32 * format.depth() + bit,
                    Mono::Mono8 => index as u32 * 8 + bit,
                    _ => index as u32 * 16 + bit,
                };
                bytes[place as usize / 8] |= (is_set as u8) << (place % 8);
            }
        }
        bytes
    }

    #[test]
    fn all_values_survive_packing() {
        for format in Mono::ALL {
            // Odd sizes leave a group of pixels unfinished.
            let [width, height] = [277, 239];
            let mask = u16::MAX >> (16 - format.depth());
            let values: Vec<u16> = (0..width * height).map(|n| n as u16 & mask).collect();
            let bytes = packed(format, &values);
            let levels = format.levels(&bytes, [width, height], 0);
            assert_eq!(levels.as_ref(), Ok(&values), "{format:?}");
            let rows = values.chunks(width).flat_map(|row| {
                let mut row = packed(format, row);
                row.extend([0xA5; 3]);
                row
            });
            let rows: Vec<u8> = rows.collect();
            let levels = format.levels(&rows, [width, height], 3);
            assert_eq!(levels.as_ref(), Ok(&values), "{format:?}");
        }
    }

    #[test]
    fn names_lead_back() {
        for format in Mono::ALL {
            assert_eq!(Mono::named(format.name()), Some(format));
            assert!(trinocular_rig::rig_file::capture::PIXEL_FORMATS.contains(&format.name()));
        }
        assert_eq!(Mono::named("BayerRG8"), None);
        assert_eq!(Mono::Mono8.levels(&[], [0, 0], 0), Ok(Vec::new()));
        assert_eq!(Mono::Mono10p.levels(&[0; 8], [0, 5], 2), Ok(Vec::new()));
    }
}
