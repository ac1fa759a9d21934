//! Checks of a file's claims before decoding, and refusals of files that end too early.

use super::*;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};

/// Image file of another program, with an APP0 segment.
const PHOTOGRAPH: &[u8] = include_bytes!("../../../../../tests/images/chessboard/left/01.jpg");
/// A progressive colour JPEG of 48 x 40 px.
const PROGRESSIVE: &[u8] = include_bytes!("tests/progressive.jpg");
/// Baseline JPEG of 48 x 40 px with an image of its own in its EXIF data.
const WITH_THUMBNAIL: &[u8] = include_bytes!("tests/thumbnail.jpg");

/// Returns a chunk of a PNG file, with its checksum.
fn chunk(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let mut sum = !0_u32;
    for byte in name.iter().chain(content) {
        sum ^= u32::from(*byte);
        for _ in 0..8 {
            sum = (sum >> 1) ^ (0xEDB8_8320 & (sum & 1).wrapping_neg());
        }
    }
    let length = (content.len() as u32).to_be_bytes();
    [&length, &name[..], content, &(!sum).to_be_bytes()].concat()
}

/// Returns a PNG header: size, bits per sample, kind of colour.
fn header(width: u32, height: u32, kind: [u8; 2]) -> Vec<u8> {
    let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
    chunk(b"IHDR", &[&size[..], &kind, &[0; 3]].concat())
}

fn png(chunks: &[Vec<u8>]) -> Vec<u8> {
    [&b"\x89PNG\r\n\x1a\n"[..], &chunks.concat()].concat()
}

/// Returns a small grey PNG in one piece per chunk: signature with header, data, end.
fn small_png() -> Vec<u8> {
    let mut file = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut file);
    let grey: Vec<u8> = (0..96).collect();
    encoder
        .write_image(&grey, 12, 8, ExtendedColorType::L8)
        .unwrap();
    file
}

/// Returns a zlib stream of `length` zeros, stored.
fn stored_zeros(length: u16) -> Vec<u8> {
    let sizes = [length.to_le_bytes(), (!length).to_le_bytes()].concat();
    let zeros = vec![0; usize::from(length)];
    let sum = u32::from(length) << 16 | 1;
    [&[0x78, 1, 1][..], &sizes, &zeros, &sum.to_be_bytes()].concat()
}

fn refusal(bytes: &[u8]) -> Refusal {
    decode(bytes, None).unwrap_err()
}

#[test]
fn claimed_size_is_checked_first() {
    let huge = png(&[header(400_000, 400_000, [8, 0]), chunk(b"IEND", b"")]);
    assert_eq!(refusal(&huge), Refusal::TooLarge(400_000, 400_000));
    assert_eq!(
        refusal(b"P5 70000 70000 255\n"),
        Refusal::TooLarge(70_000, 70_000)
    );
    let mut jpeg = PHOTOGRAPH.to_vec();
    let frame = jpeg
        .windows(2)
        .position(|pair| pair == [0xFF, 0xC0])
        .unwrap();
    jpeg[frame + 5..frame + 9].fill(0xFF);
    assert_eq!(refusal(&jpeg), Refusal::TooLarge(65_535, 65_535));
    let (given, wanted) = ([12, 8], [8, 12]);
    assert_eq!(
        decode(&small_png(), Some(wanted)),
        Err(Refusal::OtherSize { given, wanted })
    );
}

#[test]
fn empty_image_is_refused() {
    assert_eq!(refusal(b"P5 0 1 255\n"), Refusal::Empty(0, 1));
    assert_eq!(refusal(b"P5 1 0 255\n"), Refusal::Empty(1, 0));
    let empty = png(&[header(0, 7, [8, 0]), chunk(b"IEND", b"")]);
    assert_eq!(refusal(&empty), Refusal::Empty(0, 7));
    let mut jpeg = PHOTOGRAPH.to_vec();
    let frame = jpeg
        .windows(2)
        .position(|pair| pair == [0xFF, 0xC0])
        .unwrap();
    jpeg[frame + 5..frame + 7].fill(0);
    assert_eq!(refusal(&jpeg), Refusal::Empty(640, 0));
}

#[test]
fn too_short_file_is_refused() {
    let short = Refusal::CutOff("it is too short for an image of its size");
    for head in [
        "P5 6000 6000 255\n",
        "P6 5000 5000 65535\n1234",
        "P4 6000 6000\n",
        "P2 99 99 9\n",
    ] {
        assert_eq!(refusal(head.as_bytes()), short, "{head}");
    }
    let grey = header(6_000, 6_000, [16, 0]);
    assert_eq!(
        refusal(&png(&[
            grey,
            chunk(b"IDAT", &stored_zeros(9)),
            chunk(b"IEND", b"")
        ])),
        short
    );
    for file in [PHOTOGRAPH, PROGRESSIVE] {
        let mut jpeg = file.to_vec();
        let is_frame = |pair: &[u8]| matches!(pair, [0xFF, 0xC0 | 0xC2]);
        let frame = jpeg.windows(2).position(is_frame).unwrap();
        jpeg[frame + 5..frame + 9].copy_from_slice(&[0x17, 0x70, 0x17, 0x70]);
        assert_eq!(refusal(&jpeg), short);
    }
}

#[test]
fn memory_is_checked_first() {
    let file = small_png();
    for (extra, fits) in [(0, true), (MEMORY, false)] {
        let judge = Judge {
            length: file.len() as u64,
            size_px: None,
            extra,
        };
        let decoder = PngDecoder::new(Cursor::new(&file)).unwrap();
        let outcome = judge.decode(decoder);
        assert_eq!(outcome.is_ok(), fits, "{outcome:?}");
        assert_eq!(matches!(outcome, Err(Refusal::TooMuchMemory(_))), !fits);
    }
    // All coefficients of a progressive image are kept: three blocks for each 8 x 8 px.
    let frame = jpeg::frame(PROGRESSIVE).unwrap();
    assert_eq!(frame.coefficient_bytes(), 3 * 48 * 40 * 2);
    assert_eq!(jpeg::frame(PHOTOGRAPH).unwrap().coefficient_bytes(), 0);
}

#[test]
fn png_metadata_is_not_read() {
    let plain = small_png();
    // After signature and header, and before the end.
    let (head, tail) = plain.split_at(8 + 25);
    let wrong = chunk(b"iCCP", b"profile\0\0no deflate stream");
    let text = chunk(b"zTXt", b"key\0\0no deflate stream");
    let file = [head, &wrong, &text, tail].concat();
    assert_eq!(png::without_metadata(&file).unwrap(), plain);
    assert!(matches!(
        png::without_metadata(&plain).unwrap(),
        std::borrow::Cow::Borrowed(_)
    ));
    assert_eq!(decode(&file, None), decode(&plain, None));
}

#[test]
fn malformed_palette_is_refused() {
    let file = png(&[
        header(2, 2, [8, 3]),
        chunk(b"PLTE", &[1, 2, 3, 4]),
        chunk(b"IDAT", &stored_zeros(6)),
        chunk(b"IEND", b""),
    ]);
    assert!(
        refusal(&file).to_string().contains("palette"),
        "{}",
        refusal(&file)
    );
}

#[track_caller]
fn whole_but_not_cut(file: &[u8], size_px: [u32; 2]) {
    let whole = decode(file, Some(size_px)).unwrap();
    for permille in (300..=999).chain([1]) {
        let cut = &file[..file.len() * permille / 1000];
        assert!(decode(cut, Some(size_px)).is_err(), "{permille} per mille");
    }
    for lost in 1..40 {
        assert!(
            decode(&file[..file.len() - lost], Some(size_px)).is_err(),
            "{lost} bytes"
        );
    }
    let padded = [file, &[0; 5000], b"\xFF\xD8\xFF"].concat();
    assert_eq!(decode(&padded, Some(size_px)).unwrap(), whole);
}

#[test]
fn truncated_jpeg_is_refused() {
    whole_but_not_cut(PHOTOGRAPH, [640, 480]);
    whole_but_not_cut(PROGRESSIVE, [48, 40]);
    whole_but_not_cut(WITH_THUMBNAIL, [48, 40]);
    let mut grey = Vec::new();
    let pixels: Vec<u8> = (0..40 * 48).map(|i| (i * i % 251) as u8).collect();
    JpegEncoder::new_with_quality(&mut grey, 95)
        .encode(&pixels, 40, 48, ExtendedColorType::L8)
        .unwrap();
    whole_but_not_cut(&grey, [40, 48]);
}

#[test]
fn jpeg_cut_before_another_is_refused() {
    let half = &PHOTOGRAPH[..PHOTOGRAPH.len() / 2];
    for rest in [PHOTOGRAPH, &[0; 40_000]] {
        let file = [half, rest].concat();
        assert_eq!(
            refusal(&file),
            Refusal::CutOff("its end-of-image marker is missing")
        );
    }
}

#[test]
fn endless_jpeg_scans_are_refused() {
    let scan = PROGRESSIVE
        .windows(2)
        .rposition(|pair| pair == [0xFF, 0xDA])
        .unwrap();
    let (file, end) = PROGRESSIVE.split_at(PROGRESSIVE.len() - 2);
    let file = [file, &file[scan..].repeat(100), end].concat();
    assert!(
        refusal(&file).to_string().contains("scans"),
        "{}",
        refusal(&file)
    );
}

#[test]
fn truncated_png_and_pnm_are_refused() {
    let png = small_png();
    for length in 0..png.len() {
        assert!(decode(&png[..length], None).is_err(), "{length}");
    }
    let pgm = b"P5 3 2 255\nabcdef";
    for length in 0..pgm.len() {
        assert!(decode(&pgm[..length], None).is_err(), "{length}");
    }
    assert!(decode(pgm, None).is_ok());
}

#[test]
fn other_formats_are_refused() {
    for bytes in [&b"GIF89a"[..], b"text", b"BZh9"] {
        assert!(
            refusal(bytes)
                .to_string()
                .contains("none of PNG, JPEG, PNM, TIFF, BMP and WebP")
        );
    }
}

#[test]
fn empty_file_is_named() {
    assert!(refusal(b"").to_string().contains("the file is empty"));
}

/// Returns a BigTIFF file of 2 x 2 px with these bits per value, format and pixels.
fn big_tiff(bits: u64, format: u64, pixels: &[u8]) -> Vec<u8> {
    let fields = [
        (256, 2),
        (257, 2),
        (258, bits),
        (259, 1),
        (262, 1),
        (273, 16),
        (277, 1),
        (278, 2),
        (279, pixels.len() as u64),
        (339, format),
    ];
    let mut file = b"II\x2b\0\x08\0\0\0".to_vec();
    file.extend((16 + pixels.len() as u64).to_le_bytes());
    file.extend(pixels);
    file.extend((fields.len() as u64).to_le_bytes());
    for (tag, value) in fields {
        file.extend(u16::to_le_bytes(tag));
        file.extend(16_u16.to_le_bytes());
        file.extend(1_u64.to_le_bytes());
        file.extend(u64::to_le_bytes(value));
    }
    file.extend([0; 8]);
    file
}

#[test]
fn big_tiff_is_read() {
    let picture = decode_deep(&big_tiff(16, 1, &[1, 2, 3, 4, 5, 6, 7, 8]), Some([2, 2])).unwrap();
    let Picture::Sixteen { levels, .. } = picture else {
        panic!("16 bits");
    };
    assert_eq!(levels, [0x201, 0x403, 0x605, 0x807]);
}

#[test]
fn tiff_of_other_values_is_refused() {
    for (bits, format, said) in [
        (32, 3, "floating-point numbers of 32 bits"),
        (64, 3, "floating-point numbers of 64 bits"),
        (32, 1, "whole numbers of 32 bits"),
        (16, 2, "signed numbers of 16 bits"),
    ] {
        let pixels = vec![1; 4 * bits as usize / 8];
        let refusal = refusal(&big_tiff(bits, format, &pixels)).to_string();
        assert!(
            refusal.contains(said) && refusal.contains("save as 16 bits"),
            "{refusal}"
        );
    }
}

/// Returns the file without the last part of its compressed data, but with an end-of-image marker.
fn closed_after(file: &[u8], length: usize) -> Vec<u8> {
    let mut cut = file[..length].to_vec();
    if cut.last() == Some(&0xFF) {
        cut.pop();
    }
    [&cut[..], b"\xFF\xD9"].concat()
}

#[test]
fn jpeg_without_last_block_is_refused() {
    let mut grey = Vec::new();
    let pixels: Vec<u8> = (0..40 * 48).map(|i| (i * i % 251) as u8).collect();
    JpegEncoder::new_with_quality(&mut grey, 95)
        .encode(&pixels, 40, 48, ExtendedColorType::L8)
        .unwrap();
    for file in [PHOTOGRAPH, PROGRESSIVE, WITH_THUMBNAIL, &grey] {
        assert!(decode(file, None).is_ok());
        for permille in (50..=990).step_by(10) {
            let cut = closed_after(file, file.len() * permille / 1000);
            let refusal = decode(&cut, None);
            assert!(refusal.is_err(), "{permille} per mille of {}", file.len());
        }
        for lost in 4..40 {
            let cut = closed_after(file, file.len() - 2 - lost);
            assert!(decode(&cut, None).is_err(), "{lost} of {}", file.len());
        }
    }
}

#[test]
fn jpeg_without_middle_is_refused() {
    for file in [PHOTOGRAPH, PROGRESSIVE, WITH_THUMBNAIL] {
        for lost in [file.len() / 10, file.len() / 4] {
            let end = file.len() * 9 / 10;
            let rest = [&file[..end - lost], &file[end..]].concat();
            assert!(decode(&rest, None).is_err(), "{lost} of {}", file.len());
        }
    }
}

#[test]
fn jpeg_without_last_scans_is_refused() {
    let scans = PROGRESSIVE.windows(2).enumerate();
    let scans = scans.filter(|(_, pair)| *pair == [0xFF, 0xDA]);
    let starts: Vec<usize> = scans.map(|(at, _)| at).collect();
    assert!(starts.len() > 4);
    for start in &starts[1..] {
        let refusal = refusal(&closed_after(PROGRESSIVE, *start));
        assert!(matches!(refusal, Refusal::CutOff(_)), "{start}: {refusal}");
    }
}

#[test]
fn unread_jpeg_kind_is_named() {
    for (marker, kind) in [
        (0xC9, "arithmetic-coded"),
        (0xCA, "arithmetic"),
        (0xC3, "lossless"),
    ] {
        let mut file = PHOTOGRAPH.to_vec();
        let frame = file.windows(2).position(|pair| pair == [0xFF, 0xC0]);
        file[frame.unwrap() + 1] = marker;
        let text = refusal(&file).to_string();
        assert!(text.contains(kind) && text.contains("PNG"), "{text}");
    }
}
