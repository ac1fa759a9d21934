//! The far end of a line: the bytes between a simulated station and the programs that connect to
//! it, over a pseudo-terminal or TCP.

use std::io::{self, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::time::Duration;
#[cfg(unix)]
use std::{
    fs::File,
    path::{Path, PathBuf},
};

/// Longest wait for bytes.
const WAIT: Duration = Duration::from_millis(1);

/// Far end of a line.
pub trait FarEnd: Send {
    /// Waits a millisecond for bytes from a program; returns their number, perhaps 0.
    ///
    /// # Errors
    /// If the line cannot be used any more.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Writes bytes. Bytes that no program reads are lost, as on a real line.
    fn write(&mut self, bytes: &[u8]);
}

/// Pseudo-terminal by its own name.
#[cfg(unix)]
#[derive(Debug)]
pub struct Terminal {
    far: serialport::TTYPort,
    /// Near end, kept open because the line would end when the other program closes it.
    _near: serialport::TTYPort,
    name: String,
}

#[cfg(unix)]
impl Terminal {
    /// Opens a pseudo-terminal.
    ///
    /// # Errors
    /// If the system has none.
    pub fn open() -> io::Result<Self> {
        use serialport::SerialPort as _;
        let (mut far, near) = serialport::TTYPort::pair()?;
        far.set_timeout(WAIT)?;
        let name = near.name().ok_or(io::ErrorKind::NotFound)?;
        Ok(Self {
            far,
            _near: near,
            name,
        })
    }

    /// Returns the path of the end that other programs open.
    pub fn name(&self) -> &str {
        &self.name
    }
}

#[cfg(unix)]
impl FarEnd for Terminal {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.far.read(buffer) {
            Err(cause) if is_pause(&cause) => Ok(0),
            outcome => outcome,
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        let _ = self.far.write_all(bytes);
    }
}

/// Pseudo-terminal under the name of a symbolic link, which is removed when this is dropped.
///
/// A lock on a file beside the link tells a link in use from one that a crash has left: the system
/// gives its pseudo-terminal to another program later.
#[cfg(unix)]
pub struct PseudoTerminal {
    terminal: Terminal,
    link: PathBuf,
    _lock: File,
}

#[cfg(unix)]
impl PseudoTerminal {
    /// Opens a pseudo-terminal and makes `link` a symbolic link to it. A link that a crash has left
    /// is replaced.
    ///
    /// # Errors
    /// [`io::ErrorKind::ResourceBusy`] if another program uses the link,
    /// [`io::ErrorKind::AlreadyExists`] if something else is there; if the system has no
    /// pseudo-terminal.
    pub fn open(link: &Path) -> io::Result<Self> {
        let lock = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(lock_of(link))?;
        if lock.try_lock().is_err() {
            return Err(io::ErrorKind::ResourceBusy.into());
        }
        match Self::link(link) {
            Ok(terminal) => Ok(Self {
                terminal,
                link: link.to_owned(),
                _lock: lock,
            }),
            Err(cause) => {
                let _ = std::fs::remove_file(lock_of(link));
                Err(cause)
            }
        }
    }

    /// Opens a pseudo-terminal and makes the link to it, while the lock is held.
    fn link(link: &Path) -> io::Result<Terminal> {
        let terminal = Terminal::open()?;
        // A link that an earlier twin left leads to another pseudo-terminal; links to anything
        // else are the user's own.
        let folder = Path::new(terminal.name()).parent();
        if std::fs::read_link(link).is_ok_and(|leads_to| leads_to.parent() == folder) {
            std::fs::remove_file(link)?;
        }
        std::os::unix::fs::symlink(terminal.name(), link)?;
        Ok(terminal)
    }

    /// Returns true if a program keeps a pseudo-terminal under this link.
    pub fn is_in_use(link: &Path) -> bool {
        let lock = File::open(lock_of(link));
        link.exists() && lock.is_ok_and(|lock| lock.try_lock_shared().is_err())
    }
}

#[cfg(unix)]
fn lock_of(link: &Path) -> PathBuf {
    let mut path = link.as_os_str().to_owned();
    path.push(".lock");
    path.into()
}

#[cfg(unix)]
impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        // What stays behind is replaced by the next twin.
        let _ = std::fs::remove_file(&self.link);
        let _ = std::fs::remove_file(lock_of(&self.link));
    }
}

#[cfg(unix)]
impl FarEnd for PseudoTerminal {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.terminal.read(buffer)
    }

    fn write(&mut self, bytes: &[u8]) {
        self.terminal.write(bytes);
    }
}

/// TCP port that serves one connection at a time; others are closed at once.
#[derive(Debug)]
pub struct TcpPort {
    listener: TcpListener,
    stream: Option<TcpStream>,
}

impl TcpPort {
    /// Listens on an address, such as `127.0.0.1:5333`; port 0 is any free one.
    ///
    /// # Errors
    /// If the address is unknown or in use.
    pub fn open(address: impl ToSocketAddrs) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            stream: None,
        })
    }

    /// Returns the address.
    ///
    /// # Errors
    /// If the system does not report it.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    fn accept(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            let is_usable = stream.set_nodelay(true).is_ok()
                && stream.set_nonblocking(false).is_ok()
                && stream.set_read_timeout(Some(WAIT)).is_ok()
                && stream.set_write_timeout(Some(WAIT)).is_ok();
            if self.stream.is_none() && is_usable {
                self.stream = Some(stream);
            }
        }
    }
}

impl FarEnd for TcpPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.accept();
        let Some(stream) = &mut self.stream else {
            std::thread::sleep(WAIT);
            return Ok(0);
        };
        match stream.read(buffer) {
            Ok(count) if count > 0 => Ok(count),
            Err(cause) if is_pause(&cause) => Ok(0),
            _ => {
                self.stream = None;
                Ok(0)
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(stream) = &mut self.stream {
            let _ = stream.write_all(bytes);
        }
    }
}

fn is_pause(cause: &io::Error) -> bool {
    matches!(
        cause.kind(),
        io::ErrorKind::TimedOut | io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock
    )
}
