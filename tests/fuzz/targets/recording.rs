//! Recordings with any edits, and any bytes behind the magic ones.
//!
//! Laws: no panic, bounded memory; an error names the file; a frame set has an image per camera, of
//! the rig's size or missing; the rows of a CSV table have as many fields as its header.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use station_fuzz::law::check_error;
use std::fs::File;
use std::path::Path;
use std::sync::OnceLock;
use trinocular_client::observer::StationObserver as _;
use trinocular_recording::export::{self, Table};
use trinocular_recording::message::{Measurement, Outcome};
use trinocular_recording::queue::Pace;
use trinocular_recording::read::frames::{FrameSets, Topics};
use trinocular_recording::read::survey::Survey;
use trinocular_recording::read::{Source, calibration};
use trinocular_recording::recorder::{ImageForm, Recorder, Settings};
use trinocular_recording::replay;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::{FrameSet, Image};
use trinocular_vision::sums::Estimator;

/// One edit of the bytes of a good recording.
#[derive(Arbitrary, Debug)]
enum Edit {
    /// Sets one byte.
    Set(u16, u8),
    /// Cuts the file.
    Cut(u16),
    /// Takes bytes out.
    Remove(u16, u8),
    /// Puts bytes in.
    Insert(u16, Vec<u8>),
    /// Keeps only the magic bytes, and adds these.
    Any(Vec<u8>),
}

fn paper(size: u32) -> RigFile {
    let mut rig = RigFile::paper();
    rig.rig.image_size_px = [size, size];
    rig
}

/// Writes a small recording of every kind of message; returns its bytes.
fn good(path: &Path) -> Vec<u8> {
    let rig = paper(8);
    // Not by an `Output`, which watches for signals: libFuzzer has an alarm of its own.
    let file = File::create(path).expect("a writable folder");
    let settings = Settings {
        images: ImageForm::Raw,
        pace: Pace::Virtual,
        cameras: rig.names.clone(),
        epoch_us: 0,
        rig: rig.to_toml(),
        regions: Regions::default(),
        origin: Default::default(),
    };
    let recorder = Recorder::start_in(file, path.to_owned(), settings).expect("it begins");
    let tap = recorder.tap();
    for number in 0..2 {
        tap.sent(1_000 * number, &[0, 5, 1, 2, 3, 4, 0]);
        tap.received(1_000 * number, &[0, 9, 0]);
        let image = Image {
            width: 8,
            height: 8,
            grey: vec![number as u8; 64],
        };
        let set = FrameSet {
            time_us: 33_333 * number,
            images: vec![image; 3],
        };
        let measurement = Measurement {
            outcome: Outcome::Refused,
            pixels: vec![1.0; 12],
            cameras: vec![0, 1, 2],
            ..Measurement::default()
        };
        tap.frame_set(Some(&set), measurement);
    }
    tap.event("line", "lost".to_owned());
    tap.end(3_000);
    recorder.finish().expect("it is written");
    without_checksums(std::fs::read(path).expect("it was written"))
}

/// Removes the checksums of chunks, so that edits within a chunk are read.
fn without_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    const CHUNK: u8 = 6;
    let mut at = 8;
    while let Some(&[opcode, ref length @ ..]) = bytes.get(at..).and_then(<[u8]>::first_chunk::<9>)
    {
        let length = u64::from_le_bytes(*length);
        if opcode == CHUNK {
            // Behind two times and the size.
            bytes[at + 9 + 24..at + 9 + 28].fill(0);
        }
        at += 9 + length as usize;
    }
    bytes
}

fn edited(good: &[u8], edits: &[Edit]) -> Vec<u8> {
    let mut bytes = good.to_vec();
    for edit in edits {
        let place = |at: &u16| usize::from(*at) % bytes.len().max(1);
        match edit {
            Edit::Set(at, value) => {
                let place = place(at);
                if let Some(byte) = bytes.get_mut(place) {
                    *byte = *value;
                }
            }
            Edit::Cut(at) => bytes.truncate(place(at)),
            Edit::Remove(at, count) => {
                let start = place(at);
                let end = (start + usize::from(*count)).min(bytes.len());
                bytes.drain(start..end);
            }
            Edit::Insert(at, more) => {
                let start = place(at);
                bytes.splice(start..start, more.iter().copied());
            }
            Edit::Any(more) => {
                bytes.truncate(8);
                bytes.extend(more);
            }
        }
    }
    bytes
}

/// Returns the number of fields of each record of a CSV file (RFC 4180, lines end with a newline).
fn fields(csv: &str) -> Vec<usize> {
    let (mut counts, mut commas, mut is_quoted) = (Vec::new(), 0, false);
    for byte in csv.bytes() {
        match byte {
            b'"' => is_quoted = !is_quoted,
            b',' if !is_quoted => commas += 1,
            b'\n' if !is_quoted => {
                counts.push(commas + 1);
                commas = 0;
            }
            _ => {}
        }
    }
    counts
}

fuzz_target!(|edits: Vec<Edit>| {
    static GOOD: OnceLock<(tempfile::TempDir, Vec<u8>)> = OnceLock::new();
    let (folder, good) = GOOD.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let bytes = good(&folder.path().join("good.mcap"));
        (folder, bytes)
    });
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, edited(good, &edits)).expect("a writable folder");
    let source = Source::open(&path).expect("a file");
    let survey = match Survey::of(&source) {
        Ok(survey) => survey,
        Err(error) => return check_error(&error, &[&path]),
    };
    if let Some(cut) = &survey.cut {
        check_error(cut, &[&path]);
    }
    let _ = calibration::rig(&source, &survey);
    let rig = paper(8);
    match Topics::find(&path, &survey, &rig.names, &[]) {
        Err(error) => check_error(&error, &[&path]),
        Ok(topics) => {
            for set in FrameSets::new(&source, topics, rig.rig.image_size_px, 5_000) {
                match set {
                    Err(error) => check_error(&error, &[&path]),
                    Ok(set) => {
                        assert_eq!(set.images.len(), 3);
                        let is_fit = |i: &Image| i.is_missing() || i.grey.len() == 64;
                        assert!(set.images.iter().all(is_fit));
                    }
                }
            }
        }
    }
    match Table::read(&source) {
        Ok(table) => {
            let records = fields(&export::csv(&table.rows));
            assert_eq!(records.len(), table.rows.len() + 1);
            assert!(records.iter().all(|count| *count == records[0]));
            let parquet = table.parquet().expect("every table is encoded");
            assert!(parquet.starts_with(b"PAR1") && parquet.ends_with(b"PAR1"));
        }
        Err(error) => {
            check_error(&error, &[&path]);
        }
    }
    let settings = replay::Settings {
        pivot: rig.estimated_pivot(),
        rig: rig.rig,
        names: rig.names,
        estimator: Estimator::Midpoint,
        regions: Regions::default(),
        twin: Some("twin".to_owned()),
    };
    if let Err(error) = replay::replay(&source, &settings, |_| {}) {
        check_error(&error, &[&path]);
    }
});
