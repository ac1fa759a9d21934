//! Bytes to and from the host, over USB or UART.
//!
//! Both links run the same code, each with its own receiver. The machine talks to one of them at a
//! time, the *active link*: the first that received a packet with a correct checksum, until it has
//! received none for half a second (a host sends a heartbeat every 20 ms). Noise on a link makes no
//! packet, so it neither activates a link nor keeps it active, and it cannot break a packet of the
//! other link. The machine counts the rejects of the active link; those of the other link are
//! dropped.
//!
//! A host counts as *connected* while its packets arrive and, on USB, it holds DTR. Reports to any
//! other host are dropped, so an absent or hanging host costs nothing. Every write has a time
//! limit, and a zero byte closes a packet that was cut off before the next one. So unplugging,
//! plugging in again, and a dead host need no special case.

use crate::clock;
use crate::watch::{self, Task};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_stm32::usart::BufferedUart;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use trinocular_core::frame::MAX_PACKET;
use trinocular_core::frame::encode::Bytes;
use trinocular_core::frame::message::Packet;
use trinocular_core::frame::receive::{Receiver, Reject};

/// Time limit of a write.
const WRITE_LIMIT: Duration = Duration::from_millis(50);

/// Pause after a read that failed because the cable is unplugged.
const PAUSE: Duration = Duration::from_millis(5);

/// Time without a packet after which the other link may become active, ms.
const SILENCE_MS: u32 = 500;

/// Size of a full-speed USB packet, bytes.
pub const PACKET: usize = 64;

/// One of the two links.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Port {
    /// USB CDC-ACM.
    Usb,
    /// The UART.
    Uart,
}

/// Outcome of bytes from a link, with the time of the last byte.
pub struct Arrival {
    /// Instant at which the packet was complete.
    pub at: trinocular_core::time::Instant,
    /// Packet, or the reason for a reject.
    pub outcome: Result<Packet, Reject>,
}

static RECEIVED: Channel<CriticalSectionRawMutex, Arrival, 4> = Channel::new();
static TO_USB: Channel<CriticalSectionRawMutex, Bytes, 4> = Channel::new();
static TO_UART: Channel<CriticalSectionRawMutex, Bytes, 4> = Channel::new();

/// Active link in the lowest two bits (0 none, 1 USB, 2 UART), and the time of its last packet in
/// the others, ms.
static ACTIVE: AtomicU32 = AtomicU32::new(0);

impl Port {
    const fn mark(self) -> u32 {
        match self {
            Self::Usb => 1,
            Self::Uart => 2,
        }
    }

    fn queue(self) -> &'static Channel<CriticalSectionRawMutex, Bytes, 4> {
        match self {
            Self::Usb => &TO_USB,
            Self::Uart => &TO_UART,
        }
    }

    const fn task(self) -> Task {
        match self {
            Self::Usb => Task::Usb,
            Self::Uart => Task::Uart,
        }
    }

    /// Returns true if this outcome is for the machine. A packet with a correct checksum activates
    /// the link, unless the other one is active.
    fn takes(self, outcome: &Result<Packet, Reject>) -> bool {
        let active = active();
        // A message of another protocol also comes from a host rather than from a motor's cable.
        let sound = matches!(outcome, Ok(_) | Err(Reject::Malformed));
        if sound && active.is_none_or(|other| other == self) {
            ACTIVE.store(milliseconds() << 2 | self.mark(), Relaxed);
            return true;
        }
        active == Some(self)
    }
}

fn milliseconds() -> u32 {
    // 30 bits wrap every twelve days, and only differences matter.
    (Instant::now().as_millis() as u32) & (u32::MAX >> 2)
}

/// Returns the active link.
fn active() -> Option<Port> {
    let word = ACTIVE.load(Relaxed);
    let silence = milliseconds().wrapping_sub(word >> 2) & (u32::MAX >> 2);
    match word & 3 {
        1 if silence < SILENCE_MS => Some(Port::Usb),
        2 if silence < SILENCE_MS => Some(Port::Uart),
        _ => None,
    }
}

/// Returns the next arrival for the machine.
pub fn received() -> Option<Arrival> {
    RECEIVED.try_receive().ok()
}

/// Waits until there is an arrival for the machine.
pub async fn wait() {
    RECEIVED.ready_to_receive().await;
}

/// Sends a packet over the active link. Never waits: the packet is dropped if the queue is full or
/// no link is active.
pub fn send(bytes: Bytes) {
    if let Some(port) = active() {
        let _ = port.queue().try_send(bytes);
    }
}

/// Serves one link forever. `open` returns true if the other end listens.
pub async fn serve(port: Port, rx: impl Read, tx: impl Write, open: impl Fn() -> bool) {
    join(receive(port, rx), transmit(port, tx, open)).await;
}

async fn receive(port: Port, mut rx: impl Read) {
    let mut buffer = [0; PACKET];
    let mut receiver = Receiver::<Packet>::default();
    loop {
        watch::alive(port.task());
        let read = select(rx.read(&mut buffer), watch::look(port.task())).await;
        let count = match read {
            Either::First(Ok(count)) => count,
            Either::First(Err(_)) => {
                Timer::after(PAUSE).await;
                continue;
            }
            Either::Second(()) => continue,
        };
        let at = clock::now();
        let mut bytes = buffer.get(..count).unwrap_or_default();
        while let Some(outcome) = receiver.next(&mut bytes) {
            if port.takes(&outcome) {
                watch::alive(port.task());
                // The machine takes it within a control tick, so this never waits long.
                RECEIVED.send(Arrival { at, outcome }).await;
            }
        }
    }
}

async fn transmit(port: Port, mut tx: impl Write, open: impl Fn() -> bool) {
    // The host may be in the middle of other data.
    let mut torn = true;
    loop {
        let bytes = port.queue().receive().await;
        if !open() {
            torn = true;
            continue;
        }
        let mut line: heapless::Vec<u8, { MAX_PACKET + 2 }> = heapless::Vec::new();
        // There is room, so none of these fails.
        if torn {
            let _ = line.push(0);
        }
        let _ = line.extend_from_slice(&bytes);
        if line.len().is_multiple_of(PACKET) {
            // A USB host waits for more after a full packet. Our empty packet, one zero byte, means
            // nothing and ends the wait.
            let _ = line.push(0);
        }
        let written = with_timeout(WRITE_LIMIT, tx.write_all(&line)).await;
        torn = !matches!(written, Ok(Ok(())));
    }
}

/// Serves the UART link. It has no DTR: the host counts as connected while its packets arrive.
#[embassy_executor::task]
pub async fn uart(uart: BufferedUart<'static>) {
    let (tx, rx) = uart.split();
    serve(Port::Uart, rx, tx, || true).await
}
