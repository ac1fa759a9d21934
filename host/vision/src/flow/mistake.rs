//! Mistakes with whole images that explain the refusal of a keyframe, for a better message.
//!
//! Exchanged, turned and mirrored images have disparities of the wrong sign or size, so that hardly
//! any corner finds its match; the refusal then blames the texture. A texture that is really too
//! poor or repeats is refused in every order and direction, and explained by no mistake.

use super::{Flow, FlowRefusal, FlowSettings};
use crate::images::{FrameSet, Image};
use trinocular_core::rig::Rig;

/// Mistake with the images of a frame set. Numbers are those of the cameras in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mistake {
    /// Two cameras have the same image.
    SameImage([usize; 2]),
    /// The images of two cameras were exchanged.
    Exchanged([usize; 2]),
    /// The image of this camera is upside down, or those of all cameras.
    UpsideDown(Option<usize>),
    /// The image of this camera is mirrored left to right, or those of all cameras.
    Mirrored(Option<usize>),
    /// The image of this camera is mirrored top to bottom, or those of all cameras.
    Flipped(Option<usize>),
}

impl Mistake {
    /// Returns the mistakes without any one of which `frame_set` would be a usable keyframe: the
    /// simplest, and others that look the same. Call this only after a refusal, because it matches
    /// the corners again for each possible mistake.
    ///
    /// In a rig in line whose principal points have equal rows, images that are all turned by 180
    /// degrees or all mirrored have the disparities of exchanged outer cameras.
    pub fn find(rig: &Rig, frame_set: &FrameSet, refusal: &FlowRefusal) -> Vec<Self> {
        let is_of_matching = matches!(
            refusal,
            FlowRefusal::FewMatches { .. } | FlowRefusal::AmbiguousDepth { .. }
        );
        let count = frame_set.images.len();
        if !is_of_matching || count != rig.cameras.len() {
            return Vec::new();
        }
        if let Some(pair) = same_image(frame_set) {
            return vec![Self::SameImage(pair)];
        }
        let Ok(flow) = Flow::new(rig, FlowSettings::default()) else {
            return Vec::new();
        };
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| Self::Exchanged([a, b])));
        let whole = || [None].into_iter().chain((0..count).map(Some));
        let mut mistakes = pairs
            .chain(whole().map(Self::UpsideDown))
            .chain(whole().map(Self::Mirrored))
            .chain(whole().map(Self::Flipped));
        let explains = |mistake: &Self| {
            let mut flow = flow.clone();
            flow.set_keyframe(&mistake.undone(frame_set)).is_ok()
        };
        let Some(first) = mistakes.find(explains) else {
            return Vec::new();
        };
        let alike = [Self::UpsideDown(None), Self::Mirrored(None)];
        let is_alike = matches!(first, Self::Exchanged(_)) || alike.contains(&first);
        let others = alike
            .into_iter()
            .filter(|other| is_alike && *other != first && explains(other));
        std::iter::once(first).chain(others).collect()
    }

    /// Returns the frame set as it would be without the mistake.
    fn undone(self, frame_set: &FrameSet) -> FrameSet {
        let mut undone = frame_set.clone();
        let mut change = |camera: Option<usize>, turn: fn(&mut Image)| {
            let images = undone.images.iter_mut().enumerate();
            let chosen = images.filter(|(k, _)| camera.is_none_or(|only| only == *k));
            chosen.for_each(|(_, image)| turn(image));
        };
        match self {
            Self::SameImage(_) => {}
            Self::Exchanged([a, b]) => undone.images.swap(a, b),
            Self::UpsideDown(camera) => change(camera, |image| image.grey.reverse()),
            Self::Mirrored(camera) => change(camera, mirror),
            Self::Flipped(camera) => change(camera, |image| {
                image.grey.reverse();
                mirror(image);
            }),
        }
        undone
    }

    /// Returns the mistake as a sentence with the way out. `names` are those of the cameras.
    pub fn explain(self, names: &[String]) -> String {
        let name = |k: usize| names.get(k).map_or("?", String::as_str);
        let whose = |camera: Option<usize>| match camera {
            Some(k) => format!("the image of `{}`", name(k)),
            None => "all images".to_owned(),
        };
        match self {
            Self::SameImage([a, b]) => format!(
                "`{}` and `{}` have the same image, so one camera's images are there twice: give \
                 each camera its own",
                name(a),
                name(b)
            ),
            Self::Exchanged([a, b]) => format!(
                "with the images of `{}` and `{}` exchanged it can be used, so their folders or \
                 names are probably swapped: exchange them",
                name(a),
                name(b)
            ),
            Self::UpsideDown(camera) => format!(
                "with {} turned upside down it can be used: turn the camera or its images by 180 \
                 degrees",
                whose(camera)
            ),
            Self::Mirrored(camera) => format!(
                "with {} mirrored left to right it can be used: switch off the mirroring of the \
                 camera, or mirror its images",
                whose(camera)
            ),
            Self::Flipped(camera) => format!(
                "with {} mirrored top to bottom it can be used: switch off the flipping of the \
                 camera, or flip its images",
                whose(camera)
            ),
        }
    }
}

fn mirror(image: &mut Image) {
    let rows = image.grey.chunks_mut(image.width.max(1));
    rows.for_each(<[u8]>::reverse);
}

/// Returns two cameras that have the same image, pixel by pixel. The noise of two sensors differs,
/// so such images are one camera's. Images of one grey level, as in the dark, do not count.
pub fn same_image(frame_set: &FrameSet) -> Option<[usize; 2]> {
    let images = &frame_set.images;
    let is_plain = |image: &Image| {
        image
            .grey
            .iter()
            .all(|grey| Some(grey) == image.grey.first())
    };
    let mut pairs = (0..images.len()).flat_map(|a| (a + 1..images.len()).map(move |b| [a, b]));
    pairs.find(|&[a, b]| images[a].grey == images[b].grey && !is_plain(&images[a]))
}

/// Returns the mistakes that explain why `frame_set` is refused as a keyframe, in words.
pub fn hint(rig: &Rig, names: &[String], frame_set: &FrameSet) -> Option<String> {
    let mut flow = Flow::new(rig, FlowSettings::default()).ok()?;
    let refusal = flow.set_keyframe(frame_set).err()?;
    explained(rig, names, frame_set, &refusal)
}

fn explained(
    rig: &Rig,
    names: &[String],
    frame_set: &FrameSet,
    refusal: &FlowRefusal,
) -> Option<String> {
    let mistakes = Mistake::find(rig, frame_set, refusal);
    let sentences = mistakes.into_iter().map(|mistake| mistake.explain(names));
    sentences.reduce(|first, other| format!("{first}; or {other}"))
}

/// Returns the refusal as a sentence, with the [`hint`] if there is one.
pub fn explain_keyframe(
    rig: &Rig,
    names: &[String],
    frame_set: &FrameSet,
    refusal: &FlowRefusal,
) -> String {
    match explained(rig, names, frame_set, refusal) {
        Some(hint) => format!("{refusal}; {hint}"),
        None => refusal.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::{Scene, SceneSettings, Texture, TextureKind};
    use trinocular_core::rig::Camera;

    /// Makes the mistake with rendered images and returns the explanation of the refusal.
    fn found(texture: &Texture, made: Option<Mistake>) -> Option<Mistake> {
        found_with(&Rig::paper(), texture, made).first().copied()
    }

    fn found_with(rig: &Rig, texture: &Texture, made: Option<Mistake>) -> Vec<Mistake> {
        let scene = Scene::new(rig, texture, SceneSettings::default()).expect("in range");
        let mut frame_set = scene.render([0.0; 3], 0, 1);
        if let Some(Mistake::SameImage([a, b])) = made {
            frame_set.images[b] = frame_set.images[a].clone();
        }
        // Each of the others undoes itself.
        let frame_set = made.map_or(frame_set.clone(), |mistake| mistake.undone(&frame_set));
        let mut flow = Flow::new(rig, FlowSettings::default()).expect("a rig");
        let refusal = flow.set_keyframe(&frame_set).expect_err("a refusal");
        Mistake::find(rig, &frame_set, &refusal)
    }

    #[test]
    fn exchanged_pair_is_found() {
        let texture = Texture::natural(1);
        for pair in [[0, 1], [0, 2], [1, 2]] {
            let made = Some(Mistake::Exchanged(pair));
            assert_eq!(found(&texture, made), made);
        }
    }

    #[test]
    fn turned_and_mirrored_images_are_found() {
        let texture = Texture::natural(1);
        let kinds = [Mistake::UpsideDown, Mistake::Mirrored, Mistake::Flipped];
        for kind in kinds {
            for camera in [None, Some(0), Some(1), Some(2)] {
                let made = Some(kind(camera));
                assert_eq!(found(&texture, made), made);
            }
        }
    }

    #[test]
    fn same_image_twice_is_found() {
        let texture = Texture::natural(1);
        for pair in [[0, 1], [0, 2], [1, 2]] {
            let made = Some(Mistake::SameImage(pair));
            assert_eq!(found(&texture, made), made);
        }
    }

    #[test]
    fn repeating_texture_is_no_mistake() {
        for kind in [TextureKind::Bricks, TextureKind::Grid] {
            assert_eq!(found(&Texture::of_kind(kind, 1), None), None, "{kind:?}");
        }
    }

    #[test]
    fn dark_images_are_not_the_same_camera() {
        let dark = Image {
            width: 2,
            height: 1,
            grey: vec![7; 2],
        };
        let images = vec![dark.clone(), dark];
        assert_eq!(same_image(&FrameSet { time_us: 0, images }), None);
    }

    #[test]
    fn explanation_names_cameras_and_way_out() {
        let names = ["left", "right"].map(String::from);
        for (mistake, parts) in [
            (
                Mistake::SameImage([0, 1]),
                ["`left` and `right`", "its own"],
            ),
            (
                Mistake::Exchanged([0, 1]),
                ["`left` and `right`", "exchange them"],
            ),
            (Mistake::UpsideDown(Some(1)), ["of `right`", "180 degrees"]),
            (Mistake::UpsideDown(None), ["all images", "180 degrees"]),
            (Mistake::Mirrored(Some(0)), ["of `left`", "switch off"]),
            (Mistake::Flipped(None), ["all images", "switch off"]),
        ] {
            let said = mistake.explain(&names);
            assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        }
    }

    /// In a rig like those that `trinocular init` writes, exchanged outer cameras, images that are
    /// all upside down, and images that are all mirrored have the same disparities.
    #[test]
    fn mistakes_that_look_alike_are_all_named() {
        let mut rig = Rig::paper();
        for (camera, x_mm) in rig.cameras.iter_mut().zip([-70.0, 0.0, 70.0]) {
            *camera = Camera::ideal([530.0, 530.0], [159.5, 119.5], [x_mm, 0.0]);
        }
        let texture = Texture::natural(1);
        let alike = [
            Mistake::Exchanged([0, 2]),
            Mistake::UpsideDown(None),
            Mistake::Mirrored(None),
        ];
        for made in alike {
            let found = found_with(&rig, &texture, Some(made));
            assert_eq!(found, alike, "{made:?}");
        }
    }
}
