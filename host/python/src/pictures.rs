//! Images of a frame set from arrays.

use crate::errors::value;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use trinocular_vision::images::Image;
use trinocular_vision::images::decode::Picture;

/// Copies a contiguous array of rows, 8 or 16 bits.
///
/// # Errors
/// `TypeError` for any other array; the Python half converts what can be converted.
pub fn picture(array: &Bound<'_, PyAny>) -> PyResult<Picture> {
    if let Ok(eight) = array.extract::<PyReadonlyArray2<'_, u8>>() {
        let [height, width] = [eight.shape()[0], eight.shape()[1]];
        let grey = eight.as_slice().map_err(value)?.to_vec();
        return Ok(Picture::Eight(Image {
            width,
            height,
            grey,
        }));
    }
    let sixteen = array.extract::<PyReadonlyArray2<'_, u16>>().map_err(|_| {
        PyTypeError::new_err("images must be contiguous arrays (rows, columns) of uint8 or uint16")
    })?;
    Ok(Picture::Sixteen {
        height: sixteen.shape()[0],
        width: sixteen.shape()[1],
        levels: sixteen.as_slice().map_err(value)?.to_vec(),
    })
}

/// Copies the images of all cameras; `None` is a camera that gave none.
///
/// # Errors
/// As [`picture`].
pub fn pictures(images: &[Option<Bound<'_, PyAny>>]) -> PyResult<Vec<Option<Picture>>> {
    let images = images.iter();
    images
        .map(|image| image.as_ref().map(picture).transpose())
        .collect()
}

/// Scales images to 8 bits by the bits in use, `so_far` or more, as the frame sets of a folder are.
/// Returns the bits for the next frame set, too.
pub fn scaled(pictures: Vec<Option<Picture>>, so_far: u32) -> (Vec<Image>, u32) {
    let bits = pictures.iter().flatten().map(Picture::bits_in_use);
    let bits = bits.fold(so_far, u32::max);
    let images = pictures.into_iter();
    let images = images.map(|picture| picture.map_or(Image::missing(), |p| p.scaled(bits)));
    (images.collect(), bits)
}
