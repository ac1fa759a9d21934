//! The same images in every form, and the pairing of their names.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use super::pairing::Rule;
use crate::images::folder::{Folder, write};
use crate::images::{FrameSet, Image};

const SIZE: [u32; 2] = [6, 4];

fn names() -> [String; 2] {
    ["left", "right"].map(str::to_owned)
}

/// Returns an image whose pixels encode camera and number.
fn image(camera: usize, number: usize) -> Image {
    let first = 100 * camera + 30 * number;
    Image {
        width: 6,
        height: 4,
        grey: (0..24).map(|i| (first + i) as u8).collect(),
    }
}

/// Writes the image under each name: a camera's index, its number, and the path.
fn files(images: &[(usize, usize, &str)]) -> TempDir {
    let dir = TempDir::new().unwrap();
    for (camera, number, name) in images {
        let path = dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        write(&path, &image(*camera, *number)).unwrap();
    }
    dir
}

/// Returns the Y4M video of these images, each value times `factor`.
fn video(images: &[Image], factor: Option<u16>) -> Vec<u8> {
    let colours = if factor.is_some() {
        "mono12"
    } else {
        "420jpeg"
    };
    let mut file = format!("YUV4MPEG2 W6 H4 F200:1 Ip C{colours}\n").into_bytes();
    for image in images {
        file.extend(b"FRAME\n");
        match factor {
            Some(factor) => {
                let levels = image.grey.iter().map(|grey| u16::from(*grey) * factor);
                file.extend(levels.flat_map(u16::to_le_bytes));
            }
            None => {
                file.extend(&image.grey);
                file.extend([128; 12]);
            }
        }
    }
    file
}

#[track_caller]
fn assert_read(folder: &Folder, numbers: &[usize]) {
    let found: Vec<FrameSet> = folder.frame_sets().map(Result::unwrap).collect();
    assert_eq!(found.len(), numbers.len());
    for (found, number) in found.iter().zip(numbers) {
        assert_eq!(found.images, [image(0, *number), image(1, *number)]);
    }
}

fn open(dir: &Path, rule: Option<Rule>) -> Folder {
    Folder::open_paired(dir, &names(), SIZE, 5_000, rule).unwrap()
}

#[test]
fn prefixes_in_one_folder_are_cameras() {
    let dir = files(&[
        (0, 0, "left1.png"),
        (1, 0, "right1.png"),
        (0, 1, "left_10.png"),
        (1, 1, "right_10.png"),
        (0, 2, "lefty.png"),
    ]);
    let folder = open(dir.path(), None);
    assert_eq!(folder.names(), ["1.png", "10.png"]);
    assert_read(&folder, &[0, 1]);
}

#[test]
fn longest_name_owns_a_file() {
    let dir = files(&[(0, 0, "cam1_5.png"), (1, 0, "cam1_b_5.png")]);
    let names = ["cam1", "cam1_b"].map(str::to_owned);
    let folder = Folder::open(dir.path(), &names, SIZE, 1).unwrap();
    assert_read(&folder, &[0]);
}

#[test]
fn points_in_names_are_kept() {
    // Names as of the TUM RGB-D benchmark; the whole seconds alone are ambiguous.
    let dir = files(&[
        (0, 0, "left/1305031102.175304.png"),
        (1, 0, "right/1305031102.175304.PNG"),
        (0, 1, "left/1305031102.211214.png"),
        (1, 1, "right/1305031102.211214.PNG"),
    ]);
    let folder = open(dir.path(), None);
    assert_read(&folder, &[0, 1]);
    assert!(folder.pairing().unwrap().contains("endings aside"));
    let photographs = crate::calibration::photographs::list(dir.path()).unwrap();
    let instants = photographs
        .series
        .iter()
        .map(|series| series.stills()[0].instant.clone());
    assert_eq!(
        instants.collect::<Vec<_>>(),
        ["1305031102.175304", "1305031102.175304"]
    );
    assert!(
        photographs
            .pairing
            .is_none_or(|said| said.contains("endings"))
    );
}

#[test]
fn times_outrank_last_numbers() {
    // One right image ends like a left one of another instant.
    let dir = files(&[
        (0, 0, "left/20260105_102910_250.png"),
        (1, 0, "right/20260105_102910_253.png"),
        (0, 1, "left/20260105_102910_353.png"),
        (1, 1, "right/20260105_102910_351.png"),
        (0, 2, "left/20260105_102911_450.png"),
        (1, 2, "right/20260105_102911_353.png"),
    ]);
    let folder = open(dir.path(), None);
    let said = folder.pairing().unwrap();
    assert!(said.contains("nearest times"), "{said}");
    let first = folder.frame_sets().next().unwrap().unwrap();
    assert_eq!(first.images, [image(0, 0), image(1, 0)]);
    // A date that all names share is no time of an image.
    let dir = files(&[
        (0, 0, "left/20260105_102910_a1.png"),
        (1, 0, "right/20260105_102911_b1.png"),
        (0, 1, "left/20260105_102910_a2.png"),
        (1, 1, "right/20260105_102911_b2.png"),
    ]);
    let folder = open(dir.path(), None);
    assert!(folder.pairing().unwrap().contains("last numbers"));
    assert_read(&folder, &[0, 1]);
}

#[test]
fn images_without_partners_are_counted() {
    let dir = files(&[
        (0, 0, "left/1767608950.000.png"),
        (1, 0, "right/1767608950.001.png"),
        (0, 1, "left/1767608951.000.png"),
        (0, 2, "left/1767608952.000.png"),
        (1, 2, "right/1767608955.000.png"),
    ]);
    let folder = open(dir.path(), Some(Rule::Time));
    let said = folder.pairing().unwrap();
    assert!(said.contains("; 3 images without partners"), "{said}");
}

#[test]
fn folder_without_any_pair_is_refused() {
    let dir = files(&[
        (0, 0, "left/1767608950.0.png"),
        (0, 1, "left/1767608951.0.png"),
        (1, 0, "right/1767608990.0.png"),
    ]);
    let empty = TempDir::new().unwrap();
    for name in names() {
        fs::create_dir(empty.path().join(name)).unwrap();
    }
    write(&empty.path().join("left/1.png"), &image(0, 0)).unwrap();
    for (dir, rule, reason) in [
        (&dir, Some(Rule::Time), "has no partner: camera `right`"),
        (&empty, Some(Rule::Order), "camera `right` has no"),
        (
            &empty,
            None,
            "missing, but another camera has a file of this name",
        ),
    ] {
        let refused = Folder::open_paired(dir.path(), &names(), SIZE, 1, rule);
        let error = refused.unwrap_err().to_string();
        assert!(error.contains(reason), "{rule:?}: {error}");
    }
}

#[test]
fn error_of_incomplete_set_names_a_file() {
    for images in [
        [
            (0, 0, "left/imageL0.png"),
            (1, 0, "right/imageR0.png"),
            (0, 1, "left/imageL1.png"),
        ],
        [
            (0, 0, "left0.png"),
            (1, 0, "right0.png"),
            (0, 1, "left1.png"),
        ],
    ] {
        let dir = files(&images);
        let error = open(dir.path(), None).complete().unwrap_err();
        assert!(error.file.exists(), "{error}");
        assert!(
            error.reason.contains("camera `right` has no image"),
            "{error}"
        );
    }
}

#[test]
fn images_of_no_camera_are_named() {
    let dir = files(&[
        (0, 0, "left1.png"),
        (1, 0, "right1.png"),
        (0, 0, "middle1.png"),
        (0, 0, "middle2.png"),
    ]);
    let warnings = open(dir.path(), None).warnings().to_vec();
    assert!(
        warnings[0]
            .reason
            .contains("2 images belong to no camera, first middle1.png")
    );
    let dir = files(&[
        (0, 0, "left/1.png"),
        (1, 0, "right/1.png"),
        (0, 0, "board.png"),
    ]);
    let warnings = crate::calibration::photographs::list(dir.path())
        .unwrap()
        .warnings;
    assert!(
        warnings[0]
            .reason
            .contains("1 image belongs to no camera, first board.png")
    );
    let warnings = open(dir.path(), None).warnings().to_vec();
    assert!(warnings[0].reason.contains("first board.png"));
}

#[test]
fn names_pair_by_their_last_numbers() {
    let dir = files(&[
        (0, 0, "left/imageL0.png"),
        (1, 0, "right/imageR0.png"),
        (0, 1, "left/imageL10.png"),
        (1, 1, "right/imageR010.png"),
    ]);
    let folder = open(dir.path(), None);
    assert_read(&folder, &[0, 1]);
    assert!(folder.pairing().unwrap().contains("last numbers"));
}

#[test]
fn names_pair_without_their_endings() {
    let dir = files(&[(0, 0, "left/a.png"), (1, 0, "right/a.PNG")]);
    let folder = open(dir.path(), None);
    assert_read(&folder, &[0]);
    assert!(folder.pairing().unwrap().contains("endings aside"));
}

#[test]
fn images_pair_by_order_on_request() {
    let dir = files(&[
        (0, 0, "left/first.png"),
        (0, 1, "left/second.png"),
        (1, 0, "right/a9.png"),
        (1, 1, "right/a10.png"),
        (1, 2, "right/a11.png"),
    ]);
    let folder = open(dir.path(), Some(Rule::Order));
    assert_read(&folder, &[0, 1]);
    let said = folder.pairing().unwrap();
    assert!(said.contains("2 frame sets by their order") && said.contains("last 1 of right"));
    let unpaired = Folder::open(dir.path(), &names(), SIZE, 1).unwrap_err();
    assert!(unpaired.reason.contains("--pair order"), "{unpaired}");
}

#[test]
fn images_pair_by_nearest_time() {
    // The second image of the right camera was lost.
    let dir = files(&[
        (0, 0, "left/1403636579000000000.png"),
        (0, 1, "left/1403636579100000000.png"),
        (0, 2, "left/1403636579200000000.png"),
        (1, 0, "right/1403636579004000000.png"),
        (1, 2, "right/1403636579198000000.png"),
    ]);
    for rule in [None, Some(Rule::Time)] {
        let folder = open(dir.path(), rule);
        let found: Vec<FrameSet> = folder.frame_sets().map(Result::unwrap).collect();
        let times: Vec<u64> = found.iter().map(|set| set.time_us).collect();
        assert_eq!(times, [0, 100_000, 200_000]);
        assert_eq!(found[0].images, [image(0, 0), image(1, 0)]);
        assert_eq!(found[1].images, [image(0, 1), Image::missing()]);
        assert_eq!(found[2].images, [image(0, 2), image(1, 2)]);
        let said = folder.pairing().unwrap();
        assert!(said.contains("at most 4.000 ms apart"), "{said}");
    }
    let dir = files(&[(0, 0, "left/1.png"), (1, 0, "right/1.png")]);
    let refused = Folder::open_paired(dir.path(), &names(), SIZE, 1, Some(Rule::Time));
    assert!(
        refused
            .unwrap_err()
            .reason
            .contains("not all names hold a time")
    );
}

#[test]
fn stacks_equal_single_files() {
    let dir = TempDir::new().unwrap();
    for (camera, name) in names().iter().enumerate() {
        let pages: Vec<Image> = (0..3).map(|number| image(camera, number)).collect();
        let place = match camera {
            0 => dir.path().join(format!("{name}.tif")),
            // A stack may also be alone in its camera's folder.
            _ => dir.path().join(name).join("stack.TIFF"),
        };
        fs::create_dir_all(place.parent().unwrap()).unwrap();
        fs::write(place, super::stack::tests::stack_of(&pages, 16)).unwrap();
    }
    let folder = open(dir.path(), None);
    assert_eq!(folder.count(), Some(3));
    assert_read(&folder, &[0, 1, 2]);
    assert!(folder.pairing().unwrap().contains("their order"));
    let warning = folder.warnings()[0].to_string();
    assert!(warning.contains("use 12 bits"), "{warning}");
}

#[test]
fn videos_equal_single_files() {
    for factor in [None, Some(16)] {
        let dir = TempDir::new().unwrap();
        for (camera, name) in names().iter().enumerate() {
            let frames: Vec<Image> = (0..3).map(|number| image(camera, number)).collect();
            let path = dir.path().join(format!("{name}.y4m"));
            fs::write(path, video(&frames, factor)).unwrap();
        }
        let folder = open(dir.path(), None);
        assert_eq!(folder.video_period_us(), Some(5_000));
        assert_read(&folder, &[0, 1, 2]);
        let path = dir.path().join("left.y4m");
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() - 20]).unwrap();
        let folder = open(dir.path(), None);
        let last = folder.frame_sets().nth(2).unwrap().unwrap_err();
        assert!(last.to_string().contains("left.y4m: frame 3: ") && folder.count() == Some(3));
    }
}

#[test]
fn videos_of_different_rates_are_refused() {
    let dir = TempDir::new().unwrap();
    for (camera, name) in names().iter().enumerate() {
        let frames: Vec<Image> = (0..3).map(|number| image(camera, number)).collect();
        let mut file = video(&frames, None);
        if camera == 1 {
            let rate = file.windows(4).position(|four| four == b"F200").unwrap();
            file[rate + 1] = b'1';
        }
        fs::write(dir.path().join(format!("{name}.y4m")), file).unwrap();
    }
    let refused = Folder::open_paired(dir.path(), &names(), SIZE, 1, None).unwrap_err();
    assert!(
        refused.reason.contains("200.000 frames per second"),
        "{refused}"
    );
    let said = crate::calibration::photographs::list(dir.path()).unwrap_err();
    assert!(said.reason.contains("100.000"), "{said}");
    assert_read(&open(dir.path(), Some(Rule::Order)), &[0, 1, 2]);
}

/// Makes a named pipe per camera.
#[cfg(unix)]
fn pipes() -> TempDir {
    let dir = TempDir::new().unwrap();
    for name in names() {
        let path = dir.path().join(format!("{name}.y4m"));
        rustix::fs::mkfifoat(rustix::fs::CWD, &path, rustix::fs::Mode::RWXU).unwrap();
    }
    dir
}

#[cfg(unix)]
#[test]
fn pipes_of_different_rates_are_refused() {
    let dir = pipes();
    let write = |index: usize| {
        let mut file = video(&[image(index, 0), image(index, 1)], None);
        let rate = file.windows(4).position(|four| four == b"F200").unwrap();
        file[rate + 1] = b'1' + index as u8;
        let path = dir.path().join(format!("{}.y4m", names()[index]));
        std::thread::spawn(move || fs::write(path, file))
    };
    let writers = [0, 1].map(write);
    let folder = open(dir.path(), None);
    let found: Vec<_> = folder.frame_sets().collect();
    assert_eq!(found.len(), 1);
    let error = found[0].as_ref().unwrap_err().to_string();
    assert!(error.contains("frames per second"), "{error}");
    drop(folder);
    for writer in writers {
        let _ = writer.join();
    }
}

#[cfg(unix)]
#[test]
fn photographs_in_pipes_are_read_in_turn() {
    use crate::calibration::board::Board;
    use crate::calibration::folder::{CalibrationSettings, calibrate};
    const COUNT: usize = 80;
    let dir = pipes();
    let paths = names().map(|name| dir.path().join(format!("{name}.y4m")));
    // One program writes both videos frame by frame, as a splitter does.
    let writer = std::thread::spawn(move || {
        use std::io::Write as _;
        let mut pipes = paths.map(|path| fs::OpenOptions::new().write(true).open(path).unwrap());
        let frame = |camera| Image {
            width: 200,
            height: 200,
            ..image(camera, 0)
        };
        for pipe in &mut pipes {
            let _ = pipe.write_all(b"YUV4MPEG2 W200 H200 F30:1 Cmono\n");
        }
        for number in 0..COUNT {
            for (camera, pipe) in pipes.iter_mut().enumerate() {
                let Image { width, height, .. } = frame(camera);
                let _ = pipe.write_all(b"FRAME\n");
                let _ = pipe.write_all(&vec![number as u8; width * height]);
            }
        }
    });
    let board = Board {
        corners: [4, 3],
        square_mm: 10.0,
    };
    // No frame shows a board, but all frames are read.
    let mut seen = 0;
    let refused = calibrate(dir.path(), &CalibrationSettings::new(board), &mut |_| {
        seen += 1
    });
    assert!(refused.is_err());
    assert_eq!(seen, 2 * COUNT);
    writer.join().unwrap();
}

#[cfg(unix)]
#[test]
fn videos_come_through_named_pipes() {
    let dir = pipes();
    // The writer writes one whole video after the other.
    let folder = dir.path().to_owned();
    let writer = std::thread::spawn(move || {
        for (camera, name) in names().iter().enumerate().rev() {
            let frames: Vec<Image> = (0..5).map(|number| image(camera, number)).collect();
            fs::write(folder.join(format!("{name}.y4m")), video(&frames, Some(16))).unwrap();
        }
    });
    let folder = open(dir.path(), None);
    assert_eq!((folder.count(), folder.names().len()), (None, 0));
    assert_read(&folder, &[0, 1, 2, 3, 4]);
    writer.join().unwrap();
}
