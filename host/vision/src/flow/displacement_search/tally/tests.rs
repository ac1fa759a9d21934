use super::super::{FIRST_VOTERS, MAX_VOTERS};
use super::*;
use crate::flow::displacement_search::Hypothesis;
use crate::images::{FrameSet, Scene, SceneSettings, Texture, TextureKind};
use crate::matching::geometry::{Ray, RigGeometry};
use crate::matching::pyramid::Pyramid;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::ZnccPlane;
use crate::thread_pool::ThreadPool;
use trinocular_core::rig::Rig;
use trinocular_rig::random::Random;

const LEVEL: usize = 2;
const DEPTH_MM: f64 = 850.0;

/// Returns the points that the reference camera sees in a lattice, at depths that differ by up to
/// `relief`.
fn points(geometry: &RigGeometry, relief: f64) -> Vec<StereoMatch> {
    let mut random = Random::seeded(2);
    let point = |i: usize| {
        let at = [30 + i % 9 * 32, 30 + i / 9 * 28].map(|c| c as f64 + random.between(-0.5, 0.5));
        let depth_mm = DEPTH_MM * (1.0 + random.between(-relief, relief));
        let cameras = 0..geometry.cameras();
        StereoMatch {
            pixels: cameras.clone().map(|_| at).collect(),
            normalised: cameras.map(|k| geometry.normalise(k, at)).collect(),
            ray: Ray {
                direction: [0.0; 2],
                inverse_depth: 1.0 / depth_mm,
            },
            templates: Vec::new(),
        }
    };
    (0..63).map(point).collect()
}

fn coarse(geometry: &RigGeometry, frame_set: &FrameSet) -> ZnccPlane {
    let pyramid = Pyramid::new(&frame_set.images[geometry.reference], LEVEL + 1);
    ZnccPlane::new(&pyramid.levels[LEVEL])
}

fn poster(rig: &Rig, kind: TextureKind, seed: u64) -> Scene {
    let settings = SceneSettings {
        depth_mm: DEPTH_MM,
        ..SceneSettings::default()
    };
    Scene::new(rig, &Texture::of_kind(kind, seed), settings).unwrap()
}

/// Returns the hypotheses, and those of a count of all votes for all displacements.
fn both(
    geometry: &RigGeometry,
    [before, now]: [&FrameSet; 2],
    relief: f64,
    threads: usize,
) -> [Vec<Hypothesis>; 2] {
    let [before, now] = [before, now].map(|frame_set| coarse(geometry, frame_set));
    let search = DisplacementSearch {
        geometry,
        before: &before,
        now: &now,
        scale: (1 << LEVEL) as f64,
        range: 16,
        thread_pool: &ThreadPool::new(threads),
    };
    let points = points(geometry, relief);
    [FIRST_VOTERS, MAX_VOTERS].map(|first| search.hypotheses_of(&points, first))
}

#[test]
fn restricted_count_has_bits_of_whole_count() {
    let rig = Rig::paper();
    let geometry = RigGeometry::new(&rig).unwrap();
    let (mut clear, mut rivals) = (0, 0);
    for kind in TextureKind::ALL {
        let scene = poster(&rig, kind, 3);
        let before = scene.render([0.0; 3], 0, 1);
        // Still, moved, far away, jumped out of the search range, and lost: another poster.
        let moves = [
            [0.0; 3],
            [4.0, -2.5, 3.0],
            [40.0, 31.0, -70.0],
            [190.0, 0.0, 90.0],
        ];
        let mut later: Vec<FrameSet> = (moves.iter().zip(2..))
            .map(|(moved_mm, seed)| scene.render(*moved_mm, 33_333, seed))
            .collect();
        later.push(poster(&rig, kind, 8).render([0.0; 3], 33_333, 9));
        for (index, now) in later.iter().enumerate() {
            for (relief, threads) in [(0.0, 1), (0.3, 2)] {
                let [found, whole] = both(&geometry, [&before, now], relief, threads);
                assert_eq!(found, whole, "{kind} {index} {relief}");
                clear += usize::from(found.len() == 1);
                rivals += usize::from(found.len() > 1);
            }
        }
    }
    // Both kinds of scenes were met.
    assert!(clear >= 5 && rivals >= 5, "{clear} {rivals}");
}

#[test]
fn few_displacements_of_clear_motion_are_counted() {
    let rig = Rig::paper();
    let geometry = RigGeometry::new(&rig).unwrap();
    let scene = poster(&rig, TextureKind::Natural, 3);
    let [before, now] =
        [[0.0; 3], [4.0, -2.5, 3.0]].map(|mm| coarse(&geometry, &scene.render(mm, 0, 1)));
    let search = DisplacementSearch {
        geometry: &geometry,
        before: &before,
        now: &now,
        scale: (1 << LEVEL) as f64,
        range: 16,
        thread_pool: &ThreadPool::default(),
    };
    let voters = search.voters(&points(&geometry, 0.0));
    let inverse_depth = 1.0 / DEPTH_MM;
    let step = search.scale / (geometry.focal_px * inverse_depth);
    let grid = DisplacementGrid {
        side: 33,
        first: -16.0 * step,
        step,
    };
    let tally = search.tally(&voters, grid, inverse_depth, FIRST_VOTERS);
    let counted = tally.layers.iter().flat_map(|layer| &layer.counted);
    let counted: usize = counted.map(ExactSizeIterator::len).sum();
    let all = tally.layers.len() * grid.side * grid.side;
    assert!(20 * counted < all, "{counted} of {all}");
}
