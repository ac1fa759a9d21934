//! A serial port that cannot be opened: finds the program that has it, if there is one.

use super::super::StationError;
use std::path::Path;
use std::time::{Duration, Instant};
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
        let holder = holder(Path::new(&path));
        return StationError::Busy { path, holder };
    }
    StationError::Port {
        path,
        reason: format!("cannot open: {cause}"),
    }
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
    let pid = locks.lines().find_map(|line| locker(line, &name))?;
    let command = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
    let command = String::from_utf8_lossy(&command);
    let command = printable(command.trim_end_matches('\0').replace('\0', " "));
    Some(Holder { pid, command })
}

#[cfg(not(target_os = "linux"))]
fn holder(_: &Path) -> Option<Holder> {
    None
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
