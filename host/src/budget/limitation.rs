//! Limits of a rig, each under the name of the field or number that sets it.

use serde::Serialize;
use trinocular_core::estimate::Gate;
use trinocular_core::frame::message::Side;

use super::drive::AXES;
use super::headroom::RATED_MOVE_MM;
use super::sigma::WINDOW_PX;
use super::{AtDepth, Verification};
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::field_of_view::FieldOfView;
use trinocular_vision::matching::geometry::RigGeometry;
use trinocular_vision::matching::stereo::matched_depths_mm;

/// Severity of a limit, worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The station would refuse the rig.
    Refusal,
    /// Part of the range cannot be used as requested.
    Warning,
    /// Advice on the most effective change.
    Note,
}

impl Severity {
    /// Returns the name as printed.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Refusal => "refusal",
            Self::Warning => "warning",
            Self::Note => "note",
        }
    }
}

/// One limit of a rig.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Limitation {
    /// Severity of the limit.
    pub severity: Severity,
    /// Field of the rig file, or number, that sets the limit.
    pub name: String,
    /// Effect of the limit, with figures.
    pub text: String,
}

/// Largest ratio of magnification between two cameras: at 1.3 half of the points are matched, at
/// 1.5 hardly any (`tests/pipeline/rigs.rs`).
const MOST_MAGNIFICATION: f64 = 1.3;

/// Variance inflation factor above which windows are crowded: doubling the points then gains next
/// to nothing.
const CROWDED: f64 = 3.0;

/// Returns all limits of `rig`, the worst first.
pub(super) fn find(rig: &RigFile, view: &FieldOfView, found: &Verification) -> Vec<Limitation> {
    let mut limits = Vec::new();
    let mut add = |severity, name: &str, text: String| {
        limits.push(Limitation {
            severity,
            name: name.to_owned(),
            text,
        });
    };
    cameras(rig, view, found, &mut add);
    certainty(found, &mut add);
    stage(rig, found, &mut add);
    formats(found, &mut add);
    limits.sort_by_key(|limit| limit.severity);
    limits
}

type Add<'a> = dyn FnMut(Severity, &str, String) + 'a;

fn cameras(rig: &RigFile, view: &FieldOfView, found: &Verification, add: &mut Add<'_>) {
    let [near, far] = found.settings.depth_range_mm;
    let (nearest, [a, b]) = view.nearest_common();
    let (farthest, parting) = view.farthest_common();
    let names = |[a, b]: [usize; 2]| format!("{} and {}", rig.names[a], rig.names[b]);
    if nearest.is_infinite() && a == b {
        let text = format!("the images have no room for a window of {WINDOW_PX} px");
        add(Severity::Warning, "image_size_px", text);
        return;
    }
    if nearest >= far.min(farthest) || farthest <= near {
        let pair = if nearest >= far { [a, b] } else { parting };
        let text = format!(
            "{} have no common view between {near} and {far} mm",
            names(pair)
        );
        add(Severity::Warning, "camera.principal_px", text);
        return;
    }
    if nearest > near {
        let text = format!(
            "{} have no common view nearer than {nearest:.0} mm",
            names([a, b])
        );
        add(Severity::Warning, "camera.offset_mm", text);
    }
    if farthest < far {
        let text = format!(
            "{} have no common view beyond {farthest:.0} mm: they look across each other",
            names(parting)
        );
        add(Severity::Warning, "camera.principal_px", text);
    }
    if let Some(geometry) = RigGeometry::new(&rig.rig) {
        let focal = |k: usize| rig.rig.cameras[k].focal_px.iter().sum::<f64>() / 2.0;
        for (k, name) in rig.names.iter().enumerate() {
            let ratio = focal(k) / focal(geometry.reference);
            let ratio = ratio.max(1.0 / ratio);
            if ratio > MOST_MAGNIFICATION {
                let text = format!(
                    "focal lengths of {name} and {} differ {ratio:.2} times: half of the points \
                     are lost at {MOST_MAGNIFICATION}, nearly all at 1.5",
                    rig.names[geometry.reference]
                );
                add(Severity::Warning, "camera.focal_px", text);
            }
        }
        let ([least, most], reach_mm) =
            (matched_depths_mm(&geometry), geometry.longest_baseline_mm);
        if most < far {
            let text = format!(
                "no camera is farther than {reach_mm:.2} mm from the one in the middle: points \
                 beyond {most:.0} mm are not matched, their disparities say too little"
            );
            add(Severity::Warning, "camera.offset_mm", text);
        }
        if least > near.max(nearest) {
            let text = format!(
                "points nearer than {least:.0} mm are not matched: they lie more than half an \
                 image apart in the cameras"
            );
            add(Severity::Warning, "image_size_px", text);
        }
    }
    if found
        .headroom
        .as_ref()
        .is_some_and(|h| h.closed_form_to_mm.is_none())
    {
        let text =
            "not left, middle, right nearly in line: the paper's two estimators cannot be used";
        add(Severity::Note, "camera", text.to_owned());
    }
}

fn certainty(found: &Verification, add: &mut Add<'_>) {
    let Some((most, points)) = (found.settings.points.iter().enumerate())
        .max_by_key(|(_, points)| **points)
        .map(|(index, points)| (index, *points))
    else {
        return;
    };
    let sigma = |at: &AtDepth, axis: usize| at.sigma_mm.get(most).map(|s| s[axis]);
    for (axis, name) in AXES.iter().enumerate() {
        let gate = f64::from(Gate::DEFAULT.max_sigma_nm[axis]) / 1e6;
        let beyond = (found.depths.iter()).find(|at| sigma(at, axis).is_some_and(|s| s > gate));
        if let Some(at) = beyond {
            let text = format!(
                "from {:.0} mm on sigma {name} is above the station's gate of {gate} mm even with \
                 {points} points: frames are refused",
                at.depth_mm
            );
            add(Severity::Warning, &format!("sigma {name}"), text);
        }
    }
    let least = u32::from(Gate::DEFAULT.min_points);
    if found.settings.points.iter().any(|points| *points < least) {
        let text = format!("frames of fewer than {least} points are refused, whatever their sigma");
        add(Severity::Warning, "points", text);
    }
    let cramped = (found.depths.iter()).rfind(|at| at.room_for < points && !at.sigma_mm.is_empty());
    if let Some(at) = cramped {
        let text = format!(
            "no more than {} points have room in the common view at {:.0} mm, and fewer nearer",
            at.room_for, at.depth_mm
        );
        add(Severity::Note, "image_size_px", text);
    }
    let crowded =
        (found.depths.iter()).rfind(|at| at.widening.get(most).is_some_and(|w| *w > CROWDED));
    if let Some(at) = crowded {
        let text = format!(
            "{points} windows overlap in the common view up to {:.0} mm: as good as {:.0} \
             independent ones there; a larger image or less noise helps, more points do not",
            at.depth_mm,
            f64::from(points.min(at.room_for)) / at.widening[most]
        );
        add(Severity::Note, "image_size_px", text);
    }
    let Some(middle) = (found.depths.iter())
        .filter(|at| !at.sigma_mm.is_empty())
        .nth(found.depths.len() / 2)
    else {
        return;
    };
    // At very wide angles X is less certain than Z, and nothing limits Z.
    if let (Some(x), Some(z)) = (sigma(middle, 0), sigma(middle, 2))
        && z > x
    {
        let text = format!(
            "Z is {:.1} times less certain than X at {:.0} mm: it grows with the angle that the \
             views span; shorter focal lengths or cameras farther apart help",
            z / x,
            middle.depth_mm
        );
        add(Severity::Note, "camera.focal_px", text);
    }
}

fn stage(rig: &RigFile, found: &Verification, add: &mut Add<'_>) {
    let (Some(drive), Some(stage)) = (&found.drive, &rig.stage) else {
        let text = "no [stage] in the rig file: step rates and stopping distances are unknown";
        add(Severity::Note, "stage", text.to_owned());
        return;
    };
    for (field, reason) in &drive.faults {
        add(Severity::Refusal, field, reason.clone());
    }
    if !stage.tracking.prediction {
        let text = "is off, and with it the watch for lost steps (largest_unseen_mm): a stalled \
                    motor is not noticed; leave prediction on unless you compare";
        add(Severity::Warning, "stage.prediction", text.to_owned());
    }
    let highest = drive.drivers.highest_word_rate_hz;
    if highest.is_some_and(|hz| hz < drive.drivers.word_rate_hz) {
        let text = format!(
            "{} takes at most {} words/s, the station makes {}",
            drive.drivers.name,
            highest.unwrap_or_default(),
            drive.drivers.word_rate_hz
        );
        add(Severity::Note, "stage.driver", text);
    }
    for (i, (axis, name)) in drive.axes.iter().zip(AXES).enumerate() {
        if let Some(text) = outside_travel(stage, i) {
            add(Severity::Warning, &format!("stage.travel_mm[{i}]"), text);
        }
        if let Some(text) = switch_inside_travel(stage, i) {
            add(
                Severity::Warning,
                &format!("stage.home_position_mm[{i}]"),
                text,
            );
        }
        if axis.full_speed_mm > axis.travel_mm {
            let text = format!(
                "{} mm/s are never reached: that takes a move of {:.1} mm, the travel is {:.1} mm",
                stage.max_speed_mm_s[i], axis.full_speed_mm, axis.travel_mm
            );
            add(
                Severity::Warning,
                &format!("stage.max_speed_mm_s[{i}]"),
                text,
            );
        }
        // The remainder of a step is uniformly distributed.
        let rounding = axis.step_mm / 12f64.sqrt();
        let row = stage.matrix[i];
        let along = |at: &AtDepth| {
            let sigma = at.sigma_mm.last()?;
            let squares = (0..3).map(|k| (row[k] * sigma[k]).powi(2));
            Some(squares.sum::<f64>().sqrt())
        };
        let cameras_limit = |at: &&AtDepth| along(at).is_some_and(|sigma| sigma > rounding);
        let text = match found.depths.iter().find(cameras_limit) {
            Some(at) if at.depth_mm <= found.settings.depth_range_mm[0] => continue,
            Some(at) => format!("nearer than {:.0} mm", at.depth_mm),
            None => "everywhere".to_owned(),
        };
        let text = format!(
            "{text} the step of {:.4} mm limits {name}, not the cameras",
            axis.step_mm
        );
        add(Severity::Note, &format!("stage.steps_per_mm[{i}]"), text);
    }
}

/// Describes a home switch that soft limits let the axis run onto. Returns `None` if there is none.
fn switch_inside_travel(stage: &Stage, axis: usize) -> Option<String> {
    let [low, high] = stage.travel_mm[axis];
    let home = stage.care.home[axis]?;
    let trips_mm = home.position_mm;
    let is_inside = match home.side {
        Side::Negative => trips_mm > low,
        Side::Positive => trips_mm < high,
    };
    is_inside.then(|| {
        format!(
            "the home switch trips at {trips_mm} mm, inside travel_mm ({low} to {high} mm): moves \
             within the soft limits run onto the switch; correct home_position_mm, or end \
             travel_mm before it"
        )
    })
}

/// Describes an axis that will stand outside its travel once its position is known. Returns `None`
/// if the axis will be inside.
fn outside_travel(stage: &Stage, axis: usize) -> Option<String> {
    let [low, high] = stage.travel_mm[axis];
    let outside = |mm: f64| mm < low || mm > high;
    let (place, after) = match stage.care.home[axis] {
        Some(home) => {
            let back_off = match home.side {
                Side::Negative => stage.care.back_off_mm,
                Side::Positive => -stage.care.back_off_mm,
            };
            (home.position_mm + back_off, "home")
        }
        None => (0.0, "zero"),
    };
    outside(place).then(|| {
        format!(
            "excludes {place} mm, where the axis stands after `{after}`: from there it moves only \
             inwards, slowly and when a jog names it, and no target is followed"
        )
    })
}

fn formats(found: &Verification, add: &mut Add<'_>) {
    let Some(headroom) = &found.headroom else {
        return;
    };
    let [near, far] = found.settings.depth_range_mm;
    for room in headroom.rooms.iter().filter(|room| room.bits_left < 0.0) {
        let text = format!(
            "reaches {:.4} of {:.4} ({}) between {near} and {far} mm and displacements of \
             {RATED_MOVE_MM} mm: such frames are refused",
            room.worst, room.limit, room.format
        );
        add(Severity::Warning, room.name, text);
    }
    if headroom.midpoint_to_mm < far {
        let text = format!(
            "beyond {:.0} mm the station refuses points that lie within a few pixels of each other",
            headroom.midpoint_to_mm
        );
        add(Severity::Note, "spread", text);
    }
    if let Some(to) = headroom.closed_form_to_mm.filter(|to| *to < far) {
        let text = format!("the closed form ends at {to:.0} mm: its determinant becomes too small");
        add(Severity::Warning, "a1 b2 - a2 b1", text);
    }
}
