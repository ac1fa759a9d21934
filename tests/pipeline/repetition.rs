//! Posters on which every place looks like others: the answer is right, or refused with a reason,
//! but never wrong with a small sigma.

use trinocular_rig::random::Random;
use trinocular_vision::flow::FlowRefusal;
use trinocular_vision::images::{SceneSettings, Texture, TextureKind};

use super::bench::{Bench, Got};
use super::poster::{Motif, fainter, repeating, with_marks};

/// Counts answers, and fails on a wrong one.
#[derive(Default)]
struct Jury {
    right: usize,
    refused: usize,
}

impl Jury {
    #[track_caller]
    fn hear(&mut self, what: &str, moved_mm: [f64; 3], got: &Result<Got, FlowRefusal>) {
        match got {
            Err(refusal) => {
                assert!(!refusal.to_string().is_empty());
                self.refused += 1;
            }
            Ok(got) => {
                assert!(
                    got.is_honest(moved_mm),
                    "{what}: {:?} mm off {moved_mm:?} and sure to {:?}, {} points",
                    got.error_mm(moved_mm),
                    got.sigma_mm,
                    got.points
                );
                self.right += 1;
            }
        }
    }

    #[track_caller]
    fn hear_all(&mut self, what: &str, bench: &Bench, moves_mm: &[[f64; 3]], seed: u64) {
        let got = bench.measure_all(moves_mm, seed);
        for (moved, got) in moves_mm.iter().zip(&got) {
            self.hear(what, *moved, got);
        }
    }
}

/// Returns whole periods and half periods, along one axis and both, and two displacements that are
/// no multiples.
fn treacherous(period_mm: f64, random: &mut Random) -> [[f64; 3]; 6] {
    let any = |random: &mut Random, most: f64| random.between(-most, most);
    [
        [period_mm, 0.0, 0.0],
        [0.0, period_mm, 0.0],
        [0.5 * period_mm, 0.5 * period_mm, 0.0],
        [0.5 * period_mm, 0.0, 0.0],
        [15.0, 15.0, 2.0],
        [any(random, 25.0), any(random, 25.0), any(random, 5.0)],
    ]
}

fn tilted(seed: u64, random: &mut Random) -> SceneSettings {
    let mut settings = SceneSettings::default();
    if seed % 2 == 1 {
        settings.tilt_rad = [(); 2].map(|()| random.between(-0.4, 0.4));
    }
    settings
}

#[test]
fn exact_repetition_never_deceives() {
    let (mut jury, mut random) = (Jury::default(), Random::seeded(11));
    for seed in 0..2 {
        for motif in Motif::ALL {
            for (period_mm, contrast) in [(9.0, 180.0), (19.0, 60.0), (40.0, 180.0), (70.0, 120.0)]
            {
                let texture = repeating(motif, period_mm, contrast, seed);
                let settings = tilted(seed, &mut random);
                let bench = Bench::new(&texture, settings);
                let what = format!("{motif:?} every {period_mm} mm, seed {seed}");
                jury.hear_all(&what, &bench, &treacherous(period_mm, &mut random), seed);
            }
        }
    }
    assert!(jury.refused > 0, "at least one case must be refused");
}

#[test]
fn bricks_and_grids_never_deceive() {
    let (mut jury, mut random) = (Jury::default(), Random::seeded(12));
    for seed in 0..2 {
        for kind in [TextureKind::Bricks, TextureKind::Grid] {
            let texture = Texture::of_kind(kind, seed);
            for depth_mm in [500.0, 850.0] {
                let settings = SceneSettings {
                    depth_mm,
                    ..tilted(seed, &mut random)
                };
                let bench = Bench::new(&texture, settings);
                let what = format!("{kind} at {depth_mm} mm, seed {seed}");
                jury.hear_all(&what, &bench, &treacherous(51.2, &mut random), seed);
                jury.hear_all(&what, &bench, &[[25.6, 25.6, 0.0], [0.0, 25.6, 0.0]], seed);
            }
        }
    }
    assert!(jury.refused > 0);
}

/// Few marks make the answer no easier, many do. With both, it is right or refused.
#[test]
fn marked_repetition_never_deceives() {
    let mut random = Random::seeded(13);
    let mut right = Vec::new();
    for marks in [10, 60, 400, 2500] {
        let mut jury = Jury::default();
        for (seed, motif, period_mm) in [
            (0, Motif::Dots, 25.0),
            (1, Motif::Checks, 60.0),
            (2, Motif::Wallpaper, 50.0),
            (3, Motif::Lines, 35.0),
        ] {
            let texture = with_marks(&repeating(motif, period_mm, 60.0, seed), marks, 8.0, seed);
            let bench = Bench::new(&texture, tilted(seed, &mut random));
            let what = format!("{motif:?} every {period_mm} mm with {marks} marks");
            jury.hear_all(&what, &bench, &treacherous(period_mm, &mut random), seed);
        }
        right.push(jury.right);
    }
    assert!(
        right[3] >= 20,
        "marks all over should decide it: {right:?} of 24"
    );
}

#[test]
fn faint_posters_are_right_or_refused() {
    let mut jury = Jury::default();
    for (seed, contrast) in [(0, 0.3), (1, 0.15), (2, 0.07), (3, 0.03), (4, 0.0)] {
        for kind in [TextureKind::Natural, TextureKind::Blobs] {
            let texture = fainter(Texture::of_kind(kind, seed), contrast);
            let bench = Bench::new(&texture, SceneSettings::default());
            let what = format!("{kind} with contrast {contrast}");
            let moves = [[4.0, 4.0, 1.0], [-20.0, 7.0, -4.0]];
            jury.hear_all(&what, &bench, &moves, seed);
        }
    }
    assert!(
        jury.right >= 8 && jury.refused >= 4,
        "{} right, {} refused",
        jury.right,
        jury.refused
    );
}
