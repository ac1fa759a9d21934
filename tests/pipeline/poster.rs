//! Misleading posters: exact repetition in several forms, faint texture, and few marks that
//! distinguish places.

use trinocular_rig::random::Random;
use trinocular_vision::images::Texture;

/// Size of a texel, mm; a pixel of the paper's rig at 850 mm is four texels.
const MM_PER_TEXEL: f64 = 0.4;

/// One period of a repeating poster.
#[derive(Clone, Copy, Debug)]
pub enum Motif {
    /// Two dark squares on the diagonal.
    Checks,
    /// A dark disc a quarter of the period wide, which leaves no edge straight.
    Dots,
    /// Dark lines along both axes, an eighth of the period wide.
    Lines,
    /// Vertical stripes, without any texture along y.
    Stripes,
    /// Random grey blots: rich in texture, but all periods are equal.
    Wallpaper,
}

impl Motif {
    pub const ALL: [Self; 5] = [
        Self::Checks,
        Self::Dots,
        Self::Lines,
        Self::Stripes,
        Self::Wallpaper,
    ];

    /// Returns the brightness, 0 to 1, at a position in the period, 0 to 1 on both axes.
    fn level(self, [u, v]: [f64; 2], blots: Option<&Texture>) -> f64 {
        let dark = match self {
            Self::Checks => (u < 0.5) == (v < 0.5),
            Self::Dots => (u - 0.5).hypot(v - 0.5) < 0.25,
            Self::Lines => u < 0.125 || v < 0.125,
            Self::Stripes => u < 0.5,
            Self::Wallpaper => {
                let Some(blots) = blots else { return 0.5 };
                let texel = |c: f64| (c * blots.width as f64) as usize;
                return f64::from(blots.grey[texel(v) * blots.width + texel(u)]) / 255.0;
            }
        };
        if dark { 0.0 } else { 1.0 }
    }
}

/// Returns an endless poster of `motif` with the given period: grey 128 plus and minus half of
/// `contrast`.
pub fn repeating(motif: Motif, period_mm: f64, contrast: f64, seed: u64) -> Texture {
    // One period is the whole texture, which repeats by itself, so the repetition is exact.
    let side = (period_mm / MM_PER_TEXEL).round() as usize;
    let blots = matches!(motif, Motif::Wallpaper).then(|| corner_of(&Texture::natural(seed), side));
    let texel = |i: usize| {
        let place = [i % side, i / side].map(|c| (c as f64 + 0.5) / side as f64);
        (128.0 + contrast * (motif.level(place, blots.as_ref()) - 0.5)) as f32
    };
    Texture {
        width: side,
        height: side,
        mm_per_texel: MM_PER_TEXEL,
        grey: (0..side * side).map(texel).collect(),
    }
}

/// Returns the upper left part of a poster.
fn corner_of(texture: &Texture, side: usize) -> Texture {
    let texel = |i: usize| texture.grey[i / side * texture.width + i % side];
    Texture {
        width: side,
        height: side,
        mm_per_texel: texture.mm_per_texel,
        grey: (0..side * side).map(texel).collect(),
    }
}

/// Returns the same poster over an area of about 820 mm, with `count` small black or white squares
/// of `size_mm` at random positions.
pub fn with_marks(repeating: &Texture, count: usize, size_mm: f64, seed: u64) -> Texture {
    let periods = (2048 / repeating.width).max(1);
    let side = periods * repeating.width;
    let mut grey: Vec<f32> = (0..side * side)
        .map(|i| {
            let (x, y) = (i % side % repeating.width, i / side % repeating.height);
            repeating.grey[y * repeating.width + x]
        })
        .collect();
    let mut random = Random::seeded(seed);
    let size = (size_mm / repeating.mm_per_texel).round() as usize;
    for _ in 0..count {
        let [x, y] = [0; 2].map(|_| random.below(side - size));
        let level = if random.next_u64().is_multiple_of(2) {
            0.0
        } else {
            255.0
        };
        for row in y..y + size {
            grey[row * side + x..row * side + x + size].fill(level);
        }
    }
    Texture {
        width: side,
        height: side,
        mm_per_texel: repeating.mm_per_texel,
        grey,
    }
}

/// Returns the poster with its contrast scaled about mid grey.
pub fn fainter(mut texture: Texture, contrast: f32) -> Texture {
    for level in &mut texture.grey {
        *level = 128.0 + contrast * (*level - 128.0);
    }
    texture
}
