//! Images in which windows are read: a smoothed plane, or an image of which parts are smoothed.

use super::super::pyramid::{Patch, Plane};
use crate::images::Image;

/// Grey levels that contain a window.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    /// Grey levels, row by row.
    pub grey: &'a [f32],
    /// Distance between rows.
    pub stride: usize,
    /// Place of the window's first pixel.
    pub start: usize,
}

/// Image in which windows are read.
pub trait WindowSource: Copy {
    /// Memory for the part of the image around a window.
    type Part: Default;

    /// Returns the number of columns and of rows.
    fn size(self) -> [usize; 2];

    /// Returns grey levels that contain `size` pixels, columns and rows, from `corner` on. Those
    /// beyond the image are finite and have no meaning.
    fn rows<'a>(self, part: &'a mut Self::Part, corner: [usize; 2], size: [usize; 2]) -> Rows<'a>
    where
        Self: 'a;
}

impl WindowSource for &Plane {
    type Part = ();

    #[inline(always)]
    fn size(self) -> [usize; 2] {
        [self.width, self.height]
    }

    #[inline(always)]
    fn rows<'a>(self, (): &'a mut (), [left, top]: [usize; 2], _: [usize; 2]) -> Rows<'a>
    where
        Self: 'a,
    {
        Rows {
            grey: &self.grey,
            stride: self.stride,
            start: top * self.stride + left,
        }
    }
}

impl WindowSource for &Image {
    type Part = Patch;

    #[inline(always)]
    fn size(self) -> [usize; 2] {
        [self.width, self.height]
    }

    #[inline(always)]
    fn rows<'a>(self, patch: &'a mut Patch, corner: [usize; 2], size: [usize; 2]) -> Rows<'a>
    where
        Self: 'a,
    {
        let start = patch.place(self, corner, size);
        Rows {
            grey: patch.grey(),
            stride: Patch::STRIDE,
            start,
        }
    }
}
