//! Cameras, lines and clocks with all faults at once, at random.

use super::*;
use proptest::prelude::*;
use std::collections::VecDeque;

/// What happens to the image of a trigger.
#[derive(Clone, Copy, Debug)]
enum Fate {
    Good,
    /// The camera leaves the trigger out.
    LeftOut,
    /// The driver loses the image, or it is damaged: it counts.
    Lost,
    /// A second image comes after this share of a period, in hundredths.
    Doubled(i64),
    /// The stamp is later by this share of a period.
    Late(i64),
    /// This image and a few after it are stamped at the end of a pause.
    Pause(usize),
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        20 => Just(Fate::Good),
        1 => Just(Fate::LeftOut),
        1 => Just(Fate::Lost),
        1 => (1..130_i64).prop_map(Fate::Doubled),
        1 => (0..350_i64).prop_map(Fate::Late),
        1 => Just(Fate::Late(100)),
        1 => Just(Fate::Late(200)),
        1 => (2..5_usize).prop_map(Fate::Pause),
    ]
}

/// An image on its way: when it was taken, its stamp, and the camera's count.
struct Sent {
    taken_us: i64,
    shot: Shot,
}

/// Returns the images of triggers that the camera got at these instants of this computer.
fn images(
    taken_us: &[i64],
    fates: &[(Fate, i64)],
    delay_us: i64,
    period_us: i64,
) -> Vec<(usize, Sent)> {
    let mut seen = 100;
    let mut images = Vec::new();
    let mut pause_until_us = 0;
    for (n, ((fate, jitter), taken)) in fates.iter().zip(taken_us).enumerate() {
        let share = |hundredths: i64| period_us * hundredths / 100;
        let stamp_us = taken + delay_us + share(*jitter);
        seen += 1;
        // Of each image: when it is taken after the trigger, and how late its stamp is beside that.
        let sent = match *fate {
            Fate::Good => vec![(0, 0)],
            Fate::LeftOut => {
                seen -= 1;
                vec![]
            }
            Fate::Lost => vec![],
            Fate::Doubled(after) => vec![(0, 0), (share(after), 0)],
            Fate::Late(by) => vec![(0, share(by))],
            Fate::Pause(long) => {
                let end_us = taken_us.get(n + long).unwrap_or(taken);
                pause_until_us = end_us + delay_us;
                vec![(0, 0)]
            }
        };
        for (second, (after_us, late_us)) in (0..).zip(sent) {
            let at_us = (stamp_us + after_us + late_us).max(pause_until_us);
            seen += second;
            let shot = Shot { at_us, seen };
            let taken_us = taken + after_us;
            images.push((n, Sent { taken_us, shot }));
        }
    }
    images
}

proptest! {
    /// Whatever happens, no image gets the time of another trigger. An image some time after the
    /// last fault is used.
    #[test]
    fn no_image_gets_the_time_of_another_trigger(
        rate_hz in 1..=120_u16,
        delay_share in 0..250_i64,
        fates in prop::collection::vec((fate(), -4..=4_i64), 200),
        line in prop::collection::vec((0..40_u8, 0..400_i64, 0..60_000_i64, 0..30_u8), 203),
        drift_ppm in -100..=100_i64,
        waits in prop::option::of(prop::collection::vec(0..=16_i64, 203)),
    ) {
        let period_us = 1_000_000 / i64::from(rate_hz);
        let delay_us = period_us * delay_share / 100;
        let mut bench = Bench::taught(period_us, delay_us, 0);
        // No two successive images are late by the same whole number of periods.
        let mut fates = fates;
        for n in 1..fates.len() {
            if !matches!(fates[n - 1].0, Fate::Good) {
                fates[n].0 = Fate::Good;
            }
        }
        bench.reports.wait_us = waits.as_ref().map_or(0, |_| period_us / 16);
        let wait_us = |n: usize| waits.as_ref().map_or(0, |waits| period_us * waits[n - 1] / 256);
        let mut stood_us = 0;
        let mut reports = Vec::new();
        for (n, (kind, stood_share, slow_us, loss)) in (1_i64..).zip(&line) {
            if *kind == 0 {
                stood_us += period_us * stood_share / 100;
            }
            let here_us = n * period_us + n * period_us * drift_ppm / 1_000_000 + stood_us
                + wait_us(n as usize);
            let took_us = match kind {
                1 => *slow_us,
                _ => 100 + slow_us / 200,
            };
            let (is_lost, is_pinged) = (*loss == 0 && n > 1, *kind != 2);
            reports.push((n as u32, here_us, took_us, is_lost, is_pinged));
        }
        let taken_us: Vec<i64> = reports.iter().map(|(_, here_us, ..)| *here_us).collect();
        let mut waiting: VecDeque<_> = images(&taken_us, &fates, delay_us, period_us).into();
        let mut places = Vec::new();
        for (n, here_us, took_us, is_lost, is_pinged) in &reports {
            let instant_us = bench.instant_us(*n) + wait_us(*n as usize);
            if *is_pinged {
                bench.reports.pinged(here_us - 1_000 - took_us, instant_us - 1_000);
            }
            if !is_lost {
                bench.reports.add(*n, instant_us, here_us + 600 + took_us);
            }
            while let Some((image, sent)) = waiting.front() {
                if *image >= *n as usize {
                    break;
                }
                let Some(place) = bench.count.place(&mut bench.reports, sent.shot, false) else {
                    break;
                };
                if let Place::Of { number, .. } = place {
                    let off_us = taken_us[number as usize - 1] - sent.taken_us;
                    let most_us = period_us * 2 / 5;
                    prop_assert!(
                        off_us.abs() <= most_us,
                        "image of {} with {number}, after {:?}",
                        image + 1,
                        &fates[image.saturating_sub(5)..=*image],
                    );
                }
                places.push((*image, place));
                waiting.pop_front();
            }
        }
        let is_calm = |n: usize| {
            let (_, _, _, loss) = line[n];
            matches!(fates[n].0, Fate::Good) && line[n].0 > 1 && loss > 0
        };
        // A period that is long beside the delay of the line.
        let is_slow = rate_hz <= 60;
        for (image, place) in &places {
            let calm = image.saturating_sub(8)..image + 3;
            if is_slow && *image > 8 && *image < 190 && calm.into_iter().all(is_calm) {
                prop_assert!(matches!(place, Place::Of { .. }), "{image}: {place:?}");
            }
        }
    }
}
