//! USB controller OTG_FS as a device (RM0090 chapter 34): registers, FIFOs, and its answers to a
//! host's tokens.
//!
//! Written from the manual's programming model, not from the driver. Where the two differ, the
//! manual's words decide: an OUT packet is taken once the endpoint's NAK bit is clear and the
//! receive FIFO has room (34.17.6, "internal data flow" of OUT transfers); a SETUP packet is always
//! taken, sets both NAK bits of endpoint 0, and is reported done at the token after it. The enable
//! bit of an OUT endpoint is kept and cleared as described, but its absence does not refuse a
//! packet: the manual does not say so, and only a real board can settle this point.

mod endpoint;

use endpoint::{In, Out};
use std::collections::VecDeque;

/// Number of endpoints per direction.
pub const ENDPOINTS: usize = 4;

/// Length of the FIFO memory, words: 1.25 KiB.
const FIFO_WORDS: u32 = 320;

mod int {
    pub const RXFLVL: u32 = 1 << 4;
    pub const SUSPEND: u32 = 1 << 10 | 1 << 11;
    pub const USBRST: u32 = 1 << 12;
    pub const ENUMDNE: u32 = 1 << 13;
    pub const IEPINT: u32 = 1 << 18;
    pub const OEPINT: u32 = 1 << 19;
    /// Bits that writing ones clears.
    pub const CLEARED: u32 = 0xf030_fc0a;
}

/// Packet status of an entry in the receive FIFO.
mod status {
    pub const OUT_DATA: u32 = 2;
    pub const OUT_DONE: u32 = 3;
    pub const SETUP_DONE: u32 = 4;
    pub const SETUP_DATA: u32 = 6;
}

/// Entry of the receive FIFO.
#[derive(Clone, Debug)]
struct Entry {
    status: u32,
    data: VecDeque<u32>,
}

/// Answer of the device to a token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// No answer: the device is absent, or the token has another address.
    Nothing,
    /// The device took the packet.
    Ack,
    /// The device is not ready.
    Nak,
    /// The device refuses the request.
    Stall,
    /// Data with their toggle.
    Data(bool, Vec<u8>),
}

/// Registers and FIFOs.
#[derive(Clone, Debug)]
pub struct Otg {
    gahbcfg: u32,
    gusbcfg: u32,
    gintsts: u32,
    gintmsk: u32,
    gotgctl: u32,
    gccfg: u32,
    grxfsiz: u32,
    /// Start and depth of the transmit FIFOs.
    txf: [u32; ENDPOINTS],
    dcfg: u32,
    dctl: u32,
    diepmsk: u32,
    doepmsk: u32,
    daintmsk: u32,
    diepempmsk: u32,
    pcgcctl: u32,
    ins: [In; ENDPOINTS],
    outs: [Out; ENDPOINTS],
    received: VecDeque<Entry>,
    /// Words of the last popped entry that are not read yet.
    data: VecDeque<u32>,
    /// True after a SETUP packet until the next token.
    setup: bool,
    /// Address in use. A new one, written before the status stage of its request as the manual
    /// demands, takes effect at the end of that stage.
    address: u32,
    frame: u32,
    /// Misuse of the FIFOs by the driver.
    pub misuse: Option<&'static str>,
}

impl Default for Otg {
    fn default() -> Self {
        Self {
            gahbcfg: 0,
            gusbcfg: 0x1440,
            gintsts: 0x0400_0020,
            gintmsk: 0,
            gotgctl: 0x0001_0000,
            gccfg: 0,
            grxfsiz: 0x200,
            txf: [0x0200_0200; ENDPOINTS],
            dcfg: 0x0220_0000,
            dctl: 0,
            diepmsk: 0,
            doepmsk: 0,
            daintmsk: 0,
            diepempmsk: 0,
            pcgcctl: 0,
            ins: Default::default(),
            outs: Default::default(),
            received: VecDeque::new(),
            data: VecDeque::new(),
            setup: false,
            address: 0,
            frame: 0,
            misuse: None,
        }
    }
}

impl Otg {
    /// Returns true if the pull-up on D+ is on: transceiver powered, not softly disconnected, bus
    /// voltage present.
    pub fn pulls_up(&self) -> bool {
        const PWRDWN: u32 = 1 << 16;
        const NOVBUSSENS: u32 = 1 << 21;
        const FDMOD: u32 = 1 << 30;
        self.gccfg & (PWRDWN | NOVBUSSENS) == PWRDWN | NOVBUSSENS
            && self.gusbcfg & FDMOD != 0
            && self.dctl & 2 == 0
    }

    /// Returns true if the interrupt line is active.
    pub fn interrupts(&self) -> bool {
        self.gahbcfg & 1 != 0 && self.gintsts() & self.gintmsk != 0
    }

    fn gintsts(&self) -> u32 {
        let mut value = self.gintsts & !(int::RXFLVL | int::IEPINT | int::OEPINT);
        if !self.received.is_empty() {
            value |= int::RXFLVL;
        }
        let daint = self.daint() & self.daintmsk;
        value |= if daint & 0xffff != 0 { int::IEPINT } else { 0 };
        value | if daint >> 16 != 0 { int::OEPINT } else { 0 }
    }

    fn daint(&self) -> u32 {
        const TXFE: u32 = 1 << 7;
        let mut value = 0;
        for (n, (enter, leave)) in self.ins.iter().zip(&self.outs).enumerate() {
            let txfe = if self.diepempmsk & 1 << n != 0 {
                TXFE
            } else {
                0
            };
            value |= u32::from(enter.interrupts() & (self.diepmsk & !TXFE | txfe) != 0) << n;
            value |= u32::from(leave.interrupts() & self.doepmsk != 0) << (16 + n);
        }
        value
    }

    /// Returns the free words of the receive FIFO: every entry takes its data and a word of status.
    fn room(&self) -> usize {
        let used: usize = self.received.iter().map(|entry| entry.data.len() + 1).sum();
        (self.grxfsiz as usize & 0xffff).saturating_sub(used + self.data.len())
    }

    fn push(&mut self, kind: u32, endpoint: usize, toggle: bool, bytes: &[u8]) {
        let words = bytes.chunks(4).map(|chunk| {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            u32::from_le_bytes(word)
        });
        let pid = u32::from(toggle) << 16;
        self.received.push_back(Entry {
            status: self.frame << 21 & 0x01e0_0000
                | kind << 17
                | pid
                | (bytes.len() as u32) << 4
                | endpoint as u32,
            data: words.collect(),
        });
    }

    /// Applies the effect of popping an entry to its endpoint.
    fn popped(&mut self, entry: u32) {
        let endpoint = &mut self.outs[(entry & 3) as usize];
        match entry >> 17 & 0xf {
            status::OUT_DONE => endpoint.finish(endpoint::XFRC),
            status::SETUP_DONE => endpoint.finish(endpoint::STUP),
            _ => {}
        }
    }

    // The wire.

    fn is_addressed(&self, address: u8) -> bool {
        self.pulls_up() && self.address == u32::from(address)
    }

    fn written_address(&self) -> u32 {
        self.dcfg >> 4 & 0x7f
    }

    /// Handles the token after a SETUP packet, which ends the setup stage.
    fn token(&mut self, endpoint: usize) {
        if endpoint == 0 && std::mem::take(&mut self.setup) {
            self.push(status::SETUP_DONE, 0, false, &[]);
        }
    }

    /// Handles a SETUP packet to endpoint 0.
    pub fn setup(&mut self, address: u8, request: [u8; 8]) -> Answer {
        if !self.is_addressed(address) || self.room() < 4 {
            return Answer::Nothing;
        }
        self.setup = true;
        self.ins[0].begin_control();
        self.outs[0].begin_control();
        self.push(status::SETUP_DATA, 0, false, &request);
        Answer::Ack
    }

    /// Handles a data packet to an endpoint.
    pub fn out(&mut self, address: u8, endpoint: usize, toggle: bool, bytes: &[u8]) -> Answer {
        if !self.is_addressed(address) || !self.outs[endpoint].is_active(endpoint) {
            return Answer::Nothing;
        }
        self.token(endpoint);
        let words = bytes.len().div_ceil(4);
        let room = self.room();
        let target = &mut self.outs[endpoint];
        if target.stalls() {
            return Answer::Stall;
        }
        // A word for the status, and one for the end of the transfer.
        if target.naks() || room < words + 2 {
            return Answer::Nak;
        }
        if target.toggle() != toggle {
            // The host did not hear the last acknowledgement.
            return Answer::Ack;
        }
        let done = target.take(endpoint, bytes.len() as u32);
        self.push(status::OUT_DATA, endpoint, toggle, bytes);
        if done {
            self.push(status::OUT_DONE, endpoint, toggle, &[]);
        }
        Answer::Ack
    }

    /// Handles the host's request for data. Without an error on the wire the host acknowledges them
    /// at once.
    pub fn enter(&mut self, address: u8, endpoint: usize) -> Answer {
        if !self.is_addressed(address) || !self.ins[endpoint].is_active(endpoint) {
            return Answer::Nothing;
        }
        self.token(endpoint);
        let answer = self.ins[endpoint].give(endpoint);
        if endpoint == 0 && matches!(answer, Answer::Data(..)) {
            self.address = self.written_address();
        }
        answer
    }

    /// Holds the bus in reset.
    pub fn bus_reset(&mut self) {
        self.gintsts |= int::USBRST;
        for n in 1..ENDPOINTS {
            self.ins[n].deactivate();
            self.outs[n].deactivate();
        }
        self.setup = false;
        self.address = 0;
    }

    /// Ends the reset: a full-speed host.
    pub fn enumerated(&mut self) {
        self.gintsts |= int::ENUMDNE;
    }

    /// Begins a frame.
    pub fn start_of_frame(&mut self) {
        self.frame = (self.frame + 1) & 0x3fff;
        self.gintsts |= 1 << 3;
    }

    /// Suspends the bus after 3 ms without activity.
    pub fn suspend(&mut self) {
        self.gintsts |= int::SUSPEND;
    }

    // The registers.

    /// Returns the endpoint and register at an offset from the first endpoint's registers.
    fn endpoint(offset: u32) -> (usize, u32) {
        (offset as usize >> 5, offset & 0x1f)
    }

    /// Reads a register or FIFO, or returns `None` where there is none.
    pub fn read(&mut self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x000 => self.gotgctl,
            0x004 => 0,
            0x008 => self.gahbcfg,
            0x00c => self.gusbcfg,
            // Flushes and resets take no time.
            0x010 => 1 << 31,
            0x014 => self.gintsts(),
            0x018 => self.gintmsk,
            0x01c => self.received.front().map_or(0, |entry| entry.status),
            0x020 => self.pop(),
            0x024 => self.grxfsiz,
            0x028 => self.txf[0],
            0x038 => self.gccfg,
            0x03c => 0x1100,
            0x104..=0x10c => self.txf[(offset as usize - 0x100) / 4],
            0x800 => self.dcfg,
            0x804 => self.dctl,
            // Full speed.
            0x808 => self.frame << 8 | 3 << 1,
            0x810 => self.diepmsk,
            0x814 => self.doepmsk,
            0x818 => self.daint(),
            0x81c => self.daintmsk,
            0x834 => self.diepempmsk,
            0x900..0xb00 => {
                let (n, register) = Self::endpoint(offset - 0x900);
                let depth = self.txf.get(n)? >> 16;
                self.ins.get(n)?.read(n, register, depth)?
            }
            0xb00..0xd00 => {
                let (n, register) = Self::endpoint(offset - 0xb00);
                self.outs.get(n)?.read(n, register)?
            }
            0xe00 => self.pcgcctl,
            0x1000..0x5000 => self.data.pop_front().unwrap_or_else(|| {
                self.misuse = Some("the receive FIFO was read beyond its packet");
                0
            }),
            _ => return None,
        })
    }

    fn pop(&mut self) -> u32 {
        if !self.data.is_empty() {
            self.misuse = Some("a packet's status was read over the rest of another packet");
        }
        let Some(entry) = self.received.pop_front() else {
            self.misuse = Some("the empty receive FIFO was popped");
            return 0;
        };
        self.data = entry.data;
        self.popped(entry.status);
        entry.status
    }

    /// Writes a register or FIFO, or returns `None` where there is none.
    pub fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        match offset {
            0x000 => self.gotgctl = value,
            0x004 => {}
            0x008 => self.gahbcfg = value,
            0x00c => self.gusbcfg = value,
            0x010 => self.command(value),
            0x014 => self.gintsts &= !(value & int::CLEARED),
            0x018 => self.gintmsk = value,
            0x024 => self.grxfsiz = value & 0xffff,
            0x028 => self.txf[0] = value,
            0x038 => self.gccfg = value,
            0x104..=0x10c => self.txf[(offset as usize - 0x100) / 4] = value,
            0x800 => self.dcfg = value,
            0x804 => self.dctl = value,
            0x810 => self.diepmsk = value,
            0x814 => self.doepmsk = value,
            0x81c => self.daintmsk = value,
            0x834 => self.diepempmsk = value,
            0x900..0xb00 => {
                let (n, register) = Self::endpoint(offset - 0x900);
                self.ins.get_mut(n)?.write(register, value)?;
            }
            0xb00..0xd00 => {
                let (n, register) = Self::endpoint(offset - 0xb00);
                self.outs.get_mut(n)?.write(register, value)?;
            }
            0xe00 => self.pcgcctl = value,
            0x1000..0x5000 => {
                let n = offset as usize / 0x1000 - 1;
                if !self.ins[n].load(value, self.txf[n] >> 16) {
                    self.misuse = Some("a transmit FIFO was overfilled");
                }
            }
            _ => return None,
        }
        let fifos = self.txf.iter().map(|txf| (txf & 0xffff) + (txf >> 16));
        if fifos
            .zip(&self.ins)
            .any(|(end, endpoint)| endpoint.is_used() && end > FIFO_WORDS)
        {
            self.misuse = Some("a transmit FIFO lies beyond the memory");
        }
        Some(())
    }

    /// Handles a write to GRSTCTL.
    fn command(&mut self, value: u32) {
        if value & 1 != 0 {
            let kept = (self.gccfg, self.gusbcfg);
            *self = Self::default();
            (self.gccfg, self.gusbcfg) = kept;
        }
        if value & 1 << 4 != 0 {
            self.received.clear();
            self.data.clear();
        }
        if value & 1 << 5 != 0 {
            let which = value >> 6 & 0x1f;
            for (n, endpoint) in self.ins.iter_mut().enumerate() {
                if which == 0x10 || which == n as u32 {
                    endpoint.flush();
                }
            }
        }
    }
}
