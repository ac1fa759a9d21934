//! Search for two cameras whose images were exchanged, for a better message after a refusal.

use super::{Flow, FlowRefusal, FlowSettings};
use crate::images::FrameSet;
use trinocular_core::rig::Rig;

/// Returns two cameras whose images make `frame_set` a usable keyframe when they are exchanged.
///
/// Exchanged images have disparities of the wrong sign or in the wrong ratio, so that hardly any
/// corner finds its match; the refusal then blames the texture. A texture that is really too poor
/// or repeats is refused in every order. Call this only after a refusal, because it matches the
/// corners again for each pair of cameras.
pub fn exchanged_cameras(
    rig: &Rig,
    frame_set: &FrameSet,
    refusal: &FlowRefusal,
) -> Option<[usize; 2]> {
    let is_of_matching = matches!(
        refusal,
        FlowRefusal::FewMatches { .. } | FlowRefusal::AmbiguousDepth { .. }
    );
    let count = frame_set.images.len();
    if !is_of_matching || count != rig.cameras.len() {
        return None;
    }
    let flow = Flow::new(rig, FlowSettings::default()).ok()?;
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
    pairs.into_iter().find(|&[a, b]| {
        let mut exchanged = frame_set.clone();
        exchanged.images.swap(a, b);
        flow.clone().set_keyframe(&exchanged).is_ok()
    })
}

/// Returns a hint at two cameras whose images were exchanged, if `frame_set` is refused as a
/// keyframe for that reason.
pub fn hint(rig: &Rig, names: &[String], frame_set: &FrameSet) -> Option<String> {
    let mut flow = Flow::new(rig, FlowSettings::default()).ok()?;
    let refusal = flow.set_keyframe(frame_set).err()?;
    let [a, b] = exchanged_cameras(rig, frame_set, &refusal)?;
    Some(format!(
        "with the images of `{}` and `{}` exchanged it can be used, so their folders or names are \
         probably swapped: exchange them",
        names.get(a)?,
        names.get(b)?
    ))
}

/// Returns the refusal as a sentence, with the [`hint`] if there is one.
pub fn explain_keyframe(
    rig: &Rig,
    names: &[String],
    frame_set: &FrameSet,
    refusal: &FlowRefusal,
) -> String {
    match hint(rig, names, frame_set) {
        Some(hint) => format!("{refusal}; {hint}"),
        None => refusal.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::{Scene, SceneSettings, Texture};

    fn refused(texture: &Texture, pair: Option<[usize; 2]>) -> Option<[usize; 2]> {
        let rig = Rig::paper();
        let scene = Scene::new(&rig, texture, SceneSettings::default()).expect("in range");
        let mut frame_set = scene.render([0.0; 3], 0, 1);
        if let Some([a, b]) = pair {
            frame_set.images.swap(a, b);
        }
        let mut flow = Flow::new(&rig, FlowSettings::default()).expect("a rig");
        let refusal = flow.set_keyframe(&frame_set).expect_err("a refusal");
        exchanged_cameras(&rig, &frame_set, &refusal)
    }

    #[test]
    fn exchanged_pair_is_found() {
        let texture = Texture::natural(1);
        for pair in [[0, 1], [0, 2], [1, 2]] {
            assert_eq!(refused(&texture, Some(pair)), Some(pair));
        }
    }

    #[test]
    fn repeating_texture_is_no_exchange() {
        for kind in [
            crate::images::TextureKind::Bricks,
            crate::images::TextureKind::Grid,
        ] {
            assert_eq!(refused(&Texture::of_kind(kind, 1), None), None, "{kind:?}");
        }
    }
}
