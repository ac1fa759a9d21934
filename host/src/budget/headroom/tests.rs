use super::*;
use trinocular_core::rig::Camera;
use trinocular_rig::random::Random;

const RANGE_MM: [f64; 2] = [300.0, 2000.0];

fn room<'a>(headroom: &'a Headroom, name: &str) -> &'a Room {
    headroom.rooms.iter().find(|r| r.name == name).unwrap()
}

fn of(rig: &Rig) -> Headroom {
    Headroom::of(rig, None, &FieldOfView::new(rig, 0.0), RANGE_MM).unwrap()
}

/// Random quantised frames of the rated range: none exceeds the stated worst case, and some
/// come near it.
#[test]
fn rated_frames_stay_within_worst() {
    let rig = Rig::paper();
    let (headroom, view) = (of(&rig), FieldOfView::new(&rig, 0.0));
    let mut random = Random::new(3, 0);
    let names = [
        "mean_nm",
        "centroid",
        "coupling",
        "a1 b1",
        "a2 a3 b2 b3",
        "d1 d2 d3 d4",
    ];
    let mut least = names.map(|_| f64::INFINITY);
    for _ in 0..3000 {
        let mut centred = CentredSums::new(&rig).unwrap();
        let mut pair = PairSums::new(&rig).unwrap();
        let moved = [0, 1, 2].map(|_| random.between(-100.0, 100.0));
        for _ in 0..random.below(8) + 1 {
            let depth = random.between(300.0, 2000.0);
            if !(300.0..=2000.0).contains(&(depth + moved[2])) {
                continue;
            }
            let common = view.common(depth).unwrap();
            let [x, y] = [0, 1].map(|i| random.between(common.low[i], common.high[i]));
            let to = [x + moved[0], y + moved[1], depth + moved[2]];
            let views = views(&rig, [x, y, depth], to);
            assert!(centred.add(&views));
            pair.add([views[0], views[1], views[2]]);
        }
        let (Ok(c), Ok(p)) = (centred.quantise(), pair.quantise()) else {
            continue; // no point is left
        };
        let groups: [&[i32]; 6] = [
            &c.mean_nm,
            &c.centroid,
            &[c.coupling],
            &[p.a1, p.b1],
            &[p.a2, p.a3, p.b2, p.b3],
            &[p.d1, p.d2, p.d3, p.d4],
        ];
        for (least, words) in least.iter_mut().zip(groups) {
            let largest = words.iter().map(|w| w.unsigned_abs()).max().unwrap();
            *least = least.min((2f64.powi(31) / f64::from(largest)).log2());
        }
    }
    for (name, met) in names.into_iter().zip(least) {
        let stated = room(&headroom, name).bits_left;
        assert!(
            met >= stated - 1e-3 && met < stated + 1.5,
            "{name}: {met} bits left, stated {stated}"
        );
    }
}

#[test]
fn paper_rig_has_headroom() {
    let headroom = of(&Rig::paper());
    assert!(headroom.rooms.iter().all(|room| room.bits_left > 0.0));
    // As documented at the closed form for 70 and 68 mm.
    let to = headroom.closed_form_to_mm.unwrap();
    assert!((2100.0..2300.0).contains(&to), "{to}");
    assert!(headroom.midpoint_to_mm > 10_000.0);
}

#[test]
fn extreme_rigs_exceed_formats() {
    let camera = |x| Camera::ideal([400.0; 2], [960.0, 540.0], [x, 0.0]);
    let wide = Rig {
        image_size_px: [1920, 1080],
        cameras: [-500.0, 0.0, 500.0].into_iter().map(camera).collect(),
    };
    let headroom = of(&wide);
    assert!(room(&headroom, "d1 d2 d3 d4").bits_left < 0.0);
    let narrow = Rig {
        image_size_px: [1920, 1080],
        cameras: [-10.0, 0.0, 10.0].into_iter().map(camera).collect(),
    };
    assert!(of(&narrow).closed_form_to_mm.unwrap() < 400.0);
}

/// A distance overflows exactly if the station refuses the stage: tested at the edge of each
/// distance.
#[test]
fn distance_limits_match_station() {
    use trinocular_client::stage::{configuration, default_stage};
    use trinocular_core::frame::message::{Mounting, Side};
    use trinocular_rig::rig_file::HomeSwitch;
    let base = || {
        let mut stage = default_stage();
        stage.steps_per_mm = [50_000.0; 3];
        stage.max_speed_mm_s = [5.0; 3];
        stage
    };
    type Set = fn(&mut Stage, f64);
    let cases: [(&str, f64, Set); 5] = [
        ("travel", 10_000.0, |stage, mm| {
            stage.travel_mm[0] = [0.0, mm]
        }),
        ("window of an unknown position", 10_000.0, |stage, mm| {
            stage.care.unknown_window_mm = mm;
        }),
        ("watched distances", 10_000.0, |stage, mm| {
            stage.care.largest_unseen_mm = Some(mm);
        }),
        ("search for a home switch", 8_000.0, |stage, mm| {
            stage.travel_mm[1] = [0.0, mm];
            let position_mm = 0.0;
            let side = Side::Negative;
            stage.care.home[1] = Some(HomeSwitch { side, position_mm });
        }),
        ("home position", 5_000.0, |stage, mm| {
            let position_mm = mm;
            let side = Side::Positive;
            stage.care.home[2] = Some(HomeSwitch { side, position_mm });
        }),
    ];
    for (name, about_mm, set) in cases {
        let verdict = |mm: f64| {
            let mut stage = base();
            set(&mut stage, mm);
            let config = configuration(&stage, Mounting::OnStage).unwrap();
            let taken =
                trinocular_core::machine::check(&config, trinocular_core::steps::WordRate::MHZ_1);
            let rig = Rig::paper();
            let view = FieldOfView::new(&rig, 0.0);
            let headroom = Headroom::of(&rig, Some(&stage), &view, RANGE_MM).unwrap();
            (taken.is_ok(), room(&headroom, name).bits_left >= 0.0)
        };
        // Bisect for the edge, to one µm.
        let (mut low, mut high) = (about_mm, 1.2 * about_mm);
        assert_eq!(
            (verdict(low), verdict(high)),
            ((true, true), (false, false)),
            "{name}"
        );
        while high - low > 2e-3 {
            let middle = 0.5 * (low + high);
            let (taken, room) = verdict(middle);
            if taken != room {
                // The station rounds inwards, to whole µm.
                assert!(room && high - low < 0.1, "{name} at {middle} mm");
            }
            if taken { low = middle } else { high = middle }
        }
    }
}

#[test]
fn other_rigs_have_no_pair_sums() {
    let mut two = Rig::paper();
    two.cameras.pop();
    let headroom = of(&two);
    assert_eq!(headroom.closed_form_to_mm, None);
    assert!(headroom.rooms.iter().all(|room| room.name != "a1 b1"));
}
