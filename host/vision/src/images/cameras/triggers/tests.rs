//! Images with faults beside the reports of a station whose clock has its own zero, stands still
//! now and then, and is heard over a line with delays.

mod hostile;
mod learning;

use super::reports::Given;
use super::*;

/// Lead of the station's clock over this computer's at first, µs.
const AHEAD_US: i64 = 77_000_000;

/// A camera before a station that triggers it.
struct Bench {
    reports: Reports,
    count: Count,
    period_us: i64,
    /// Time for which the station's clock has stood still, µs.
    stood_us: i64,
    seen: u64,
}

impl Bench {
    fn new(period_us: i64) -> Self {
        let mut reports = Reports::new(period_us);
        reports.attend(vec!["camera 0".into()]);
        Self {
            reports,
            count: Count::of(0),
            period_us,
            stood_us: 0,
            seen: 0,
        }
    }

    /// Returns a bench whose images are stamped `delay_us` after their triggers, with the reports
    /// of a number of triggers.
    fn taught(period_us: i64, delay_us: i64, triggers: u32) -> Self {
        let mut bench = Self::new(period_us);
        for number in 1..=3 {
            bench.report(number, 300);
            bench.image(number, delay_us);
        }
        bench.reports.learn().expect("one image of each trigger");
        bench.reports.begin();
        (1..=triggers).for_each(|number| bench.report(number, 300));
        bench
    }

    fn instant_us(&self, number: u32) -> i64 {
        AHEAD_US + i64::from(number) * self.period_us
    }

    /// Returns the instant of a trigger on this computer's clock, as it is now.
    fn here_us(&self, number: u32) -> i64 {
        self.instant_us(number) - AHEAD_US + self.stood_us
    }

    /// Reports a trigger after the answer to a ping; each takes `took_us` to this computer.
    fn report(&mut self, number: u32, took_us: i64) {
        let (instant_us, here_us) = (self.instant_us(number), self.here_us(number));
        self.reports
            .pinged(here_us - 1_000 - took_us, instant_us - 1_000);
        self.reports
            .add(number, instant_us, here_us + 700 + took_us);
    }

    /// Returns the place of an image that is stamped `delay_us` after this trigger.
    fn image(&mut self, number: u32, delay_us: i64) -> Option<Place> {
        self.seen += 1;
        self.stamped(self.here_us(number) + delay_us)
    }

    fn stamped(&mut self, at_us: i64) -> Option<Place> {
        let seen = self.seen;
        self.count
            .place(&mut self.reports, Shot { at_us, seen }, false)
    }

    fn of(&self, number: u32, missed: u32) -> Option<Place> {
        let instant_us = self.instant_us(number).unsigned_abs();
        Some(Place::Of {
            number,
            instant_us,
            missed,
        })
    }
}

#[test]
fn missed_and_doubled_images_are_known_at_once() {
    let mut bench = Bench::taught(33_333, 4_000, 40);
    assert_eq!(bench.image(1, 4_000), Some(Place::Before));
    assert_eq!(bench.image(2, 4_100), bench.of(2, 0));
    // The driver lost those of three and four.
    bench.seen += 2;
    assert_eq!(bench.image(5, 3_900), bench.of(5, 2));
    let anew = |number| Some(Place::Miscounted { number, missed: 0 });
    assert_eq!(bench.image(5, 7_000), Some(Place::Doubled { number: 5 }));
    assert_eq!(bench.image(6, 4_000), anew(6));
    assert_eq!(bench.image(7, 4_000), bench.of(7, 0));
    assert_eq!(bench.image(7, 20_000), Some(Place::Doubtful));
    assert_eq!(bench.image(8, 4_000), anew(8));
    assert_eq!(bench.image(9, 4_000), bench.of(9, 0));
}

/// A camera that left a trigger out does not count it. The image after may be late instead.
#[test]
fn image_after_uncounted_gap_is_not_used() {
    let mut bench = Bench::taught(10_000, 500, 20);
    bench.image(1, 500);
    assert_eq!(bench.image(2, 500), bench.of(2, 0));
    let missed = Place::Miscounted {
        number: 4,
        missed: 1,
    };
    assert_eq!(bench.image(4, 500), Some(missed));
    assert_eq!(bench.image(5, 500), bench.of(5, 0));
    // The image of 6 is late by exactly a period.
    let late = Place::Miscounted {
        number: 7,
        missed: 1,
    };
    assert_eq!(bench.image(7, 500), Some(late));
    assert_eq!(bench.image(7, 500), Some(Place::Doubled { number: 7 }));
    let anew = Place::Miscounted {
        number: 8,
        missed: 0,
    };
    assert_eq!(bench.image(8, 500), Some(anew));
    assert_eq!(bench.image(9, 500), bench.of(9, 0));
}

/// The fault for which triggers were taken back once: the simulated station's time stood still
/// for nearly two periods, and from then on every image had the time of the trigger but one.
#[test]
fn station_that_stood_still_changes_no_place() {
    let mut bench = Bench::taught(100_000, 0, 3);
    for number in 1..=3 {
        bench.image(number, 0);
    }
    bench.stood_us += 180_000;
    for number in 4..10 {
        bench.report(number, 300);
        assert_eq!(bench.image(number, 0), bench.of(number, 0));
    }
}

/// A computer that was suspended: its clock did not run.
#[test]
fn computer_that_stood_still_drops_images_only() {
    let mut bench = Bench::taught(100_000, 0, 3);
    for number in 1..=3 {
        bench.image(number, 0);
    }
    bench.stood_us -= 1_005_000;
    // The report comes before the answer to any ping.
    let (instant_us, here_us) = (bench.instant_us(4), bench.here_us(4));
    bench.reports.add(4, instant_us, here_us + 1_000);
    assert_eq!(bench.image(4, 0), Some(Place::Doubtful));
    bench.report(5, 300);
    let anew = Place::Miscounted {
        number: 5,
        missed: 1,
    };
    assert_eq!(bench.image(5, 0), Some(anew));
    bench.report(6, 300);
    assert_eq!(bench.image(6, 0), bench.of(6, 0));
}

#[test]
fn image_waits_for_the_report_of_its_trigger() {
    let mut bench = Bench::taught(10_000, 500, 2);
    bench.image(1, 500);
    assert_eq!(bench.image(2, 500), bench.of(2, 0));
    assert_eq!(bench.image(3, 500), None);
    bench.report(3, 300);
    assert_eq!(bench.stamped(bench.here_us(3) + 500), bench.of(3, 0));
}

#[test]
fn image_before_first_trigger_does_not_count() {
    let mut bench = Bench::taught(33_333, 100, 0);
    assert_eq!(bench.image(0, -20_000), Some(Place::Before));
    bench.report(1, 300);
    bench.report(2, 200);
    assert_eq!(bench.image(0, 10_000), Some(Place::Before));
    assert_eq!(bench.image(1, 100), Some(Place::Before));
    assert_eq!(bench.image(2, 100), bench.of(2, 0));
}

#[test]
fn image_without_report_has_no_time() {
    let mut bench = Bench::taught(10_000, 500, 3);
    // The report of 4 was lost on the line.
    bench.report(5, 300);
    bench.image(2, 500);
    assert_eq!(bench.image(3, 500), bench.of(3, 0));
    assert_eq!(bench.image(4, 500), Some(Place::Unreported));
    let anew = Place::Miscounted {
        number: 5,
        missed: 0,
    };
    assert_eq!(bench.image(5, 500), Some(anew));
    bench.report(6, 300);
    assert_eq!(bench.image(6, 500), bench.of(6, 0));
}

#[test]
fn station_that_counts_anew_is_followed() {
    let mut bench = Bench::taught(10_000, 500, 9);
    bench.image(7, 500);
    assert_eq!(bench.image(8, 500), bench.of(8, 0));
    let begun_us = AHEAD_US + 300_000;
    for number in 1..=2_i64 {
        let instant_us = begun_us + number * 10_000;
        let heard_us = instant_us - AHEAD_US + 900;
        bench.reports.add(number as u32, instant_us, heard_us);
        bench.seen += 1;
        let place = bench.stamped(instant_us - AHEAD_US + 500);
        let is_place = match number {
            1 => place == Some(Place::Before),
            _ => matches!(place, Some(Place::Of { number: 2, .. })),
        };
        assert!(is_place, "{place:?}");
    }
}

/// The line is so slow that an image may be of either of two triggers.
#[test]
fn image_of_either_trigger_is_doubtful() {
    let mut bench = Bench::taught(10_000, 500, 2);
    bench.image(1, 500);
    assert_eq!(bench.image(2, 500), bench.of(2, 0));
    // As long as that of an image waits for, which its reports do not bound.
    for number in 3..8 {
        let (instant_us, here_us) = (bench.instant_us(number), bench.here_us(number));
        bench.reports.add(number, instant_us, here_us + 30_000);
    }
    assert_eq!(bench.image(5, 500), Some(Place::Doubtful));
}

/// Returns triggers at 100 Hz with one camera whose images are stamped at the trigger, and whose
/// count has begun with trigger 1.
fn counting(at: Instant) -> (Triggers, Count) {
    let triggers = Triggers::new(100, 2_000);
    triggers.attend(vec!["camera 0".into()]);
    let mut count = Count::of(0);
    let ms = |ms: u64| at + Duration::from_millis(ms);
    for number in 1..=3_u32 {
        let due = u64::from(number) * 10;
        triggers.ping(ms(due - 1), 4_999_000 + due * 1_000);
        triggers.report(number, 5_000_000 + due * 1_000, ms(due + 1));
        let place = triggers.place(&mut count, ms(due), number.into());
        assert_eq!(place, Place::Before);
    }
    triggers.learn().expect("one image of each");
    triggers.begin();
    triggers.report(1, 5_100_000, ms(101));
    assert_eq!(triggers.place(&mut count, ms(100), 4), Place::Before);
    (triggers, count)
}

#[test]
fn image_waits_until_its_report_comes() {
    let at = Instant::now();
    let (mut triggers, mut count) = counting(at);
    // Long enough for any machine.
    triggers.patience = Duration::from_secs(60);
    let place = std::thread::scope(|scope| {
        scope.spawn(|| triggers.report(2, 5_110_000, at + Duration::from_millis(111)));
        triggers.place(&mut count, at + Duration::from_millis(110), 5)
    });
    let second = Place::Of {
        number: 2,
        // The middle of its exposure.
        instant_us: 5_112_000,
        missed: 0,
    };
    assert_eq!(place, second);
}

/// The triggers go on while the line is lost: the first image waits, the others do not.
#[test]
fn lost_line_holds_up_one_image() {
    let at = Instant::now();
    let (triggers, mut count) = counting(at);
    let ms = |ms: u64| at + Duration::from_millis(ms);
    for image in 2..20 {
        let place = triggers.place(&mut count, ms(90 + 10 * image), 3 + image);
        assert_eq!(place, Place::Unreported);
        assert_eq!(count.waited_at, Some(1));
    }
    triggers.report(20, 5_290_000, ms(291));
    let place = triggers.place(&mut count, ms(290), 23);
    let anew = Place::Miscounted {
        number: 20,
        missed: 0,
    };
    assert_eq!(place, anew);
}

#[test]
fn lost_reports_fill_the_gap() {
    let mut bench = Bench::taught(10_000, 500, 2);
    bench.report(6, 300);
    let given: Vec<&Given> = bench.reports.given.iter().collect();
    assert_eq!(given.len(), 6);
    assert!(given[2..5].iter().all(|one| !one.is_reported));
    assert_eq!(given[3].instant_us, bench.instant_us(4));
}
