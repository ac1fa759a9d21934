//! The serial ports of this computer, and the one that a station is on. Opens no port, hence
//! writes to none.

use super::twin::link::is_locked;
use super::{StationError, owner};
use serialport::SerialPortType;
use std::path::{Path, PathBuf};
use trinocular_rig::printable::printable;

/// USB vendor and product of Trinocular's boards.
const USB_IDS: (u16, u16) = (0x1209, 0x0001);

/// Value in place of a path: the only port with the USB vendor and product of Trinocular's boards.
pub const AUTO: &str = "auto";

/// Value in place of a path: the station that `trinocular twin` simulates on this computer.
pub const TWIN: &str = "twin";

/// A serial port of this computer.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Candidate {
    /// Path of the port, as `--port` takes it.
    pub path: String,
    /// USB vendor and product, if it is a USB port.
    pub usb: Option<(u16, u16)>,
    /// Product name that the device reports, fit for printing.
    pub product: Option<String>,
    /// Serial number of the device, fit for printing.
    pub serial_number: Option<String>,
    /// True if vendor and product are those of Trinocular's boards.
    pub is_station: bool,
}

/// Lists the serial ports of this computer, stations first. Pseudo-terminals are not listed.
///
/// # Errors
/// [`StationError::Port`] if the system cannot list them.
pub fn candidates() -> Result<Vec<Candidate>, StationError> {
    let ports = serialport::available_ports().map_err(|cause| StationError::Port {
        path: "serial ports".to_owned(),
        reason: format!("cannot list: {cause}"),
    })?;
    let candidate = |port: serialport::SerialPortInfo| {
        let usb = match port.port_type {
            SerialPortType::UsbPort(usb) => Some(usb),
            _ => None,
        };
        let ids = usb.as_ref().map(|usb| (usb.vid, usb.pid));
        Candidate {
            path: port.port_name,
            usb: ids,
            is_station: ids == Some(USB_IDS),
            product: (usb.as_ref()).and_then(|usb| usb.product.as_ref().map(printable)),
            serial_number: usb.and_then(|usb| usb.serial_number).map(printable),
        }
    };
    let mut list: Vec<Candidate> = ports.into_iter().map(candidate).collect();
    list.sort_by(|a, b| (!a.is_station, &a.path).cmp(&(!b.is_station, &b.path)));
    Ok(list)
}

/// Returns the path that `port` means: itself, for [`AUTO`] the only station among the ports of
/// this computer, for [`TWIN`] the simulated station.
///
/// # Errors
/// [`StationError::Port`] with the ports that were found, if none or several are a station, or if
/// no station is simulated or it is unplugged.
///
/// # Example
/// ```
/// use trinocular_client::ports::resolve;
///
/// assert_eq!(resolve("/dev/ttyACM0")?, "/dev/ttyACM0");
/// # Ok::<(), trinocular_client::StationError>(())
/// ```
pub fn resolve(port: &str) -> Result<String, StationError> {
    match port {
        AUTO => only_station(&candidates()?),
        TWIN => twin(),
        path => Ok(path.to_owned()),
    }
}

/// Returns the place of the simulated station's link.
///
/// # Errors
/// If this user has no folder of its own for it.
pub fn twin_link() -> std::io::Result<PathBuf> {
    Ok(owner::folder()?.join(TWIN))
}

fn twin() -> Result<String, StationError> {
    let failed = |reason: String| StationError::Port {
        path: TWIN.to_owned(),
        reason,
    };
    let link = twin_link().map_err(|cause| failed(cause.to_string()))?;
    simulated(&link).map_err(|reason| failed(reason.to_owned()))
}

/// Returns the path of the link to a simulated station, or the reason why there is none.
fn simulated(link: &Path) -> Result<String, &'static str> {
    match (link.exists(), is_locked(link)) {
        (true, true) => Ok(link.to_string_lossy().into_owned()),
        (false, true) => Err(
            "the simulated station is unplugged: type `plug` in the terminal of `trinocular twin`",
        ),
        (_, false) => {
            Err("no station is simulated now: run `trinocular twin` in another terminal first")
        }
    }
}

fn only_station(list: &[Candidate]) -> Result<String, StationError> {
    let stations: Vec<&Candidate> = list.iter().filter(|port| port.is_station).collect();
    let reason = match stations[..] {
        [station] => return Ok(station.path.clone()),
        [] => format!(
            "no USB port of a station (1209:0001); seen: {}; plug the station in, flash it, or \
             give --port PATH",
            named(list.iter())
        ),
        _ => format!(
            "{} stations: name one of {}",
            stations.len(),
            named(stations.into_iter())
        ),
    };
    Err(StationError::Port {
        path: AUTO.to_owned(),
        reason,
    })
}

fn named<'a>(ports: impl Iterator<Item = &'a Candidate>) -> String {
    let one = |port: &Candidate| match (port.usb, &port.serial_number) {
        (Some((vendor, product)), Some(number)) => {
            format!("{} ({vendor:04x}:{product:04x}, {number})", port.path)
        }
        (Some((vendor, product)), None) => format!("{} ({vendor:04x}:{product:04x})", port.path),
        (None, _) => port.path.clone(),
    };
    let names: Vec<String> = ports.map(one).collect();
    match names.is_empty() {
        true => "no serial port at all".to_owned(),
        false => names.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(path: &str, usb: Option<(u16, u16)>) -> Candidate {
        Candidate {
            path: path.to_owned(),
            usb,
            product: None,
            serial_number: None,
            is_station: usb == Some(USB_IDS),
        }
    }

    #[test]
    #[cfg(unix)]
    fn unplugged_twin_is_told_from_absent_one() {
        use crate::twin::far_end::{Plug as _, PseudoTerminal};
        let folder = tempfile::tempdir().expect("a folder");
        let link = folder.path().join("station");
        let mut twin = PseudoTerminal::open(&link).expect("a pseudo-terminal");
        assert_eq!(simulated(&link).as_deref(), Ok(&*link.to_string_lossy()));
        twin.unplug();
        let reason = simulated(&link).expect_err("it is unplugged");
        assert!(reason.contains("`plug`"), "{reason}");
        twin.plug().expect("the name is free");
        assert!(simulated(&link).is_ok());
        drop(twin);
        let reason = simulated(&link).expect_err("it has ended");
        assert!(reason.contains("no station is simulated"), "{reason}");
    }

    #[test]
    fn only_one_station_is_taken() {
        let modem = port("/dev/ttyACM0", Some((0x0483, 0x5740)));
        let plain = port("/dev/ttyS0", None);
        let ours = |path| port(path, Some(USB_IDS));
        let list = [plain.clone(), modem.clone(), ours("/dev/ttyACM1")];
        assert_eq!(only_station(&list).unwrap(), "/dev/ttyACM1");
        let text = |list: &[Candidate]| only_station(list).unwrap_err().to_string();
        let none = text(&[plain, modem]);
        assert!(
            none.contains("/dev/ttyS0") && none.contains("/dev/ttyACM0 (0483:5740)"),
            "{none}"
        );
        let two = text(&[ours("/dev/ttyACM1"), ours("/dev/ttyACM2")]);
        assert!(
            two.contains("2 stations") && two.contains("/dev/ttyACM2"),
            "{two}"
        );
        assert!(text(&[]).contains("no serial port at all"));
    }
}
