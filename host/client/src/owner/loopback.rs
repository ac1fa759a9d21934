//! Connections on the loopback address, for systems without sockets in the file system.
//!
//! A file in the user's own folder holds the port number and a token. A guest sends the token
//! first; without it the owner closes the connection.

use std::io::{self, Read as _, Write as _};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Timeout for the token.
const PATIENCE: Duration = Duration::from_millis(500);

/// Length of a token, bytes.
const TOKEN: usize = 32;

/// Connection between owner and guest.
pub(crate) type Stream = TcpStream;

/// Address and token of an owner, in a file that is removed when this is dropped.
#[derive(Debug)]
pub(crate) struct Listener {
    listener: TcpListener,
    token: String,
    path: PathBuf,
}

impl Listener {
    /// Listens, and writes address and token to `path`. Whoever calls this has the port, so a file
    /// that lies there is left over from a crash.
    pub fn bind(path: &Path) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        listener.set_nonblocking(true)?;
        let mut secret = [0; TOKEN / 2];
        getrandom::fill(&mut secret).map_err(io::Error::other)?;
        let token: String = secret.iter().map(|byte| format!("{byte:02x}")).collect();
        let port = listener.local_addr()?.port();
        std::fs::write(path, format!("{port} {token}"))?;
        Ok(Self {
            listener,
            token,
            path: path.to_owned(),
        })
    }

    /// Returns the next guest, or [`io::ErrorKind::WouldBlock`] at once if there is none.
    pub fn accept(&self) -> io::Result<Stream> {
        self.listener.accept().map(|(stream, _)| stream)
    }

    /// Reads the guest's token.
    ///
    /// # Errors
    /// [`io::ErrorKind::PermissionDenied`] for a wrong one.
    pub fn check(&self, stream: &mut Stream) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        let mut token = [0; TOKEN];
        stream.read_exact(&mut token)?;
        let pairs = token.iter().zip(self.token.as_bytes());
        match pairs.fold(0, |differences, (a, b)| differences | (a ^ b)) {
            0 => Ok(()),
            _ => Err(io::ErrorKind::PermissionDenied.into()),
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        // A later owner may have written its own address there.
        let there = std::fs::read_to_string(&self.path);
        if there.is_ok_and(|there| there.ends_with(&self.token)) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Connects to an owner by its file.
pub(crate) fn connect(path: &Path) -> io::Result<Stream> {
    let text = std::fs::read_to_string(path)?;
    let strange = || io::Error::new(io::ErrorKind::InvalidData, "no address");
    let (port, token) = text.split_once(' ').ok_or_else(strange)?;
    let port: u16 = port.parse().map_err(|_| strange())?;
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
    stream.set_nodelay(true)?;
    stream.write_all(token.as_bytes())?;
    Ok(stream)
}

/// Returns the folder in the user's local data.
pub(super) fn folder() -> io::Result<PathBuf> {
    let base = std::env::var_os("LOCALAPPDATA").map(PathBuf::from);
    let folder = base.unwrap_or_else(std::env::temp_dir).join("trinocular");
    std::fs::create_dir_all(&folder)?;
    Ok(folder)
}
