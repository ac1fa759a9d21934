//! Rectangles of pixels: left, top, width and height, px.

/// Returns true if a rectangle lies in an image of this size, columns and rows.
///
/// ```
/// use trinocular_rig::rectangle::is_within;
///
/// assert!(is_within([600, 0, 40, 480], [640, 480]));
/// assert!(!is_within([600, 0, 41, 480], [640, 480]));
/// assert!(!is_within([u32::MAX, 0, 41, 480], [640, 480]));
/// ```
pub fn is_within(rectangle_px: [u32; 4], size_px: [u32; 2]) -> bool {
    let [x, y, width, height] = rectangle_px;
    let fits =
        |at: u32, length: u32, side: u32| at.checked_add(length).is_some_and(|end| end <= side);
    fits(x, width, size_px[0]) && fits(y, height, size_px[1])
}
