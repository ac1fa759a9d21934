//! Bytes to and from the host, over USB or UART.
//!
//! Both links run the same code, each with its own receiver. The machine talks to one of them at a
//! time, the *speaker*: the first that sent a packet with a right checksum, until it has sent none
//! for half a second (a host sends a heartbeat every 20 ms). Noise on a link is no packet, so it
//! neither makes a speaker nor keeps one, and it cannot break a packet of the other link. What the
//! speaker's link garbles is counted by the machine; what the other link garbles is dropped.
//!
//! A host counts as *connected* while it is heard and, on USB, holds DTR; what the machine says to
//! anybody else is dropped, so an absent or hanging host costs nothing. Every write has a time
//! limit; a packet that was cut off is closed by a zero byte before the next one. So unplugging,
//! plugging in again, and a host that died need no special case.

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
use shared::frame::MAX_PACKET;
use shared::frame::encode::Bytes;
use shared::frame::message::Packet;
use shared::frame::receive::{Receiver, Reject};

/// How long a write may take.
const WRITE_LIMIT: Duration = Duration::from_millis(50);

/// How long to wait after a read that failed: the cable is not plugged in.
const PAUSE: Duration = Duration::from_millis(5);

/// Time without a packet after which the other link may speak, ms.
const SILENCE_MS: u32 = 500;

/// A full-speed USB packet.
pub const PACKET: usize = 64;

/// Which link.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Port {
    /// USB CDC-ACM.
    Usb,
    /// The UART.
    Uart,
}

/// What came over a link, with the time of its last byte.
pub struct Arrival {
    /// When it was complete.
    pub at: shared::time::Instant,
    /// A packet, or the reason why the bytes were none.
    pub outcome: Result<Packet, Reject>,
}

static RECEIVED: Channel<CriticalSectionRawMutex, Arrival, 4> = Channel::new();
static TO_USB: Channel<CriticalSectionRawMutex, Bytes, 4> = Channel::new();
static TO_UART: Channel<CriticalSectionRawMutex, Bytes, 4> = Channel::new();

/// Who speaks (0 nobody, 1 USB, 2 UART) in the lowest two bits, and when it was last heard in the
/// others, ms.
static SPEAKER: AtomicU32 = AtomicU32::new(0);

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

    /// Whether the machine is to have what came over this link. A packet with a right checksum
    /// makes the link the speaker, if the other is not.
    fn speaks(self, outcome: &Result<Packet, Reject>) -> bool {
        let speaker = speaker();
        // A message of another protocol, too, comes from a host rather than from a motor's cable.
        let sound = matches!(outcome, Ok(_) | Err(Reject::Malformed));
        if sound && speaker.is_none_or(|other| other == self) {
            SPEAKER.store(milliseconds() << 2 | self.mark(), Relaxed);
            return true;
        }
        speaker == Some(self)
    }
}

fn milliseconds() -> u32 {
    // 30 bits: they wrap every twelve days, and only differences matter.
    (Instant::now().as_millis() as u32) & (u32::MAX >> 2)
}

/// The link that sent a packet lately.
fn speaker() -> Option<Port> {
    let word = SPEAKER.load(Relaxed);
    let silence = milliseconds().wrapping_sub(word >> 2) & (u32::MAX >> 2);
    match word & 3 {
        1 if silence < SILENCE_MS => Some(Port::Usb),
        2 if silence < SILENCE_MS => Some(Port::Uart),
        _ => None,
    }
}

/// The next arrival for the machine.
pub fn received() -> Option<Arrival> {
    RECEIVED.try_receive().ok()
}

/// Until there is something for the machine.
pub async fn wait() {
    RECEIVED.ready_to_receive().await;
}

/// Sends a packet to whoever speaks. Never waits: with a full queue or nobody there it is dropped.
pub fn send(bytes: Bytes) {
    if let Some(port) = speaker() {
        let _ = port.queue().try_send(bytes);
    }
}

/// Serves one link for ever. `open` says whether the other end listens at all.
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
            if port.speaks(&outcome) {
                watch::alive(port.task());
                // The machine takes it within a control tick, so this never waits long.
                RECEIVED.send(Arrival { at, outcome }).await;
            }
        }
    }
}

async fn transmit(port: Port, mut tx: impl Write, open: impl Fn() -> bool) {
    // The host may have been in the middle of something else.
    let mut torn = true;
    loop {
        let bytes = port.queue().receive().await;
        if !open() {
            torn = true;
            continue;
        }
        let mut line: heapless::Vec<u8, { MAX_PACKET + 2 }> = heapless::Vec::new();
        // The room is there, so none of these is refused.
        if torn {
            let _ = line.push(0);
        }
        let _ = line.extend_from_slice(&bytes);
        if line.len().is_multiple_of(PACKET) {
            // A USB host waits for more after a full packet. An empty packet of ours, one zero
            // byte, means nothing and ends the wait.
            let _ = line.push(0);
        }
        let written = with_timeout(WRITE_LIMIT, tx.write_all(&line)).await;
        torn = !matches!(written, Ok(Ok(())));
    }
}

/// The UART link. It has no DTR: the host is there while it is heard.
#[embassy_executor::task]
pub async fn uart(uart: BufferedUart<'static>) {
    let (tx, rx) = uart.split();
    serve(Port::Uart, rx, tx, || true).await
}
