//! Calibration of known cameras from known boards with known noise: errors must agree with sigma.

mod rolled;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::board::Board;
use super::find::{FoundBoard, NotFound};
use super::intrinsics::{self, Verdict};
use super::lens::{Lens, PARAMETERS};
use super::rejection::{ImageRejection, InstantRejection};
use super::rig::{self, Instant, RigCamera};
use super::stand;
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::can_undistort;

const BOARD: Board = Board {
    corners: [9, 6],
    square_mm: 25.0,
};
const SIZE_PX: [u32; 2] = [640, 480];
const NOISE_PX: f64 = 0.1;
/// Outlier limit that rejects nothing.
const KEEP: f64 = f64::INFINITY;

const LENS: Lens = Lens([533.0, 529.0, 331.0, 236.0, -0.2, 0.05, 1e-3, -5e-4, 0.0]);

/// Returns a random pose of the board before the cameras, tilted by up to 35 degrees about any
/// axis.
fn pose(random: &mut Random) -> Isometry3<f64> {
    let turn = Vector3::from_fn(|_, _| random.between(-0.6, 0.6));
    let turn = UnitQuaternion::from_scaled_axis(turn);
    let middle = turn * Vector3::new(100.0, 62.5, 0.0);
    let place = Vector3::new(
        random.between(-60.0, 60.0),
        random.between(-40.0, 40.0),
        random.between(380.0, 520.0),
    );
    Isometry3::from_parts((place - middle).into(), turn)
}

fn corners(
    board: &Board,
    lens: &Lens,
    motion: &Isometry3<f64>,
    noise_px: f64,
    random: &mut Random,
) -> Vec<[f64; 2]> {
    let seen = |[x, y]: [f64; 2]| {
        let pixel = lens
            .project((motion * Point3::new(x, y, 0.0)).coords)
            .unwrap()
            .pixel;
        pixel.map(|c| c + noise_px * random.gaussian())
    };
    board.points_mm().into_iter().map(seen).collect()
}

fn found(corners: Vec<[f64; 2]>) -> Result<FoundBoard, ImageRejection> {
    Ok(FoundBoard {
        corners,
        blur_px: 1.0,
    })
}

fn images(
    count: usize,
    noise_px: f64,
    random: &mut Random,
) -> Vec<Result<FoundBoard, ImageRejection>> {
    (0..count)
        .map(|_| found(corners(&BOARD, &LENS, &pose(random), noise_px, random)))
        .collect()
}

#[test]
fn exact_corners_give_the_lens() {
    let images = images(6, 0.0, &mut Random::new(1, 0));
    let found = intrinsics::calibrate(&BOARD, SIZE_PX, &images, KEEP).unwrap();
    for (got, truth) in found.lens.0.iter().zip(LENS.0) {
        assert!(
            (got - truth).abs() < 1e-6 * truth.abs().max(1.0),
            "{:?}",
            found.lens
        );
    }
    assert!(found.rms_px < 1e-7, "{}", found.rms_px);
}

/// Tests that errors over their standard deviations have mean square 1. Over 60 runs of nine
/// parameters, correlated within each run, it scatters by 0.12.
#[test]
fn camera_sigma_is_true() {
    let runs = 60;
    let (mut squares, mut counts) = ([0.0; PARAMETERS], [0.0; PARAMETERS]);
    let mut worst: f64 = 0.0;
    for run in 0..runs {
        let images = images(12, NOISE_PX, &mut Random::new(7, run));
        let found = intrinsics::calibrate(&BOARD, SIZE_PX, &images, KEEP).unwrap();
        for (i, sigma) in found.sigma().into_iter().enumerate() {
            // In some runs k3 is held at zero, its true value.
            if sigma > 0.0 {
                let error = (found.lens.0[i] - LENS.0[i]) / sigma;
                squares[i] += error * error;
                counts[i] += 1.0;
                worst = worst.max(error.abs());
            }
        }
        // Two coordinates of noise each.
        let expected = NOISE_PX * 2.0_f64.sqrt();
        assert!(
            (found.rms_px / expected - 1.0).abs() < 0.15,
            "{}",
            found.rms_px
        );
    }
    assert!(counts[8] > 0.5 * runs as f64, "{counts:?}");
    let mean = squares.iter().sum::<f64>() / counts.iter().sum::<f64>();
    assert!((0.7..1.4).contains(&mean), "{mean} {squares:?}");
    for (square, count) in squares.into_iter().zip(counts) {
        assert!(
            (0.5..1.7).contains(&(square / count)),
            "{squares:?} {counts:?}"
        );
    }
    assert!(worst < 4.5, "{worst}");
}

#[test]
fn bad_images_are_rejected() {
    let mut random = Random::new(3, 0);
    let mut images = images(10, NOISE_PX, &mut random);
    images[2] = Err(NotFound::Nothing.into());
    images[4].as_mut().unwrap().blur_px = 2.5;
    // One corner lies on the neighbouring square's border.
    images[6].as_mut().unwrap().corners[10][0] += 8.0;
    let found = intrinsics::calibrate(&BOARD, SIZE_PX, &images, 3.0).unwrap();
    for (index, verdict) in found.verdicts.iter().enumerate() {
        let reason = match verdict {
            Verdict::Used { .. } => String::new(),
            Verdict::Rejected(reason) => reason.to_string(),
        };
        let expected = match index {
            2 => "no board found",
            4 => "blurred: edges 2.5 px wide, the median image's 1.0 px",
            6 => "times the median image's",
            _ => "",
        };
        assert!(reason.contains(expected), "{index}: {verdict:?}");
        assert_eq!(
            reason.is_empty(),
            expected.is_empty(),
            "{index}: {verdict:?}"
        );
        assert_eq!(found.poses[index].is_some(), expected.is_empty());
    }
    assert_eq!(found.used(), 7);
}

/// Tests that k3 is left out if it would fold the image corners over. Boards in the middle of the
/// image hardly determine the distortion there.
#[test]
fn undetermined_k3_is_left_out() {
    let mut held = 0;
    for run in 0..20 {
        let mut random = Random::new(13, run);
        let images: Vec<_> = (0..6)
            .map(|_| {
                let mut motion = pose(&mut random);
                motion.translation.vector.z += 150.0;
                found(corners(&BOARD, &LENS, &motion, NOISE_PX, &mut random))
            })
            .collect();
        let found = intrinsics::calibrate(&BOARD, SIZE_PX, &images, KEEP).unwrap();
        if !found.held.is_empty() {
            held += 1;
            assert_eq!(found.held, ["k3"]);
            assert_eq!((found.lens.0[8], found.sigma()[8]), (0.0, 0.0));
            assert!(
                can_undistort(&found.lens.camera(), SIZE_PX),
                "{:?}",
                found.lens
            );
        }
    }
    assert!(held > 2, "{held} of 20");
}

#[test]
fn unsolvable_views_are_refused() {
    let mut random = Random::new(4, 0);
    let two = images(2, NOISE_PX, &mut random);
    let (refusal, verdicts) = intrinsics::calibrate(&BOARD, SIZE_PX, &two, KEEP).unwrap_err();
    assert!(refusal.to_string().contains("2 of 2 images"), "{refusal}");
    assert_eq!(verdicts.len(), 2);
    // Boards parallel to the image do not determine its focal length.
    let square = |random: &mut Random| {
        let place = Vector3::new(-100.0, -60.0, random.between(400.0, 500.0));
        let motion = Isometry3::from_parts(place.into(), UnitQuaternion::identity());
        found(corners(&BOARD, &LENS, &motion, NOISE_PX, random))
    };
    let alike: Vec<_> = (0..8).map(|_| square(&mut random)).collect();
    let (refusal, _) = intrinsics::calibrate(&BOARD, SIZE_PX, &alike, KEEP).unwrap_err();
    assert!(refusal.to_string().contains("too alike"), "{refusal}");
}

/// Returns motions of three cameras nearly in line and nearly parallel, from the middle one's axes.
fn motions() -> Vec<Isometry3<f64>> {
    let place = |centre: [f64; 3], degrees: [f64; 3]| {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(degrees.map(f64::to_radians)));
        Isometry3::from_parts((turn * -Vector3::from(centre)).into(), turn)
    };
    vec![
        place([-70.0, 0.3, 0.2], [0.8, -1.1, 1.4]),
        Isometry3::identity(),
        place([68.0, 0.1, -0.4], [-0.6, 1.3, -0.9]),
    ]
}

struct Bench {
    eyes: Vec<RigCamera>,
    instants: Vec<Instant>,
}

/// Calibrates cameras from the images that then determine their poses.
fn bench(board: &Board, instants: usize, noise_px: f64, random: &mut Random) -> Bench {
    let motions = motions();
    let all: Vec<Instant> = (0..instants)
        .map(|_| {
            let pose = pose(random);
            let seen =
                |motion: &Isometry3<f64>| corners(board, &LENS, &(motion * pose), noise_px, random);
            motions.iter().map(seen).map(Some).collect()
        })
        .collect();
    let eye = |camera: usize| {
        let images: Vec<_> = all
            .iter()
            .filter_map(|i| i[camera].clone())
            .map(found)
            .collect();
        let own = intrinsics::calibrate(board, SIZE_PX, &images, KEEP).unwrap();
        RigCamera {
            lens: own.lens,
            covariance: own.covariance,
        }
    };
    Bench {
        eyes: (0..3).map(eye).collect(),
        instants: all,
    }
}

/// Returns offsets and rotations of all cameras, in a row.
fn row(stands: &[stand::CameraPose]) -> Vec<f64> {
    let stands = stands.iter();
    stands
        .flat_map(|s| s.offset_mm.into_iter().chain(s.rotation_deg))
        .collect()
}

#[test]
fn exact_corners_give_the_rig() {
    let bench = bench(&BOARD, 6, 0.0, &mut Random::new(5, 0));
    let solution = rig::calibrate(&BOARD, &bench.eyes, 1, &bench.instants, KEEP).unwrap();
    for (got, truth) in row(&solution.stands).iter().zip(stand::numbers(&motions())) {
        assert!((got - truth).abs() < 1e-6, "{solution:?}");
    }
    // Properties of the chosen axes: the line of the cameras is level on average, and the middle
    // camera is the origin.
    let [left, middle, right] = [0, 1, 2].map(|k| solution.stands[k].offset_mm);
    assert_eq!(middle, [0.0; 3]);
    assert!((left[0] + 70.0).abs() < 0.01 && (right[0] - 68.0).abs() < 0.01);
    assert!(
        left[1..].iter().chain(&right[1..]).all(|c| c.abs() < 0.5),
        "{left:?} {right:?}"
    );
}

#[test]
fn rig_sigma_is_true() {
    let runs = 40;
    let truth = stand::numbers(&motions());
    let mut squares = vec![0.0; truth.len()];
    let mut axes = [0.0; 3];
    for run in 0..runs {
        let bench = bench(&BOARD, 12, NOISE_PX, &mut Random::new(11, run));
        let solution = rig::calibrate(&BOARD, &bench.eyes, 1, &bench.instants, KEEP).unwrap();
        let (values, sigma) = (row(&solution.stands), row(&solution.sigma));
        for (i, square) in squares.iter_mut().enumerate() {
            if sigma[i] > 0.0 {
                *square += ((values[i] - truth[i]) / sigma[i]).powi(2) / runs as f64;
            }
        }
        for (i, square) in axes.iter_mut().enumerate() {
            let of_cameras = (0..3).map(|k| values[6 * k + 3 + i] - truth[6 * k + 3 + i]);
            let error = of_cameras.sum::<f64>() / 3.0;
            *square += (error / solution.axes_sigma_deg[i]).powi(2) / runs as f64;
        }
    }
    println!("axes: {axes:?}");
    assert!(
        axes.iter().all(|square| (0.45..2.0).contains(square)),
        "{axes:?}"
    );
    // The origin has no error: 3 of 18.
    let mean = squares.iter().sum::<f64>() / 15.0;
    assert!((0.7..1.4).contains(&mean), "{mean} {squares:?}");
    assert!(squares.iter().all(|square| *square < 2.2), "{squares:?}");
}

#[test]
fn moved_board_is_left_out() {
    let mut random = Random::new(6, 0);
    let mut bench = bench(&BOARD, 8, NOISE_PX, &mut random);
    if let Some(corners) = &mut bench.instants[3][2] {
        corners.iter_mut().for_each(|corner| corner[1] += 4.0);
    }
    bench.instants[5][0] = None;
    bench.instants[6] = vec![None, None, bench.instants[6][2].clone()];
    let solution = rig::calibrate(&BOARD, &bench.eyes, 1, &bench.instants, 3.0).unwrap();
    for (index, instant) in solution.instants.iter().enumerate() {
        match (index, instant) {
            (3, Err(InstantRejection::Residual { .. })) | (6, Err(InstantRejection::FewImages)) => {
            }
            (3 | 6, Ok(_)) | (_, Err(_)) => panic!("{index}: {instant:?}"),
            (_, Ok(rms_px)) => assert!(*rms_px < 2.0 * NOISE_PX, "{rms_px}"),
        }
    }
}

#[test]
fn cameras_never_together_are_named() {
    let mut bench = bench(&BOARD, 6, NOISE_PX, &mut Random::new(8, 0));
    for instant in &mut bench.instants[2..] {
        instant[2] = None;
    }
    let refusal = rig::calibrate(&BOARD, &bench.eyes, 1, &bench.instants, KEEP).unwrap_err();
    assert_eq!(
        refusal,
        rig::RigRefusal::Apart {
            camera: 2,
            instants: 2
        }
    );
    let one = rig::calibrate(&BOARD, &bench.eyes[..1], 0, &bench.instants, KEEP).unwrap_err();
    assert_eq!(one, rig::RigRefusal::Count(1));
}

/// Tests a board that looks the same after a turn, where one camera begins at the other end.
#[test]
fn turned_numbers_are_corrected() {
    for corners in [[7, 5], [6, 6]] {
        let board = Board {
            corners,
            square_mm: 25.0,
        };
        let mut bench = bench(&board, 6, NOISE_PX, &mut Random::new(9, 0));
        let straight = rig::calibrate(&board, &bench.eyes, 1, &bench.instants, KEEP).unwrap();
        for (number, instant) in bench.instants.iter_mut().enumerate() {
            let turns = board.symmetries();
            let quarters = turns[number % turns.len()];
            if let Some(seen) = &mut instant[2] {
                let old = seen.clone();
                for (index, at) in old.into_iter().enumerate() {
                    seen[board.turned(index, quarters)] = at;
                }
            }
        }
        let turned = rig::calibrate(&board, &bench.eyes, 1, &bench.instants, KEEP).unwrap();
        for (a, b) in row(&straight.stands).into_iter().zip(row(&turned.stands)) {
            assert!((a - b).abs() < 1e-6, "{straight:?} {turned:?}");
        }
    }
}

/// Returns motions from the first camera's axes, which are turned against the axes of `places_mm`.
fn standing(places_mm: &[[f64; 3]], turns_deg: &[[f64; 3]]) -> Vec<Isometry3<f64>> {
    let motion = |(place, degrees): (&[f64; 3], &[f64; 3])| {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(degrees.map(f64::to_radians)));
        Isometry3::from_parts((turn * -Vector3::from(*place)).into(), turn)
    };
    let all: Vec<Isometry3<f64>> = places_mm.iter().zip(turns_deg).map(motion).collect();
    all.iter().map(|motion| motion * all[0].inverse()).collect()
}

#[test]
fn coplanar_cameras_keep_their_plane() {
    let square = [
        [0.0, 0.0, 0.0],
        [60.0, 0.0, 0.0],
        [0.0, 50.0, 0.0],
        [60.0, 50.0, 0.0],
    ];
    let turns = [
        [1.0, -1.5, 0.6],
        [-1.0, 1.5, -0.6],
        [0.5, 0.5, 0.0],
        [-0.5, -0.5, 0.0],
    ];
    let upright = [[0.0, 0.0, 0.0], [0.0, 55.0, 0.0]];
    let slanted = [[0.0, 0.0, 0.0], [50.0, 4.0, 0.0], [100.0, 8.0, 0.0]];
    for (places, is_level) in [
        (&square[..], false),
        (&upright[..], false),
        (&slanted[..], true),
    ] {
        let stands = stand::stands(&stand::numbers(&standing(places, &turns)));
        for (stand, place) in stands.iter().zip(places) {
            let [x, y, z] = stand.offset_mm;
            assert!(z.abs() < 1e-9, "{stands:?}");
            assert!(
                (x.hypot(y) - place[0].hypot(place[1])).abs() < 1e-9,
                "{stands:?}"
            );
            // A line of cameras near the x axis becomes the x axis; other axes are the mean of the
            // cameras' own, within their rotations.
            let expected = if is_level {
                [place[0].hypot(place[1]), 0.0]
            } else {
                [place[0], place[1]]
            };
            assert!(
                (x - expected[0]).abs() < 1.5 && (y - expected[1]).abs() < 1.5,
                "{stands:?}"
            );
            assert!(!is_level || y.abs() < 1e-9, "{stands:?}");
        }
    }
}

/// Tests that a camera upside down is turned by 180 degrees, not by none, and one by a millionth of
/// a degree by that.
#[test]
fn half_and_tiny_turns_are_kept() {
    let turns = [[0.0; 3], [0.0, 0.0, 180.0], [1e-6, 0.0, 0.0]];
    let places = [[0.0; 3], [50.0, 0.0, 0.0], [100.0, 0.0, 0.0]];
    let stands = stand::placed(&standing(&places, &turns));
    for (stand, turn) in stands.iter().zip(turns) {
        for (got, truth) in stand.rotation_deg.into_iter().zip(turn) {
            assert!((got.abs() - truth).abs() < 1e-12, "{stands:?}");
        }
    }
}

#[test]
fn fitting_axes_stay_and_doubts_are_named() {
    let turns = [[0.0; 3], [0.0, 6.0, 0.0], [0.0; 3]];
    let level = standing(&[[0.0; 3], [50.0, 4.0, 0.0], [100.0, -3.0, 0.0]], &turns);
    let kept = stand::placed(&level);
    assert!(
        (kept[1].offset_mm[1] - 4.0).abs() < 1e-9 && (kept[1].rotation_deg[1] - 6.0).abs() < 1e-9,
        "{kept:?}"
    );
    let names = ["left", "middle", "right"];
    let sure = vec![stand::CameraPose::default(); 3];
    let doubts = stand::doubts(&names, &kept, &sure);
    assert_eq!(doubts.len(), 1, "{doubts:?}");
    assert!(
        doubts[0].starts_with("middle is turned by 6.0 degrees"),
        "{doubts:?}"
    );
    let ahead = stand::placed(&standing(
        &[[0.0; 3], [50.0, 0.0, 3.0], [100.0, 0.0, 0.0]],
        &[[0.0; 3]; 3],
    ));
    let doubts = stand::doubts(&names, &ahead, &sure);
    assert!(
        doubts
            .iter()
            .any(|doubt| doubt.starts_with("middle stands")),
        "{doubts:?} {ahead:?}"
    );
}
