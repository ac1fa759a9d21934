//! Cameras whose images come when the test sends them. The images carry their own times, so a slow
//! machine changes nothing.

use super::*;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Camera that delivers the images it is sent; ends with an error when all senders are gone.
struct Sent {
    name: &'static str,
    shots: Receiver<CameraEvent>,
    sent: u64,
}

impl Camera for Sent {
    fn path(&self) -> PathBuf {
        self.name.into()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        let gone = |_| InputError::file(&self.path(), "unplugged");
        let shot = self.shots.recv().map_err(gone)?;
        self.sent += 1;
        Ok(shot)
    }

    /// Counts one lost image before each delivered one.
    fn lost(&self) -> u64 {
        self.sent
    }
}

struct Bench {
    live: LiveCameras,
    stop: Arc<AtomicBool>,
    told: Receiver<String>,
    senders: Vec<Sender<CameraEvent>>,
}

const NAMES: [&str; 3] = ["/dev/left", "/dev/middle", "/dev/right"];

fn bench() -> Bench {
    bench_with([30_000; 3])
}

fn bench_with(delays_us: [i64; 3]) -> Bench {
    let (senders, cameras) = NAMES
        .map(|name| {
            let (sender, shots) = channel();
            let sent = 0;
            (sender, Sent { name, shots, sent })
        })
        .into_iter()
        .unzip();
    let stop = Arc::new(AtomicBool::new(false));
    let window = Duration::from_millis(5);
    let (teller, told) = channel();
    let tell = move |loss: &InputError| teller.send(loss.to_string()).unwrap();
    let live = LiveCameras::start(cameras, window, &delays_us, Arc::clone(&stop), tell).unwrap();
    Bench {
        live,
        stop,
        told,
        senders,
    }
}

fn image(grey: u8) -> Image {
    Image {
        width: 1,
        height: 1,
        grey: vec![grey],
    }
}

impl Bench {
    /// Sends an image of `camera`, delivered `ms` after the start.
    fn send(&self, camera: usize, ms: u64, grey: u8) {
        let at = self.live.started + Duration::from_millis(ms);
        let shot = CameraEvent::Image(at, image(grey));
        self.senders[camera].send(shot).unwrap();
    }

    /// Waits until `shots` images of each camera have been processed.
    fn settle(&self, shots: [u64; 3]) {
        let seen =
            |tally: &Tally| tally.matching.arrived + tally.stale + tally.damaged + tally.incomplete;
        while self.live.tallies().iter().map(seen).ne(shots) {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

#[test]
fn capture_time_is_mean_less_delay() {
    let mut bench = bench();
    for (camera, ms) in [(0, 100), (1, 103), (2, 101)] {
        bench.send(camera, ms, camera as u8);
    }
    let capture = bench.live.next().unwrap().unwrap();
    assert_eq!(capture.time_us, (304_000 / 3) - 30_000);
    assert_eq!(capture.images, [image(0), image(1), image(2)]);
}

/// Images with equal stamps were taken at different instants if the delays differ.
#[test]
fn each_camera_has_its_own_delay() {
    let mut bench = bench_with([30_000, 10_000, 20_000]);
    for (camera, ms) in [(0, 130), (1, 110), (2, 120), (0, 163), (1, 163), (2, 163)] {
        bench.send(camera, ms, ms as u8);
    }
    bench.settle([2; 3]);
    let capture = bench.live.next().unwrap().unwrap();
    assert_eq!(capture.time_us, 100_000);
    assert_eq!(capture.images, [image(130), image(110), image(120)]);
    bench.stop.store(true, Relaxed);
    assert!(bench.live.next().is_none());
    assert_eq!(bench.live.tallies()[0].matching.used, 1);
}

/// Tests a driver that stamps the start of the exposure.
#[test]
fn negative_delay_adds_to_stamp() {
    let mut bench = bench_with([-8_000; 3]);
    for camera in 0..3 {
        bench.send(camera, 100, 0);
    }
    let capture = bench.live.next().unwrap().unwrap();
    assert_eq!(capture.time_us, 108_000);
}

#[test]
fn newest_set_is_given_and_the_rest_counted() {
    let mut bench = bench();
    for (n, ms) in [100, 133, 167].into_iter().enumerate() {
        for camera in 0..3 {
            bench.send(camera, ms + camera as u64, n as u8);
        }
    }
    bench.send(1, 200, 9);
    bench.senders[2].send(CameraEvent::Damaged).unwrap();
    for _ in 0..2 {
        bench.senders[2].send(CameraEvent::Incomplete).unwrap();
    }
    bench.senders[2].send(CameraEvent::Stale).unwrap();
    // Delivered 20 ms after the start, so taken before it.
    bench.send(0, 20, 9);
    bench.settle([4, 4, 7]);
    let capture = bench.live.next().unwrap().unwrap();
    assert_eq!(capture.images, [image(2), image(2), image(2)]);
    let tallies = bench.live.tallies();
    for (tally, arrived) in tallies.iter().zip([3, 4, 3]) {
        assert_eq!(tally.matching.arrived, arrived);
        assert_eq!(tally.matching.used, 1);
        assert_eq!(tally.matching.overtaken, 2);
    }
    let rest = tallies.iter().map(|t| (t.stale, t.damaged, t.lost));
    assert_eq!(rest.collect::<Vec<_>>(), [(1, 0, 4), (0, 0, 4), (1, 1, 7)]);
    let drops = tallies[2].drops();
    assert!(drops.contains(&("with missing packets", 2)), "{drops:?}");
}

#[test]
fn second_failed_camera_ends_the_run() {
    let mut bench = bench();
    for camera in 0..3 {
        bench.send(camera, 100, 0);
    }
    let capture = bench.live.next().unwrap().unwrap();
    assert!(capture.images.iter().all(|view| !view.is_missing()));
    bench.senders[1] = channel().0;
    for camera in [0, 2] {
        bench.send(camera, 200, 1);
    }
    let capture = bench.live.next().unwrap().unwrap();
    assert_eq!(capture.images, [image(1), Image::missing(), image(1)]);
    assert_eq!(bench.told.try_recv().unwrap(), "/dev/middle: unplugged");
    bench.senders[2] = channel().0;
    let error = bench.live.next().unwrap().unwrap_err();
    assert_eq!(error.to_string(), "/dev/right: unplugged");
    assert!(bench.live.next().is_none());
    assert!(bench.told.try_recv().is_err());
}

#[test]
fn silent_or_distant_cameras_are_named() {
    let mut bench = bench();
    bench.live.patience = Duration::from_millis(50);
    bench.send(0, 100, 0);
    bench.send(2, 100, 0);
    bench.settle([1, 0, 1]);
    let error = bench.live.next().unwrap().unwrap_err().to_string();
    assert!(error.starts_with("/dev/middle: no image for"), "{error}");

    // A camera that sends only unusable images.
    let mut bench = self::bench();
    bench.live.patience = Duration::from_millis(50);
    bench.senders[1].send(CameraEvent::Stale).unwrap();
    bench.settle([0, 1, 0]);
    bench.send(0, 100, 0);
    bench.send(2, 100, 0);
    bench.settle([1, 1, 1]);
    let error = bench.live.next().unwrap().unwrap_err().to_string();
    assert!(
        error.starts_with("/dev/middle: no image that can be used") && error.contains("1 came"),
        "{error}"
    );

    // A camera without partners while the call waits: another thread sends the images.
    let mut bench = self::bench();
    bench.live.patience = Duration::from_secs(2);
    let senders = bench.senders.clone();
    let at = bench.live.started + Duration::from_secs(1);
    let sending = std::thread::spawn(move || {
        for n in 0..40 {
            std::thread::sleep(Duration::from_millis(100));
            for (camera, sender) in senders.iter().enumerate() {
                let late = Duration::from_millis(33 * n + 10 * camera as u64);
                // The bench may be gone at the end.
                let _ = sender.send(CameraEvent::Image(at + late, image(0)));
            }
        }
    });
    let error = bench.live.next().unwrap().unwrap_err().to_string();
    assert!(
        error.contains("--window") && error.contains("ms apart"),
        "{error}"
    );
    drop(bench);
    sending.join().unwrap();
}

/// A caller that looks at something else between two short waits finds a silent camera all the same.
#[test]
fn short_waits_add_up() {
    let mut bench = bench();
    bench.live.patience = Duration::from_secs(1);
    bench.send(0, 100, 0);
    bench.settle([1, 0, 0]);
    let mut pending = 0;
    let found = loop {
        match bench.live.next_within(Duration::from_millis(20)) {
            Poll::Pending => pending += 1,
            Poll::Ready(found) => break found,
        }
    };
    assert!(pending > 0);
    let error = found.unwrap().unwrap_err().to_string();
    assert!(error.contains("no image for"), "{error}");
    let after = bench.live.next_within(Duration::ZERO);
    assert!(matches!(after, Poll::Ready(None)));
}

#[test]
fn stop_ends_frame_sets() {
    let mut bench = bench();
    bench.stop.store(true, Relaxed);
    assert!(bench.live.next().is_none());
}

/// Camera that delivers what it is sent; a [`CameraEvent::Nothing`] is an image that its driver
/// lost.
struct Counting {
    name: &'static str,
    shots: Receiver<CameraEvent>,
    lost: u64,
}

impl Camera for Counting {
    fn path(&self) -> PathBuf {
        self.name.into()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        let gone = |_| InputError::file(&self.path(), "unplugged");
        let shot = self.shots.recv().map_err(gone)?;
        self.lost += u64::from(shot == CameraEvent::Nothing);
        Ok(shot)
    }

    fn lost(&self) -> u64 {
        self.lost
    }
}

/// The middle camera's driver loses the image of trigger 3, the right camera gives two of trigger 4,
/// and the left one leaves trigger 5 out.
#[test]
fn triggered_images_have_their_triggers_time() {
    let (senders, cameras): (Vec<_>, Vec<_>) = NAMES
        .map(|name| {
            let (sender, shots) = channel();
            let lost = 0;
            (sender, Counting { name, shots, lost })
        })
        .into_iter()
        .unzip();
    let triggers = Arc::new(Triggers::new(100, 0));
    let (teller, told) = channel();
    let tell = move |anomaly: &InputError| teller.send(anomaly.to_string()).unwrap();
    let stop = Arc::default();
    let live = LiveCameras::start_triggered(cameras, &triggers, stop, |_| (), tell);
    let mut live = live.unwrap();
    let begun = live.started;
    let at = |number: u32| begun + Duration::from_millis(10) * number;
    let give = |number: u32, count: u32| {
        let instant_us = 5_000_000 + 10_000 * u64::from(number);
        triggers.ping(at(number) - Duration::from_micros(500), instant_us - 500);
        triggers.report(count, instant_us, at(number) + Duration::from_millis(1));
    };
    let send = |camera: usize, number: u32| {
        let late = at(number) + Duration::from_millis(camera as u64);
        let shot = CameraEvent::Image(late, image(number as u8));
        senders[camera].send(shot).unwrap();
    };
    for number in 1..=2 {
        give(number, number);
        (0..3).for_each(|camera| send(camera, number));
    }
    while triggers.learn().is_err() {
        std::thread::sleep(Duration::from_millis(1));
    }
    triggers.begin();
    (11..=17).for_each(|number| give(number, number - 10));
    // The first one only starts the count.
    for number in [11, 12] {
        (0..3).for_each(|camera| send(camera, number));
    }
    let mut is_next = |number: u8| {
        let capture = live.next().unwrap().unwrap();
        assert_eq!(capture.time_us, 5_000_000 + 10_000 * u64::from(number));
        assert_eq!(
            capture.images,
            [image(number), image(number), image(number)]
        );
    };
    is_next(12);
    senders[1].send(CameraEvent::Nothing).unwrap();
    for (camera, number) in [(0, 13), (0, 14), (1, 14), (2, 13), (2, 14)] {
        send(camera, number);
    }
    is_next(14);
    send(2, 14);
    for (camera, number) in [(0, 16), (1, 15), (1, 16), (2, 15), (2, 16)] {
        send(camera, number);
    }
    (0..3).for_each(|camera| send(camera, 17));
    is_next(17);
    let mut told: Vec<String> = told.try_iter().collect();
    told.sort();
    let expected = [
        "/dev/left: no image of trigger 5; the image that fits trigger 6 is not used, because it \
         may be of another",
        "/dev/middle: no image of trigger 3",
        "/dev/right: a second image of trigger 4",
        "/dev/right: the image that fits trigger 5 is not used, because it may be of another",
    ];
    assert_eq!(told, expected);
    let counts = live.tallies().into_iter();
    let counts = counts.map(|tally| (tally.missed, tally.doubled, tally.doubtful));
    assert_eq!(
        counts.collect::<Vec<_>>(),
        [(1, 0, 1), (1, 0, 0), (0, 1, 1)]
    );
}
