//! The V4L2 cameras that are there.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture;
use v4l::{Device, FourCC};

use super::refusal;

/// Folder of links to cameras, whose names hold the serial number of USB cameras.
const LINKS: &str = "/dev/v4l/by-id";

/// A camera that is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Link that stays the same in any order of plugging, or else the path.
    pub device: PathBuf,
    /// Path, such as `/dev/video0`.
    pub path: PathBuf,
    /// Name that the driver gives.
    pub model: Option<String>,
    /// Serial number of a USB camera that has one.
    pub serial: Option<String>,
    /// Formats with their sizes: `YUYV 320x240 640x480`.
    pub formats: Vec<String>,
    /// Reason why the formats cannot be read.
    pub problem: Option<String>,
}

/// Returns all V4L2 devices that capture video, by number.
pub fn list() -> Vec<Listed> {
    let links = links();
    let entries = fs::read_dir("/sys/class/video4linux");
    let names = entries.into_iter().flatten().flatten();
    let names = names.filter_map(|entry| entry.file_name().into_string().ok());
    let number = |name: &String| name.strip_prefix("video")?.parse::<u32>().ok();
    let mut numbers: Vec<u32> = names.filter_map(|name| number(&name)).collect();
    numbers.sort_unstable();
    let paths = numbers.into_iter().map(|n| format!("/dev/video{n}").into());
    paths.filter_map(|path| describe(path, &links)).collect()
}

/// Describes the device at `path`; `None` if it captures no video.
fn describe(path: PathBuf, links: &BTreeMap<PathBuf, PathBuf>) -> Option<Listed> {
    let (formats, problem) = match Device::with_path(&path) {
        Ok(device) => {
            let formats = device.enum_formats().unwrap_or_default();
            if formats.is_empty() {
                return None;
            }
            let formats = formats
                .iter()
                .map(|format| with_sizes(&device, format.fourcc));
            (formats.collect(), None)
        }
        Err(cause) => (Vec::new(), Some(refusal::cannot_open(&path, &cause).reason)),
    };
    let about = Path::new("/sys/class/video4linux").join(path.file_name()?);
    // The parent of a camera's USB interface is the USB device.
    let usb = about.join("device").canonicalize().ok();
    let usb = usb.as_deref().and_then(Path::parent);
    Some(Listed {
        device: links.get(&path).unwrap_or(&path).clone(),
        model: line(&about.join("name")),
        serial: usb.and_then(|usb| line(&usb.join("serial"))),
        path,
        formats,
        problem,
    })
}

fn with_sizes(device: &Device, fourcc: FourCC) -> String {
    let sizes = device.enum_framesizes(fourcc).unwrap_or_default();
    let sizes = sizes.into_iter().map(|size| match size.size {
        FrameSizeEnum::Discrete(size) => format!(" {}x{}", size.width, size.height),
        FrameSizeEnum::Stepwise(sizes) => format!(
            " {}x{} to {}x{}",
            sizes.min_width, sizes.min_height, sizes.max_width, sizes.max_height
        ),
    });
    fourcc.repr.escape_ascii().to_string() + &sizes.collect::<String>()
}

/// Returns the first link to each device.
fn links() -> BTreeMap<PathBuf, PathBuf> {
    let entries = fs::read_dir(LINKS).into_iter().flatten().flatten();
    let mut links: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    links.sort_unstable();
    let pairs = links.into_iter().rev();
    pairs
        .filter_map(|link| Some((link.canonicalize().ok()?, link)))
        .collect()
}

/// Returns the only line of a small file; `None` if there is none.
fn line(path: &Path) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    Some(text.trim().to_owned()).filter(|line| !line.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_devices_are_no_cameras() {
        assert_eq!(describe("/dev/null".into(), &BTreeMap::new()), None);
        let path = PathBuf::from("/dev/video-without-device");
        let missing = describe(path.clone(), &BTreeMap::new()).expect("a problem");
        assert!(missing.problem.expect("one").contains("no such camera"));
        assert_eq!((missing.device, missing.serial), (path, None));
    }
}
