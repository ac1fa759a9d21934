//! The far end of a line: the bytes between a simulated station and the programs that connect to
//! it, over a pseudo-terminal or TCP.

use std::io::{self, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::time::Duration;
#[cfg(unix)]
use {
    super::link::LinkLock,
    std::path::{Path, PathBuf},
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

/// Far end of a line that can be unplugged.
pub trait Plug: FarEnd {
    /// Unplugs the line: the programs that have it lose it, and the others do not find it.
    fn unplug(&mut self);

    /// Plugs the line in again under the same name.
    ///
    /// # Errors
    /// If the name is taken.
    fn plug(&mut self) -> io::Result<()>;
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
        let (far, near) = serialport::TTYPort::pair()?;
        // Programs that this one starts do not inherit the duplicates. An end that they had would
        // keep an unplugged line open.
        let (mut far, near) = (far.try_clone_native()?, near.try_clone_native()?);
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
/// gives its pseudo-terminal to another program later. An unplugged line keeps the lock.
#[cfg(unix)]
pub struct PseudoTerminal {
    /// `None` while the line is unplugged.
    terminal: Option<Terminal>,
    link: PathBuf,
    _lock: LinkLock,
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
        let lock = LinkLock::take(link)?;
        Ok(Self {
            terminal: Some(Self::link(link)?),
            link: link.to_owned(),
            _lock: lock,
        })
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
}

#[cfg(unix)]
impl Plug for PseudoTerminal {
    fn unplug(&mut self) {
        if self.terminal.take().is_some() {
            // What stays behind is replaced by the next twin.
            let _ = std::fs::remove_file(&self.link);
        }
    }

    fn plug(&mut self) -> io::Result<()> {
        if self.terminal.is_none() {
            self.terminal = Some(Self::link(&self.link)?);
        }
        Ok(())
    }
}

#[cfg(unix)]
impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        self.unplug();
    }
}

#[cfg(unix)]
impl FarEnd for PseudoTerminal {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match &mut self.terminal {
            Some(terminal) => terminal.read(buffer),
            None => {
                std::thread::sleep(WAIT);
                Ok(0)
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(terminal) = &mut self.terminal {
            terminal.write(bytes);
        }
    }
}

/// TCP port that serves one connection at a time; others are closed at once.
#[derive(Debug)]
pub struct TcpPort {
    /// `None` while the line is unplugged.
    listener: Option<TcpListener>,
    address: SocketAddr,
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
            address: listener.local_addr()?,
            listener: Some(listener),
            stream: None,
        })
    }

    /// Returns the address.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    fn accept(&mut self) {
        let Some(listener) = &self.listener else {
            return;
        };
        while let Ok((stream, _)) = listener.accept() {
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

impl Plug for TcpPort {
    fn unplug(&mut self) {
        self.listener = None;
        self.stream = None;
    }

    fn plug(&mut self) -> io::Result<()> {
        if self.listener.is_none() {
            *self = Self::open(self.address)?;
        }
        Ok(())
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
