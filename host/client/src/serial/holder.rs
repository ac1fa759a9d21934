//! Programs that have a port, as the system reports them: by a lock, an open file or a socket.

use std::path::Path;
#[cfg(target_os = "linux")]
use std::path::PathBuf;
#[cfg(target_os = "linux")]
use trinocular_rig::printable::printable;

/// A running program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Process number.
    pub pid: u32,
    /// Command line of the program, fit for printing.
    pub command: String,
}

#[cfg(target_os = "linux")]
pub(super) fn is_this_program(holder: &Holder) -> bool {
    let file = |pid: &str| std::fs::read_link(format!("/proc/{pid}/exe")).ok();
    let name = |pid: &str| Some(file(pid)?.file_name()?.to_owned());
    let other = name(&holder.pid.to_string());
    other.is_some() && other == name("self")
}

#[cfg(target_os = "linux")]
pub(super) fn interrupt(holder: &Holder) -> bool {
    use rustix::process::{Pid, Signal, kill_process};
    let pid = i32::try_from(holder.pid).ok().and_then(Pid::from_raw);
    pid.is_some_and(|pid| kill_process(pid, Signal::INT).is_ok())
}

/// Returns true if a signal stopped the program or a debugger holds it.
#[cfg(target_os = "linux")]
pub(super) fn is_suspended(holder: &Holder) -> bool {
    let about = std::fs::read_to_string(format!("/proc/{}/stat", holder.pid));
    // The state follows the name, which stands in parentheses and may hold some itself.
    let state = about.ok().and_then(|about| {
        let (_, rest) = about.rsplit_once(')')?;
        rest.trim_start().chars().next()
    });
    matches!(state, Some('T' | 't'))
}

#[cfg(not(target_os = "linux"))]
pub(super) fn is_suspended(_: &Holder) -> bool {
    false
}

#[cfg(not(target_os = "linux"))]
pub(super) fn is_this_program(_: &Holder) -> bool {
    false
}

#[cfg(not(target_os = "linux"))]
pub(super) fn interrupt(_: &Holder) -> bool {
    false
}

/// Returns the program that holds the lock on a port, where the system reports it.
#[cfg(target_os = "linux")]
pub(super) fn holder(path: &Path) -> Option<Holder> {
    use std::os::unix::fs::MetadataExt as _;
    let file = std::fs::metadata(path).ok()?;
    let locks = std::fs::read_to_string("/proc/locks").ok()?;
    let name = name_in_locks(file.dev(), file.ino());
    program(locks.lines().find_map(|line| locker(line, &name))?)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn holder(_: &Path) -> Option<Holder> {
    None
}

/// Returns another program that has the port open without a lock. Only programs of the same user
/// are visible.
#[cfg(target_os = "linux")]
pub(super) fn opener(path: &Path) -> Option<Holder> {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |about: std::fs::Metadata| (about.dev(), about.ino());
    let port = identity(std::fs::metadata(path).ok()?);
    let own = std::process::id();
    // Follows the link to the open file.
    let has_port = |link: &Path| std::fs::metadata(link).is_ok_and(|file| identity(file) == port);
    let pid = processes().find(|pid| *pid != own && has_open(*pid, has_port))?;
    program(pid)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn opener(_: &Path) -> Option<Holder> {
    None
}

/// Returns the program that listens at the socket `path`, which has opened it for its guests. Only
/// programs of the same user are visible.
#[cfg(target_os = "linux")]
pub(super) fn listener(path: &Path) -> Option<Holder> {
    let sockets = std::fs::read_to_string("/proc/net/unix").ok()?;
    let number = sockets.lines().find_map(|line| listening(line, path))?;
    let socket = PathBuf::from(format!("socket:[{number}]"));
    let has_socket = |link: &Path| std::fs::read_link(link).is_ok_and(|target| target == socket);
    program(processes().find(|pid| has_open(*pid, has_socket))?)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn listener(_: &Path) -> Option<Holder> {
    None
}

/// Returns the number of the socket of a line of `/proc/net/unix` if it listens at `path`. Such a
/// line reads `ffff8881: 00000002 00000000 00010000 0001 01 4711 /run/user/1000/trinocular/port`.
#[cfg(target_os = "linux")]
fn listening<'a>(line: &'a str, path: &Path) -> Option<&'a str> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        [_, _, _, "00010000", _, _, number, place] if Path::new(place) == path => Some(number),
        _ => None,
    }
}

/// Returns the numbers of all processes.
#[cfg(target_os = "linux")]
fn processes() -> impl Iterator<Item = u32> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}

/// Returns true if the process has an open file whose link in `/proc` is `wanted`.
#[cfg(target_os = "linux")]
fn has_open(pid: u32, wanted: impl Fn(&Path) -> bool) -> bool {
    let files = std::fs::read_dir(format!("/proc/{pid}/fd"));
    let mut files = files.into_iter().flatten().flatten();
    files.any(|file| wanted(&file.path()))
}

/// Returns a running program with its command line, which one that has just ended no longer has.
#[cfg(target_os = "linux")]
fn program(pid: u32) -> Option<Holder> {
    let command = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
    if command.is_empty() {
        return None;
    }
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

    #[test]
    fn only_listener_at_the_place_is_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("port");
        assert_eq!(listener(&path), None);
        let socket = std::os::unix::net::UnixListener::bind(&path).expect("a socket");
        let found = listener(&path).expect("this process");
        assert_eq!(found.pid, std::process::id());
        drop(socket);
        assert_eq!(listener(&path), None);
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
