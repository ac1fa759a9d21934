//! Time stamps, with a drivers' clock that reads 1000 s at the tests' instant.

use super::*;
use std::cell::Cell;

const NOW: Duration = Duration::from_secs(1000);

fn moments() -> (Moments, Instant) {
    let instant = Instant::now();
    let monotonic = NOW;
    (Moments::new(Clocks { instant, monotonic }), instant)
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn stamp(time: Duration) -> Stamp {
    Stamp::Monotonic(time, Point::End)
}

#[test]
fn late_fetch_keeps_stamp() {
    let (mut moments, now) = moments();
    assert_eq!(moments.source(), None);
    for (taken, fetched, was_awaited) in [(0, 0, true), (33, 40, true), (66, 1900, false)] {
        let at = moments.of(stamp(NOW + ms(taken)), now + ms(fetched), was_awaited);
        assert_eq!(at, Some(now + ms(taken)));
        assert_eq!(moments.source(), Some(Source::Driver(Point::End)));
    }
    // A time before the clocks were read.
    let at = moments.of(stamp(NOW - ms(20)), now, true);
    assert_eq!(at, Some(now - ms(20)));
    let start = Stamp::Monotonic(NOW + ms(99), Point::Start);
    assert_eq!(moments.of(start, now + ms(140), true), Some(now + ms(99)));
    assert_eq!(moments.source(), Some(Source::Driver(Point::Start)));
}

#[test]
fn doubted_driver_stays_doubted() {
    let far = Stamp::Monotonic(Duration::MAX, Point::End);
    let cases = [
        (Stamp::Unknown, Doubt::OtherClock),
        (stamp(NOW + ms(52)), Doubt::Ahead),
        (stamp(Duration::ZERO), Doubt::Behind),
        (stamp(NOW - ms(2951)), Doubt::Behind),
        (far, Doubt::Behind),
    ];
    for (stamp_of_it, doubt) in cases {
        let (mut moments, now) = moments();
        let arrived = now + ms(50);
        assert_eq!(moments.of(stamp_of_it, arrived, true), Some(arrived));
        assert_eq!(moments.source(), Some(Source::Arrival(doubt)));
        let next = now + ms(80);
        assert_eq!(moments.of(stamp(NOW + ms(70)), next, true), Some(next));
        // An image that was ready before the wait has no known time.
        assert_eq!(moments.of(stamp(NOW + ms(90)), now + ms(100), false), None);
        assert_eq!(moments.source(), Some(Source::Arrival(doubt)));
    }
    // Within the error of two clock readings, and just below the largest age.
    for time in [NOW + ms(51), NOW - ms(2950)] {
        let (mut moments, now) = moments();
        assert!(moments.of(stamp(time), now + ms(50), true).is_some());
        assert_eq!(moments.source(), Some(Source::Driver(Point::End)));
    }
}

#[test]
fn queued_images_keep_driver_trusted() {
    let (mut moments, now) = moments();
    assert!(moments.of(stamp(NOW), now, true).is_some());
    let resumed = now + ms(60_000);
    assert_eq!(moments.of(stamp(NOW + ms(33)), resumed, false), None);
    assert_eq!(moments.source(), Some(Source::Driver(Point::End)));
    let fresh = stamp(NOW + ms(59_999));
    let at = moments.of(fresh, resumed, false);
    assert_eq!(at, Some(now + ms(59_999)));
}

#[test]
fn paired_clocks_convert_times() {
    let zero = Instant::now();
    let clocks = Clocks::read(|| NOW + zero.elapsed());
    let back = clocks.instant(NOW).unwrap();
    // On either side of zero: the error of a reading is at most its duration.
    let apart = back.max(zero).duration_since(back.min(zero));
    assert!(apart <= zero.elapsed(), "{apart:?}");
    assert_eq!(clocks.instant(NOW + ms(5)), Some(back + ms(5)));
    assert_eq!(clocks.instant(Duration::MAX), None);
}

#[test]
fn source_is_described_in_words() {
    let text = |source: Source| source.to_string();
    assert!(text(Source::Driver(Point::End)).ends_with("of their end"));
    assert!(text(Source::Driver(Point::Start)).ends_with("of their start"));
    for doubt in [Doubt::OtherClock, Doubt::Ahead, Doubt::Behind] {
        assert!(text(Source::Arrival(doubt)).contains("arrival"));
    }
}

/// The clock is five seconds ahead. Each reading takes a microsecond, but in most pairs the
/// processor is away for 20 ms, before or after.
#[test]
fn quickest_reading_compares_clocks() {
    for quick in 0..READINGS as u64 {
        let (now_us, calls) = (Cell::new(1_000_000), Cell::new(0));
        let read = |place: u64, ahead_us: u64| {
            let pair = calls.get() / 3;
            let is_held_up = pair != quick && (calls.get() % 3 == 1 + pair % 2);
            assert_eq!(calls.get() % 3, place, "in the order of one reading");
            calls.set(calls.get() + 1);
            now_us.set(now_us.get() + if is_held_up { 20_000 } else { 1 });
            now_us.get() + ahead_us
        };
        let of_us = || read(calls.get() % 3, 0);
        assert_eq!(
            offset_us(|| read(1, 5_000_000), of_us),
            5_000_000,
            "{quick}"
        );
    }
}
