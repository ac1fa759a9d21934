//! The three estimators: signs, the paper's identities, and fixed point against floating point.

use proptest::prelude::*;
use trinocular_core::estimate::{Refusal, closed_form, least_squares, midpoint};
use trinocular_core::rig::Rig;
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::sums::pair::FixedPairSums;
use trinocular_rig::random::Random;
use trinocular_tests::points::{Cloud, centred, ideal_rig, pairs};

const LINE: [[f64; 2]; 3] = [[-70.0, 0.0], [0.0, 0.0], [68.0, 0.0]];

fn cloud(displacement_mm: [f64; 3]) -> Cloud {
    Cloud {
        depth_mm: [780.0, 1010.0],
        field: [0.2, 0.2],
        points: 50,
        displacement_mm,
        noise_px: 0.0,
    }
}

/// A wrong sign makes the stage run away from the target.
#[test]
fn right_down_away_is_plus_x_y_z() {
    let rig = ideal_rig(530.0, &LINE);
    for axis in 0..3 {
        for direction in [1.0, -1.0] {
            let mut moved = [0.0; 3];
            moved[axis] = direction;
            let views = cloud(moved).views(&rig, &mut Random::seeded(1));
            let (pair, mid) = (pairs(&rig, &views), centred(&rig, &views));
            let all = [
                closed_form::solve(&pair).unwrap(),
                least_squares::solve(&pair).unwrap(),
                midpoint::solve(&mid).unwrap().displacement_mm,
                closed_form::solve_fixed(&pair.quantise().unwrap())
                    .unwrap()
                    .map(|nm| f64::from(nm) * 1e-6),
                midpoint::displacement_fixed(&mid.quantise().unwrap())
                    .unwrap()
                    .map(|nm| f64::from(nm) * 1e-6),
            ];
            for got in all {
                for i in 0..3 {
                    assert!((got[i] - moved[i]).abs() < 0.01, "{got:?} for {moved:?}");
                }
            }
        }
    }
}

/// In image terms: if the target moves right, so do its pixels; if it moves away, its pixels move
/// to the centre.
#[test]
fn flow_signs_match_images() {
    let rig = ideal_rig(530.0, &LINE);
    let seen = |displacement| cloud(displacement).views(&rig, &mut Random::seeded(2));
    assert!(
        seen([1.0, 0.0, 0.0])
            .iter()
            .flatten()
            .all(|v| v.flow()[0] > 0.0)
    );
    assert!(
        seen([0.0, 1.0, 0.0])
            .iter()
            .flatten()
            .all(|v| v.flow()[1] > 0.0)
    );
    assert!(
        seen([0.0, 0.0, 1.0])
            .iter()
            .flatten()
            .all(|v| v.flow()[0] * v.start[0] <= 0.0)
    );
}

/// Appendix A of the paper: disparity products of any two points commute for all baselines (eq. 3).
#[test]
fn appendix_a_products_commute() {
    let rig = ideal_rig(530.0, &[[-90.0, 0.0], [0.0, 0.0], [31.0, 0.0]]);
    let views = cloud([0.0; 3]).views(&rig, &mut Random::seeded(3));
    let x = |p: usize, camera: usize| views[p][camera].start[0];
    for i in 0..views.len() {
        for j in 0..views.len() {
            let left = (x(i, 1) - x(i, 0)) * (x(j, 2) - x(j, 1));
            let right = (x(i, 2) - x(i, 1)) * (x(j, 1) - x(j, 0));
            assert!((left - right).abs() < 1e-15);
        }
    }
}

/// Appendix B of the paper: the normal matrix of eq. 7 and its determinant (eq. 8), also for sums
/// of noisy, unrelated images; in the ideal geometry `a1 b3 = a3 b1`.
#[test]
fn appendix_b_matrix_and_determinant() {
    let rig = ideal_rig(530.0, &LINE);
    for noise_px in [0.0, 20.0] {
        let scene = Cloud {
            noise_px,
            ..cloud([3.0, 2.0, 1.0])
        };
        let s = pairs(&rig, &scene.views(&rig, &mut Random::seeded(4)));
        let a = least_squares::matrix(&s);
        let normal = a.transpose() * a;
        let n = s.a1 * s.a1 + s.b1 * s.b1;
        let expected = nalgebra::Matrix3::new(
            n,
            0.0,
            s.a1 * s.a2 + s.b1 * s.b2,
            0.0,
            n,
            s.a1 * s.a3 + s.b1 * s.b3,
            s.a1 * s.a2 + s.b1 * s.b2,
            s.a1 * s.a3 + s.b1 * s.b3,
            s.a2 * s.a2 + s.a3 * s.a3 + s.b2 * s.b2 + s.b3 * s.b3,
        );
        assert!((normal - expected).norm() < 1e-12 * normal.norm());
        let (q, twist) = (s.a1 * s.b2 - s.a2 * s.b1, s.a1 * s.b3 - s.a3 * s.b1);
        let determinant = n * (q * q + twist * twist);
        assert!((normal.determinant() - determinant).abs() < 1e-9 * determinant);
        if noise_px == 0.0 {
            assert!(twist.abs() < 1e-12 * n && q > 0.0);
        }
    }
}

#[test]
fn midpoint_takes_2_to_8_cameras() {
    let eight: Vec<[f64; 2]> = (0..8)
        .map(|k| [f64::from(k % 4) * 50.0, f64::from(k / 4) * 40.0])
        .collect();
    for offsets in [&LINE[..2], &eight[..]] {
        let rig = ideal_rig(530.0, offsets);
        let views = cloud([5.0, -3.0, 4.0]).views(&rig, &mut Random::seeded(5));
        let got = midpoint::solve(&centred(&rig, &views))
            .unwrap()
            .displacement_mm;
        assert!(
            (got[0] - 5.0).abs() < 1e-9
                && (got[1] + 3.0).abs() < 1e-9
                && (got[2] - 4.0).abs() < 1e-9
        );
    }
}

#[test]
fn degenerate_input_is_refused() {
    let rig = ideal_rig(530.0, &LINE);
    let views = cloud([1.0, 1.0, 1.0]).views(&rig, &mut Random::seeded(6));
    // Cameras in the wrong order: disparities and q change sign.
    let mut mirrored = pairs(&rig, &[]);
    for p in &views {
        mirrored.add([p[2], p[1], p[0]]);
    }
    assert_eq!(closed_form::solve(&mirrored), Err(Refusal::Degenerate));
    assert_eq!(
        closed_form::solve_fixed(&mirrored.quantise().unwrap()),
        Err(Refusal::Degenerate)
    );
    assert_eq!(
        closed_form::solve(&pairs(&rig, &[])),
        Err(Refusal::TooFewPoints)
    );
    assert!(
        !centred(&rig, &[]).add(&[views[0][2], views[0][1], views[0][0]]),
        "behind the cameras"
    );
    // All points at one position.
    let same = vec![views[0].clone(); 20];
    let mut sums = centred(&rig, &[]);
    for p in &same {
        // Three cameras still see the point from three positions, but refitted positions differ
        // only in disparity.
        assert!(sums.add(p));
    }
    assert!(
        midpoint::solve(&sums).is_ok(),
        "disparity alone spreads the positions"
    );
    assert_eq!(
        midpoint::solve(&centred(&rig, &[])),
        Err(Refusal::TooFewPoints)
    );
    let two = ideal_rig(530.0, &LINE[..2]);
    assert_eq!(pairs_of_two(&two), Err(Refusal::WrongRig));
    let mut poisoned = pairs(&rig, &views);
    poisoned.d3 = f64::NAN;
    assert_eq!(closed_form::solve(&poisoned), Err(Refusal::OutOfRange));
    assert_eq!(least_squares::solve(&poisoned), Err(Refusal::OutOfRange));
    assert_eq!(poisoned.quantise(), Err(Refusal::OutOfRange));
}

fn pairs_of_two(rig: &Rig) -> Result<(), Refusal> {
    trinocular_core::sums::pair::PairSums::new(rig).map(|_| ())
}

#[derive(Clone, Debug)]
struct Rated {
    rig: Rig,
    cloud: Cloud,
    seed: u64,
}

/// Returns cases from the whole rated range: depth 300 to 2000 mm, focal length 300 to 2500 px,
/// displacement up to 100 mm, 8 to 4000 points.
fn rated(h: std::ops::Range<f64>) -> impl Strategy<Value = Rated> {
    let depth = (300.0..1900.0f64, 1.02..1.5f64)
        .prop_map(|(near, ratio)| [near, (near * ratio).min(2000.0)]);
    let shift = prop::array::uniform3(-100.0..100.0f64);
    let points = prop_oneof![4 => 8usize..200, 1 => 200usize..4000];
    (
        depth,
        shift,
        points,
        300.0..2500.0f64,
        h.clone(),
        h,
        0.02..0.45f64,
        0.0..0.5f64,
        any::<u64>(),
    )
        .prop_map(
            |(depth_mm, displacement_mm, points, focal, h1, h2, field, noise_px, seed)| Rated {
                rig: ideal_rig(focal, &[[-h1, 0.0], [0.0, 0.0], [h2, 0.0]]),
                cloud: Cloud {
                    depth_mm,
                    field: [field, field * 0.75],
                    points,
                    displacement_mm,
                    noise_px,
                },
                seed,
            },
        )
}

fn worst_nm(fixed: [i32; 3], exact_mm: [f64; 3]) -> f64 {
    (0..3)
        .map(|i| (f64::from(fixed[i]) - exact_mm[i] * 1e6).abs())
        .fold(0.0, f64::max)
}

/// Returns the number of cases: 3,000, or more by `PROPTEST_CASES`. A test that cannot use two of
/// three fails.
fn cases() -> ProptestConfig {
    let config = ProptestConfig::default();
    let cases = config.cases.max(3_000);
    ProptestConfig {
        cases,
        max_global_rejects: cases / 2,
        ..config
    }
}

proptest! {
    #![proptest_config(cases())]

    /// Closed form: within 1 µm of the oracle on unquantised sums. One case in four is out of
    /// range, because the disparities are lost in noise at that distance or the answer leaves the
    /// rated range.
    #[test]
    fn closed_form_fixed_point_follows_the_oracle(case in rated(60.0..300.0)) {
        let sums = pairs(&case.rig, &case.cloud.views(&case.rig, &mut Random::seeded(case.seed)));
        let words = sums.quantise();
        if words == Err(Refusal::OutOfRange) {
            let nearest_mm = case.cloud.depth_mm[0] + case.cloud.displacement_mm[2];
            prop_assert!(nearest_mm < 300.0, "refused within the rated depth");
            return Err(TestCaseError::reject("nearer than the rated depth"));
        }
        let words = words.unwrap();
        let exact = closed_form::solve(&sums);
        prop_assume!(exact != Err(Refusal::Degenerate));
        let exact = exact.unwrap();
        prop_assume!(exact.iter().all(|v| v.abs() <= 100.0));
        let fixed = closed_form::solve_fixed(&words).unwrap();
        prop_assert!(worst_nm(fixed, exact) <= 1000.0, "{fixed:?} {exact:?}");
    }

    /// Midpoint: within 0.1 µm of the oracle, variances within 1 %.
    #[test]
    fn midpoint_fixed_point_follows_the_oracle(case in rated(30.0..300.0)) {
        let sums = centred(&case.rig, &case.cloud.views(&case.rig, &mut Random::seeded(case.seed)));
        let exact = midpoint::solve(&sums).unwrap();
        prop_assume!(exact.displacement_mm.iter().all(|v| v.abs() <= 110.0));
        let words = sums.quantise().unwrap();
        let fixed = midpoint::solve_fixed(&words).unwrap();
        let worst_nm = worst_nm(fixed.displacement_nm, exact.displacement_mm);
        prop_assert!(worst_nm <= 100.0, "{fixed:?} {exact:?}");
        prop_assert_eq!(midpoint::displacement_fixed(&words).unwrap(), fixed.displacement_nm);
        for i in 0..3 {
            let variance = exact.covariance_mm2[i][i] * 1e12;
            if variance > 1e6 && sums.freedom() <= 65535 {
                let error = (fixed.variance_nm2[i] as f64 - variance).abs();
                prop_assert!(error <= 0.01 * variance + 2.0);
            }
        }
    }

    /// Any input gives an answer or a refusal without a panic, and the same one again.
    #[test]
    fn any_words_are_answered(
        w in prop::array::uniform10(any::<i32>()),
        points: u16,
        freedom: u16,
        exponent: i8,
        spread: u32,
        residual_nm: u32,
    ) {
        let [a1, a2, a3, b1, b2, b3, d1, d2, d3, d4] = w;
        let pair = FixedPairSums { points, a1, a2, a3, b1, b2, b3, d1, d2, d3, d4 };
        prop_assert_eq!(closed_form::solve_fixed(&pair), closed_form::solve_fixed(&pair));
        let mid = FixedCentredSums {
            points,
            freedom,
            mean_nm: [w[0], w[1]],
            centroid: [w[2], w[3]],
            spread,
            exponent,
            coupling: w[4],
            residual_nm,
        };
        prop_assert_eq!(midpoint::solve_fixed(&mid), midpoint::solve_fixed(&mid));
    }
}

/// Extreme values of the formats, which random words rarely reach.
#[test]
fn extreme_words_are_answered() {
    let edge = [i32::MIN, -1, 0, 1, i32::MAX];
    for a in edge {
        for b in edge {
            for c in edge {
                let pair = FixedPairSums {
                    points: 9,
                    a1: a,
                    a2: b,
                    a3: c,
                    b1: b,
                    b2: c,
                    b3: a,
                    d1: c,
                    d2: a,
                    d3: b,
                    d4: c,
                };
                let _ = closed_form::solve_fixed(&pair);
                for (exponent, spread) in [
                    (i8::MIN, 0),
                    (-19, u32::MAX),
                    (4, 1 << 31),
                    (i8::MAX, u32::MAX),
                    (0, 1 << 31),
                ] {
                    let mid = FixedCentredSums {
                        points: 9,
                        freedom: 1,
                        mean_nm: [a, b],
                        centroid: [c, a],
                        spread,
                        exponent,
                        coupling: b,
                        residual_nm: u32::MAX,
                    };
                    let _ = midpoint::solve_fixed(&mid);
                }
            }
        }
    }
}
