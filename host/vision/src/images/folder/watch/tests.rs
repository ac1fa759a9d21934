//! Files that come whole, in halves, late or never. Time is an argument, so no test waits.

use super::*;
use crate::images::Image;
use crate::images::folder::write;
use crate::images::series::stack::tests::stack_of;
use std::cell::RefCell;
use std::rc::Rc;
use tempfile::TempDir;

struct Bench {
    folder: TempDir,
    told: Rc<RefCell<Vec<String>>>,
    start: Instant,
}

const NAMES: [&str; 2] = ["left", "right"];
const SIZE_PX: [u32; 2] = [8, 8];

impl Bench {
    fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            told: Rc::default(),
            start: Instant::now(),
        }
    }

    fn watch(&self, idle_s: Option<u64>) -> Watch<impl FnMut(&InputError)> {
        self.watch_cameras(&NAMES, idle_s)
    }

    fn watch_cameras(
        &self,
        names: &[&str],
        idle_s: Option<u64>,
    ) -> Watch<impl FnMut(&InputError) + use<>> {
        let settings = Settings {
            period_us: 1_000,
            idle: idle_s.map(Duration::from_secs),
            stop: Arc::default(),
        };
        let told = Rc::clone(&self.told);
        let tell = move |error: &InputError| told.borrow_mut().push(error.to_string());
        let names: Vec<String> = names.iter().copied().map(String::from).collect();
        Watch::open(self.folder.path(), &names, SIZE_PX, settings, tell).unwrap()
    }

    fn at(&self, ms: u64) -> Instant {
        // Later than the opening of the watch in any case.
        self.start + Duration::from_secs(1_000) + Duration::from_millis(ms)
    }

    fn path(&self, camera: &str, name: &str) -> PathBuf {
        let folder = self.folder.path().join(camera);
        fs::create_dir_all(&folder).unwrap();
        folder.join(name)
    }

    fn whole(&self, camera: &str, name: &str, grey: u8) {
        let image = Image {
            width: 8,
            height: 8,
            grey: vec![grey; 64],
        };
        write(&self.path(camera, name), &image).unwrap();
    }

    fn told(&self) -> Vec<String> {
        self.told.take()
    }
}

#[track_caller]
fn grey(look: Result<Look, InputError>) -> u8 {
    match look {
        Ok(Look::FrameSet(capture)) => capture.images[0].grey[0],
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn unreadable(look: Result<Look, InputError>) -> InputError {
    match look {
        Ok(Look::Unreadable(error)) => error,
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn nothing(look: Result<Look, InputError>) {
    assert!(matches!(look, Ok(Look::Nothing)), "{look:?}");
}

#[test]
fn settled_frame_set_is_given() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    nothing(watch.look(bench.at(0)));
    bench.whole("left", "1.png", 7);
    nothing(watch.look(bench.at(100)));
    nothing(watch.look(bench.at(900)));
    bench.whole("right", "1.png", 8);
    nothing(watch.look(bench.at(1_000)));
    nothing(watch.look(bench.at(1_199)));
    assert_eq!(grey(watch.look(bench.at(1_200))), 7);
    // Reported once.
    nothing(watch.look(bench.at(9_000)));
    assert!(bench.told().is_empty());
}

#[test]
fn stacks_and_videos_are_refused_by_name() {
    let page = Image {
        width: 8,
        height: 8,
        grey: vec![7; 64],
    };
    let stack = stack_of(&[page.clone(), page.clone()], 1);
    for (folder, name) in [
        ("", "left.tif"),
        ("", "right.Y4M"),
        ("left", "all.tif"),
        ("right", "0.y4m"),
    ] {
        let bench = Bench::new();
        let mut watch = bench.watch(None);
        nothing(watch.look(bench.at(0)));
        fs::write(bench.path(folder, name), &stack).unwrap();
        let error = watch.look(bench.at(100)).unwrap_err().to_string();
        assert!(
            error.contains(name) && error.contains("--images"),
            "{error}"
        );
    }
    // A single page is an image, and a stack after it is an error of its frame set.
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    let single = stack_of(&[page], 1);
    for camera in NAMES {
        fs::write(bench.path(camera, "0.tif"), &single).unwrap();
    }
    nothing(watch.look(bench.at(0)));
    assert_eq!(grey(watch.look(bench.at(300))), 7);
    for camera in NAMES {
        fs::write(bench.path(camera, "1.tif"), &stack).unwrap();
    }
    nothing(watch.look(bench.at(400)));
    let error = unreadable(watch.look(bench.at(3_000)));
    assert!(error.to_string().contains("1.tif: a stack"), "{error}");
}

#[test]
fn unread_formats_are_reported_once() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    fs::write(bench.path("left", "0.gif"), "GIF89a").unwrap();
    nothing(watch.look(bench.at(100)));
    nothing(watch.look(bench.at(900)));
    let told = bench.told();
    assert!(
        told.len() == 1 && told[0].contains("not read: 0.gif"),
        "{told:?}"
    );
}

#[test]
fn growing_file_is_not_read() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    for camera in NAMES {
        bench.whole(camera, "1.png", 7);
    }
    let whole = fs::read(bench.path("right", "1.png")).unwrap();
    // Written byte by byte with pauses shorter and longer than the settling time: a truncated file
    // is never given, and is not an error yet. The last 12 bytes of a PNG only mark its end.
    for (step, length) in (1..whole.len() - 16).step_by(9).enumerate() {
        fs::write(bench.path("right", "1.png"), &whole[..length]).unwrap();
        let ms = 1_000 * step as u64;
        for after in [0, 150, 250, 990] {
            nothing(watch.look(bench.at(ms + after)));
        }
    }
    fs::write(bench.path("right", "1.png"), &whole).unwrap();
    nothing(watch.look(bench.at(100_000)));
    assert_eq!(grey(watch.look(bench.at(100_200))), 7);
}

#[test]
fn truncated_file_is_named() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    bench.whole("left", "1.png", 7);
    fs::write(bench.path("right", "1.png"), b"\x89PNG").unwrap();
    nothing(watch.look(bench.at(0)));
    nothing(watch.look(bench.at(1_999)));
    let error = unreadable(watch.look(bench.at(2_000)));
    assert_eq!(error.file, bench.path("right", "1.png"));
    // Reported once, and the next file has its own time.
    for camera in NAMES {
        bench.whole(camera, "2.png", 2);
    }
    nothing(watch.look(bench.at(3_000)));
    match watch.look(bench.at(3_200)) {
        Ok(Look::FrameSet(capture)) => assert_eq!(capture.time_us, 1_000),
        other => panic!("{other:?}"),
    }
    // The same for an image of another size.
    let bench = Bench::new();
    let mut watch = bench.watch(Some(1));
    watch.size_px = [9, 8];
    for camera in NAMES {
        bench.whole(camera, "1.png", 7);
    }
    nothing(watch.look(bench.at(0)));
    nothing(watch.look(bench.at(999)));
    let error = unreadable(watch.look(bench.at(1_000)));
    assert!(error.reason.contains("8 x 8 px"), "{error}");
    assert!(matches!(watch.look(bench.at(1_050)), Ok(Look::Over)));
}

#[test]
fn changed_file_is_not_given() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    for (name, grey) in [("1.png", 1), ("2.png", 2), ("3.png", 3)] {
        for camera in NAMES {
            bench.whole(camera, name, grey);
        }
    }
    nothing(watch.look(bench.at(0)));
    watch.list(bench.at(300)).unwrap();
    // A readable file that has changed after it settled, and one that is gone.
    let path = bench.path("right", "1.png");
    bench.whole("right", "1.png", 9);
    let later = SystemTime::now() + Duration::from_secs(7);
    fs::File::options()
        .write(true)
        .open(path)
        .unwrap()
        .set_modified(later)
        .unwrap();
    nothing(Ok(watch.ready(bench.at(310), false)));
    nothing(watch.look(bench.at(350)));
    match watch.look(bench.at(550)) {
        Ok(Look::FrameSet(capture)) => assert_eq!(capture.images[1].grey[0], 9),
        other => panic!("{other:?}"),
    }
    for camera in NAMES {
        fs::remove_file(bench.path(camera, "2.png")).unwrap();
    }
    nothing(Ok(watch.ready(bench.at(5_000), false)));
    assert_eq!(grey(watch.look(bench.at(5_050))), 3);
    assert_eq!(bench.told(), [""; 0]);
}

#[test]
fn long_folder_is_listed_once() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    for n in 0..30 {
        for camera in NAMES {
            bench.whole(camera, &format!("{n}.png"), n);
        }
    }
    nothing(watch.look(bench.at(0)));
    assert_eq!(grey(watch.look(bench.at(300))), 0);
    for n in 1..30 {
        assert_eq!(grey(Ok(watch.ready(bench.at(300), false))), n);
    }
    nothing(Ok(watch.ready(bench.at(300), false)));
}

#[test]
fn removed_frame_sets_are_forgotten() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    for n in 0..20 {
        let name = format!("{n}.png");
        for camera in NAMES {
            bench.whole(camera, &name, n);
        }
        let ms = 1_000 * u64::from(n);
        nothing(watch.look(bench.at(ms)));
        assert_eq!(grey(watch.look(bench.at(ms + 200))), n);
        for camera in NAMES {
            fs::remove_file(bench.path(camera, &name)).unwrap();
        }
        assert!(watch.done.len() <= 2, "{:?}", watch.done);
    }
    // The last file and an earlier one come once more.
    for name in ["19.png", "7.png"] {
        nothing(watch.look(bench.at(30_000)));
        for camera in NAMES {
            bench.whole(camera, name, 99);
        }
        nothing(watch.look(bench.at(31_000)));
        nothing(watch.look(bench.at(39_000)));
        let told = bench.told();
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(told[0].contains("came after"), "{told:?}");
    }
}

#[test]
fn frame_sets_come_in_name_order() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    for name in ["view10.png", "view9.png", "view11.png"] {
        for camera in NAMES {
            bench.whole(camera, name, name[4..name.len() - 4].parse().unwrap());
        }
    }
    nothing(watch.look(bench.at(0)));
    let mut times = Vec::new();
    for expected in [9, 10, 11] {
        match watch.look(bench.at(300)) {
            Ok(Look::FrameSet(capture)) => {
                assert_eq!(capture.images[1].grey[0], expected);
                times.push(capture.time_us);
            }
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(times, [0, 1_000, 2_000]);
}

#[test]
fn incomplete_set_is_skipped_after_patience() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    bench.whole("left", "1.png", 1);
    nothing(watch.look(bench.at(0)));
    // Without a later frame set, an incomplete one waits without limit.
    nothing(watch.look(bench.at(60_000)));
    for camera in NAMES {
        bench.whole(camera, "2.png", 2);
    }
    let told = bench.told();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("right: no image yet"), "{told:?}");
    nothing(watch.look(bench.at(60_100)));
    assert_eq!(grey(watch.look(bench.at(60_300))), 2);
    let told = bench.told();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("right/1.png: never came"), "{told:?}");
    assert!(told[0].ends_with("; the frame set is skipped"), "{told:?}");

    // Two incomplete frame sets: the first waits its two seconds, then the second comes at once.
    bench.whole("right", "3.png", 3);
    for camera in NAMES {
        bench.whole(camera, "4.png", 4);
    }
    nothing(watch.look(bench.at(70_000)));
    nothing(watch.look(bench.at(71_900)));
    assert_eq!(grey(watch.look(bench.at(72_000))), 4);
    assert!(bench.told()[0].contains("left/3.png: never came"));
    // A frame set that comes now is too late: it is reported once, the skipped one not again.
    bench.whole("left", "3.png", 3);
    bench.whole("left", "0.png", 0);
    bench.whole("right", "0.png", 0);
    nothing(watch.look(bench.at(73_000)));
    nothing(watch.look(bench.at(80_000)));
    let told = bench.told();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("left/0.png: came after"), "{told:?}");
    assert!(told[0].ends_with("; skipped"), "{told:?}");
}

#[test]
fn silent_camera_is_left_out() {
    const TRIO: [&str; 3] = ["left", "middle", "right"];
    let bench = Bench::new();
    let mut watch = bench.watch_cameras(&TRIO, Some(10));
    let mut present = |ms| match watch.look(bench.at(ms)) {
        Ok(Look::FrameSet(capture)) => {
            let shown = capture.images.iter().map(|view| !view.is_missing());
            Some((capture.time_us, shown.collect::<Vec<_>>()))
        }
        Ok(_) => None,
        Err(error) => panic!("{error}"),
    };
    // No image of the third camera yet: its files may be copied last.
    bench.whole("left", "1.png", 1);
    bench.whole("middle", "1.png", 1);
    assert_eq!(present(0), None);
    assert_eq!(present(9_000), None);
    bench.whole("right", "1.png", 1);
    assert_eq!(present(9_100), None);
    assert_eq!(present(9_300), Some((0, vec![true; 3])));
    // The camera misses one frame set and goes on.
    for camera in ["left", "middle"] {
        bench.whole(camera, "2.png", 2);
    }
    for camera in TRIO {
        bench.whole(camera, "3.png", 3);
    }
    assert_eq!(present(10_000), None);
    assert_eq!(present(11_900), None);
    assert_eq!(present(12_000), Some((1_000, vec![true, true, false])));
    assert_eq!(present(12_000), Some((2_000, vec![true; 3])));
    // The camera is gone: the next frame set waits until the camera has been silent for two
    // seconds, later ones likewise.
    for (name, ms) in [("4.png", 12_500), ("5.png", 15_000)] {
        bench.whole("left", name, 4);
        bench.whole("middle", name, 4);
        assert_eq!(present(ms), None);
        assert_eq!(present(ms + 1_999), None);
        assert!(present(ms + 2_000).is_some_and(|(_, shown)| shown == [true, true, false]));
    }
    // A single image is not a frame set.
    bench.whole("middle", "6.png", 6);
    assert_eq!(present(18_000), None);
    assert_eq!(present(20_000), None);
    let told = bench.told();
    assert!(told[0].contains("right: no image yet"), "{told:?}");
    assert!(told[1].contains("left/6.png: never came"), "{told:?}");
}

#[test]
fn unheard_camera_is_awaited() {
    let bench = Bench::new();
    let mut watch = bench.watch_cameras(&["left", "middle", "right"], Some(10));
    bench.whole("left", "1.png", 1);
    bench.whole("middle", "1.png", 1);
    nothing(watch.look(bench.at(0)));
    nothing(watch.look(bench.at(1_999)));
    assert_eq!(bench.told(), [""; 0]);
    nothing(watch.look(bench.at(2_000)));
    nothing(watch.look(bench.at(9_999)));
    match watch.look(bench.at(10_000)) {
        Ok(Look::FrameSet(capture)) => assert!(capture.images[2].is_missing()),
        other => panic!("{other:?}"),
    }
    // The missing camera is reported once.
    let told = bench.told();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("right: no image yet"), "{told:?}");
}

#[test]
fn idle_folder_ends() {
    let bench = Bench::new();
    let mut watch = bench.watch(Some(10));
    for camera in NAMES {
        bench.whole(camera, "1.png", 1);
    }
    nothing(watch.look(bench.at(0)));
    assert_eq!(grey(watch.look(bench.at(300))), 1);
    nothing(watch.look(bench.at(9_000)));
    bench.whole("left", "2.png", 2);
    nothing(watch.look(bench.at(9_500)));
    nothing(watch.look(bench.at(19_499)));
    assert!(matches!(watch.look(bench.at(19_500)), Ok(Look::Over)));
    assert!(bench.told()[0].contains("right/2.png: never came"));
}

#[test]
fn hidden_files_and_late_folders_are_accepted() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    nothing(watch.look(bench.at(0)));
    for camera in NAMES {
        fs::write(bench.path(camera, ".1.png"), b"half").unwrap();
        fs::write(bench.path(camera, "notes.txt"), b"notes").unwrap();
    }
    nothing(watch.look(bench.at(10_000)));
    for camera in NAMES {
        bench.whole(camera, ".1.png", 5);
        fs::rename(bench.path(camera, ".1.png"), bench.path(camera, "1.png")).unwrap();
    }
    nothing(watch.look(bench.at(20_000)));
    assert_eq!(grey(watch.look(bench.at(20_200))), 5);
}

#[test]
fn stop_ends_the_watch() {
    let bench = Bench::new();
    let mut watch = bench.watch(None);
    watch.settings.stop.store(true, Relaxed);
    assert!(watch.next().is_none());
    let nowhere = bench.folder.path().join("nowhere");
    let settings = watch.settings.clone();
    assert!(Watch::open(&nowhere, &[], SIZE_PX, settings, |_| {}).is_err());
}
