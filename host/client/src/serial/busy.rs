//! A serial port that cannot be opened: its reason, and the end of the program that has it.

use super::super::StationError;
use super::super::owner;
use super::holder::{Holder, holder, interrupt, is_suspended, is_this_program, listener, opener};
use std::path::Path;
use std::time::{Duration, Instant};
#[cfg(unix)]
use trinocular_rig::printable::printable;

/// Timeout for another program to stop its stage and leave: a stop is repeated for 2 s, and a
/// stage ramps down.
const LEAVING_PATIENCE: Duration = Duration::from_secs(15);

/// Polling period while the other program leaves.
const LOOK: Duration = Duration::from_millis(10);

/// Timeout for a suspended program to go on: a shell's `fg` continues it at once.
const SUSPENDED_PATIENCE: Duration = Duration::from_secs(1);

/// Returns the error for a port that did not open.
pub(super) fn explain(path: &str, cause: &serialport::Error) -> StationError {
    let path = path.to_owned();
    // The system's "busy" and a lock of another program both come as this kind.
    if cause.kind == serialport::ErrorKind::NoDevice && Path::new(&path).exists() {
        let place = Path::new(&path);
        let holder = holder(place).or_else(|| opener(place));
        return StationError::Busy { path, holder };
    }
    let reason = format!("cannot open: {cause}; {}", way_out(&path, cause));
    StationError::Port { path, reason }
}

/// Returns the user's next action after a port did not open.
fn way_out(path: &str, cause: &serialport::Error) -> String {
    use std::io::ErrorKind::{InvalidInput, NotConnected, NotFound, PermissionDenied};
    if path.starts_with(super::port::TCP) {
        return match cause.kind {
            serialport::ErrorKind::Io(InvalidInput) => {
                "write tcp://HOST:PORT, such as tcp://192.168.1.5:4000".to_owned()
            }
            _ => "see that the other end runs (`trinocular twin --tcp`, or a serial server) and \
                  listens on this address"
                .to_owned(),
        };
    }
    let is_absent = !Path::new(path).exists();
    match cause.kind {
        serialport::ErrorKind::Io(PermissionDenied) => {
            let group = group_of(Path::new(path));
            let group = group.map_or(String::new(), |group| {
                format!("run `sudo usermod -aG {group} $USER` and log in again, or ")
            });
            format!(
                "your user may not use this port: {group}install the udev rule of \
                 firmware/README.md"
            )
        }
        serialport::ErrorKind::Io(NotFound) => absent(),
        serialport::ErrorKind::Io(NotConnected) => {
            "its pseudo-terminal may belong to another program by now; run `trinocular twin` again"
                .to_owned()
        }
        _ if is_absent => absent(),
        _ => "it may be no serial port: `trinocular ports` lists those of this computer".to_owned(),
    }
}

fn absent() -> String {
    "see that the station is plugged in and switched on; `trinocular ports` lists the ports of \
     this computer"
        .to_owned()
}

/// Returns the group that may use a device.
#[cfg(unix)]
fn group_of(path: &Path) -> Option<String> {
    use std::os::unix::fs::MetadataExt as _;
    /// Permissions of the group to read and to write.
    const GROUP_MAY_USE: u32 = 0o060;
    let about = std::fs::metadata(path).ok()?;
    if about.mode() & GROUP_MAY_USE != GROUP_MAY_USE {
        return None;
    }
    let groups = std::fs::read_to_string("/etc/group").ok()?;
    group_named(&groups, about.gid())
}

#[cfg(not(unix))]
fn group_of(_: &Path) -> Option<String> {
    None
}

/// Returns the name of a group in the text of `/etc/group`, unless it is the administrator's.
#[cfg(unix)]
fn group_named(groups: &str, number: u32) -> Option<String> {
    let names = groups.lines().find_map(|line| {
        let mut parts = line.split(':');
        let name = parts.next()?;
        (parts.nth(1)?.parse() == Ok(number)).then(|| printable(name))
    });
    names.filter(|name| name != "root")
}

/// Returns the program that has a port: by its lock, or by the socket for its guests, because a
/// port that is reached by TCP has no lock.
pub(crate) fn owner_of(path: &str) -> Option<Holder> {
    let guests = || listener(&owner::socket(path).ok()?);
    holder(Path::new(path)).or_else(guests)
}

/// Another program that had the port, and its reaction to the request to end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OtherHost {
    /// Another run of this program, which stopped its stage and left the port on request.
    Left(Holder),
    /// A suspended run of this program (Ctrl-Z, SIGSTOP or a debugger), which cannot react.
    Suspended(Holder),
    /// A run of this program that did not end on request.
    Stays(Holder),
    /// A different program, which was not asked to end.
    Foreign(Holder),
}

/// Interrupts another run of this program that has the port, as Ctrl-C does, and waits until it has
/// left the port. That run stops its stage before it ends. Returns `None` if the port is free, or
/// where the system does not report its holder.
pub fn end_other_host(path: &str) -> Option<OtherHost> {
    let other = owner_of(path)?;
    if !is_this_program(&other) || !interrupt(&other) {
        return Some(OtherHost::Foreign(other));
    }
    let end = Instant::now() + LEAVING_PATIENCE;
    let mut suspended: Option<Instant> = None;
    while owner_of(path).as_ref() == Some(&other) {
        let now = Instant::now();
        if now >= end {
            return Some(OtherHost::Stays(other));
        }
        suspended = is_suspended(&other).then(|| suspended.unwrap_or(now));
        if suspended.is_some_and(|since| now.duration_since(since) >= SUSPENDED_PATIENCE) {
            return Some(OtherHost::Suspended(other));
        }
        std::thread::sleep(LOOK);
    }
    Some(OtherHost::Left(other))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    fn reason(path: &str, kind: serialport::ErrorKind) -> String {
        explain(path, &serialport::Error::new(kind, "no")).to_string()
    }

    #[test]
    fn port_that_does_not_open_names_way_out() {
        use std::io::ErrorKind::PermissionDenied;
        let absent = reason("/dev/no-such-port", serialport::ErrorKind::NoDevice);
        assert!(absent.contains("`trinocular ports`"), "{absent}");
        let denied = serialport::ErrorKind::Io(PermissionDenied);
        let forbidden = reason("/dev/null", denied);
        assert!(forbidden.contains("udev rule"), "{forbidden}");
        let other = reason("/dev/null", serialport::ErrorKind::Unknown);
        assert!(other.contains("no serial port"), "{other}");
    }

    #[test]
    fn group_of_a_device_is_named() {
        let groups = "root:x:0:\ntty:x:5:\ndialout:x:20:ann,bo\n";
        assert_eq!(group_named(groups, 20).as_deref(), Some("dialout"));
        assert_eq!(group_named(groups, 0), None);
        assert_eq!(group_named(groups, 7), None);
        assert_eq!(group_named("", 7), None);
    }
}
