//! `--roi` and `--mask`: the parts of the images that are used.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use crate::commands::failure::Failure;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::{Region, Regions, USED};
use trinocular_vision::images::rectangle::beyond;
use trinocular_vision::images::{Image, folder};

/// Rectangles in the images.
#[derive(Clone, Debug, Args)]
pub struct RoiOption {
    /// Rectangle in which points are chosen at the keyframe, px: left, top, width, height; of all
    /// cameras, or once per camera: left=40,30,200,150
    ///
    /// The points are followed beyond it.
    #[arg(long, value_name = "[CAMERA=]X,Y,W,H", value_parser = roi)]
    roi: Vec<(Option<String>, [u32; 4])>,
}

/// Parts of the images in which points may be.
#[derive(Clone, Debug, Args)]
pub struct RegionOption {
    #[command(flatten)]
    roi: RoiOption,

    /// Image of the cameras' size whose dark pixels (below 128 of 255) are never used; of all
    /// cameras, or once per camera: left=left-mask.png
    #[arg(long, value_name = "[CAMERA=]FILE", value_parser = mask)]
    mask: Vec<(Option<String>, PathBuf)>,
}

/// Splits the camera's name from a value. A path may have an equals sign of its own.
fn of_camera(text: &str) -> (Option<String>, &str) {
    match text.split_once('=') {
        Some((camera, value)) if !camera.contains(std::path::is_separator) => {
            (Some(camera.to_owned()), value)
        }
        _ => (None, text),
    }
}

fn roi(text: &str) -> Result<(Option<String>, [u32; 4]), String> {
    let (camera, value) = of_camera(text);
    let numbers: Result<Vec<u32>, _> = value.split(',').map(|n| n.trim().parse()).collect();
    let numbers = numbers
        .ok()
        .and_then(|numbers| <[u32; 4]>::try_from(numbers).ok());
    match numbers {
        Some([x, y, width, height]) if width > 0 && height > 0 => {
            Ok((camera, [x, y, width, height]))
        }
        _ => Err("must be X,Y,WIDTH,HEIGHT in whole px, such as 40,30,200,150".to_owned()),
    }
}

fn mask(text: &str) -> Result<(Option<String>, PathBuf), String> {
    let (camera, value) = of_camera(text);
    match value.is_empty() {
        true => Err("must be the name of an image".to_owned()),
        false => Ok((camera, PathBuf::from(value))),
    }
}

/// Returns the reason why a mask leaves nothing of the image; `None` if it leaves some of it.
fn dark(mask: &Image) -> Option<String> {
    let brightest = mask.grey.iter().copied().max().unwrap_or(0);
    (brightest < USED).then(|| {
        format!(
            "the brightest pixel of the mask is {brightest} of 255, but only pixels of {USED} and \
             more are used: write 255 where the image counts and 0 elsewhere"
        )
    })
}

/// Returns the indices of the cameras that an option is for: all, or the one that it names.
fn chosen(camera: Option<&str>, option: &str, names: &[String]) -> Result<Vec<usize>, Failure> {
    let Some(camera) = camera else {
        return Ok((0..names.len()).collect());
    };
    let index = names.iter().position(|name| name == camera);
    index.map(|index| vec![index]).ok_or_else(|| {
        let names = names.join(", ");
        Failure::Usage(format!("--{option} {camera}: the cameras are {names}"))
    })
}

impl RoiOption {
    /// Returns the rectangle of each camera: left, top, width and height, px. That of one camera
    /// replaces that of all.
    pub fn rectangles_px(&self, names: &[String]) -> Result<Vec<Option<[u32; 4]>>, Failure> {
        let mut rectangles_px = vec![None; names.len()];
        // Those of all cameras first.
        let mut rois: Vec<_> = self.roi.iter().collect();
        rois.sort_by_key(|(camera, _)| camera.is_some());
        for (camera, rectangle_px) in rois {
            for index in chosen(camera.as_deref(), "roi", names)? {
                rectangles_px[index] = Some(*rectangle_px);
            }
        }
        Ok(rectangles_px)
    }
}

impl RegionOption {
    /// Returns the regions of the rig's cameras. A region of one camera replaces that of all.
    pub fn regions(&self, rig: &RigFile) -> Result<Regions, Failure> {
        if self.roi.roi.is_empty() && self.mask.is_empty() {
            return Ok(Regions::default());
        }
        let size_px = rig.rig.image_size_px;
        let given = self.roi.roi.iter();
        if let Some(reason) = given.filter_map(|(_, it)| beyond(*it, size_px)).next() {
            return Err(Failure::Usage(reason));
        }
        let rectangles_px = self.roi.rectangles_px(&rig.names)?.into_iter();
        let mut regions: Vec<Region> = rectangles_px
            .map(|rectangle_px| Region {
                rectangle_px,
                mask: None,
            })
            .collect();
        let mut masks: Vec<_> = self.mask.iter().collect();
        masks.sort_by_key(|(camera, _)| camera.is_some());
        for (camera, path) in masks {
            let indices = chosen(camera.as_deref(), "mask", &rig.names)?;
            let image = Arc::new(folder::read(path, size_px)?);
            if let Some(reason) = dark(&image) {
                return Err(InputError::file(path, reason).into());
            }
            for index in indices {
                regions[index].mask = Some(Arc::clone(&image));
            }
        }
        Ok(Regions(regions))
    }

    /// Refuses a region without images: `is_there` tells that there are some, `with` names them.
    pub fn goes_with(&self, is_there: bool, with: &str) -> Result<(), Failure> {
        let given = [
            ("roi", self.roi.roi.is_empty()),
            ("mask", self.mask.is_empty()),
        ];
        match given
            .into_iter()
            .find(|(_, is_empty)| !is_empty && !is_there)
        {
            Some((option, _)) => Err(Failure::Usage(format!("--{option} goes with {with}"))),
            None => Ok(()),
        }
    }
}
