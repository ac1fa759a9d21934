//! The paper's section 4.2: single moves seen by resting cameras, through the whole vision path
//! (its Table 5).

use crate::servo::ServoError;
use serde::Serialize;
use trinocular_core::rig::Rig;
use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings};
use trinocular_vision::images::{Scene, SceneSettings, Texture, TextureKind};
use trinocular_vision::sums::Sums;

/// A move and the paper's estimate, mm.
pub const PRINTED: [([f64; 3], [f64; 3]); 8] = [
    ([10.0, 10.0, 0.0], [10.2277, 10.4544, 0.2204]),
    ([15.0, 15.0, 0.0], [15.0612, 15.2314, 0.3384]),
    ([20.0, 20.0, 0.0], [19.8168, 19.2955, 1.3064]),
    ([0.0, 0.0, 3.0], [0.8342, 0.3312, 2.8683]),
    ([0.0, 0.0, 5.0], [0.7917, 1.3999, 5.1455]),
    ([0.0, 0.0, 7.0], [1.8516, 1.3700, 6.1966]),
    ([15.0, 15.0, 2.0], [15.6381, 15.7348, 1.7697]),
    ([20.0, 20.0, 2.0], [20.2748, 19.6554, 1.5016]),
];

/// Bounds on the midpoint's error, mm.
pub const BOUND_MM: [f64; 3] = [0.02, 0.02, 0.05];

/// One move, the paper's estimate and this program's, mm. `None` if an estimator gave no answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// True motion of the target.
    #[serde(rename = "true")]
    pub true_mm: [f64; 3],
    /// The paper's estimate.
    #[serde(rename = "paper")]
    pub paper_mm: [f64; 3],
    /// Estimate of the closed form (eq. 9).
    pub closed_form: Option<[f64; 3]>,
    /// Estimate of the least squares (eq. 7).
    pub least_squares: Option<[f64; 3]>,
    /// Estimate of the midpoint, this program's own estimator.
    pub midpoint: Option<[f64; 3]>,
    /// Standard deviation of the midpoint.
    #[serde(skip)]
    pub sigma_mm: Option<[f64; 3]>,
    /// Number of points in the estimates.
    #[serde(skip)]
    pub points: usize,
    /// Reason for a missing answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// Measures all eight moves of a rendered poster.
///
/// ```
/// use trinocular::paper::moves;
/// use trinocular_vision::images::{SceneSettings, TextureKind};
///
/// let rows = moves::run(TextureKind::Natural, 1, SceneSettings::default())?;
/// assert_eq!(rows[0].true_mm, [10.0, 10.0, 0.0]);
/// let [x, _, _] = rows[0].midpoint.expect("an answer");
/// assert!((x - 10.0).abs() < moves::BOUND_MM[0]);
/// # Ok::<(), trinocular::servo::ServoError>(())
/// ```
///
/// # Errors
/// If the scene cannot be rendered or the keyframe shows nothing usable.
pub fn run(
    texture: TextureKind,
    seed: u64,
    settings: SceneSettings,
) -> Result<Vec<Row>, ServoError> {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::of_kind(texture, seed), settings)?;
    let mut flow = Flow::new(&rig, FlowSettings::default()).map_err(ServoError::Reference)?;
    flow.set_keyframe(&scene.render([0.0; 3], 0, seed))
        .map_err(ServoError::Reference)?;
    let rows = PRINTED
        .iter()
        .enumerate()
        .map(|(index, (true_mm, paper_mm))| {
            let picture = scene.render(*true_mm, 1, seed.wrapping_add(1 + index as u64));
            let row = Row {
                true_mm: *true_mm,
                paper_mm: *paper_mm,
                closed_form: None,
                least_squares: None,
                midpoint: None,
                sigma_mm: None,
                points: 0,
                refused: None,
            };
            match estimates(&rig, &mut flow, &picture) {
                Err(refusal) => Row {
                    refused: Some(refusal.to_string()),
                    ..row
                },
                Ok((sums, points)) => {
                    let estimates = sums.estimates();
                    let midpoint = estimates.midpoint.ok();
                    Row {
                        closed_form: estimates.closed_form.ok(),
                        least_squares: estimates.least_squares.ok(),
                        midpoint: midpoint.as_ref().map(|estimate| estimate.displacement_mm),
                        sigma_mm: midpoint.map(|estimate| estimate.sigma_mm()),
                        points,
                        ..row
                    }
                }
            }
        });
    Ok(rows.collect())
}

fn estimates(
    rig: &Rig,
    flow: &mut Flow,
    picture: &trinocular_vision::images::FrameSet,
) -> Result<(Sums, usize), FlowRefusal> {
    let measured = flow.measure(picture)?;
    let sums = Sums::of(rig, &measured).map_err(|_| FlowRefusal::WrongRig)?;
    Ok((sums, measured.correspondences.len()))
}
