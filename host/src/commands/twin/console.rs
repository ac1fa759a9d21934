//! Orders to a simulated station, one per line of standard input.

use std::io::{BufRead as _, Read as _};
use std::sync::mpsc::{Receiver, channel};
use trinocular_client::twin::real_time::Switches;
use trinocular_rig::printable::printable;

/// Orders, for messages.
pub const ORDERS: &str = "type press, release, fault, clear, unplug, plug, restart, miss, \
                          double, where or quit";

/// Longest line, bytes.
const LONGEST: u64 = 200;

/// Fault of a simulated camera at one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Disturbance {
    /// The image does not come.
    Miss,
    /// The image comes twice.
    Double,
}

/// One order.
pub enum Order {
    /// Change what the station senses.
    Switches(fn(Switches) -> Switches),
    /// Cut the line.
    Unplug,
    /// Connect the line again.
    Plug,
    /// Power-cycle the board.
    Restart,
    /// Disturb the first simulated camera at its next image.
    Disturb(Disturbance),
    /// Print the position of the stage.
    Where,
    /// End.
    Quit,
    /// Anything else.
    Unknown(String),
}

impl Order {
    fn read(line: &str) -> Self {
        match line {
            "press" => Self::Switches(|switches| Switches {
                emergency_stop: true,
                ..switches
            }),
            "release" => Self::Switches(|switches| Switches {
                emergency_stop: false,
                ..switches
            }),
            "fault" => Self::Switches(|switches| Switches {
                driver_fault: true,
                ..switches
            }),
            "clear" => Self::Switches(|switches| Switches {
                driver_fault: false,
                ..switches
            }),
            "unplug" => Self::Unplug,
            "plug" => Self::Plug,
            "restart" => Self::Restart,
            "miss" => Self::Disturb(Disturbance::Miss),
            "double" => Self::Disturb(Disturbance::Double),
            "where" => Self::Where,
            "quit" => Self::Quit,
            other => Self::Unknown(printable(other)),
        }
    }
}

/// Waits until standard input may be read. The system stops a program in the background of a
/// terminal (`twin &`) that reads from it.
#[cfg(unix)]
fn wait_for_foreground() {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::process::getpgrp;
    use rustix::termios::tcgetpgrp;
    use std::time::Duration;

    /// Pause between two looks.
    const LOOK: Duration = Duration::from_millis(200);
    let input = std::io::stdin();
    let timeout = Timespec::try_from(LOOK).ok();
    loop {
        let mut fds = [PollFd::new(&input, PollFlags::IN)];
        let is_ready = poll(&mut fds, timeout.as_ref()).is_ok_and(|count| count > 0);
        match tcgetpgrp(&input) {
            // What is no terminal has no foreground.
            Err(_) => return,
            Ok(foreground) if is_ready && foreground == getpgrp() => return,
            // The line is for the program in the foreground, which reads it now.
            Ok(_) if is_ready => std::thread::sleep(LOOK),
            Ok(_) => {}
        }
    }
}

/// Waits for nothing: no program is stopped for reading.
#[cfg(not(unix))]
fn wait_for_foreground() {}

/// Thread that reads the orders. It ends with standard input or with the program.
pub struct Console(Receiver<Order>);

impl Console {
    /// Starts to read. At the end of standard input the station goes on without orders.
    pub fn start() -> Self {
        let (sender, orders) = channel();
        std::thread::spawn(move || {
            let mut input = std::io::stdin().lock();
            loop {
                wait_for_foreground();
                let mut line = Vec::new();
                match input.by_ref().take(LONGEST).read_until(b'\n', &mut line) {
                    Ok(0) | Err(_) => return,
                    Ok(_) => {}
                }
                let line = String::from_utf8_lossy(&line);
                let word = line.trim();
                if !word.is_empty() && sender.send(Order::read(word)).is_err() {
                    return;
                }
            }
        });
        Self(orders)
    }

    /// Returns the next order, if there is one.
    pub fn order(&self) -> Option<Order> {
        self.0.try_recv().ok()
    }
}
