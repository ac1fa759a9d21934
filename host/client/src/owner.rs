//! Sharing of a station: the program that has the port lets others reach it.
//!
//! The owner of a port listens on a local socket that belongs to this port. A guest connects,
//! introduces itself in one line, and is let in or refused in one line:
//!
//! ```text
//! guest: trinocular 1 stop 4711 trinocular stop --port /dev/ttyACM0
//! owner: welcome 4700 trinocular track --sim --port /dev/ttyACM0
//! ```
//!
//! From then on the socket carries the same packets as the serial line. The owner passes on what
//! the guest's [`Purpose`] allows (`serial::sharing`). So a guest is a connection as any other, and
//! there is still only one program that writes to the station.
//!
//! The socket lies in a folder of the user's own with mode 0700, and is named after the port's real
//! path. One that is left over from a crash refuses connections; it is replaced by the next owner.
//! An owner that is suspended accepts a connection, because the system does that, and says nothing:
//! then the port has an owner, and no second program opens it.
//! Where there are no such sockets, the owner listens on the loopback address and writes its port
//! number and a token to a file in the user's own folder.

#[cfg_attr(unix, path = "owner/unix.rs")]
#[cfg_attr(not(unix), path = "owner/loopback.rs")]
mod system;

pub(crate) use system::{Listener, Stream};

use crate::serial::{Holder, TCP, owner_of};
use std::io::{self, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use trinocular_rig::printable::printable;

/// Version of the introduction.
const VERSION: &str = "1";

/// Longest introduction or reply, bytes.
const LONGEST_LINE: usize = 1024;

/// Timeout for the introduction of a guest.
const GUEST_PATIENCE: Duration = Duration::from_millis(500);

/// Timeout for an owner's reply, which comes within a few ms.
const OWNER_PATIENCE: Duration = Duration::from_secs(1);

/// Polling period of a line that is not complete.
const LOOK: Duration = Duration::from_millis(1);

/// Purpose of a guest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// To stop the stage. Every owner allows it.
    Stop,
    /// To read the station's reports. Every owner allows it.
    Watch,
    /// To send commands. An owner that uses the station itself refuses it.
    Drive,
}

impl Purpose {
    const ALL: [(Self, &str); 3] = [
        (Self::Stop, "stop"),
        (Self::Watch, "watch"),
        (Self::Drive, "drive"),
    ];

    fn word(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(purpose, _)| *purpose == self)
            .map_or("", |(_, word)| word)
    }
}

/// Guest that has introduced itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Guest {
    pub purpose: Purpose,
    pub holder: Holder,
}

/// Answer of an owner to a guest.
#[derive(Debug)]
pub(crate) enum Reception {
    /// The guest may use the socket to this owner.
    Welcome(Stream, Holder),
    /// The owner refuses this purpose at present.
    Refused(Holder),
    /// The owner has the port and does not answer. It is named where the system reports it.
    Silent(Option<Holder>),
}

/// Asks the owner of `port` to let this program in. Returns `None` if the port has no owner, or one
/// that is about to leave.
pub(crate) fn connect_to_owner(port: &str, purpose: Purpose) -> Option<Reception> {
    match ask_owner(&socket(port).ok()?, purpose) {
        Ok(reception) => reception,
        Err(Silence) => Some(Reception::Silent(owner_of(port))),
    }
}

/// Silence of an owner for [`OWNER_PATIENCE`].
struct Silence;

fn ask_owner(socket: &Path, purpose: Purpose) -> Result<Option<Reception>, Silence> {
    let Ok(mut stream) = system::connect(socket) else {
        return Ok(None);
    };
    match introduce(&mut stream, purpose) {
        Ok(reply) => Ok(reception(&reply, stream)),
        Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => Err(Silence),
        Err(_) => Ok(None),
    }
}

/// Introduces this program; returns the owner's reply.
fn introduce(stream: &mut Stream, purpose: Purpose) -> io::Result<String> {
    stream.set_nonblocking(true)?;
    let this = this_program();
    let line = format!(
        "trinocular {VERSION} {} {} {}",
        purpose.word(),
        this.pid,
        this.command
    );
    write_line(stream, &line)?;
    read_line(stream, OWNER_PATIENCE)
}

fn reception(reply: &str, stream: Stream) -> Option<Reception> {
    let mut words = reply.splitn(3, ' ');
    let (verdict, pid, command) = (words.next()?, words.next()?, words.next()?);
    let holder = Holder {
        pid: pid.parse().ok()?,
        command: printable(command),
    };
    match verdict {
        "welcome" => Some(Reception::Welcome(stream, holder)),
        "refused" => Some(Reception::Refused(holder)),
        _ => None,
    }
}

/// Reads the introduction of a guest of `listener`.
pub(crate) fn introduction(listener: &Listener, stream: &mut Stream) -> io::Result<Guest> {
    listener.check(stream)?;
    stream.set_nonblocking(true)?;
    let line = read_line(stream, GUEST_PATIENCE)?;
    let mut words = line.splitn(5, ' ');
    let strange = || io::Error::new(io::ErrorKind::InvalidData, "no introduction");
    if words.next() != Some("trinocular") || words.next() != Some(VERSION) {
        return Err(strange());
    }
    let word = words.next().ok_or_else(strange)?;
    let purpose = Purpose::ALL.iter().find(|(_, name)| *name == word);
    let (purpose, _) = purpose.ok_or_else(strange)?;
    let pid = words.next().and_then(|pid| pid.parse().ok());
    Ok(Guest {
        purpose: *purpose,
        holder: Holder {
            pid: pid.ok_or_else(strange)?,
            command: printable(words.next().unwrap_or_default()),
        },
    })
}

/// Lets a guest in.
pub(crate) fn welcome(stream: &mut Stream) -> io::Result<()> {
    let this = this_program();
    write_line(stream, &format!("welcome {} {}", this.pid, this.command))
}

/// Refuses a guest because of `holder`, who uses the station.
pub(crate) fn refuse(stream: &mut Stream, holder: &Holder) -> io::Result<()> {
    write_line(
        stream,
        &format!("refused {} {}", holder.pid, holder.command),
    )
}

/// Returns true if a program receives guests at this socket.
pub(crate) fn is_answered(socket: &Path) -> bool {
    system::connect(socket).is_ok()
}

/// Returns this program.
pub fn this_program() -> Holder {
    let command: Vec<String> = std::env::args_os()
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    Holder {
        pid: std::process::id(),
        command: printable(command.join(" ")),
    }
}

/// Returns the place of the socket of a port's owner.
pub(crate) fn socket(port: &str) -> io::Result<PathBuf> {
    let real = match port.strip_prefix(TCP) {
        Some(address) => tcp_name(address),
        None => Path::new(port)
            .canonicalize()
            .map_or(port.to_owned(), |path| path.to_string_lossy().into_owned()),
    };
    let last = real.rsplit(['/', '\\']).next().unwrap_or_default();
    let plain = |letter: char| match letter.is_ascii_alphanumeric() {
        true => letter,
        false => '-',
    };
    let last: String = last.chars().map(plain).take(24).collect();
    Ok(folder()?.join(format!("{last}-{:016x}", fnv(real.as_bytes()))))
}

/// Returns one name for the spellings of an address of this computer: `localhost`, `127.0.0.1`,
/// `::1` and `0.0.0.0` lead to the same station. Other addresses keep their spelling: a name is not
/// resolved, because a stop must not wait for that.
fn tcp_name(address: &str) -> String {
    let (host, port) = address.rsplit_once(':').unwrap_or((address, ""));
    let ip: Option<IpAddr> = host.trim_matches(['[', ']']).parse().ok();
    let is_here = host.eq_ignore_ascii_case("localhost")
        || ip.is_some_and(|ip| {
            ip == Ipv4Addr::LOCALHOST || ip == Ipv6Addr::LOCALHOST || ip.is_unspecified()
        });
    match port.parse::<u16>() {
        Ok(port) if is_here => format!("{TCP}localhost:{port}"),
        _ => format!("{TCP}{address}"),
    }
}

/// Returns the user's own folder for sockets and links, which only the user can enter.
///
/// # Errors
/// If it cannot be made, or another user has made it.
pub fn folder() -> io::Result<PathBuf> {
    system::folder()
}

/// Hashes by Fowler, Noll and Vo, 64 bits, variant 1a: the same in every version of the program.
fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

fn write_line(stream: &mut Stream, line: &str) -> io::Result<()> {
    let mut end = line.len().min(LONGEST_LINE - 1);
    while !line.is_char_boundary(end) {
        end -= 1;
    }
    // It fits the socket's buffer as a whole.
    stream.write_all(format!("{}\n", &line[..end]).as_bytes())
}

/// Reads up to the end of a line, byte by byte, because packets follow it.
fn read_line(stream: &mut Stream, patience: Duration) -> io::Result<String> {
    let end = Instant::now() + patience;
    let (mut line, mut byte) = (Vec::new(), [0]);
    while line.len() < LONGEST_LINE {
        match stream.read(&mut byte) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(_) if byte == *b"\n" => return Ok(String::from_utf8_lossy(&line).into_owned()),
            Ok(_) => line.extend(byte),
            Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
            Err(cause) if cause.kind() == io::ErrorKind::WouldBlock && Instant::now() < end => {
                std::thread::sleep(LOOK);
            }
            Err(cause) => return Err(cause),
        }
    }
    Err(io::Error::new(io::ErrorKind::InvalidData, "endless line"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_to_one_socket() {
        let folder = tempfile::tempdir().expect("a folder");
        let port = folder.path().join("port");
        std::fs::write(&port, []).expect("a file");
        let name = |path: &Path| socket(path.to_str().expect("UTF-8")).expect("a place");
        let roundabout = folder.path().join(".").join("port");
        assert_eq!(name(&port), name(&roundabout));
        assert_ne!(name(&port), name(&folder.path().join("other")));
    }

    #[test]
    fn spellings_of_an_address_are_one_port() {
        let place = |port: &str| socket(port).expect("a place");
        for same in [
            "tcp://localhost:7600",
            "tcp://0.0.0.0:7600",
            "tcp://127.0.0.1:07600",
            "tcp://[::1]:7600",
        ] {
            assert_eq!(place(same), place("tcp://127.0.0.1:7600"), "{same}");
        }
        for other in [
            "tcp://127.0.0.1:7601",
            "tcp://192.0.2.7:7600",
            "tcp://:7600",
        ] {
            assert_ne!(place(other), place("tcp://127.0.0.1:7600"), "{other}");
        }
    }

    /// The system accepts connections for a suspended owner.
    #[test]
    fn owner_that_says_nothing_is_named() {
        let port = format!("tcp://owner-{}.test:1", std::process::id());
        assert!(connect_to_owner(&port, Purpose::Watch).is_none());
        let place = socket(&port).expect("a place");
        let listener = Listener::bind(&place).expect("a socket");
        let Some(Reception::Silent(holder)) = connect_to_owner(&port, Purpose::Watch) else {
            panic!("it has an owner");
        };
        if cfg!(target_os = "linux") {
            assert_eq!(holder.map(|holder| holder.pid), Some(std::process::id()));
        }
        drop(listener);
        assert!(connect_to_owner(&port, Purpose::Watch).is_none());
    }

    #[test]
    fn names_of_ports_stay_short() {
        let path = socket(&format!("tcp://{}:80", "long.".repeat(100))).expect("a place");
        // A socket's path has at most 107 bytes on Linux, and 103 elsewhere.
        assert!(path.to_string_lossy().len() < 100, "{path:?}");
    }
}
