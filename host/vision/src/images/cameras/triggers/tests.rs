//! Images with faults beside the reports of a station that counts from its own zero.

use super::*;
use proptest::prelude::*;

/// Lead of the station's clock over this computer's, µs.
const AHEAD_US: i64 = 77_000_000;

/// A camera before a station that triggers it.
struct Bench {
    reports: Reports,
    count: Count,
    period_us: i64,
}

impl Bench {
    fn new(period_us: i64) -> Self {
        Self {
            reports: Reports::default(),
            count: Count::default(),
            period_us,
        }
    }

    fn instant_us(&self, number: u32) -> i64 {
        AHEAD_US + i64::from(number) * self.period_us
    }

    /// Reports a trigger with the first control tick half a millisecond after it; the report takes
    /// `took_us` to this computer.
    fn report(&mut self, number: u32, took_us: i64) {
        let instant_us = self.instant_us(number);
        let tick_us = (instant_us + 500 + 999) / 1_000 * 1_000;
        let heard_us = tick_us - AHEAD_US + took_us;
        self.reports.add(number, instant_us, heard_us);
    }

    /// Returns the place of an image that is stamped `delay_us` after this trigger.
    fn image(&mut self, number: u32, delay_us: i64) -> Option<Place> {
        let at_us = self.instant_us(number) - AHEAD_US + delay_us;
        let period_us = self.period_us;
        self.reports.place(&mut self.count, at_us, period_us, false)
    }

    fn of(&self, number: u32, missed: u32) -> Option<Place> {
        let instant_us = self.instant_us(number).unsigned_abs();
        Some(Place::Of {
            number,
            instant_us,
            missed,
        })
    }

    fn reported(period_us: i64, until: u32) -> Self {
        let mut bench = Self::new(period_us);
        (1..=until).for_each(|number| bench.report(number, 300));
        bench
    }
}

#[test]
fn missed_and_doubled_images_are_known_at_once() {
    let mut bench = Bench::reported(33_333, 40);
    assert_eq!(bench.image(1, 4_000), bench.of(1, 0));
    assert_eq!(bench.image(2, 4_100), bench.of(2, 0));
    // Three and four are missing.
    assert_eq!(bench.image(5, 3_900), bench.of(5, 2));
    assert_eq!(bench.image(5, 14_000), Some(Place::Doubled { number: 5 }));
    assert_eq!(bench.image(6, 4_000), bench.of(6, 0));
    assert_eq!(bench.image(7, 4_000), bench.of(7, 0));
}

#[test]
fn image_waits_for_the_report_of_its_trigger() {
    let mut bench = Bench::reported(10_000, 2);
    assert_eq!(bench.image(1, 500), bench.of(1, 0));
    assert_eq!(bench.image(2, 500), bench.of(2, 0));
    assert_eq!(bench.image(3, 500), None);
    bench.report(3, 300);
    assert_eq!(bench.image(3, 500), bench.of(3, 0));
}

#[test]
fn image_before_first_trigger_does_not_count() {
    let mut bench = Bench::new(33_333);
    assert_eq!(bench.image(0, -20_000), Some(Place::Before));
    bench.report(1, 300);
    bench.report(2, 200);
    assert_eq!(bench.image(0, 10_000), Some(Place::Before));
    assert_eq!(bench.image(1, 100), bench.of(1, 0));
}

#[test]
fn image_without_report_has_no_time() {
    let mut bench = Bench::reported(10_000, 3);
    // The report of 4 was lost on the line.
    bench.report(5, 300);
    assert_eq!(bench.image(3, 500), bench.of(3, 0));
    assert_eq!(bench.image(4, 500), Some(Place::Unreported));
    assert_eq!(bench.image(5, 500), bench.of(5, 0));
}

#[test]
fn station_that_counts_anew_is_followed() {
    let mut bench = Bench::reported(10_000, 9);
    assert_eq!(bench.image(8, 500), bench.of(8, 0));
    bench.reports.add(1, AHEAD_US + 300_000, 301_500);
    bench.reports.add(2, AHEAD_US + 310_000, 311_500);
    let instant_us = (AHEAD_US + 300_000).unsigned_abs();
    let first = Place::Of {
        number: 1,
        instant_us,
        missed: 0,
    };
    let place = bench
        .reports
        .place(&mut bench.count, 300_500, 10_000, false);
    assert_eq!(place, Some(first));
}

#[test]
fn threads_hear_reports() {
    let triggers = Triggers::new(100);
    let mut count = Count::default();
    let at = Instant::now();
    triggers.report(1, 5_000_000, at + Duration::from_millis(1));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            triggers.report(2, 5_010_000, at + Duration::from_millis(11));
        });
        let place = triggers.place(&mut count, at);
        let first = Place::Of {
            number: 1,
            instant_us: 5_000_000,
            missed: 0,
        };
        assert_eq!(place, first);
    });
}

/// The triggers go on while the line is lost: the first image waits, the others do not.
#[test]
fn lost_line_holds_up_one_image() {
    let triggers = Triggers::new(100);
    let mut count = Count::default();
    let at = Instant::now();
    let ms = |ms: u64| at + Duration::from_millis(ms);
    triggers.report(1, 5_000_000, ms(1));
    triggers.report(2, 5_010_000, ms(11));
    assert!(matches!(triggers.place(&mut count, at), Place::Of { .. }));
    for image in 3..20 {
        let place = triggers.place(&mut count, ms(10 * image));
        assert_eq!(place, Place::Unreported);
        assert_eq!(count.waited_at, Some(2));
    }
    triggers.report(20, 5_190_000, ms(191));
    let place = triggers.place(&mut count, ms(190));
    let found = Place::Of {
        number: 20,
        instant_us: 5_190_000,
        missed: 0,
    };
    assert_eq!(place, found);
}

proptest! {
    /// Stamps that are early or late by up to a fifth of a period, reports that are late, images
    /// that are lost or come twice, clocks that drift by 100 parts in a million: every image gets
    /// its own trigger, and every fault its name.
    #[test]
    fn every_image_gets_its_trigger(
        rate_hz in 1..=1000u16,
        share in 0..50i64,
        jitter in prop::collection::vec((-20..=20i64, 0..40_000i64, 0..12u8), 300),
        drift_ppm in -100..=100i64,
    ) {
        let period_us = 1_000_000 / i64::from(rate_hz);
        let mut bench = Bench::reported(period_us, 1);
        for (n, (_, took_us, _)) in (2..).zip(&jitter) {
            bench.report(n, 200 + took_us);
        }
        let delay_us = period_us * share / 100;
        let mut missed = 0;
        let mut is_first = true;
        for (n, (jitter, _, fate)) in (1..).zip(&jitter) {
            let drift_us = i64::from(n) * period_us * drift_ppm / 1_000_000;
            let late_us = if is_first { 0 } else { period_us * jitter / 100 };
            match fate {
                0 if !is_first => missed += 1,
                1 if !is_first && missed == 0 && n > 1 => {
                    let expected = bench.of(n, 0);
                    prop_assert_eq!(bench.image(n, delay_us + late_us + drift_us), expected);
                    let soon_us = delay_us + drift_us + period_us * 25 / 100;
                    let doubled = Some(Place::Doubled { number: n });
                    prop_assert_eq!(bench.image(n, soon_us), doubled);
                }
                _ => {
                    let expected = bench.of(n, missed);
                    prop_assert_eq!(bench.image(n, delay_us + late_us + drift_us), expected);
                    missed = 0;
                    is_first = false;
                }
            }
        }
    }
}
