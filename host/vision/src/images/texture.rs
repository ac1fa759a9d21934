//! Textures of posters: from dead leaves, which have the statistics of natural images, to a
//! perfectly periodic grid, on which matchers that use appearance alone fail.
//!
//! All posters repeat endlessly, without a seam, so no motion ever leaves them.

mod leaves;
mod noise;

use std::fmt;
use std::str::FromStr;

use super::Image;
use trinocular_rig::choice::unknown;
use trinocular_rig::random::Random;

/// Width and height of the drawn posters, texels.
const SIZE: usize = 2048;
/// Size of one texel of the drawn posters, mm. At 850 mm and 533 px focal length a pixel is 4
/// texels.
const MM_PER_TEXEL: f64 = 0.4;

/// Flat grey image of known size, repeated endlessly in both directions.
///
/// ```
/// use trinocular_vision::images::{Texture, TextureKind};
///
/// let kind: TextureKind = "bricks".parse()?;
/// let texture = Texture::of_kind(kind, 1);
/// assert_eq!(texture.grey.len(), texture.width * texture.height);
/// # Ok::<(), trinocular_vision::images::texture::UnknownTexture>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Number of columns, at least 1.
    pub width: usize,
    /// Number of rows, at least 1.
    pub height: usize,
    /// Edge length of a texel on the poster, mm.
    pub mm_per_texel: f64,
    /// `width * height` grey levels 0..=255, row by row.
    pub grey: Vec<f32>,
}

impl Texture {
    /// Draws the poster of a kind. Equal seeds give equal posters; [`TextureKind::Grid`] has no
    /// randomness to seed.
    pub fn of_kind(kind: TextureKind, seed: u64) -> Self {
        match kind {
            TextureKind::Natural => Self::natural(seed),
            TextureKind::Notes => Self::notes(seed),
            TextureKind::Blobs => Self::blobs(seed),
            TextureKind::Bricks => Self::bricks(seed),
            TextureKind::Grid => Self::grid(),
        }
    }

    /// Draws dead leaves: opaque shapes of all sizes on top of each other. Rich in corners at every
    /// scale.
    pub fn natural(seed: u64) -> Self {
        Self::drawn(leaves::fall(SIZE, &mut Random::new(seed, 1)))
    }

    /// Draws a plain wall with notes of dead leaves, 48 to 77 mm wide and high, on a third of it.
    pub fn notes(seed: u64) -> Self {
        /// Side of the squares that hold one note each, texels.
        const PITCH: usize = 256;
        let mut random = Random::new(seed, 4);
        let squares = SIZE / PITCH;
        let notes: Vec<[[usize; 2]; 2]> = (0..squares * squares)
            .map(|square| {
                let corner = [square % squares * PITCH, square / squares * PITCH];
                let sides = [(); 2].map(|()| 120 + random.below(73));
                let first = [0, 1].map(|i| corner[i] + random.below(PITCH - sides[i]));
                [first, [0, 1].map(|i| first[i] + sides[i])]
            })
            .collect();
        let mut poster = Self::natural(seed);
        for (i, grey) in poster.grey.iter_mut().enumerate() {
            let at = [i % SIZE, i / SIZE];
            let [first, end] = notes[at[1] / PITCH * squares + at[0] / PITCH];
            let is_in = |axis: usize| (first[axis]..end[axis]).contains(&at[axis]);
            if !(is_in(0) && is_in(1)) {
                *grey = 170.0;
            }
        }
        poster
    }

    /// Draws cloud-like noise of six octaves: texture everywhere, but no edges or corners.
    pub fn blobs(seed: u64) -> Self {
        let cells = [8, 16, 32, 64, 128, 256];
        let clouds = noise::octaves(SIZE, &cells, &mut Random::new(seed, 2));
        Self::drawn(clouds.iter().map(|c| 128.0 + 42.0 * c).collect())
    }

    /// Draws a wall of equal bricks 51.2 mm wide and 25.6 mm high: repetitive, distinguished only
    /// by slight grain.
    pub fn bricks(seed: u64) -> Self {
        let (wide, high, mortar) = (128, 64, 10);
        let grain = noise::octaves(SIZE, &[4, 8], &mut Random::new(seed, 3));
        let texel = |i: usize| {
            let (x, y) = (i % SIZE, i / SIZE);
            let shift = if y / high % 2 == 0 { 0 } else { wide / 2 };
            let in_mortar = (x + shift) % wide < mortar || y % high < mortar;
            (if in_mortar { 205.0 } else { 95.0 }) + 3.0 * grain[i]
        };
        Self::drawn((0..SIZE * SIZE).map(texel).collect())
    }

    /// Draws black lines 3.2 mm wide, 25.6 mm apart both ways, on white: every crossing equals
    /// every other.
    pub fn grid() -> Self {
        let (pitch, line) = (64, 8);
        let texel = |i: usize| {
            let on_line = i % SIZE % pitch < line || i / SIZE % pitch < line;
            if on_line { 25.0 } else { 230.0 }
        };
        Self::drawn((0..SIZE * SIZE).map(texel).collect())
    }

    /// Converts an image to a poster. It repeats with a visible seam.
    pub fn from_image(image: &Image, mm_per_texel: f64) -> Self {
        Self {
            width: image.width,
            height: image.height,
            mm_per_texel,
            grey: image.grey.iter().copied().map(f32::from).collect(),
        }
    }

    fn drawn(mut grey: Vec<f32>) -> Self {
        for level in &mut grey {
            *level = level.clamp(0.0, 255.0);
        }
        Self {
            width: SIZE,
            height: SIZE,
            mm_per_texel: MM_PER_TEXEL,
            grey,
        }
    }
}

/// Kinds of posters that the command line can name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureKind {
    /// Poster of [`Texture::natural`].
    Natural,
    /// Poster of [`Texture::notes`].
    Notes,
    /// Poster of [`Texture::blobs`].
    Blobs,
    /// Poster of [`Texture::bricks`].
    Bricks,
    /// Poster of [`Texture::grid`].
    Grid,
}

impl TextureKind {
    /// All kinds, the easiest first.
    pub const ALL: [Self; 5] = [
        Self::Natural,
        Self::Notes,
        Self::Blobs,
        Self::Bricks,
        Self::Grid,
    ];

    /// Returns the name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Natural => "natural",
            Self::Notes => "notes",
            Self::Blobs => "blobs",
            Self::Bricks => "bricks",
            Self::Grid => "grid",
        }
    }
}

impl fmt::Display for TextureKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Error of a name that no [`TextureKind`] has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", unknown("texture", .0, &TextureKind::ALL.map(TextureKind::name)))]
pub struct UnknownTexture(String);

impl FromStr for TextureKind {
    type Err = UnknownTexture;

    fn from_str(name: &str) -> Result<Self, UnknownTexture> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| UnknownTexture(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_contrast_and_no_seam() {
        for kind in TextureKind::ALL {
            let t = Texture::of_kind(kind, 5);
            assert_eq!(t.grey.len(), t.width * t.height);
            assert!(t.grey.iter().all(|g| (0.0..=255.0).contains(g)), "{kind}");
            let count = t.grey.len() as f64;
            let mean = t.grey.iter().map(|&g| f64::from(g)).sum::<f64>() / count;
            let square = |&g: &f32| (f64::from(g) - mean).powi(2);
            let sigma = (t.grey.iter().map(square).sum::<f64>() / count).sqrt();
            assert!((80.0..200.0).contains(&mean), "{kind}: mean {mean}");
            assert!((30.0..90.0).contains(&sigma), "{kind}: sigma {sigma}");
            // Across the seam the image changes no more than between other neighbouring columns.
            let change = |a: usize, b: usize| -> f32 {
                let row = |y| t.grey[y * t.width + a] - t.grey[y * t.width + b];
                (0..t.height).map(|y| f32::abs(row(y))).sum()
            };
            let most = (1..t.width).map(|x| change(x, x - 1)).fold(0.0, f32::max);
            assert!(change(0, t.width - 1) <= 1.2 * most, "{kind}");
        }
    }

    #[test]
    fn photograph_keeps_its_pixels() {
        let image = Image {
            width: 3,
            height: 2,
            grey: vec![0, 1, 2, 3, 4, 255],
        };
        let poster = Texture::from_image(&image, 1.5);
        assert_eq!((poster.width, poster.height), (3, 2));
        assert_eq!(poster.mm_per_texel, 1.5);
        assert_eq!(poster.grey, [0.0, 1.0, 2.0, 3.0, 4.0, 255.0]);
    }

    #[test]
    fn seed_determines_the_poster() {
        for kind in [TextureKind::Natural, TextureKind::Blobs] {
            assert!(Texture::of_kind(kind, 1) == Texture::of_kind(kind, 1));
            assert!(Texture::of_kind(kind, 1) != Texture::of_kind(kind, 2));
        }
    }

    #[test]
    fn names_round_trip() {
        for kind in TextureKind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        let error = "Grid".parse::<TextureKind>().unwrap_err();
        assert!(error.to_string().contains("did you mean `grid`?"));
    }
}
