//! A recording is written, read back, damaged, and ends early.

use std::collections::BTreeMap;
use std::path::Path;
use trinocular_client::observer::StationObserver as _;
use trinocular_recording::message::{Measurement, Outcome};
use trinocular_recording::queue::Pace;
use trinocular_recording::read::Source;
use trinocular_recording::read::frames::{FrameSets, TOLERANCE_US, Topics};
use trinocular_recording::read::survey::Survey;
use trinocular_recording::recorder::{Account, ImageForm, Recorder, Settings};
use trinocular_rig::output::{Output, OwnFile, Replace};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::{FrameSet, Image};

fn settings(images: ImageForm) -> Settings {
    let rig = RigFile::paper();
    Settings {
        images,
        pace: Pace::Virtual,
        cameras: rig.names.clone(),
        epoch_us: 0,
        rig: rig.to_toml(),
        regions: Regions::default(),
        origin: BTreeMap::from([("program".to_owned(), "trinocular".to_owned())]),
    }
}

/// Frame set in which every pixel depends on number, camera and place.
fn frame_set(number: u64, [width, height]: [usize; 2]) -> FrameSet {
    let image = |camera: u64| Image {
        width,
        height,
        grey: (0..(width * height) as u64)
            .map(|place| (place * (camera + 3) + number * 7) as u8)
            .collect(),
    };
    FrameSet {
        time_us: 1_000_000 + number * 33_333,
        images: (0..3).map(image).collect(),
    }
}

const SIZE: [usize; 2] = [320, 240];

fn record(path: &Path, images: ImageForm, frames: u64) -> Account {
    let output = Output::open(path, Replace::Own(OwnFile::Recording)).expect("a writable place");
    let recorder = Recorder::start(output, settings(images)).expect("it begins");
    let tap = recorder.tap();
    for number in 0..frames {
        let mut set = frame_set(number, SIZE);
        if number % 5 == 3 {
            set.images[1] = Image::missing();
        }
        tap.sent(number * 33_333, &[1, 2, 3, 0]);
        let message = Measurement {
            stamp_us: set.time_us,
            outcome: Outcome::Refused,
            reason: format!("reason {number}"),
            ..Measurement::default()
        };
        tap.frame_set(Some(&set), message);
    }
    tap.end(frames * 33_333);
    recorder.finish().expect("it is written")
}

fn read(path: &Path) -> Vec<FrameSet> {
    let source = Source::open(path).expect("a file");
    let survey = Survey::of(&source).expect("a whole file");
    let names = RigFile::paper().names;
    let topics = Topics::find(path, &survey, &names, &[]).expect("three topics");
    let size = SIZE.map(|side| side as u32);
    let sets = FrameSets::new(&source, topics, size, TOLERANCE_US);
    sets.map(|set| set.expect("a frame set")).collect()
}

#[test]
fn images_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for form in [ImageForm::Raw, ImageForm::Png] {
        let path = folder.path().join(format!("{form:?}.mcap"));
        let account = record(&path, form, 12);
        assert_eq!(account.dropped.frame_sets + account.dropped.messages, 0);
        assert_eq!(account.bytes, path.metadata().unwrap().len());
        let sets = read(&path);
        assert_eq!(sets.len(), 12, "{form:?}");
        for (number, set) in sets.iter().enumerate() {
            let mut expected = frame_set(number as u64, SIZE);
            if number % 5 == 3 {
                expected.images[1] = Image::missing();
            }
            assert_eq!(set.time_us, expected.time_us);
            assert_eq!(set.images, expected.images, "{form:?} {number}");
        }
    }
}

#[test]
fn survey_finds_origin_rig_and_counts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    record(&path, ImageForm::None, 3);
    let survey = Survey::of(&Source::open(&path).unwrap()).unwrap();
    assert_eq!(survey.rig, Some(RigFile::paper().to_toml()));
    assert_eq!(survey.origin.unwrap()["program"], "trinocular");
    assert_eq!(survey.end.unwrap()["frame_sets_dropped"], "0");
    assert_eq!(survey.topics["/measurement"].count, 3);
    // Three packets, and the end of the run.
    assert_eq!(survey.topics["/station/input"].count, 4);
    assert!(!survey.topics.contains_key("/left/image_raw"));
    assert!(survey.cut.is_none());
}

#[test]
fn own_recording_is_replaced_others_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    record(&path, ImageForm::None, 2);
    record(&path, ImageForm::None, 3);
    std::fs::write(&path, b"\x89MCAP0\r\nof another program").unwrap();
    let error = Output::open(&path, Replace::Own(OwnFile::Recording)).unwrap_err();
    assert!(error.reason.contains("--force"), "{error}");
    assert_eq!(folder.path().read_dir().unwrap().count(), 1);
}

/// A cut at any place gives the frame sets before it, and never an error of another kind.
#[test]
fn cut_file_is_read_up_to_its_last_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    record(&path, ImageForm::Raw, 40);
    let whole = std::fs::read(&path).unwrap();
    let mut counts = Vec::new();
    for end in (2_000..whole.len()).step_by(whole.len() / 23) {
        std::fs::write(&path, &whole[..end]).unwrap();
        let source = Source::open(&path).unwrap();
        let survey = Survey::of(&source).expect("it is read");
        let cut = survey.cut.clone().expect("the end is missing");
        assert!(cut.reason.contains("cut off"), "{cut}");
        let images = survey.topics.contains_key("/right/image_raw");
        counts.push(if images { read(&path).len() } else { 0 });
    }
    assert!(counts.is_sorted(), "{counts:?}");
    // Chunks of 2 MB hold nine frame sets.
    assert!(*counts.last().unwrap() >= 30, "{counts:?}");
}

#[test]
fn flipped_bit_is_named_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    record(&path, ImageForm::Raw, 4);
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&path, &bytes).unwrap();
    let error = Survey::of(&Source::open(&path).unwrap()).unwrap_err();
    assert!(error.reason.contains("damaged at byte"), "{error}");
    assert!(error.reason.contains("checksum"), "{error}");
    // The way out that it names.
    let (_, rest) = error.reason.split_once("head -c ").expect("a command");
    let place = rest.split(' ').next().and_then(|word| word.parse().ok());
    std::fs::write(&path, &bytes[..place.expect("a place")]).unwrap();
    let survey = Survey::of(&Source::open(&path).unwrap()).expect("it is read");
    assert!(survey.cut.is_some());
}

#[test]
fn foreign_and_empty_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    for content in [&b""[..], b"MCAP", b"id,camera,x0\n"] {
        std::fs::write(&path, content).unwrap();
        let error = Survey::of(&Source::open(&path).unwrap()).unwrap_err();
        assert!(error.reason.contains("no MCAP file"), "{error}");
    }
    let error = Source::open(&folder.path().join("none.mcap")).unwrap_err();
    assert!(error.reason.contains("cannot read"), "{error}");
}

#[test]
fn file_without_its_beginning_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let rest = [&[7; 100_000][..], mcap::MAGIC].concat();
    std::fs::write(&path, rest).unwrap();
    let error = Survey::of(&Source::open(&path).unwrap()).unwrap_err();
    for part in ["lost its beginning", "copy the whole file"] {
        assert!(error.reason.contains(part), "{error}");
    }
}

/// A file whose records claim more than is there costs no memory.
#[test]
fn huge_claims_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    for (claim, reason) in [(1u64 << 40, "more than 256 MB"), (200 << 20, "cut off")] {
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.push(6);
        bytes.extend(claim.to_le_bytes());
        std::fs::write(&path, &bytes).unwrap();
        let text = match Survey::of(&Source::open(&path).unwrap()) {
            Err(error) => error.reason,
            Ok(survey) => survey.cut.expect("it is cut").reason,
        };
        assert!(text.contains(reason), "{text}");
    }
}

/// The two malformed records on which the reader of the mcap crate panics.
#[test]
fn malformed_records_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let record = |opcode: u8, content: &[u8]| {
        let mut bytes = vec![opcode];
        bytes.extend((content.len() as u64).to_le_bytes());
        bytes.extend(content);
        bytes
    };
    let mut chunk = vec![0; 16];
    // One record in the chunk, which claims a byte more than the chunk has.
    let mut inner = record(5, &[0; 30]);
    inner[1] += 1;
    chunk.extend((inner.len() as u64).to_le_bytes());
    chunk.extend([0; 8]);
    chunk.extend((inner.len() as u64).to_le_bytes());
    chunk.extend(&inner);
    let attachment = [[0; 16].as_slice(), &[0; 8], &[0; 8]].concat();
    for (opcode, content) in [(6, chunk), (9, attachment[..30].to_vec())] {
        let bytes = [mcap::MAGIC, &record(opcode, &content)].concat();
        std::fs::write(&path, &bytes).unwrap();
        let error = Survey::of(&Source::open(&path).unwrap()).unwrap_err();
        assert!(error.reason.contains("malformed"), "{error}");
    }
}
