//! The two halves of a byte link to a station: a serial port, a TCP connection, or the socket of
//! the program that has the port.

use super::super::owner;
use super::super::twin::link::is_left_behind;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::path::Path;
use std::time::{Duration, Instant};

/// Speed of a serial line, baud. USB ignores it; a UART link must use it.
const BAUD: u32 = 921_600;

/// Timeout for a write.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// Timeout for a TCP connection.
const CONNECT_PATIENCE: Duration = Duration::from_secs(2);

/// Pause of a socket that takes no more bytes.
const FULL: Duration = Duration::from_millis(1);

/// Beginning of the name of a port that is reached by TCP.
pub(crate) const TCP: &str = "tcp://";

/// One half of a link.
pub(super) enum Half {
    Serial(Box<dyn serialport::SerialPort>),
    Tcp(TcpStream),
    Owner(owner::Stream),
}

/// Reading and writing half of one link.
pub(super) type Halves = (Half, Half);

/// Opens a serial port, or connects to `tcp://HOST:PORT`. A link that a crashed twin has left is
/// refused, because its pseudo-terminal may be another program's by now.
pub(super) fn open(path: &str) -> serialport::Result<Halves> {
    match path.strip_prefix(TCP) {
        Some(address) => {
            let stream = connect(address)?;
            Ok((Half::Tcp(stream.try_clone()?), Half::Tcp(stream)))
        }
        None if is_left_behind(Path::new(path)) => Err(serialport::Error::new(
            serialport::ErrorKind::Io(io::ErrorKind::NotConnected),
            "the program that simulated a station here has crashed",
        )),
        None => {
            let port = serialport::new(path, BAUD).timeout(WRITE_PATIENCE);
            let mut port = port.open()?;
            // Signals a USB board that a host listens. A pseudo-terminal has no such line and
            // reports that.
            let _ = port.write_data_terminal_ready(true);
            let writer = port.try_clone()?;
            Ok((Half::Serial(port), Half::Serial(writer)))
        }
    }
}

/// Splits the socket to the program that has the port.
pub(super) fn through(owner: owner::Stream) -> io::Result<Halves> {
    owner.set_nonblocking(true)?;
    Ok((Half::Owner(owner.try_clone()?), Half::Owner(owner)))
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut failed = io::Error::new(io::ErrorKind::NotFound, "the host has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_PATIENCE) {
            Ok(stream) => {
                // A packet must not wait for the next one.
                stream.set_nodelay(true)?;
                stream.set_nonblocking(true)?;
                return Ok(stream);
            }
            Err(cause) => failed = cause,
        }
    }
    Err(failed)
}

impl Half {
    /// Reads the bytes that have arrived, without waiting; 0 if there are none.
    pub fn read_arrived(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Serial(port) => match port.bytes_to_read()? {
                0 => Ok(0),
                waiting => port.read(clip(buffer, waiting)),
            },
            Self::Tcp(stream) => received(stream.read(buffer)),
            Self::Owner(stream) => received(stream.read(buffer)),
        }
    }

    /// Returns the reason why the line is lost, after an error of this port.
    pub fn loss(&self, doing: &str, cause: &io::Error) -> String {
        match self {
            // The system reports the end of a device as an error of its file.
            Self::Serial(_) => format!(
                "the port is gone (cannot {doing}: {cause}): it was unplugged, or the program \
                 behind it has ended"
            ),
            Self::Tcp(_) | Self::Owner(_) => format!("cannot {doing}: {cause}"),
        }
    }

    /// Writes all bytes, within a tenth of a second.
    pub fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Serial(port) => port.write_all(bytes),
            Self::Tcp(stream) => send_all(stream, bytes),
            Self::Owner(stream) => send_all(stream, bytes),
        }
    }
}

fn clip(buffer: &mut [u8], waiting: u32) -> &mut [u8] {
    let count = buffer.len().min(waiting as usize);
    &mut buffer[..count]
}

/// Tells the end of a connection from the absence of bytes.
fn received(outcome: io::Result<usize>) -> io::Result<usize> {
    match outcome {
        Ok(0) => Err(io::Error::new(
            io::ErrorKind::UnexpectedEof,
            "the other side has closed the connection",
        )),
        Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => Ok(0),
        other => other,
    }
}

pub(super) fn send_all(stream: &mut impl Write, mut bytes: &[u8]) -> io::Result<()> {
    let end = Instant::now() + WRITE_PATIENCE;
    while !bytes.is_empty() {
        match stream.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => bytes = &bytes[count..],
            Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
            Err(cause) if cause.kind() == io::ErrorKind::WouldBlock && Instant::now() < end => {
                std::thread::sleep(FULL);
            }
            Err(cause) => return Err(cause),
        }
    }
    Ok(())
}
