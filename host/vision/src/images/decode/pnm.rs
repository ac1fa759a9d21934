//! Least length of a PNM file.

use image::codecs::pnm::{PnmHeader, PnmSubtype, SampleEncoding};

/// Returns the least size of the pixels of such a file, bytes.
pub(super) fn least_bytes(header: &PnmHeader) -> u64 {
    let [width, height] = [header.width(), header.height()].map(u64::from);
    let samples = width
        * u64::from(header.as_arbitrary().map_or_else(
            || match header.subtype() {
                PnmSubtype::Pixmap(_) => 3,
                _ => 1,
            },
            |header| header.depth,
        ));
    let sample_bytes = u64::from(header.maximal_sample() > 255) + 1;
    let row = match header.subtype() {
        PnmSubtype::Bitmap(SampleEncoding::Binary) => width.div_ceil(8),
        // Digits of 0 and 1 may follow each other without a space.
        PnmSubtype::Bitmap(SampleEncoding::Ascii) => width,
        // One digit, and a space between each two of them.
        PnmSubtype::Graymap(SampleEncoding::Ascii) | PnmSubtype::Pixmap(SampleEncoding::Ascii) => {
            return samples
                .saturating_mul(2)
                .saturating_mul(height)
                .saturating_sub(1);
        }
        _ => samples.saturating_mul(sample_bytes),
    };
    row.saturating_mul(height)
}
