//! Rectangles of pixels: left, top, width and height, px.

use super::Image;
use trinocular_rig::rectangle::is_within;

/// Returns the reason why a rectangle does not lie in an image of this size; `None` if it does.
///
/// ```
/// use trinocular_vision::images::rectangle::beyond;
///
/// assert_eq!(beyond([600, 0, 40, 480], [640, 480]), None);
/// assert!(beyond([600, 0, 41, 480], [640, 480]).is_some());
/// assert!(beyond([u32::MAX, 0, 41, 480], [640, 480]).is_some());
/// ```
pub fn beyond(rectangle_px: [u32; 4], size_px: [u32; 2]) -> Option<String> {
    let [x, y, w, h] = rectangle_px;
    let [width, height] = size_px;
    (!is_within(rectangle_px, size_px))
        .then(|| format!("--roi {x},{y},{w},{h} reaches beyond the image of {width} x {height} px"))
}

impl Image {
    /// Returns the part of the image in a rectangle: left, top, width and height, px. What lies
    /// beyond the image is left out.
    ///
    /// ```
    /// use trinocular_vision::images::Image;
    ///
    /// let image = Image { width: 3, height: 2, grey: vec![1, 2, 3, 4, 5, 6] };
    /// assert_eq!(image.part([1, 0, 2, 2]).grey, [2, 3, 5, 6]);
    /// assert_eq!(image.part([2, 1, 9, 9]).grey, [6]);
    /// ```
    pub fn part(&self, rectangle_px: [u32; 4]) -> Self {
        let [x, y, w, h] = rectangle_px.map(|px| px as usize);
        let (left, top) = (x.min(self.width), y.min(self.height));
        let right = left.saturating_add(w).min(self.width);
        let bottom = top.saturating_add(h).min(self.height);
        let rows = self.grey.chunks_exact(self.width.max(1));
        let rows = rows.skip(top).take(bottom - top);
        Self {
            width: right - left,
            height: bottom - top,
            grey: rows.flat_map(|row| &row[left..right]).copied().collect(),
        }
    }
}
