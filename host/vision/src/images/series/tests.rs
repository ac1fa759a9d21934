//! The same images in every form, and the pairing of their names.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use super::pairing::Rule;
use crate::images::folder::{Folder, write};
use crate::images::{FrameSet, Image};

const SIZE: [u32; 2] = [6, 4];

fn names() -> Vec<String> {
    ["left", "right"].map(str::to_owned).to_vec()
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

#[cfg(unix)]
#[test]
fn videos_come_through_named_pipes() {
    let dir = TempDir::new().unwrap();
    for name in names() {
        let path = dir.path().join(format!("{name}.y4m"));
        rustix::fs::mkfifoat(rustix::fs::CWD, &path, rustix::fs::Mode::RWXU).unwrap();
    }
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
