//! What is learnt from a few triggers, and what is refused.

use super::*;

#[test]
fn delay_is_learnt_from_one_image_per_trigger() {
    let learnt = |images: &[(u32, i64)]| {
        let mut bench = Bench::new(33_333);
        (1..=3).for_each(|number| bench.report(number, 300));
        for (number, delay_us) in images {
            bench.image(*number, *delay_us);
        }
        bench.reports.learn().map_err(|error| error.to_string())
    };
    // Stamps that are later than a period.
    let late = [(1, 40_000), (2, 40_100), (3, 39_900)];
    assert_eq!(learnt(&late), Ok(()));
    // Images from before the triggers are of cameras that ran freely.
    let before = [(0, -60_000), (1, 4_000), (2, 4_000), (3, 4_000)];
    assert_eq!(learnt(&before), Ok(()));
    for images in [
        // One is missing; one comes twice; one is missing and another comes twice.
        &[(1, 4_000), (2, 4_000)][..],
        &[(1, 4_000), (2, 4_000), (3, 4_000), (3, 8_000)],
        &[(1, 4_000), (3, 4_000), (3, 8_000)],
        &[],
    ] {
        let refused = learnt(images).unwrap_err();
        assert!(refused.starts_with("camera 0: "), "{refused}");
    }
}

#[test]
fn delay_is_not_learnt_over_a_slow_line() {
    let mut bench = Bench::new(10_000);
    for number in 1..=3 {
        bench.report(number, 4_000);
        bench.image(number, 500);
    }
    let refused = bench.reports.learn().unwrap_err().to_string();
    assert!(refused.contains("lower rate_hz"), "{refused}");
}

#[test]
fn delay_is_not_learnt_without_all_reports() {
    let mut bench = Bench::new(10_000);
    for number in [1, 3] {
        bench.report(number, 300);
    }
    (1..=3).for_each(|number| {
        bench.image(number, 500);
    });
    let refused = bench.reports.learn().unwrap_err().to_string();
    assert!(refused.contains("see to the line"), "{refused}");
}
