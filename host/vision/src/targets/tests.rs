use super::*;
use crate::estimation::{Rotation, Solution};
use crate::images::{Scene, SceneSettings, Texture};

/// First column of the right target in every image, px.
const EDGE_PX: usize = 160;

/// Renders two posters side by side, which have moved by these displacements.
fn frame_set(rig: &Rig, moved_mm: [[f64; 3]; 2], seed: u64) -> FrameSet {
    let scene = |seed| Scene::new(rig, &Texture::natural(seed), SceneSettings::default()).unwrap();
    let mut seen = scene(1).render(moved_mm[0], 0, seed);
    let other = scene(2).render(moved_mm[1], 0, seed + 1);
    for (image, other) in seen.images.iter_mut().zip(other.images) {
        let width = image.width;
        let rows = image.grey.chunks_mut(width).zip(other.grey.chunks(width));
        for (row, other) in rows {
            row[EDGE_PX..].copy_from_slice(&other[EDGE_PX..]);
        }
    }
    seen
}

fn targets(reference: Option<&str>) -> [Target; 2] {
    [("left", [75, 10, 65, 220]), ("right", [215, 10, 60, 220])].map(|(name, roi_px)| Target {
        name: name.to_owned(),
        roi_px,
        camera: 1,
        is_reference: reference == Some(name),
        drives: false,
    })
}

fn solutions(rule: &Rule, reference: Option<&str>, moved_mm: [[f64; 3]; 2]) -> Vec<Solution> {
    let rig = Rig::paper();
    let (settings, regions) = (FlowSettings::default(), Regions::default());
    let mut flows = TargetFlows::new(&rig, settings, &targets(reference), &regions).unwrap();
    for keyframe in flows.set_keyframe(&frame_set(&rig, [[0.0; 3]; 2], 10)) {
        keyframe.unwrap();
    }
    let measured = flows.measure(rule, &rig, &frame_set(&rig, moved_mm, 20));
    let solutions = measured.into_iter().map(|seen| seen.unwrap().solution);
    solutions.map(|solution| solution.unwrap()).collect()
}

#[track_caller]
fn assert_near(solution: &Solution, wanted_mm: [f64; 3]) {
    let sigma_mm = solution.sigma_mm.expect("sigma");
    for (axis, wanted_mm) in wanted_mm.into_iter().enumerate() {
        let error_mm = solution.displacement_mm[axis] - wanted_mm;
        let most_mm = [0.03, 0.03, 0.3][axis];
        assert!(
            error_mm.abs() < 4.0 * sigma_mm[axis] && sigma_mm[axis] < most_mm,
            "{solution:?}, not {wanted_mm}"
        );
    }
}

const MOVED_MM: [[f64; 3]; 2] = [[1.0, -0.5, 0.4], [-0.6, 0.8, -0.3]];

#[test]
fn each_target_is_measured_by_itself() {
    let found = solutions(&Rule::default(), None, MOVED_MM);
    for (solution, moved_mm) in found.iter().zip(MOVED_MM) {
        assert_near(solution, moved_mm);
    }
}

#[test]
fn reference_takes_out_common_motion() {
    let of = |rotation| Rule {
        rotation,
        ..Rule::default()
    };
    let alone = solutions(&of(Some(Rotation::Refuse)), None, MOVED_MM);
    for rotation in [None, Some(Rotation::Refuse), Some(Rotation::Estimate)] {
        let rule = of(rotation);
        let found = solutions(&rule, Some("right"), MOVED_MM);
        assert_near(&found[1], MOVED_MM[1]);
        let wanted_mm = [0, 1, 2].map(|i| MOVED_MM[0][i] - MOVED_MM[1][i]);
        if rotation != Some(Rotation::Refuse) {
            // The lever arm from one target to the other makes sigma larger, not wrong.
            for (axis, wanted_mm) in wanted_mm.into_iter().enumerate() {
                let error_mm = found[0].displacement_mm[axis] - wanted_mm;
                assert!(error_mm.abs() < 4.0 * found[0].sigma_mm.expect("sigma")[axis]);
            }
            continue;
        }
        assert_near(&found[0], wanted_mm);
        for axis in 0..3 {
            let [a, b] = [&alone[0], &alone[1]].map(|s| s.sigma_mm.expect("sigma")[axis]);
            let combined = found[0].sigma_mm.expect("sigma")[axis];
            assert!((combined - a.hypot(b)).abs() < 1e-12);
        }
    }
}

#[test]
fn refused_reference_refuses_the_others() {
    let rig = Rig::paper();
    let (settings, regions) = (FlowSettings::default(), Regions::default());
    let mut flows = TargetFlows::new(&rig, settings, &targets(Some("right")), &regions).unwrap();
    let still = [[0.0; 3]; 2];
    flows.set_keyframe(&frame_set(&rig, still, 10));
    let mut covered = frame_set(&rig, still, 20);
    for image in &mut covered.images {
        let width = image.width;
        for row in image.grey.chunks_mut(width) {
            row[EDGE_PX..].fill(90);
        }
    }
    let seen = flows.measure(&Rule::default(), &rig, &covered);
    assert!(seen[1].is_err());
    let reason = seen[0].as_ref().unwrap().solution.as_ref().unwrap_err();
    assert!(
        reason.starts_with("the reference right is refused: "),
        "{reason}"
    );
    // Without a reference the other is measured.
    let mut flows = TargetFlows::new(
        &rig,
        FlowSettings::default(),
        &targets(None),
        &Regions::default(),
    )
    .unwrap();
    flows.set_keyframe(&frame_set(&rig, still, 10));
    let seen = flows.measure(&Rule::default(), &rig, &covered);
    assert!(seen[0].as_ref().is_ok_and(|seen| seen.solution.is_ok()));
}

#[test]
fn rectangles_are_within_those_of_all() {
    let rig = Rig::paper();
    let [left, _] = targets(None);
    let all = Region {
        rectangle_px: Some([100, 0, 100, 50]),
        mask: None,
    };
    let regions = within(&left, &rig, &Regions(vec![Region::default(), all]));
    assert_eq!(regions.0[1].rectangle_px, Some([100, 10, 40, 40]));
    assert_eq!(overlap([0, 0, 5, 5], [7, 2, 5, 5])[2], 0);
}
