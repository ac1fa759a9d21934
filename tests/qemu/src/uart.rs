//! UART0, the link to the host: interrupts move bytes between the line and two pipes.

use crate::interrupts::{self, Line};
use crate::registers::UART0;
use core::future::poll_fn;
use core::task::Poll;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::waitqueue::AtomicWaker;
use trinocular_core::frame::MAX_PACKET;

// Register offsets of a CMSDK UART.
const DATA: usize = 0x0;
const STATE: usize = 0x4;
const CONTROL: usize = 0x8;
const INTERRUPT: usize = 0xc;
const DIVISOR: usize = 0x10;

const TRANSMIT_FULL: u32 = 1 << 0;
const RECEIVE_FULL: u32 = 1 << 1;

/// Bytes from the host. When the pipe is full, bytes are lost, which the packets' checksums show.
static RECEIVED: Pipe<CriticalSectionRawMutex, 1024> = Pipe::new();

/// Bytes to the host: several packets.
static TO_SEND: Pipe<CriticalSectionRawMutex, { 8 * MAX_PACKET }> = Pipe::new();

static SENDER: AtomicWaker = AtomicWaker::new();

/// Starts the UART.
pub fn start() {
    UART0.write(DIVISOR, 16); // the smallest; QEMU does not model the time a byte takes
    UART0.write(CONTROL, 0b1111); // both ways, with interrupts
    interrupts::enable(Line::Uart0Receive);
    interrupts::enable(Line::Uart0Transmit);
}

/// Waits for bytes from the host.
pub async fn receive(buffer: &mut [u8]) -> usize {
    RECEIVED.read(buffer).await
}

/// Queues a packet. A host that does not read loses whole packets, never parts of them.
pub fn send(packet: &[u8]) {
    if TO_SEND.free_capacity() >= packet.len() {
        let _ = TO_SEND.try_write(packet);
    }
}

/// Sends queued bytes.
#[embassy_executor::task]
pub async fn sender() {
    let mut chunk = [0; 64];
    loop {
        let count = TO_SEND.read(&mut chunk).await;
        for byte in chunk.iter().take(count) {
            poll_fn(|context| {
                SENDER.register(context.waker());
                match UART0.read(STATE) & TRANSMIT_FULL {
                    0 => Poll::Ready(()),
                    _ => Poll::Pending,
                }
            })
            .await;
            UART0.write(DATA, u32::from(*byte));
        }
    }
}

/// Handles a received byte.
pub unsafe extern "C" fn on_receive() {
    UART0.write(INTERRUPT, 0b10);
    while UART0.read(STATE) & RECEIVE_FULL != 0 {
        let _ = RECEIVED.try_write(&[UART0.read(DATA) as u8]);
    }
}

/// Handles a transmitted byte.
pub unsafe extern "C" fn on_transmit() {
    UART0.write(INTERRUPT, 0b01);
    SENDER.wake();
}
