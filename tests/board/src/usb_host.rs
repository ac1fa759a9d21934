//! USB host with a program: enumerates a CDC-ACM device as Linux does, then carries bytes in both
//! directions.
//!
//! It makes one transaction at a time, each as long as its bits take at 12 Mb/s, and retries
//! refused ones. Toggles follow USB 2.0 section 8.6, so a device with a wrong one loses data here
//! as it would on a wire.

use crate::chip::otg::{Answer, Otg};
use crate::time::{Beats, MS, US};
use std::collections::VecDeque;

/// Debounce time after a device was plugged in (USB 2.0, 7.1.7.3).
const DEBOUNCE: Beats = 100 * MS;
/// Duration of a reset of the bus (7.1.7.5).
const RESET: Beats = 10 * MS;
/// Recovery time from a reset, or from a new address, to the first transfer (9.2.6.2, 9.2.6.3).
const RECOVERY: Beats = 10 * MS;
/// Timeout of a request.
const PATIENCE: Beats = 500 * MS;
/// Time without a frame after which the bus counts as suspended (7.1.7.6).
const SUSPEND: Beats = 3 * MS;
/// Address that the device gets.
const ADDRESS: u8 = 7;
/// Interval between two polls of a bulk endpoint without data.
const POLL: Beats = 50 * US;

/// Returns the duration of a transaction with `bytes` bytes of data: three packets, their sync
/// fields and gaps, and bit stuffing.
fn duration(bytes: usize) -> Beats {
    12 * US + bytes as Beats * 9 * US / 12
}

/// Stage of a control transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Setup,
    Data,
    Status,
}

/// Control transfer.
#[derive(Clone, Debug)]
struct Request {
    setup: [u8; 8],
    out: Vec<u8>,
    /// Data received, or the number of bytes of `out` sent.
    got: Vec<u8>,
    gone: usize,
    stage: Stage,
    toggle: bool,
    deadline: Beats,
}

/// State of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bus {
    Empty,
    /// A device pulls D+ up; the reset begins at this moment.
    Attached(Beats),
    /// The reset ends at this moment.
    Reset(Beats),
    Running,
}

/// Descriptors of the device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Descriptors {
    /// Device descriptor.
    pub device: Vec<u8>,
    /// Configuration descriptor, with interfaces and endpoints.
    pub configuration: Vec<u8>,
    /// Manufacturer, product, serial number.
    pub strings: Vec<String>,
}

/// The host.
#[derive(Clone, Debug)]
pub struct UsbHost {
    plugged: bool,
    bus: Bus,
    address: u8,
    requests: VecDeque<Request>,
    /// Moment before which the host does nothing.
    wait: Beats,
    next_frame: Beats,
    /// Moment of the last frame at the device, until the device is suspended.
    last_frame: Option<Beats>,
    /// Toggles of bulk IN and OUT.
    toggles: [bool; 2],
    /// Endpoints of the data interface: IN and OUT.
    bulk: [usize; 2],
    /// True once the device is enumerated and the port opened.
    open: bool,
    outgoing: VecDeque<u8>,
    /// Packet that is sent again until the device takes it.
    packet: Option<Vec<u8>>,
    ask_first: bool,
    /// Descriptors of the device.
    pub descriptors: Descriptors,
    /// Bytes received, each with its moment.
    pub received: Vec<(Beats, u8)>,
    /// Failed requests, with their reasons.
    pub failures: Vec<String>,
}

impl Default for UsbHost {
    fn default() -> Self {
        Self {
            plugged: false,
            bus: Bus::Empty,
            address: 0,
            requests: VecDeque::new(),
            wait: 0,
            next_frame: 0,
            last_frame: None,
            toggles: [false; 2],
            bulk: [0; 2],
            open: false,
            outgoing: VecDeque::new(),
            packet: None,
            ask_first: false,
            descriptors: Descriptors::default(),
            received: Vec::new(),
            failures: Vec::new(),
        }
    }
}

/// Returns a request from the host to the device: type, request, value, index.
fn request(kind: u8, number: u8, value: u16, index: u16, length: u16, out: &[u8]) -> Request {
    let ([v0, v1], [i0, i1], [l0, l1]) = (
        value.to_le_bytes(),
        index.to_le_bytes(),
        length.to_le_bytes(),
    );
    Request {
        setup: [kind, number, v0, v1, i0, i1, l0, l1],
        out: out.to_vec(),
        got: Vec::new(),
        gone: 0,
        stage: Stage::Setup,
        toggle: true,
        deadline: Beats::MAX,
    }
}

const GET_DESCRIPTOR: u8 = 6;
const SET_ADDRESS: u8 = 5;
const SET_CONFIGURATION: u8 = 9;
const SET_LINE_CODING: u8 = 0x20;
const SET_CONTROL_LINE_STATE: u8 = 0x22;

impl UsbHost {
    /// Plugs the device in.
    pub fn plug(&mut self) {
        self.plugged = true;
    }

    /// Unplugs the device: data in flight are lost.
    pub fn unplug(&mut self) {
        self.plugged = false;
        self.forget();
    }

    fn forget(&mut self) {
        self.bus = Bus::Empty;
        self.address = 0;
        self.requests.clear();
        self.open = false;
        self.outgoing.clear();
        self.packet = None;
        self.toggles = [false; 2];
    }

    /// Returns true if the program has its port open, with DTR on.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// Writes bytes of the program.
    pub fn write(&mut self, bytes: &[u8]) {
        self.outgoing.extend(bytes);
    }

    /// Returns the number of bytes that the program wrote and the device has not taken.
    pub fn unsent(&self) -> usize {
        self.outgoing.len() + self.packet.as_ref().map_or(0, Vec::len)
    }

    /// Returns the moment of the next action.
    pub fn next(&self, otg: &Otg) -> Option<Beats> {
        let silence = self
            .last_frame
            .filter(|_| self.bus != Bus::Running)
            .map(|at| at + SUSPEND);
        let bus = match self.bus {
            Bus::Empty => (self.plugged && otg.pulls_up()).then_some(0),
            Bus::Attached(at) | Bus::Reset(at) => Some(at),
            Bus::Running if !otg.pulls_up() => Some(0),
            Bus::Running => Some(self.next_frame.min(self.wait)),
        };
        bus.into_iter().chain(silence).min()
    }

    /// Executes the action that is due.
    pub fn act(&mut self, now: Beats, otg: &mut Otg) {
        if self.bus != Bus::Running && self.last_frame.is_some_and(|at| at + SUSPEND <= now) {
            self.last_frame = None;
            otg.suspend();
        }
        match self.bus {
            Bus::Empty if self.plugged && otg.pulls_up() => {
                self.bus = Bus::Attached(now + DEBOUNCE)
            }
            Bus::Empty => {}
            Bus::Attached(_) | Bus::Reset(_) | Bus::Running if !otg.pulls_up() => self.forget(),
            Bus::Attached(at) if at <= now => {
                self.bus = Bus::Reset(now + RESET);
                otg.bus_reset();
            }
            Bus::Reset(at) if at <= now => {
                otg.enumerated();
                self.bus = Bus::Running;
                self.wait = now + RECOVERY;
                self.next_frame = now;
                self.requests = [
                    request(0x80, GET_DESCRIPTOR, 0x0100, 0, 64, &[]),
                    request(0, SET_ADDRESS, ADDRESS.into(), 0, 0, &[]),
                    request(0x80, GET_DESCRIPTOR, 0x0100, 0, 18, &[]),
                    request(0x80, GET_DESCRIPTOR, 0x0200, 0, 9, &[]),
                ]
                .into();
            }
            Bus::Running => {
                if self.next_frame <= now {
                    self.next_frame += MS;
                    self.last_frame = Some(now);
                    otg.start_of_frame();
                }
                if self.wait <= now {
                    self.wait = now + self.transact(now, otg);
                }
            }
            _ => {}
        }
    }

    /// Makes one transaction. Returns the moment until which the bus is busy.
    fn transact(&mut self, now: Beats, otg: &mut Otg) -> Beats {
        if let Some(mut request) = self.requests.pop_front() {
            let (busy, done) = self.control(now, otg, &mut request);
            match done {
                None => self.requests.push_front(request),
                Some(Ok(())) => return busy + self.finish(&request),
                Some(Err(how)) => self.failures.push(format!("{:02x?}: {how}", request.setup)),
            }
            return busy;
        }
        if !self.open {
            return MS;
        }
        self.ask_first = !self.ask_first;
        if self.ask_first || self.unsent() == 0 {
            self.ask(now, otg)
        } else {
            self.tell(otg)
        }
    }

    /// Makes one step of a control transfer.
    fn control(
        &self,
        now: Beats,
        otg: &mut Otg,
        request: &mut Request,
    ) -> (Beats, Option<Result<(), &'static str>>) {
        request.deadline = request.deadline.min(now + PATIENCE);
        if now > request.deadline {
            return (0, Some(Err("no end in time")));
        }
        let length = u16::from_le_bytes([request.setup[6], request.setup[7]]).into();
        let inwards = request.setup[0] & 0x80 != 0;
        let (busy, answer) = match (request.stage, inwards) {
            (Stage::Setup, _) => (duration(8), otg.setup(self.address, request.setup)),
            (Stage::Data, true) | (Stage::Status, false) => {
                let answer = otg.enter(self.address, 0);
                let bytes = if let Answer::Data(_, bytes) = &answer {
                    bytes.len()
                } else {
                    0
                };
                (duration(bytes), answer)
            }
            (Stage::Data, false) => {
                let piece = &request.out[request.gone..request.out.len().min(request.gone + 64)];
                (
                    duration(piece.len()),
                    otg.out(self.address, 0, request.toggle, piece),
                )
            }
            (Stage::Status, true) => (duration(0), otg.out(self.address, 0, true, &[])),
        };
        let done = match answer {
            Answer::Nothing | Answer::Nak => None,
            Answer::Stall => Some(Err("stall")),
            Answer::Ack => match request.stage {
                Stage::Setup => {
                    request.stage = if length == 0 {
                        Stage::Status
                    } else {
                        Stage::Data
                    };
                    None
                }
                Stage::Data => {
                    request.gone = request.out.len().min(request.gone + 64);
                    request.toggle = !request.toggle;
                    if request.gone == request.out.len() {
                        request.stage = Stage::Status;
                    }
                    None
                }
                Stage::Status => Some(Ok(())),
            },
            Answer::Data(toggle, bytes) => match request.stage {
                Stage::Status if toggle && bytes.is_empty() => Some(Ok(())),
                Stage::Status => Some(Err("a status stage is an empty DATA1")),
                _ if toggle != request.toggle => Some(Err("a data stage has the wrong toggle")),
                _ => {
                    request.toggle = !request.toggle;
                    request.got.extend_from_slice(&bytes);
                    if bytes.len() < 64 || request.got.len() >= length {
                        request.stage = Stage::Status;
                    }
                    None
                }
            },
        };
        (busy, done)
    }

    /// Applies a request that succeeded. Returns the time to wait after it.
    fn finish(&mut self, done: &Request) -> Beats {
        let value = u16::from_le_bytes([done.setup[2], done.setup[3]]);
        match (done.setup[1], value) {
            (SET_ADDRESS, _) => {
                self.address = ADDRESS;
                return RECOVERY;
            }
            (GET_DESCRIPTOR, 0x0100) => self.descriptors.device = done.got.clone(),
            (GET_DESCRIPTOR, 0x0200) if done.got.len() == 9 => {
                let whole = u16::from_le_bytes([done.got[2], done.got[3]]);
                self.requests
                    .push_back(request(0x80, GET_DESCRIPTOR, 0x0200, 0, whole, &[]));
            }
            (GET_DESCRIPTOR, 0x0200) => {
                self.descriptors.configuration = done.got.clone();
                self.descriptors.strings.clear();
                for index in
                    [14, 15, 16].map(|at| self.descriptors.device.get(at).copied().unwrap_or(0))
                {
                    let string = request(
                        0x80,
                        GET_DESCRIPTOR,
                        0x0300 | u16::from(index),
                        0x0409,
                        255,
                        &[],
                    );
                    self.requests.push_back(string);
                }
                let configuration = done.got.get(5).copied().unwrap_or(0);
                self.requests.push_back(request(
                    0,
                    SET_CONFIGURATION,
                    configuration.into(),
                    0,
                    0,
                    &[],
                ));
            }
            (GET_DESCRIPTOR, _) => {
                let units = done.got.get(2..).unwrap_or_default().chunks_exact(2);
                let units: Vec<u16> = units
                    .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
                    .collect();
                self.descriptors
                    .strings
                    .push(String::from_utf16_lossy(&units));
            }
            (SET_CONFIGURATION, _) => {
                self.bulk = self.data_endpoints();
                self.toggles = [false; 2];
                // The program opens the port: 921,600 baud, 8N1, then DTR and RTS.
                let coding = [0x00, 0x10, 0x0e, 0x00, 0, 0, 8];
                self.requests
                    .push_back(request(0x21, SET_LINE_CODING, 0, 0, 7, &coding));
                self.requests
                    .push_back(request(0x21, SET_CONTROL_LINE_STATE, 3, 0, 0, &[]));
            }
            (SET_CONTROL_LINE_STATE, lines) => self.open = lines & 1 != 0,
            _ => {}
        }
        0
    }

    /// Returns the bulk endpoints IN and OUT, from the configuration's endpoint descriptors.
    fn data_endpoints(&self) -> [usize; 2] {
        let mut found = [0; 2];
        let mut rest = &self.descriptors.configuration[..];
        while let [length, kind, ..] = *rest {
            let Some((descriptor, after)) = rest.split_at_checked(usize::from(length.max(2)))
            else {
                break;
            };
            if let (5, [_, _, address, attributes, ..]) = (kind, descriptor)
                && attributes & 3 == 2
            {
                found[usize::from(address & 0x80 == 0)] = usize::from(address & 0xf);
            }
            rest = after;
        }
        found
    }

    /// Polls the bulk IN endpoint.
    fn ask(&mut self, now: Beats, otg: &mut Otg) -> Beats {
        match otg.enter(self.address, self.bulk[0]) {
            Answer::Data(toggle, bytes) => {
                let busy = duration(bytes.len());
                if toggle == self.toggles[0] {
                    self.toggles[0] = !toggle;
                    self.received
                        .extend(bytes.iter().map(|byte| (now + busy, *byte)));
                } else {
                    self.failures.push("bulk IN: wrong toggle".to_owned());
                }
                busy
            }
            Answer::Stall => {
                self.failures.push("bulk IN: stall".to_owned());
                MS
            }
            _ => POLL,
        }
    }

    /// Sends the program's next packet to the bulk OUT endpoint.
    fn tell(&mut self, otg: &mut Otg) -> Beats {
        let packet = self.packet.take().unwrap_or_else(|| {
            let length = self.outgoing.len().min(64);
            self.outgoing.drain(..length).collect()
        });
        let busy = duration(packet.len());
        match otg.out(self.address, self.bulk[1], self.toggles[1], &packet) {
            Answer::Ack => self.toggles[1] = !self.toggles[1],
            Answer::Stall => self.failures.push("bulk OUT: stall".to_owned()),
            _ => self.packet = Some(packet),
        }
        busy
    }
}
