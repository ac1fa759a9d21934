//! A serial port that cannot be opened: finds the program that has it, if there is one.

use super::super::StationError;
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

/// A running program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Process number.
    pub pid: u32,
    /// Command line of the program, fit for printing.
    pub command: String,
}

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
    let other = holder(Path::new(path))?;
    if !is_this_program(&other) || !interrupt(&other) {
        return Some(OtherHost::Foreign(other));
    }
    let end = Instant::now() + LEAVING_PATIENCE;
    let mut suspended: Option<Instant> = None;
    while holder(Path::new(path)).as_ref() == Some(&other) {
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

#[cfg(target_os = "linux")]
fn is_this_program(holder: &Holder) -> bool {
    let file = |pid: &str| std::fs::read_link(format!("/proc/{pid}/exe")).ok();
    let name = |pid: &str| Some(file(pid)?.file_name()?.to_owned());
    let other = name(&holder.pid.to_string());
    other.is_some() && other == name("self")
}

#[cfg(target_os = "linux")]
fn interrupt(holder: &Holder) -> bool {
    use rustix::process::{Pid, Signal, kill_process};
    let pid = i32::try_from(holder.pid).ok().and_then(Pid::from_raw);
    pid.is_some_and(|pid| kill_process(pid, Signal::INT).is_ok())
}

/// Returns true if a signal stopped the program or a debugger holds it.
#[cfg(target_os = "linux")]
fn is_suspended(holder: &Holder) -> bool {
    let about = std::fs::read_to_string(format!("/proc/{}/stat", holder.pid));
    // The state follows the name, which stands in parentheses and may hold some itself.
    let state = about.ok().and_then(|about| {
        let (_, rest) = about.rsplit_once(')')?;
        rest.trim_start().chars().next()
    });
    matches!(state, Some('T' | 't'))
}

#[cfg(not(target_os = "linux"))]
fn is_suspended(_: &Holder) -> bool {
    false
}

#[cfg(not(target_os = "linux"))]
fn is_this_program(_: &Holder) -> bool {
    false
}

#[cfg(not(target_os = "linux"))]
fn interrupt(_: &Holder) -> bool {
    false
}

/// Returns the program that holds the lock on a port, where the system reports it.
#[cfg(target_os = "linux")]
fn holder(path: &Path) -> Option<Holder> {
    use std::os::unix::fs::MetadataExt as _;
    let file = std::fs::metadata(path).ok()?;
    let locks = std::fs::read_to_string("/proc/locks").ok()?;
    let name = name_in_locks(file.dev(), file.ino());
    program(locks.lines().find_map(|line| locker(line, &name))?)
}

#[cfg(not(target_os = "linux"))]
fn holder(_: &Path) -> Option<Holder> {
    None
}

/// Returns another program that has the port open without a lock. Only programs of the same user
/// are visible.
#[cfg(target_os = "linux")]
fn opener(path: &Path) -> Option<Holder> {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |about: std::fs::Metadata| (about.dev(), about.ino());
    let port = identity(std::fs::metadata(path).ok()?);
    let own = std::process::id();
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    let numbers = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let has_port = |pid: &u32| {
        let files = std::fs::read_dir(format!("/proc/{pid}/fd"));
        let mut files = files.into_iter().flatten().flatten();
        // Follows the link to the open file.
        files.any(|file| std::fs::metadata(file.path()).is_ok_and(|about| identity(about) == port))
    };
    let pid = numbers.filter(|pid| *pid != own).find(has_port)?;
    program(pid)
}

#[cfg(not(target_os = "linux"))]
fn opener(_: &Path) -> Option<Holder> {
    None
}

/// Returns a running program with its command line.
#[cfg(target_os = "linux")]
fn program(pid: u32) -> Option<Holder> {
    let command = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
    let command = String::from_utf8_lossy(&command);
    let command = printable(command.trim_end_matches('\0').replace('\0', " "));
    Some(Holder { pid, command })
}

/// Returns a file as `/proc/locks` names it: the device's two numbers, hexadecimal, and the file's.
#[cfg(target_os = "linux")]
fn name_in_locks(device: u64, inode: u64) -> String {
    // The layout of Linux's 64-bit device numbers.
    let major = (device >> 32 & 0xffff_f000) | (device >> 8 & 0xfff);
    let minor = (device >> 12 & 0xffff_ff00) | (device & 0xff);
    format!("{major:02x}:{minor:02x}:{inode}")
}

/// Returns the process of a line of `/proc/locks` if its lock is on this file. Such a line reads
/// `5: FLOCK  ADVISORY  WRITE 4711 00:18:12 0 EOF`.
#[cfg(target_os = "linux")]
fn locker(line: &str, name: &str) -> Option<u32> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        [_, "FLOCK", _, _, pid, file, ..] if file == name => pid.parse().ok(),
        _ => None,
    }
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

    #[test]
    fn program_with_the_file_open_is_found() {
        let name = format!("trinocular-port-{}", std::process::id());
        let path = std::env::temp_dir().join(name);
        let file = std::fs::File::create(&path).unwrap();
        assert_eq!(opener(&path), None, "this process does not count");
        let mut other = std::process::Command::new("sleep")
            .arg("60")
            .stdin(file)
            .spawn()
            .unwrap();
        let found = opener(&path);
        std::fs::remove_file(&path).unwrap();
        other.kill().unwrap();
        other.wait().unwrap();
        let found = found.expect("the other process");
        assert_eq!(
            (found.pid, found.command.as_str()),
            (other.id(), "sleep 60")
        );
    }

    #[test]
    fn lock_on_a_file_names_its_process() {
        let name = name_in_locks(0x18, 12);
        let line = "5: FLOCK  ADVISORY  WRITE 4711 00:18:12 0 EOF";
        assert_eq!(locker(line, &name), Some(4711));
        assert_eq!(locker(line, "00:19:12"), None);
        let waits = "5: -> FLOCK  ADVISORY  WRITE 4712 00:18:12 0 EOF";
        assert_eq!(locker(waits, &name), None);
        let range = "6: POSIX  ADVISORY  WRITE 4713 00:18:12 0 EOF";
        assert_eq!(locker(range, &name), None);
        assert_eq!(locker("", &name), None);
        assert_eq!(name_in_locks(0x0080_0102, 3), "01:802:3");
    }
}
