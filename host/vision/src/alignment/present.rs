//! An alignment in words: facts and warnings.

use super::Alignment;
use super::penalty::Cost;

/// Largest standard deviation of an offset without a warning, px.
pub const GOAL_PX: f64 = 0.02;

/// Least magnification with a warning, in standard deviations.
const SIGNIFICANT: f64 = 5.0;
/// Least effect of a magnification with a warning, at the image's border, px.
const VISIBLE_PX: f64 = 0.1;

/// Returns the names and values that are not part of the table.
pub fn facts(found: &Alignment) -> Vec<(&'static str, String)> {
    let [matched, all] = found.captures;
    let mut facts = vec![
        (
            "points",
            format!(
                "{} of {} in {matched} of {all} frame sets, scatter {:.3} px, around {:.0} mm",
                found.points,
                found.points + found.outliers,
                found.scatter_px,
                found.depth_mm
            ),
        ),
        ("Z penalty before", cost(found.penalty.before_percent)),
        ("Z penalty after", cost(found.penalty.after_percent)),
        (
            "0.1 px of X left",
            format!(
                "in one outer image: {}",
                cost(found.penalty.tenth_px_percent)
            ),
        ),
        ("not seen", unseen(found)),
    ];
    facts.extend(found.cameras.iter().filter_map(|camera| {
        let [roll, sigma] = camera.roll_deg.filter(|_| camera.name != found.reference)?;
        let name = &camera.name;
        let verdict = match camera.rotation_deg {
            Some([x, y, z]) => format!("undone by rotation_deg = [{x:.4}, {y:.4}, {z:.4}]"),
            None => "may be nothing, left as it is".to_owned(),
        };
        let roll = format!(
            "of {name} {roll:.4} ± {sigma:.4} degrees against {}: {verdict}",
            found.reference
        );
        Some(("roll", roll))
    }));
    facts
}

fn cost(cost: Cost) -> String {
    let percent = |value: Option<f64>| match value {
        Some(value) => format!("{:.2} %", value.abs()),
        None => "none".to_owned(),
    };
    format!(
        "midpoint {}, closed form {}",
        percent(cost.midpoint),
        percent(cost.closed_form)
    )
}

fn unseen(found: &Alignment) -> String {
    if found.depth_known {
        return format!(
            "a common shift of all images ({} keeps its principal point)",
            found.reference
        );
    }
    format!(
        "a common shift of all images ({} keeps its principal point), and a common error of all \
         disparities: 0.1 px of it costs {:.2} % of Z, the midpoint's too (a flat target at a \
         known --depth shows it)",
        found.reference, found.penalty.unseen_percent
    )
}

/// Formats warnings for the user.
pub fn warnings(found: &Alignment) -> Vec<String> {
    let mut warnings = Vec::new();
    if let Some([a, b]) = &found.same_view {
        warnings.push(format!(
            "`{a}` and `{b}` see all points at the same pixels, although they are at different \
             places: are these images of one camera?"
        ));
    }
    let worst = found.cameras.iter().flat_map(|c| c.sigma_px);
    let worst = worst.fold(0.0, f64::max);
    if worst > GOAL_PX {
        warnings.push(format!(
            "sigma {worst:.3} px is above {GOAL_PX} px: take more frame sets, of a scene with \
             finer texture all over the image"
        ));
    }
    let half = found.rig.image_size_px.map(|side| 0.5 * f64::from(side));
    let reach_px = half[0].hypot(half[1]);
    for camera in &found.cameras {
        let visible = |[value, sigma]: [f64; 2]| {
            value.abs() > SIGNIFICANT * sigma && value.abs() * reach_px > VISIBLE_PX
        };
        let scaled = camera.scale_percent.map(|scale| scale.map(|s| 0.01 * s));
        if let Some([scale, sigma]) = scaled.filter(|scale| visible(*scale)) {
            warnings.push(format!(
                "{} magnifies {:.3} ± {:.3} % {} than {} across the line of cameras: {:.2} px at \
                 the image's corners, check focal_px, and that the cameras are parallel",
                camera.name,
                100.0 * scale.abs(),
                100.0 * sigma,
                if scale > 0.0 { "more" } else { "less" },
                found.reference,
                scale.abs() * reach_px
            ));
        }
    }
    let [matched, all] = found.captures;
    if matched < all {
        warnings.push(format!(
            "{} of {all} frame sets could not be matched",
            all - matched
        ));
    }
    warnings
}
