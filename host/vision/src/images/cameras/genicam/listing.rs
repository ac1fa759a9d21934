//! The GenICam cameras that are there, and how one of them is found.

use std::ffi::CString;
use std::net::Ipv4Addr;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use aravis::glib::prelude::Cast as _;
use aravis::prelude::*;
use aravis::{Aravis, DeviceInfo, GvDevice};

use super::refusal;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::capture::GENICAM;

/// A camera that is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Serial number.
    pub serial: String,
    /// Maker.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// Protocol: `GigEVision` or `USB3Vision`.
    pub protocol: String,
    /// IP address, or the serial number of a USB camera.
    pub address: String,
    /// Names of its pixel formats; empty if they cannot be read.
    pub formats: Vec<String>,
    /// Reason why the formats cannot be read, such as another program that has the camera.
    pub problem: Option<String>,
}

/// The library's access to the cameras, which only one thread may use at a time.
struct Library {
    aravis: Aravis,
    /// Cameras found by the last search, which takes a second.
    found: Vec<DeviceInfo>,
}

impl Library {
    fn search(&mut self) {
        self.found = self.aravis.get_device_list();
        self.found.sort_by(|a, b| a.id.cmp(&b.id));
    }
}

fn library() -> MutexGuard<'static, Option<Library>> {
    static LIBRARY: Mutex<Option<Library>> = Mutex::new(None);
    let mut library = LIBRARY.lock().unwrap_or_else(PoisonError::into_inner);
    if library.is_none() {
        *library = Aravis::initialize().ok().map(|aravis| Library {
            aravis,
            found: Vec::new(),
        });
    }
    library
}

fn text(text: &CString) -> String {
    text.to_string_lossy().into_owned()
}

/// Returns a camera's serial number, which ends the library's name of it:
/// `VENDOR-MODEL-SERIAL`.
fn serial(info: &DeviceInfo) -> String {
    let (id, vendor, model) = (text(&info.id), text(&info.vendor), text(&info.model));
    let serial = id.strip_prefix(&format!("{vendor}-{model}-"));
    let last = || id.rsplit_once('-').map(|(_, serial)| serial);
    serial.or_else(last).unwrap_or(&id).to_owned()
}

/// Searches for cameras, and reads the pixel formats of each.
pub fn list() -> Vec<Listed> {
    let mut library = library();
    let Some(library) = library.as_mut() else {
        return Vec::new();
    };
    library.search();
    let cameras = library.found.iter().map(|info| {
        let formats = aravis::Camera::new(info.id.to_str().ok())
            .and_then(|camera| camera.dup_available_pixel_formats_as_strings());
        let problem = formats
            .as_ref()
            .err()
            .map(|cause| cause.message().to_owned());
        Listed {
            serial: serial(info),
            vendor: text(&info.vendor),
            model: text(&info.model),
            protocol: text(&info.protocol),
            address: text(&info.address),
            formats: formats.iter().flatten().map(ToString::to_string).collect(),
            problem,
        }
    });
    cameras.collect()
}

/// Opens the camera `name`: `genicam:` and its serial number, its IP address, or `first`.
///
/// # Errors
/// [`InputError`] if there is no such camera, or it is in use.
pub fn open(name: &Path) -> Result<aravis::Camera, InputError> {
    let wanted = name.to_str().and_then(|name| name.strip_prefix(GENICAM));
    let wanted = wanted.unwrap_or_default();
    let mut library = library();
    let found = match library.as_mut() {
        None => None,
        Some(library) => find(library, wanted),
    };
    let Some(id) = found else {
        let found = library.iter().flat_map(|library| &library.found);
        let serials: Vec<String> = found.map(serial).collect();
        return Err(refusal::not_found(name, &serials));
    };
    let camera = aravis::Camera::new(Some(&id));
    let camera = camera.map_err(|cause| refusal::cannot(name, "open", &cause))?;
    let device = camera.device();
    let network = device
        .as_ref()
        .and_then(|device| device.downcast_ref::<GvDevice>());
    match network.is_some_and(|device| !device.is_controller()) {
        true => Err(refusal::in_use(name)),
        false => Ok(camera),
    }
}

/// Returns the library's name of the wanted camera. It searches once more if the last search has
/// not found it. A camera behind a router is found by its address only.
fn find(library: &mut Library, wanted: &str) -> Option<String> {
    let matching = |library: &Library| {
        let is_wanted = |info: &&DeviceInfo| {
            wanted == "first" || serial(info) == wanted || text(&info.address) == wanted
        };
        library
            .found
            .iter()
            .find(is_wanted)
            .map(|info| text(&info.id))
    };
    matching(library)
        .or_else(|| {
            library.search();
            matching(library)
        })
        .or_else(|| wanted.parse::<Ipv4Addr>().ok().map(|at| at.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(id: &str, vendor: &str, model: &str) -> DeviceInfo {
        let text = |text: &str| CString::new(text).expect("no zero");
        DeviceInfo {
            id: text(id),
            physical_id: text(""),
            vendor: text(vendor),
            model: text(model),
            protocol: text("GigEVision"),
            address: text("192.168.1.5"),
        }
    }

    #[test]
    fn serial_number_ends_the_name() {
        let camera = info("Aravis-Fake-GV01", "Aravis", "Fake");
        assert_eq!(serial(&camera), "GV01");
        let camera = info(
            "The Maker-acA-1300-60gm-21-34",
            "The Maker",
            "acA-1300-60gm",
        );
        assert_eq!(serial(&camera), "21-34");
        // The library shortens the names of some makers.
        assert_eq!(serial(&info("TM-A1-777", "The Maker Inc.", "A1")), "777");
        assert_eq!(serial(&info("777", "", "")), "777");
    }
}
