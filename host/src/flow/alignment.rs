//! A rig that explains three pictures when nobody says what it is: good enough to time the
//! matching, not to measure with.
//!
//! Pictures alone tell how far each outer image lies above or below the middle one, and the ratio
//! of the two baselines; the unit of length stays unknown. Corners of the middle image are looked
//! for in a band of rows of the others, the medians make a first rig, and the matches of that rig
//! make the second.

use shared::rig::{Camera, Rig};

use super::{Flow, Refusal, Settings, level_of};
use crate::images::Capture;
use crate::matching::corner;
use crate::matching::lucas_kanade::Large;
use crate::matching::pyramid::Pyramid;
use crate::matching::stereo::Match;
use crate::matching::zncc::{Field, OUTSIDE};
use crate::thread_pool::Workers;

/// How far outer images may lie above or below the middle one, in heights of the image.
const BAND: f64 = 0.1;
/// Corners that are looked for.
const CORNERS: usize = 150;
/// Least likeness of a place, and how much less all others must have.
const CLEAR: [f32; 2] = [0.8, 0.08];
/// The middle camera's place among the three.
const MIDDLE: usize = 1;
/// Depth the medians are given, mm: any will do.
const DEPTH_MM: f64 = 1000.0;

/// Left, middle and right camera of the capture, parallel, with a focal length of 5/3 of the
/// image's width.
///
/// # Errors
/// [`Refusal`], if the capture has not three views of one size or they have nothing in common.
pub fn align(capture: &Capture) -> Result<Rig, Refusal> {
    let (found, cameras) = (capture.views.len(), 3);
    if found != cameras {
        return Err(Refusal::WrongViews { found, cameras });
    }
    let size_px = [capture.views[MIDDLE].width, capture.views[MIDDLE].height];
    let rough = rough_shifts(capture, size_px)?;
    let first = rig(size_px, rough);
    let settings = Settings {
        view_residual_px: 4.0,
        ..Settings::default()
    };
    let mut flow = Flow::new(&first, settings)?;
    flow.set_reference(capture)?;
    if let Some(keyframe) = &flow.keyframe
        && keyframe.team.cameras.len() < cameras
    {
        let left = keyframe.team.cameras.len();
        return Err(Refusal::FewCameras { left });
    }
    let matches = flow.keyframe.iter().flat_map(|k| &k.matches);
    let matches: Vec<&Match> = matches.collect();
    let shift = |k: usize, axis: usize| {
        let shifts = matches
            .iter()
            .map(|m| m.pixels[k][axis] - m.pixels[MIDDLE][axis]);
        median(shifts.collect())
    };
    Ok(rig(size_px, [0, 2].map(|k| [shift(k, 0), shift(k, 1)])))
}

/// With outer images shifted by so much, px right and down.
fn rig(size_px: [usize; 2], [left, right]: [[f64; 2]; 2]) -> Rig {
    let focal = 5.0 / 3.0 * size_px[0] as f64;
    let centre = size_px.map(|s| (s as f64 - 1.0) / 2.0);
    let camera = |[x, y]: [f64; 2]| {
        let offset = [-x * DEPTH_MM / focal, 0.0];
        Camera::ideal([focal; 2], [centre[0], centre[1] + y], offset)
    };
    Rig {
        image_size_px: size_px.map(|s| s as u32),
        cameras: [left, [0.0; 2], right].map(camera).into_iter().collect(),
    }
}

/// Of the left and the right image, px, to about two pixels.
fn rough_shifts(capture: &Capture, size_px: [usize; 2]) -> Result<[[f64; 2]; 2], Refusal> {
    let level = level_of(size_px[0], 240).max(1);
    let scale = (1 << level) as f64;
    let rig = size_px;
    for (camera, view) in capture.views.iter().enumerate() {
        let found = [view.width, view.height];
        if found != rig || view.grey.len() != rig[0] * rig[1] || rig.contains(&0) {
            return Err(Refusal::WrongSize { camera, found, rig });
        }
    }
    let pyramids = capture.views.iter().map(|v| Pyramid::new(v, level + 1));
    let pyramids: Vec<Pyramid> = pyramids.collect();
    let fields: Vec<Field> = pyramids
        .iter()
        .map(|p| Field::new(&p.levels[level]))
        .collect();
    let base = &pyramids[MIDDLE].levels[0];
    let alone = Workers::default();
    let corners = corner::corners(base, Large::MARGIN + 1, 8.0, CORNERS, &alone);
    let band = (BAND * size_px[1] as f64 / scale).ceil() as i64;
    let mut shifts = [[0.0; 2]; 2];
    for (shift, k) in shifts.iter_mut().zip([0, 2]) {
        let found: Vec<[f64; 2]> = corners
            .iter()
            .filter_map(|corner| {
                place(
                    &fields[MIDDLE],
                    &fields[k],
                    corner.map(|c| c as f64 / scale),
                    band,
                )
            })
            .collect();
        let least = Settings::default().least_points;
        if found.len() < least {
            let (matched, corners) = (found.len(), corners.len());
            return Err(Refusal::FewMatches {
                matched,
                corners,
                least,
            });
        }
        let middle = [0, 1].map(|axis| median(found.iter().map(|f| f[axis]).collect()));
        *shift = middle.map(|m| m * scale);
    }
    Ok(shifts)
}

/// By how much what `from` shows at `at` is shifted in `to`, if there is only one such place.
fn place(from: &Field, to: &Field, at: [f64; 2], band: i64) -> Option<[f64; 2]> {
    let [x, y] = at.map(|c| c.round() as i64);
    let probe = from.probe(x, y)?;
    let width = to.size()[0];
    let rows = 2 * band + 1;
    let mut map = vec![OUTSIDE; rows as usize * width];
    for (row, out) in (0..).zip(map.chunks_mut(width)) {
        to.compare(&probe, 0, y + row - band, out);
    }
    let (best, likeness) = (map.iter().enumerate()).max_by(|a, b| a.1.total_cmp(b.1))?;
    let (column, row) = (best % width, best / width);
    let elsewhere = |i: &usize| (i % width).abs_diff(column) > 3 || (i / width).abs_diff(row) > 3;
    let second = (0..map.len())
        .filter(elsewhere)
        .map(|i| map[i])
        .fold(OUTSIDE, f32::max);
    let clear = *likeness >= CLEAR[0] && *likeness >= second + CLEAR[1];
    clear.then_some([(column as i64 - x) as f64, (row as i64 - band) as f64])
}

/// 0 of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::{Scene, SceneSettings, Texture, TextureKind};

    #[test]
    fn the_papers_rig_is_told_from_its_pictures() {
        let paper = Rig::paper();
        let texture = Texture::of_kind(TextureKind::Natural, 5);
        let scene = Scene::new(&paper, &texture, SceneSettings::default()).unwrap();
        let captures = [([0.0; 3], 1), ([5.0, 3.0, 2.0], 2)];
        let captures = captures.map(|(displaced, seed)| scene.render(displaced, 0, seed));
        let rig = align(&captures[0]).unwrap();
        // Principal points of 123.00, 111.18 and 117.76 px, at nearly equal focal lengths.
        let rows =
            [0, 1, 2].map(|k| rig.cameras[k].principal_px[1] - rig.cameras[1].principal_px[1]);
        assert!(
            (rows[0] - 11.8).abs() < 1.0 && (rows[2] - 6.6).abs() < 1.0,
            "{rows:?}"
        );
        let settings = Settings {
            view_residual_px: 2.0,
            ..Settings::default()
        };
        let mut flow = Flow::new(&rig, settings).unwrap();
        flow.set_reference(&captures[0]).unwrap();
        assert!(flow.measure(&captures[1]).unwrap().tracks.len() > 100);
    }

    #[test]
    fn pictures_with_nothing_in_common_are_refused() {
        let scene = |seed| {
            let texture = Texture::of_kind(TextureKind::Natural, seed);
            Scene::new(&Rig::paper(), &texture, SceneSettings::default()).unwrap()
        };
        let mut mixed = scene(1).render([0.0; 3], 0, 1);
        mixed.views[0] = scene(2).render([0.0; 3], 0, 1).views.remove(0);
        assert!(align(&mixed).is_err());
        mixed.views.pop();
        assert!(matches!(align(&mixed), Err(Refusal::WrongViews { .. })));
    }
}
