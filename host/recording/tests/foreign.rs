//! Images of other programs: their depth, repeated messages, and stamps without an order.

use mcap::WriteOptions;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Cursor;
use std::path::Path;
use trinocular_recording::cdr::Writer;
use trinocular_recording::read::Source;
use trinocular_recording::read::frames::{FrameSets, TOLERANCE_US, Topics};
use trinocular_recording::read::survey::Survey;
use trinocular_vision::images::FrameSet;

const CAMERAS: [&str; 3] = ["left", "middle", "right"];
const SIZE: [u32; 2] = [16, 16];
const PERIOD_NS: u64 = 100_000_000;

/// Topic of a camera's images.
fn topic(camera: &str) -> String {
    format!("/{camera}/image_raw")
}

/// Grey levels of a camera's image; all 256 occur.
fn grey(number: u64, camera: usize) -> Vec<u8> {
    let level = |place: u64| (place * (2 * camera as u64 + 3) + number) as u8;
    (0..256).map(level).collect()
}

fn header(writer: &mut Writer<'_>, stamp_ns: u64) {
    writer.i32((stamp_ns / 1_000_000_000) as i32);
    writer.u32((stamp_ns % 1_000_000_000) as u32);
    writer.text("optical");
}

/// `sensor_msgs/msg/Image` with the levels shifted left by `bits - 8`.
fn raw(stamp_ns: u64, grey: &[u8], bits: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes);
    header(&mut writer, stamp_ns);
    writer.u32(SIZE[1]);
    writer.u32(SIZE[0]);
    writer.text(if bits == 8 { "mono8" } else { "mono16" });
    writer.u8(0);
    writer.u32(SIZE[0] * if bits == 8 { 1 } else { 2 });
    match bits {
        8 => writer.block(grey),
        _ => {
            let levels = grey.iter().map(|grey| u16::from(*grey) << (bits - 8));
            writer.block(&levels.flat_map(u16::to_le_bytes).collect::<Vec<u8>>());
        }
    }
    bytes
}

/// `sensor_msgs/msg/CompressedImage`: a 16-bit PNG file with the levels shifted left by `bits - 8`.
fn png(stamp_ns: u64, grey: &[u8], bits: u32) -> Vec<u8> {
    let levels = grey.iter().map(|grey| u16::from(*grey) << (bits - 8));
    let image =
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(SIZE[0], SIZE[1], levels.collect());
    let mut file = Cursor::new(Vec::new());
    let image: image::DynamicImage = image.expect("its size").into();
    image.write_to(&mut file, image::ImageFormat::Png).unwrap();
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes);
    header(&mut writer, stamp_ns);
    writer.text("16UC1; png compressed ");
    writer.block(file.get_ref());
    bytes
}

/// Writes messages, each with the index of its camera, as a file of another program.
fn write(path: &Path, kind: &str, messages: impl IntoIterator<Item = (usize, Vec<u8>)>) {
    let file = File::create(path).expect("a place");
    let mut writer = WriteOptions::new().compression(None).create(file).unwrap();
    let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
    let channels = CAMERAS.map(|camera| {
        let channel = writer.add_channel(schema, &topic(camera), "cdr", &BTreeMap::new());
        channel.expect("a channel")
    });
    for (sequence, (camera, data)) in messages.into_iter().enumerate() {
        let header = MessageHeader {
            channel_id: channels[camera],
            sequence: sequence as u32,
            log_time: sequence as u64,
            publish_time: sequence as u64,
        };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
}

/// Camera, stamp and levels of each image of `count` frame sets, in their order.
fn shots(count: u64) -> impl Iterator<Item = (usize, u64, Vec<u8>)> {
    let set = |number| (0..3).map(move |k| (k, (number + 1) * PERIOD_NS, grey(number, k)));
    (0..count).flat_map(set)
}

/// What a file gave.
struct Read {
    sets: Vec<FrameSet>,
    warnings: Vec<String>,
    repeated: Vec<(String, usize)>,
    late: usize,
    doubt: String,
}

fn read(path: &Path) -> Read {
    let source = Source::open(path).expect("a file");
    let survey = Survey::of(&source).expect("a whole file");
    let names = CAMERAS.map(str::to_owned);
    let topics = Topics::find(path, &survey, &names, &[]).expect("three topics");
    let mut frames = FrameSets::new(&source, topics, SIZE, TOLERANCE_US);
    let sets = frames.by_ref().map(|set| set.expect("a frame set"));
    let sets = sets.collect();
    let warnings = frames.take_warnings();
    let repeated = frames.repeated();
    Read {
        sets,
        warnings: warnings.iter().map(ToString::to_string).collect(),
        repeated: repeated.map(|(topic, n)| (topic.to_owned(), n)).collect(),
        late: frames.leftover().late,
        doubt: frames.doubt().unwrap_or_default(),
    }
}

/// Cameras of 10, 12 and 14 bits leave the upper bits unused, in messages as in files.
#[test]
fn bits_in_use_scale_raw_and_compressed_alike() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let image = "sensor_msgs/msg/Image";
    write(
        &path,
        image,
        shots(3).map(|(k, ns, grey)| (k, raw(ns, &grey, 8))),
    );
    let plain = read(&path);
    assert_eq!((plain.sets.len(), plain.warnings.len()), (3, 0));
    for bits in [10, 12, 14, 16] {
        let deep = shots(3).map(|(k, ns, grey)| (k, raw(ns, &grey, bits)));
        write(&path, image, deep);
        let from_raw = read(&path);
        let files = shots(3).map(|(k, ns, grey)| (k, png(ns, &grey, bits)));
        write(&path, "sensor_msgs/msg/CompressedImage", files);
        let from_files = read(&path);
        for found in [&from_raw, &from_files] {
            for (found, expected) in found.sets.iter().zip(&plain.sets) {
                assert_eq!(found.images, expected.images, "{bits} bits");
            }
            assert_eq!(found.sets.len(), 3);
            let told = format!("16-bit images that use {bits} bits");
            assert!(found.warnings[0].contains(&told), "{:?}", found.warnings);
            assert_eq!(found.warnings.len(), 1, "{:?}", found.warnings);
        }
    }
}

/// A brighter frame set raises the scale for itself and all after it.
#[test]
fn scale_grows_with_brighter_frame_sets() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let bits = |ns| if ns == 2 * PERIOD_NS { 12 } else { 10 };
    let deep = shots(3).map(|(k, ns, grey)| (k, raw(ns, &grey, bits(ns))));
    write(&path, "sensor_msgs/msg/Image", deep);
    let found = read(&path);
    let most = |number: usize| found.sets[number].images[0].grey.iter().max().copied();
    assert_eq!(
        [most(0), most(1), most(2)],
        [Some(255), Some(255), Some(63)]
    );
    assert!(
        found.warnings[0].contains("use 10 bits"),
        "{:?}",
        found.warnings
    );
    assert!(
        found.warnings[1].contains("use 12 bits"),
        "{:?}",
        found.warnings
    );
}

#[test]
fn repeated_messages_are_dropped_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    for jitter_ns in [0, 2_000_000] {
        let shot =
            |(k, ns, grey): (usize, u64, Vec<u8>)| (k, raw(ns + k as u64 * jitter_ns, &grey, 8));
        let once: Vec<_> = shots(4).map(shot).collect();
        write(&path, "sensor_msgs/msg/Image", once.clone());
        let expected = read(&path);
        assert!(expected.repeated.is_empty());
        // Each message twice in sequence, and each frame set twice.
        let in_sequence: Vec<_> = once.iter().flat_map(|shot| [shot; 2]).cloned().collect();
        let in_sets: Vec<_> = once.chunks(3).flat_map(|set| [set, set].concat()).collect();
        for twice in [in_sequence, in_sets] {
            write(&path, "sensor_msgs/msg/Image", twice);
            let found = read(&path);
            assert_eq!(found.sets.len(), 4);
            for (found, expected) in found.sets.iter().zip(&expected.sets) {
                assert_eq!(found.images, expected.images);
            }
            let counts = CAMERAS.map(|camera| (topic(camera), 4));
            assert_eq!(found.repeated, counts);
            assert_eq!((found.late, found.doubt.as_str()), (0, ""));
        }
    }
}

#[test]
fn stamps_without_an_order_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let unset = shots(4).map(|(k, _, grey)| (k, raw(0, &grey, 8)));
    write(&path, "sensor_msgs/msg/Image", unset);
    let found = read(&path);
    assert_eq!(found.sets.len(), 1);
    assert!(
        found.doubt.contains("all 12 images have the stamp 0 s"),
        "{}",
        found.doubt
    );
    let backwards = shots(4).map(|(k, ns, grey)| (k, raw(PERIOD_NS * 9 - ns, &grey, 8)));
    write(&path, "sensor_msgs/msg/Image", backwards);
    let found = read(&path);
    assert_eq!((found.sets.len(), found.late), (1, 9));
    assert!(found.doubt.contains("run backwards"), "{}", found.doubt);
}
