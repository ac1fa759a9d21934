//! Pyramid of an image of a frame set.

use std::sync::OnceLock;

use pulp::{Arch, NullaryFnOnce};

use super::first_level::FirstLevel;
use super::{Halve, PADDING, Patch, Plane, smooth};
use crate::images::Image;
use crate::thread_pool::ThreadPool;

/// Number of rows of level 1 in a band.
const BAND_ROWS: usize = 32;

/// Pyramid of an image of a frame set: a copy of the image, and all levels but level 0. That is
/// smoothed in parts, where windows are read, or at its first use as a whole.
///
/// ```
/// use trinocular_vision::images::Image;
/// use trinocular_vision::matching::pyramid::{FramePyramid, Pyramid};
///
/// let image = Image { width: 64, height: 48, grey: vec![128; 64 * 48] };
/// let (frame, whole) = (FramePyramid::new(&image, 3), Pyramid::new(&image, 3));
/// assert_eq!(frame.coarse()[1].grey, whole.levels[2].grey);
/// assert_eq!(frame.fine().grey, whole.levels[0].grey);
/// ```
#[derive(Clone, Debug)]
pub struct FramePyramid {
    /// Copy of the image; missing if level 0 does not come from an image.
    image: Image,
    /// Level 0, if it was needed whole.
    fine: OnceLock<Plane>,
    /// Memory for level 0.
    spare: Plane,
    /// Levels from 1 on.
    coarse: Vec<Plane>,
}

/// Level 0 of an image: whole, or to be smoothed in parts.
#[derive(Clone, Copy, Debug)]
pub enum Finest<'a> {
    /// Whole level.
    Whole(&'a Plane),
    /// Image of which the level is made.
    Image(&'a Image),
}

impl<'a> From<&'a Plane> for Finest<'a> {
    fn from(plane: &'a Plane) -> Self {
        Self::Whole(plane)
    }
}

impl Finest<'_> {
    /// Returns the number of columns and of rows.
    pub fn size(self) -> [usize; 2] {
        match self {
            Self::Whole(plane) => [plane.width, plane.height],
            Self::Image(image) => [image.width, image.height],
        }
    }
}

/// Rows of an image, with the rows of level 1 above them.
#[derive(Debug)]
pub struct Band<'a> {
    image: &'a Image,
    /// First row of level 1.
    first: usize,
    /// Memory for the copy of the image's rows.
    copy: &'a mut [u8],
    /// Memory for the rows of level 0, if it is needed whole.
    fine: Option<&'a mut [f32]>,
    /// Memory for the rows of level 1, which come from level 0 if that is whole.
    out: &'a mut [f32],
}

impl<'a> Band<'a> {
    /// Returns the grey levels of the image's rows.
    pub fn grey(&self) -> &'a [u8] {
        &self.image.grey[2 * self.first * self.image.width..][..self.copy.len()]
    }

    /// Copies the rows and computes level 0, if it is needed whole, or else level 1.
    pub fn fill(self) {
        self.copy.copy_from_slice(self.grey());
        let Self {
            image, first, out, ..
        } = self;
        if let Some(out) = self.fine {
            let first = 2 * first;
            Arch::new().dispatch(Smooth { image, first, out });
            return;
        }
        Arch::new().dispatch(FirstLevel { image, first, out });
    }
}

/// Computation of some rows of level 0.
struct Smooth<'a> {
    image: &'a Image,
    first: usize,
    out: &'a mut [f32],
}

impl NullaryFnOnce for Smooth<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { image, first, out } = self;
        let mut sums = vec![0_u16; image.width + 4];
        for (r, row) in (first..).zip(out.chunks_exact_mut(image.width + PADDING)) {
            smooth(image, r, &mut sums, row);
        }
    }
}

/// Fills `plane` with level 0 of `image`.
fn smooth_whole(image: &Image, plane: &mut Plane, thread_pool: &ThreadPool) {
    plane.resize(image.width, image.height);
    if image.is_missing() {
        return;
    }
    let rows = 2 * BAND_ROWS;
    let (inside, _) = plane.grey.split_at_mut(plane.stride * plane.height);
    let bands = inside.chunks_mut(rows * plane.stride).enumerate().collect();
    thread_pool.map(bands, |(index, out): (usize, &mut [f32])| {
        let first = index * rows;
        Arch::new().dispatch(Smooth { image, first, out });
    });
}

impl Default for FramePyramid {
    /// Returns the pyramid of a missing image.
    fn default() -> Self {
        Self {
            image: Image::missing(),
            fine: OnceLock::new(),
            spare: Plane::default(),
            coarse: Vec::new(),
        }
    }
}

impl FramePyramid {
    /// Builds the pyramid of `image`, which must not be empty, with `levels` levels, at least two.
    pub fn new(image: &Image, levels: usize) -> Self {
        let mut pyramid = Self::default();
        let bands = pyramid.bands(image, levels, 0);
        bands.into_iter().for_each(Band::fill);
        pyramid.complete();
        pyramid
    }

    /// Begins the pyramid of another image in the memory of this one. The caller fills all bands,
    /// in any order, and then calls [`FramePyramid::complete`]. Level 0 is smoothed as a whole if
    /// the parts for this number of windows would have more pixels.
    pub fn bands<'a>(
        &'a mut self,
        image: &'a Image,
        levels: usize,
        windows: usize,
    ) -> Vec<Band<'a>> {
        if let Some(plane) = self.fine.take() {
            self.spare = plane;
        }
        let fine = if windows * Patch::PIXELS > image.width * image.height {
            let mut plane = std::mem::take(&mut self.spare);
            plane.resize(image.width, image.height);
            self.fine = OnceLock::from(plane);
            self.fine.get_mut()
        } else {
            None
        };
        let fine = fine.map(|plane| {
            let rows = 2 * BAND_ROWS * plane.stride;
            let (inside, _) = plane.grey.split_at_mut(plane.stride * plane.height);
            inside.chunks_mut(rows)
        });
        let fine = fine.into_iter().flatten().map(Some);
        let fine = fine.chain(std::iter::repeat_with(|| None));
        (self.image.width, self.image.height) = (image.width, image.height);
        self.image.grey.resize(image.grey.len(), 0);
        self.coarse.resize_with(levels.max(2) - 1, Plane::default);
        let plane = &mut self.coarse[0];
        plane.resize(image.width.div_ceil(2), image.height.div_ceil(2));
        let (inside, _) = plane.grey.split_at_mut(plane.stride * plane.height);
        let rows = inside.chunks_mut(BAND_ROWS * plane.stride);
        let copies = self.image.grey.chunks_mut(2 * BAND_ROWS * image.width);
        let bands = rows.zip(copies).zip(fine).enumerate();
        let band = |(index, ((out, copy), fine))| Band {
            image,
            first: index * BAND_ROWS,
            copy,
            fine,
            out,
        };
        bands.map(band).collect()
    }

    /// Computes the levels above the one that the bands have filled.
    pub fn complete(&mut self) {
        if let (Some(fine), Some(coarse)) = (self.fine.get_mut(), self.coarse.first_mut()) {
            let mut planes = [std::mem::take(fine), std::mem::take(coarse)];
            Arch::new().dispatch(Halve(&mut planes));
            [*fine, *coarse] = planes;
        }
        Arch::new().dispatch(Halve(&mut self.coarse));
    }

    /// Returns the levels from 1 on.
    pub fn coarse(&self) -> &[Plane] {
        &self.coarse
    }

    /// Returns the levels from 1 on, to change them.
    pub(crate) fn coarse_mut(&mut self) -> &mut [Plane] {
        &mut self.coarse
    }

    /// Returns a level above level 0. A missing image has none.
    pub fn level(&self, level: usize) -> Option<&Plane> {
        self.coarse.get(level.checked_sub(1)?)
    }

    /// Returns level 0 as far as there is any need for it: whole if it was computed, otherwise the
    /// image, so that a window costs no more than its part.
    pub fn finest(&self) -> Finest<'_> {
        match self.fine.get() {
            Some(plane) => Finest::Whole(plane),
            None => Finest::Image(&self.image),
        }
    }

    /// Returns level 0 as a whole, and computes it first if need be.
    pub fn fine(&self) -> &Plane {
        self.fine.get_or_init(|| {
            let mut plane = Plane::default();
            smooth_whole(&self.image, &mut plane, &ThreadPool::default());
            plane
        })
    }

    /// Computes level 0 as a whole, in the memory of an old one and by several threads.
    pub fn prepare_fine(&mut self, thread_pool: &ThreadPool) {
        if self.fine.get().is_none() {
            let mut plane = std::mem::take(&mut self.spare);
            smooth_whole(&self.image, &mut plane, thread_pool);
            self.fine = OnceLock::from(plane);
        }
    }

    /// Returns the pyramid of `levels` levels that begins at level 1 of this one. The pyramid of a
    /// missing image stays one.
    pub fn halved(&self, levels: usize) -> Self {
        let mut planes: Vec<Plane> = self.coarse.iter().take(levels).cloned().collect();
        if planes.is_empty() {
            return Self::default();
        }
        // Levels that this pyramid lacks.
        let known = planes.len();
        planes.resize_with(levels, Plane::default);
        Arch::new().dispatch(Halve(&mut planes[known - 1..]));
        let coarse = planes.split_off(1);
        Self {
            fine: planes.pop().map(OnceLock::from).unwrap_or_default(),
            coarse,
            ..Self::default()
        }
    }
}
