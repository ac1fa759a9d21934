//! Errors of a folder, each with the file's name, and saved frame sets.

use super::*;
use tempfile::TempDir;

fn names() -> Vec<String> {
    ["left", "middle", "right"].map(str::to_owned).to_vec()
}

/// Returns a frame set of 6 x 4 px whose pixels encode camera and number.
fn capture(frame: u8) -> FrameSet {
    let view = |camera: u8| Image {
        width: 6,
        height: 4,
        grey: (0..24).map(|i| i * 3 + camera * 80 + frame).collect(),
    };
    FrameSet {
        time_us: 0,
        images: (0..3).map(view).collect(),
    }
}

fn saved(frames: u8) -> TempDir {
    let dir = TempDir::new().unwrap();
    for frame in 0..frames {
        save(dir.path(), &names(), frame.into(), &capture(frame)).unwrap();
    }
    dir
}

fn open(dir: &Path) -> Result<Folder, InputError> {
    Folder::open(dir, &names(), [6, 4], DEFAULT_PERIOD_US)
}

#[test]
fn saved_frame_sets_round_trip() {
    let dir = saved(3);
    let folder = open(dir.path()).unwrap();
    assert_eq!(folder.names(), ["000000.png", "000001.png", "000002.png"]);
    assert_eq!((folder.count(), folder.frame_sets().count()), (Some(3), 3));
    for (frame, read) in (0..).zip(folder.frame_sets()) {
        let read = read.unwrap();
        assert_eq!(read.images, capture(frame).images);
        assert_eq!(read.time_us, u64::from(frame) * 33_333);
    }
}

#[test]
fn other_files_are_skipped() {
    let dir = saved(1);
    for name in ["notes.txt", ".hidden.png", "no_extension"] {
        fs::write(dir.path().join("left").join(name), "text").unwrap();
    }
    assert_eq!(open(dir.path()).unwrap().count(), Some(1));
}

#[test]
fn other_image_formats_are_named() {
    let dir = saved(1);
    let left = dir.path().join("left");
    for number in 0..12 {
        fs::write(left.join(format!("{number:02}.GIF")), "GIF89a").unwrap();
    }
    let remark = listing(&left).unwrap().remark().unwrap();
    assert!(
        remark.contains("00.GIF, 01.GIF") && remark.contains("2 more"),
        "{remark}"
    );
    let folder = open(dir.path()).unwrap();
    assert_eq!(folder.count(), Some(1));
    let [warning] = folder.warnings() else {
        panic!("{:?}", folder.warnings());
    };
    assert_eq!((&warning.file, &warning.reason), (&left, &remark));
    for camera in names() {
        fs::remove_file(dir.path().join(camera).join("000000.png")).unwrap();
    }
    let error = open(dir.path()).unwrap_err();
    assert!(error.reason.contains("left: not read: 00.GIF"), "{error}");
}

#[cfg(unix)]
#[test]
fn non_files_named_as_images_are_refused() {
    let dir = saved(3);
    let path = |name: &str| dir.path().join("left").join(name);
    for name in ["000000.png", "000001.png", "000002.png"] {
        fs::remove_file(path(name)).unwrap();
    }
    fs::create_dir(path("000000.png")).unwrap();
    std::os::unix::fs::symlink("nowhere", path("000001.png")).unwrap();
    std::os::unix::net::UnixListener::bind(path("000002.png")).unwrap();
    let folder = open(dir.path()).unwrap();
    assert_eq!(folder.count(), Some(3));
    let reasons = ["a folder", "cannot read", "a socket"];
    for ((capture, reason), name) in folder.frame_sets().zip(reasons).zip(folder.names()) {
        let error = capture.unwrap_err();
        assert!(error.reason.contains(reason), "{error}");
        assert_eq!(error.file, path(name));
    }
}

#[test]
fn names_sort_by_their_numbers() {
    let dir = TempDir::new().unwrap();
    for name in ["view10.png", "view9.png", "view9b.png", "other.png"] {
        for camera in names() {
            fs::create_dir_all(dir.path().join(&camera)).unwrap();
            write(&dir.path().join(camera).join(name), &capture(0).images[0]).unwrap();
        }
    }
    let folder = open(dir.path()).unwrap();
    let expected = ["other.png", "view9.png", "view9b.png", "view10.png"];
    assert_eq!(folder.names(), expected);
}

#[test]
fn missing_folder_is_named() {
    let error = open(Path::new("/no/such/folder")).unwrap_err();
    assert_eq!(error.to_string(), "/no/such/folder: no such folder");
    let dir = saved(1);
    fs::remove_dir_all(dir.path().join("middle")).unwrap();
    let error = open(dir.path()).unwrap_err();
    assert_eq!(error.file, dir.path().join("middle"));
    assert!(error.reason.starts_with("no such folder"), "{error}");
}

#[test]
fn empty_folders_are_refused() {
    let dir = TempDir::new().unwrap();
    for camera in names() {
        fs::create_dir(dir.path().join(camera)).unwrap();
    }
    let error = open(dir.path()).unwrap_err();
    assert_eq!(error.file, dir.path());
    assert!(error.reason.starts_with("holds no images"), "{error}");
}

#[test]
fn missing_image_fails_a_complete_folder() {
    let dir = saved(2);
    for (index, camera) in names().iter().enumerate() {
        let lost = dir.path().join(camera).join("000001.png");
        let aside = dir.path().join("aside");
        fs::rename(&lost, &aside).unwrap();
        let folder = open(dir.path()).unwrap();
        let captures: Vec<_> = folder.frame_sets().map(Result::unwrap).collect();
        let mut expected = [capture(0).images, capture(1).images];
        expected[1][index] = Image::missing();
        assert_eq!(
            [&captures[0].images, &captures[1].images],
            expected.each_ref()
        );
        assert_eq!(folder.lost("000000.png"), None);
        assert_eq!(folder.complete().unwrap_err().file, lost);
        fs::rename(&aside, &lost).unwrap();
    }
    assert_eq!(
        open(dir.path()).unwrap().complete().unwrap().count(),
        Some(2)
    );
}

#[test]
fn unequal_names_are_refused() {
    let dir = saved(2);
    for (frame, other) in [("000000", "first"), ("000001", "second")] {
        let from = dir.path().join(format!("middle/{frame}.png"));
        fs::rename(&from, from.with_file_name(format!("{other}.PNG"))).unwrap();
    }
    let error = open(dir.path()).unwrap_err();
    assert_eq!(error.file, dir.path().join("middle/000000.png"));
    assert!(error.reason.starts_with("missing"), "{error}");
    let endings = "`left` end in .png, those of `middle` in .PNG";
    assert!(error.reason.contains(endings), "{error}");
    assert!(error.reason.contains("--pair order"), "{error}");
}

#[test]
fn damaged_file_spoils_one_set() {
    let dir = saved(3);
    let whole = fs::read(dir.path().join("right/000001.png")).unwrap();
    let damaged = dir.path().join("right/000001.png");
    for content in [&b""[..], b"not an image", &whole[..whole.len() / 2]] {
        fs::write(&damaged, content).unwrap();
        let folder = open(dir.path()).unwrap();
        let read: Vec<_> = folder.frame_sets().collect();
        assert!(read[0].is_ok() && read[2].is_ok());
        let error = read[1].as_ref().unwrap_err();
        assert_eq!(error.file, damaged);
        assert!(error.reason.starts_with("cannot read"), "{error}");
    }
    let folder = open(dir.path()).unwrap();
    fs::remove_file(&damaged).unwrap();
    let error = folder.frame_sets().nth(1).unwrap().unwrap_err();
    assert_eq!(error.file, damaged);
}

#[test]
fn other_image_size_is_refused() {
    let dir = saved(1);
    let folder = Folder::open(dir.path(), &names(), [320, 240], 1).unwrap();
    let error = folder.frame_sets().next().unwrap().unwrap_err();
    assert_eq!(error.file, dir.path().join("left/000000.png"));
    assert_eq!(
        error.reason,
        "6 x 4 px, but the rig's images are 320 x 240 px"
    );
}

#[test]
fn colour_jpeg_and_pgm_become_grey() {
    let dir = TempDir::new().unwrap();
    let colour = image::RgbImage::from_pixel(6, 4, image::Rgb([90, 90, 90]));
    let path = dir.path().join("a.JPG");
    colour.save(&path).unwrap();
    let grey = read(&path, [6, 4]).unwrap().grey;
    assert!(grey.len() == 24 && grey.iter().all(|g| g.abs_diff(90) <= 1));

    let path = dir.path().join("b.pgm");
    fs::write(&path, b"P5 2 2 255 \x01\x02\x03\xff").unwrap();
    assert_eq!(read(&path, [2, 2]).unwrap().grey, [1, 2, 3, 255]);
}

#[test]
fn unwritable_image_is_refused() {
    let dir = TempDir::new().unwrap();
    let mut bad = capture(0);
    bad.images[1].grey.pop();
    let error = save(dir.path(), &names(), 0, &bad).unwrap_err();
    assert_eq!(error.file, dir.path().join("middle/000000.png"));
    let error = save(dir.path(), &names()[..2], 0, &capture(0)).unwrap_err();
    assert_eq!(error.reason, "cannot save 3 images for 2 cameras");
    fs::write(dir.path().join("file"), "").unwrap();
    let error = save(&dir.path().join("file"), &names(), 0, &capture(0)).unwrap_err();
    assert!(
        error.reason.starts_with("cannot make the folder"),
        "{error}"
    );
}

/// Saves a frame set of 16-bit values: those of `capture`, times `factor`.
fn save_deep(dir: &Path, file: &str, capture: &FrameSet, factor: u16) {
    for (name, view) in names().iter().zip(&capture.images) {
        fs::create_dir_all(dir.join(name)).unwrap();
        let levels = view.grey.iter().map(|grey| u16::from(*grey) * factor);
        let (width, height) = (view.width as u32, view.height as u32);
        let image = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(
            width,
            height,
            levels.collect::<Vec<_>>(),
        );
        image.unwrap().save(dir.join(name).join(file)).unwrap();
    }
}

#[test]
fn images_of_10_to_16_bits_equal_8_bits() {
    let mut expected = capture(3);
    for (index, view) in expected.images.iter_mut().enumerate() {
        // The cameras differ in brightness, but are scaled alike.
        view.grey[0] = if index == 0 { 255 } else { 90 };
    }
    for file in ["0.png", "0.tif", "0.tiff"] {
        for (bits, factor) in [(10, 4), (12, 16), (14, 64), (16, 256)] {
            let dir = TempDir::new().unwrap();
            save_deep(dir.path(), file, &expected, factor);
            let folder = Folder::open(dir.path(), &names(), [6, 4], 1).unwrap();
            let found = folder.frame_sets().next().unwrap().unwrap();
            assert_eq!(found.images, expected.images, "{file}, {bits} bits");
            let warning = folder.warnings()[0].to_string();
            let said = format!("use {bits} bits; values are divided by {factor}");
            assert!(warning.contains(&said), "{warning}");
        }
    }
}

#[test]
fn scale_of_16_bit_images_never_falls() {
    let dir = TempDir::new().unwrap();
    let mut bright = capture(0);
    bright.images[0].grey[0] = 255;
    let mut dark = capture(1);
    for grey in dark.images.iter_mut().flat_map(|view| &mut view.grey) {
        *grey = 8;
    }
    save_deep(dir.path(), "0.png", &bright, 16);
    save_deep(dir.path(), "1.png", &dark, 16);
    let folder = Folder::open(dir.path(), &names(), [6, 4], 1).unwrap();
    let found: Vec<FrameSet> = folder.frame_sets().map(Result::unwrap).collect();
    assert_eq!(found[0].images, bright.images);
    assert_eq!(found[1].images, dark.images);
}

#[test]
fn saturation_of_16_bit_images_is_named() {
    let dir = TempDir::new().unwrap();
    let mut bright = capture(0);
    bright.images[1].grey[..6].fill(255);
    save_deep(dir.path(), "0.png", &bright, 257);
    let folder = Folder::open(dir.path(), &names(), [6, 4], 1).unwrap();
    let warnings: Vec<String> = folder.warnings().iter().map(ToString::to_string).collect();
    let said = |w: &String| w.contains("25.0 % of its pixels saturated");
    assert!(warnings.iter().any(said), "{warnings:?}");
}

#[test]
fn tiff_bmp_and_webp_are_read() {
    let dir = TempDir::new().unwrap();
    for file in ["a.tif", "a.tiff", "a.bmp", "a.webp"] {
        let path = dir.path().join(file);
        let grey = image::GrayImage::from_fn(6, 4, |x, y| image::Luma([(x * 40 + y) as u8]));
        let image = image::DynamicImage::from(grey.clone());
        // WebP has no grey images.
        let image = match file {
            "a.webp" => image::DynamicImage::from(image.to_rgb8()),
            _ => image,
        };
        image.save(&path).unwrap();
        assert_eq!(read(&path, [6, 4]).unwrap().grey, grey.into_raw(), "{file}");
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() / 2 {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(read(&path, [6, 4]).is_err(), "{file} cut to {length} bytes");
        }
    }
}
