//! Invariants of the matching, with cameras that jitter, drop images, stop, start late and run at
//! other rates.

use super::*;
use proptest::prelude::*;

/// Times of the images of each camera, µs.
type Streams = Vec<Vec<u64>>;

/// Image: its camera and number.
type Picture = (usize, usize);
type Run = (Vec<Set<Picture>>, Matching<Picture>);

/// Pushes all images in the order of their times (cameras in order where equal), and takes sets as
/// they come.
fn run(streams: &Streams, window_us: u64) -> Run {
    let mut arrivals: Vec<(u64, usize, usize)> = Vec::new();
    for (camera, times) in streams.iter().enumerate() {
        arrivals.extend(times.iter().enumerate().map(|(n, t)| (*t, camera, n)));
    }
    arrivals.sort_unstable();
    deliver(streams.len(), &arrivals, window_us)
}

fn deliver(cameras: usize, arrivals: &[(u64, usize, usize)], window_us: u64) -> Run {
    let mut matching = Matching::new(cameras, window_us);
    let mut sets = Vec::new();
    for (time_us, camera, number) in arrivals {
        matching.push(*camera, *time_us, (*camera, *number));
        while let Some(set) = matching.take() {
            sets.push(set);
        }
    }
    (sets, matching)
}

/// Checks the invariants that hold for any images.
fn assert_laws(
    streams: &Streams,
    window_us: u64,
    sets: &[Set<Picture>],
    matching: &Matching<Picture>,
) -> Result<(), TestCaseError> {
    for set in sets {
        prop_assert!(set.spread_us() <= window_us);
        prop_assert_eq!(set.pictures.len(), streams.len());
        prop_assert!(set.times_us().count() >= 2);
        for (camera, picture) in set.pictures.iter().enumerate() {
            if let Some((time_us, (of, number))) = picture {
                prop_assert_eq!(camera, *of);
                prop_assert_eq!(streams[camera][*number], *time_us);
            }
        }
        let [first, last] = [set.times_us().min(), set.times_us().max()];
        prop_assert!(first <= Some(set.time_us()) && Some(set.time_us()) <= last);
    }
    for camera in 0..streams.len() {
        let used = sets.iter().filter_map(|set| set.pictures[camera]);
        prop_assert!(used.is_sorted_by_key(|(time_us, _)| time_us));
    }
    for (camera, counts) in matching.counts().iter().enumerate() {
        let waiting = matching.waiting[camera].len();
        prop_assert!(waiting <= DEPTH);
        prop_assert_eq!(counts.arrived, streams[camera].len() as u64);
        let used = sets.iter().filter(|set| set.pictures[camera].is_some());
        prop_assert_eq!(counts.used, used.count() as u64);
        prop_assert_eq!(counts.overtaken, 0);
        let known = counts.used + counts.unmatched + counts.disordered + waiting as u64;
        prop_assert_eq!(counts.arrived, known);
    }
    Ok(())
}

/// Generates an image of a camera: its delay in µs, and true if it is lost.
fn picture(jitter_us: u64) -> impl Strategy<Value = (u64, bool)> {
    (0..=jitter_us, prop::bool::weighted(0.15))
}

/// Generates cameras that are triggered together every 1,000 µs, each with a jitter, and each
/// losing some images.
fn triggered(jitter_us: u64) -> impl Strategy<Value = Vec<Vec<(u64, bool)>>> {
    (2usize..=5, 1usize..40).prop_flat_map(move |(cameras, pictures)| {
        let stream = prop::collection::vec(picture(jitter_us), pictures);
        prop::collection::vec(stream, cameras)
    })
}

const PERIOD_US: u64 = 1_000;

fn times(stream: &[(u64, bool)]) -> Vec<u64> {
    let times = stream.iter().enumerate();
    times
        .filter(|(_, (_, lost))| !lost)
        .map(|(n, (late, _))| n as u64 * PERIOD_US + late)
        .collect()
}

proptest! {
    #[test]
    fn invariants_hold_for_any_times(
        gaps in prop::collection::vec(prop::collection::vec(1u64..3_000, 0..30), 2..6),
        starts in prop::collection::vec(0u64..5_000, 6),
        window_us in 0u64..2_000,
    ) {
        let streams: Streams = gaps.iter().zip(starts).map(|(gaps, start)| {
            gaps.iter().scan(start, |time, gap| { *time += gap; Some(*time) }).collect()
        }).collect();
        let (sets, matching) = run(&streams, window_us);
        assert_laws(&streams, window_us, &sets, &matching)?;
    }

    /// Tests that every trigger at which no camera lost its image gives a set.
    #[test]
    fn whole_trigger_is_a_set(cameras in triggered(400)) {
        let streams: Streams = cameras.iter().map(|stream| times(stream)).collect();
        let (sets, matching) = run(&streams, 400);
        assert_laws(&streams, 400, &sets, &matching)?;
        let whole: Vec<u64> = (0..cameras[0].len())
            .filter(|n| cameras.iter().all(|stream| !stream[*n].1))
            .map(|n| n as u64)
            .collect();
        let found = sets.iter().filter(|set| set.pictures.iter().all(Option::is_some));
        let found: Vec<u64> = found.map(|set| set.time_us() / PERIOD_US).collect();
        prop_assert_eq!(found, whole);
    }

    /// Tests that the sets do not depend on the cameras' delays, as long as at most [`DEPTH`]
    /// images wait.
    #[test]
    fn arrival_order_changes_nothing(
        cameras in triggered(500),
        delays in prop::collection::vec(0u64..6_000, 5),
    ) {
        let streams: Streams = cameras.iter().map(|stream| times(stream)).collect();
        let (sets, _) = run(&streams, 250);
        let mut late: Vec<(u64, usize, u64, usize)> = Vec::new();
        for (camera, times) in streams.iter().enumerate() {
            late.extend(times.iter().enumerate().map(|(n, t)| (t + delays[camera], camera, *t, n)));
        }
        late.sort_unstable();
        let arrivals: Vec<_> = late.into_iter().map(|(_, camera, t, n)| (t, camera, n)).collect();
        let (others, _) = deliver(streams.len(), &arrivals, 250);
        prop_assert_eq!(sets, others);
    }

    /// Tests that the newest set is the last of those that single calls return.
    #[test]
    fn newest_set_overtakes_others(cameras in triggered(100)) {
        let first = |stream: &Vec<_>| times(&stream[..stream.len().min(DEPTH)]);
        let streams: Streams = cameras.iter().map(first).collect();
        let (sets, _) = run(&streams, 100);
        let mut matching = Matching::new(streams.len(), 100);
        for (camera, times) in streams.iter().enumerate() {
            for (number, time) in times.iter().enumerate() {
                matching.push(camera, *time, (camera, number));
            }
        }
        let newest = matching.take_newest();
        prop_assert_eq!(newest.as_ref(), sets.last());
        let expected = sets.len().saturating_sub(1) as u64;
        for counts in matching.counts() {
            prop_assert_eq!(counts.overtaken, expected);
            prop_assert_eq!(counts.used, u64::from(!sets.is_empty()));
        }
        prop_assert_eq!(matching.take_newest(), None);
    }
}

fn every(period_us: u64, from_us: u64, count: u64) -> Vec<u64> {
    (0..count).map(|n| from_us + n * period_us).collect()
}

#[test]
fn single_camera_makes_no_set_and_stays_bounded() {
    let streams = vec![every(100, 0, 50), every(100, 5, 20)];
    let (sets, matching) = run(&streams, 10);
    assert_eq!(sets.len(), 20);
    assert_eq!(matching.counts()[0].unmatched, (30 - DEPTH) as u64);
    assert_eq!(matching.apart_us(), Some(4_900 - 1_905));
    // The camera comes back, and so do the sets.
    let mut back = streams;
    back[1].extend(every(100, 4_005, 10));
    assert_eq!(run(&back, 10).0.len(), 30);
}

#[test]
fn stopped_camera_is_left_out_until_it_returns() {
    let every = |from_ms: u64, count| every(100_000, 1_000 * from_ms, count);
    let mut streams = vec![every(0, 50), every(3, 50), every(5, 20)];
    let without = |sets: &[Set<Picture>]| {
        let two = sets.iter().filter(|set| set.pictures[2].is_none());
        two.count()
    };
    let (sets, matching) = run(&streams, 10_000);
    // The silence is noticed before an image of the others is dropped.
    assert_eq!((sets.len(), without(&sets)), (50, 30));
    assert_eq!(matching.counts().iter().map(|c| c.unmatched).max(), Some(0));
    assert_eq!(matching.apart_us(), Some(3_000));
    assert!(!matching.needs(2));
    streams[2].extend(every(4_005, 10));
    let (sets, matching) = run(&streams, 10_000);
    // Its first image comes after the others' images have made their set.
    assert_eq!((sets.len(), without(&sets)), (50, 21));
    assert!(matching.needs(2));
    // A camera that has not sent any image may be slow to start.
    streams[2].clear();
    assert!(run(&streams, 10_000).0.is_empty());
}

/// Tests that silence is noticed before a caller gives up after three seconds.
#[test]
fn silence_is_noticed_at_one_image_per_second() {
    for period_ms in [33, 100, 250, 500, 1_000] {
        let every = |count| every(1_000 * period_ms, 0, count);
        let streams = vec![every(20), every(20), every(10)];
        let (sets, _) = run(&streams, 1_000);
        let whole = sets.iter().filter(|set| set.pictures[2].is_some());
        assert_eq!(whole.count(), 10, "{period_ms}");
        // Until then the others' images wait.
        let mut matching = Matching::new(3, 1_000);
        matching.push(2, 0, 2);
        let mut noticed_ms = None;
        for ms in (0..10_000).step_by(period_ms as usize) {
            for camera in [0, 1] {
                matching.push(camera, 1_000 * ms, camera);
            }
            let set = matching.take_newest();
            if set.is_some_and(|set| set.pictures[2].is_none()) {
                noticed_ms = noticed_ms.or(Some(ms));
            }
        }
        let noticed_ms = noticed_ms.expect("it is noticed");
        let longest_ms = (2 * period_ms).max(500 + period_ms);
        assert!(
            (500..=longest_ms).contains(&noticed_ms),
            "{period_ms} {noticed_ms}"
        );
    }
}

#[test]
fn pausing_camera_is_awaited() {
    let mut streams = vec![every(33_333, 0, 60), every(33_333, 0, 60)];
    streams.push(
        streams[0]
            .iter()
            .copied()
            .filter(|t| !(500_000..950_000).contains(t))
            .collect(),
    );
    let (sets, matching) = run(&streams, 1_000);
    assert_eq!(sets.len(), streams[2].len());
    assert!(matching.needs(2) && sets.iter().all(|set| set.pictures[2].is_some()));
}

#[test]
fn two_cameras_are_always_left() {
    let mut matching = Matching::new(3, 10);
    assert!(matching.leave_out(1) && !matching.leave_out(0) && !matching.leave_out(2));
    for camera in [0, 2] {
        matching.push(camera, 100, camera);
    }
    let set = matching.take().expect("two are enough");
    assert_eq!(set.pictures, [Some((100, 0)), None, Some((100, 2))]);
    // The camera comes back, and another one may stop.
    matching.push(1, 200, 1);
    assert!(matching.take().is_none() && matching.leave_out(0));
}

#[test]
fn late_camera_finds_partners_at_once() {
    let streams = vec![every(100, 0, 30), every(100, 1_402, 16)];
    let (sets, matching) = run(&streams, 5);
    assert_eq!(sets.len(), 16);
    assert!(sets[0].times_us().eq([1_400, 1_402]));
    assert_eq!(matching.counts()[0].unmatched, 14);
    assert_eq!(matching.counts()[1].unmatched, 0);
}

#[test]
fn faster_camera_gives_its_nearest_image() {
    // Three times as fast, with an offset of 12: of 988, 1021, 1054 the first is nearest to 1000.
    let streams = vec![every(100, 1_000, 10), every(33, 988, 29)];
    let (sets, matching) = run(&streams, 16);
    assert_eq!(sets.len(), 10, "{sets:?}");
    for set in &sets {
        let first = set.times_us().next().expect("two");
        let nearest = streams[1].iter().map(|t| t.abs_diff(first)).min();
        assert_eq!(Some(set.spread_us()), nearest, "{set:?}");
    }
    assert_eq!(matching.counts()[0].unmatched, 0);
    assert_eq!(matching.counts()[1].unmatched, 19);
}

#[test]
fn distant_cameras_make_no_set() {
    let streams = vec![every(100, 0, 40), every(100, 50, 40)];
    let (sets, matching) = run(&streams, 49);
    assert!(sets.is_empty());
    assert_eq!(matching.apart_us(), Some(50));
    assert_eq!(run(&streams, 50).0.len(), 40);
}

#[test]
fn disordered_images_are_not_used() {
    let mut matching = Matching::new(2, 10);
    for time_us in [100, 100, 90, 200] {
        matching.push(0, time_us, time_us);
    }
    matching.push(1, 95, 95);
    let take = |matching: &mut Matching<u64>, expected: [u64; 2]| {
        let set = matching.take().expect("a set");
        assert_eq!(
            set.pictures,
            expected.map(|time_us| Some((time_us, time_us)))
        );
    };
    take(&mut matching, [100, 95]);
    matching.push(1, 205, 205);
    take(&mut matching, [200, 205]);
    assert_eq!(matching.counts()[0].disordered, 2);
    // An image of a camera that does not exist.
    matching.push(7, 300, 300);
    assert_eq!(matching.counts().len(), 2);
    assert_eq!(Matching::<()>::new(3, 10).apart_us(), None);
}

/// A program that starts its station meanwhile takes no sets.
#[test]
fn sets_not_taken_in_time_are_overtaken() {
    let mut matching = Matching::new(3, 10);
    let sets = 50;
    for number in 0..sets {
        for camera in 0..3 {
            matching.push(camera, 1_000 * number + camera as u64, number);
        }
    }
    let newest = matching.take_newest().expect("the last ones wait");
    assert_eq!(newest.pictures[0].map(|(_, number)| number), Some(sets - 1));
    for counts in matching.counts() {
        let wanted = Counts {
            arrived: sets,
            used: 1,
            overtaken: sets - 1,
            ..Counts::default()
        };
        assert_eq!(*counts, wanted);
    }
}

/// A station that restarts begins its clock anew.
#[test]
fn earlier_times_count_after_a_new_beginning() {
    let mut matching = Matching::new(2, 0);
    matching.push(0, 9_000, 'a');
    matching.begin_anew();
    for (camera, picture) in [(0, 'b'), (1, 'c')] {
        matching.push(camera, 100, picture);
    }
    let set = matching.take().expect("a set");
    assert_eq!(set.pictures, [Some((100, 'b')), Some((100, 'c'))]);
    assert_eq!(matching.counts()[0].unmatched, 1);
    assert_eq!(matching.counts()[0].disordered, 0);
}
