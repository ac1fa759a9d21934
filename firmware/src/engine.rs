//! Step engine: converts segments to port words, which reach the pins without the processor.
//!
//! ```text
//!  TIM8 update ---> DMA2 stream 1 ("player") : ring[n] -> BSRR of the step port
//!  TIM8 compare 1 -> DMA2 stream 2 ("eraser") : idle word -> ring[n], half a word later
//! ```
//!
//! TIM8 overflows once per word. Each overflow makes the player copy the next word of the ring into
//! the port's set/reset register, so an edge lies where the timer puts it. The remaining jitter is
//! the time in which the bus matrix grants the DMA its transfer, some tens of ns.
//!
//! # Why old words cannot be replayed
//! A circular DMA never stops, and would play the last millisecond of motion again and again if the
//! refill stopped. Here a second stream runs half a word behind the first and overwrites each
//! played word with the *idle word*, which lowers the STEP pins and can raise none. Events of the
//! same timer start both streams, so the eraser never lags by more than one word and needs no
//! software at all: each written word is played at most once. When the processor stops writing, for
//! any reason, the ring runs dry within its remaining words (at most 1 ms of motion, [`LEAD`]
//! blocks and the one that was filled), and from then on every word is the idle word.
//!
//! | event | end of the steps |
//! |---|---|
//! | the refill stalls, interrupts stay masked, the processor hangs | the eraser; then the watchdog's reset |
//! | panic, hard fault | the handler stops TIM8; if even that fails, the eraser |
//! | the emergency stop's second contact opens | the gate stops TIM8 in hardware; `check` detects it and stops TIM8 until a restart |
//! | a debugger halts the processor | TIM8 freezes with it (DBGMCU); without that, the eraser |
//! | a stream dies (transfer error), or loses a request | `check` detects it at the next segment, 250 µs later, and stops TIM8 |
//! | reset | the pins become inputs; the drivers' enable lines have their own pull-ups |
//!
//! So a single failure, of the processor or of a stream, makes no step that was not planned. (The
//! processor detects a failure of the eraser alone; only both failing within the same 250 µs would
//! replay.)
//!
//! The alternatives were a second timer that counts words and gates TIM8, and TIM8 in one-pulse
//! mode with its repetition counter. Both stop the timer at a count that software must advance in
//! time, one write away from an error at each wrap, and both lose the time base on a stop. Erasing
//! keeps it: after an underrun the next word is still played at its time.
//!
//! # Blocks
//! A segment of the machine is a *block* of 250 words; the ring holds five. Block `b` is played
//! from `b` times 250 µs after the engine's start. A segment that the machine hands out during
//! block `b` becomes block `b + 3`, whose first word comes 750 µs after the segment was due: that
//! is the machine's `delay_us`. A segment that comes later than its block is an underrun: the
//! engine plays nothing more until the machine has detected it (words are not emitted), faulted,
//! and come to rest.

use crate::board::{CAMERA_PIN, GATE, Hardware, STEP_PINS, STEP_PORT, WORD_RATE};
use crate::pins::{self, IDLE_WORD};
use crate::watch;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering::Relaxed, fence};
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::{Dir, Pl, Size};
use embassy_stm32::pac::timer::vals::{Ckd, Etp, FilterValue, Sms, Ts};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::Instant;
use trinocular_core::machine::SEGMENT_US;
use trinocular_core::steps::{AxisMotion, CameraEdges, CameraPin, Generator, Segment};

/// Clock of TIM8, Hz: twice APB2.
const TIMER_HZ: u32 = 168_000_000;

/// Timer counts per word.
const PERIOD: u32 = TIMER_HZ / WORD_RATE.hz();
const _: () =
    assert!(TIMER_HZ.is_multiple_of(WORD_RATE.hz()) && PERIOD >= 16 && PERIOD <= 0x1_0000);

/// Words per segment.
pub const BLOCK: usize = WORD_RATE.slots_per_segment() as usize * 2;

/// Blocks in the ring.
const BLOCKS: u64 = 5;

/// Blocks between the one being played when a segment is due and the segment's own: the time that
/// the machine has for a tick. With the segment itself that is 1 ms of motion, the most that may be
/// queued.
const LEAD: u64 = 3;
const _: () = assert!(LEAD + 2 <= BLOCKS && (LEAD + 1) * SEGMENT_US <= 1000);

/// Delay from a segment's due time to its first word, µs.
pub const DELAY_US: u32 = LEAD as u32 * SEGMENT_US as u32;

const RING: usize = BLOCK * BLOCKS as usize;
const _: () = assert!(RING <= 0xffff, "a stream counts to 65535");

/// Least time before the start of a block in which it may still be written, µs: the player could
/// overtake.
const MARGIN_US: u64 = 30;

/// Time of a slot, µs.
const SLOT_US: u64 = 1_000_000 / WORD_RATE.slots_per_s() as u64;
const _: () = assert!(SLOT_US * WORD_RATE.slots_per_s() as u64 == 1_000_000);

/// Last part of the wait at the start, with interrupts masked, µs.
const UNDISTURBED_US: u64 = 10;

/// Largest distance of the player from its place by time, words.
const SLIP: usize = 2;

/// Ring of words between processor and DMA.
static WORDS: [AtomicU32; RING] = [const { AtomicU32::new(0) }; RING];

/// Word that the eraser writes.
static ERASED: AtomicU32 = AtomicU32::new(IDLE_WORD);

static SEGMENTS: Channel<CriticalSectionRawMutex, (Segment, [bool; 3], CameraEdges), 2> =
    Channel::new();

/// Instant at which the last planned word is emitted: low half of the station's clock, µs.
static END: AtomicU32 = AtomicU32::new(0);

/// Present [`EngineFault`], or 0.
static ENGINE_FAULT: AtomicU8 = AtomicU8::new(0);

/// True while the emergency stop suppresses motion: words are erased instead of written, until
/// [`resume`].
static SUPPRESSED: AtomicBool = AtomicBool::new(false);

static RESTART: AtomicBool = AtomicBool::new(false);

/// Word that gives the camera pin its level at rest.
static CAMERA_REST: AtomicU32 = AtomicU32::new(0);

/// Number of times that planned triggers were lost.
static TRIGGER_LOSSES: AtomicU32 = AtomicU32::new(0);

/// Reason for which the engine plays nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum EngineFault {
    /// A segment with motion came too late.
    Late = 1,
    /// A segment came before there was room.
    Early = 2,
    /// The generator refused a segment.
    Refused = 3,
    /// A stream stopped, or is not at its place by time.
    Stream = 4,
}

fn player() -> pac::dma::St {
    pac::DMA2.st(1)
}

fn eraser() -> pac::dma::St {
    pac::DMA2.st(2)
}

/// Channel of both requests (RM0090, table "DMA2 request mapping").
const REQUEST: u8 = 7;

/// Converts segments to words as they come.
#[embassy_executor::task]
pub async fn run(_hardware: Hardware) {
    let Ok(generator) = Generator::new(STEP_PINS) else {
        panic!("board.rs: STEP and DIR pins")
    };
    let camera = CAMERA_PIN.map(|pin| CameraPin::new(pin, &STEP_PINS));
    let Ok(camera) = camera.transpose() else {
        panic!("board.rs: camera pin")
    };
    let mut engine = Engine {
        generator,
        camera,
        began_us: 0,
        playing: Block::default(),
        next: 0,
        motion_end: 0,
    };
    engine.start();
    loop {
        let (segment, invert, edges) = SEGMENTS.receive().await;
        // With the gate open the timer does not run, and each start would wait for it.
        if !pins::gate_is_open() && RESTART.swap(false, Relaxed) {
            note!("step engine: restart after {}", ENGINE_FAULT.load(Relaxed));
            engine.start();
        }
        engine.feed(&segment, invert);
        engine.trigger(&edges);
        watch::alive(watch::Task::Step);
    }
}

struct Engine {
    generator: Generator,
    camera: Option<CameraPin>,
    /// Instant at which block 0 began, µs.
    began_us: u64,
    /// Block that is being played.
    playing: Block,
    /// Block of the next segment.
    next: u64,
    /// Number of the last block with motion, plus one.
    motion_end: u64,
}

/// Block on its way to the pins. Kept from segment to segment, because divisions of 64 bits are
/// slow.
#[derive(Clone, Copy, Default)]
struct Block {
    number: u64,
    /// Index of its first word in the ring.
    place: usize,
    /// Instant at which it begins, µs.
    at_us: u64,
}

impl Block {
    /// Returns the block in which `now` lies.
    fn at(self, now: u64) -> Self {
        const SEGMENT: u32 = SEGMENT_US as u32;
        let later = u32::try_from(now.saturating_sub(self.at_us)).unwrap_or(u32::MAX);
        self.after(later / SEGMENT)
    }

    /// Returns the block `blocks` later.
    fn after(self, blocks: u32) -> Self {
        Self {
            number: self.number.saturating_add(blocks.into()),
            place: (self.place + (blocks % BLOCKS as u32) as usize * BLOCK) % RING,
            at_us: self.at_us.saturating_add(u64::from(blocks) * SEGMENT_US),
        }
    }
}

impl Engine {
    /// Starts timer and streams on an empty ring, at a multiple of 250 µs of the station's clock,
    /// as segments are due.
    fn start(&mut self) {
        // Registers without a clock cannot be written.
        pac::RCC.apb2enr().modify(|w| w.set_tim8en(true));
        pac::RCC.ahb1enr().modify(|w| w.set_dma2en(true));
        stop();
        // Triggers that are still in the ring are lost.
        lose_triggers();
        for word in &WORDS {
            word.store(IDLE_WORD, Relaxed);
        }
        prepare_timer();
        prepare_streams();
        // Once per start, at most 270 µs, during which nothing is played. The last part runs with
        // interrupts masked, because `check` compares by the word.
        let began_us =
            (Instant::now().as_micros() + UNDISTURBED_US) / SEGMENT_US * SEGMENT_US + SEGMENT_US;
        while Instant::now().as_micros() + UNDISTURBED_US < began_us {}
        cortex_m::interrupt::free(|_| {
            while Instant::now().as_micros() < began_us {}
            pac::TIM8.cr1().modify(|w| w.set_cen(true));
        });
        self.began_us = began_us;
        self.playing = Block {
            at_us: began_us,
            ..Block::default()
        };
        self.next = LEAD;
        self.motion_end = 0;
        self.generator.forget_directions();
        ENGINE_FAULT.store(0, Relaxed);
        self.publish();
    }

    fn block_start(&self, block: u64) -> u64 {
        self.began_us
            .saturating_add(block.saturating_mul(SEGMENT_US))
    }

    /// Converts a segment to the words of its block.
    fn feed(&mut self, segment: &Segment, invert: [bool; 3]) {
        let now = Instant::now().as_micros();
        self.playing = self.playing.at(now);
        let playing = self.playing.number;
        let stands = ENGINE_FAULT.load(Relaxed) == EngineFault::Stream as u8;
        if !stands && !check(self.playing) {
            stop();
            lose_triggers();
            ENGINE_FAULT.store(EngineFault::Stream as u8, Relaxed);
        }
        let rest = segment.axes().iter().all(AxisMotion::is_rest);
        if rest {
            // Idle words are in the ring already, so a pause may lie anywhere: it brings the blocks
            // back to their place in time.
            self.next = self.motion_end.max(playing.saturating_add(LEAD));
        } else if now.saturating_add(MARGIN_US) > self.block_start(self.next) {
            self.fail(EngineFault::Late);
        } else if self.next >= playing.saturating_add(BLOCKS) {
            self.fail(EngineFault::Early);
        }
        let block = self.next;
        self.next = block.saturating_add(1);
        let silent = rest || ENGINE_FAULT.load(Relaxed) != 0 || SUPPRESSED.load(Relaxed);
        if !silent {
            self.motion_end = self.next;
        }
        if ENGINE_FAULT.load(Relaxed) != 0 || SUPPRESSED.load(Relaxed) {
            // Erased words may have been the ones that write DIR.
            self.generator.forget_directions();
        }
        // The generator always runs, so that its count stays the sum of all segments.
        self.generator.set_invert(invert);
        if self.generator.load(segment).is_err() {
            self.generator.halt();
            self.fail(EngineFault::Refused);
            return;
        }
        if silent {
            // The ring holds idle words only.
            self.generator.skip();
        } else {
            // Less than BLOCKS ahead, by the check above.
            let from = self
                .playing
                .after(block.saturating_sub(playing) as u32)
                .place;
            let places = WORDS.get(from..from + BLOCK).unwrap_or_default();
            self.generator.play(places);
        }
        // All words are in memory before the task goes to sleep.
        fence(core::sync::atomic::Ordering::SeqCst);
        self.publish();
    }

    /// Writes the edges of the camera pin into the ring, at their place by time: where a segment
    /// with motion was late, its block is another one.
    ///
    /// Only second words of slots have such edges, and nothing else, so that a fault of the motion
    /// does not end the triggers.
    fn trigger(&mut self, edges: &CameraEdges) {
        let Some(camera) = self.camera else { return };
        let (begin, end) = (camera.begin(edges.active_low), camera.end(edges.active_low));
        CAMERA_REST.store(end, Relaxed);
        for (slot, bits) in [(edges.end, end), (edges.begin, begin)] {
            let Some(slot) = slot else { continue };
            let at = edges.from.plus_micros(u64::from(slot) * SLOT_US);
            let in_time = self.put(at.micros(), IDLE_WORD | bits);
            if !in_time {
                lose_triggers();
            }
            if !in_time && bits == end {
                // The pulse has begun: it ends as soon as it can.
                let soon = Instant::now().as_micros().saturating_add(2 * MARGIN_US);
                self.put(soon, IDLE_WORD | bits);
            }
        }
    }

    /// Writes the second word of the slot at `at_us`. Returns false if it cannot be played then.
    fn put(&self, at_us: u64, bits: u32) -> bool {
        let soon = Instant::now().as_micros().saturating_add(MARGIN_US);
        let ahead_us = at_us.saturating_sub(self.playing.at_us);
        let far_us = SEGMENT_US * (BLOCKS - 1);
        let stands = ENGINE_FAULT.load(Relaxed) == EngineFault::Stream as u8;
        if stands || at_us <= soon || ahead_us >= far_us {
            return false;
        }
        let word = words(ahead_us as u32) | 1;
        let place = self.playing.place.saturating_add(word) % RING;
        if let Some(place) = WORDS.get(place) {
            place.store(bits, Relaxed);
        }
        true
    }

    /// Erases the queue and plays nothing more until a restart.
    fn fail(&mut self, fault: EngineFault) {
        if ENGINE_FAULT.load(Relaxed) == 0 {
            ENGINE_FAULT.store(fault as u8, Relaxed);
            erase();
        }
    }

    fn publish(&self) {
        END.store(self.block_start(self.next) as u32, Relaxed);
    }
}

/// Stops the timer, and with it every edge. Callable from any context, also from a panic.
pub fn stop() {
    pac::TIM8.cr1().modify(|w| w.set_cen(false));
    STEP_PORT
        .bsrr()
        .write(|w| w.0 = IDLE_WORD | CAMERA_REST.load(Relaxed));
}

/// Notes that the triggers on their way are lost; the machine counts them.
fn lose_triggers() {
    TRIGGER_LOSSES.fetch_add(1, Relaxed);
}

/// Returns the number of times that planned triggers were lost, modulo 2^32.
pub fn trigger_losses() -> u32 {
    TRIGGER_LOSSES.load(Relaxed)
}

/// Suppresses all motion at once, for the emergency stop. The machine sees the stop at its next
/// tick.
pub fn suppress() {
    SUPPRESSED.store(true, Relaxed);
    erase();
}

/// Plays again from now on. Called when the machine is at rest.
pub fn resume() {
    SUPPRESSED.store(false, Relaxed);
    if ENGINE_FAULT.load(Relaxed) != 0 {
        RESTART.store(true, Relaxed);
    }
}

/// Overwrites the first word of every slot of the ring, beginning with the next one to be played.
/// The second words lower STEP in any case, and may trigger cameras.
fn erase() {
    let next = RING.saturating_sub(usize::from(player().ndtr().read().ndt())) & !1;
    let (played, ahead) = WORDS.split_at(next.min(RING));
    for word in ahead.iter().step_by(2).chain(played.iter().step_by(2)) {
        word.store(IDLE_WORD, Relaxed);
    }
}

/// Queues a segment. Returns false when it has no place, which [`room`] shows beforehand.
pub fn give(segment: Segment, invert: [bool; 3], edges: CameraEdges) -> bool {
    SEGMENTS.try_send((segment, invert, edges)).is_ok()
}

/// Returns the number of words that can be queued now.
pub fn room() -> usize {
    // The engine's executor has the higher priority: an empty channel means that END is up to date.
    let queued = queued_us() / SEGMENT_US as u32;
    if SEGMENTS.is_empty() && u64::from(queued) < BLOCKS - 1 {
        BLOCK
    } else {
        0
    }
}

/// Returns the time of the planned words that are not on the pins yet, µs.
pub fn queued_us() -> u32 {
    let now = Instant::now().as_micros() as u32;
    END.load(Relaxed).wrapping_sub(now).cast_signed().max(0) as u32
}

/// Returns true if the engine plays the segments that it gets.
pub fn plays() -> bool {
    ENGINE_FAULT.load(Relaxed) == 0 && !RESTART.load(Relaxed)
}

fn prepare_timer() {
    let timer = pac::TIM8;
    if let Some(gate) = GATE {
        // The slowest filter: 8 samples at 168 MHz / 4 / 32, 6 µs.
        timer.cr1().modify(|w| w.set_ckd(Ckd::DIV4));
        timer.smcr().write(|w| {
            w.set_etf(FilterValue::FDTS_DIV32_N8);
            w.set_etp(match gate.active_high {
                true => Etp::NOT_INVERTED,
                false => Etp::INVERTED,
            });
            w.set_ts(Ts::ETRF);
            w.set_sms(Sms::GATED_MODE);
        });
    }
    timer.dier().write(|_| {});
    timer.psc().write_value(0);
    // PERIOD fits, by the assertion above.
    timer.arr().write(|w| w.set_arr((PERIOD - 1) as u16));
    timer.ccr(0).write(|w| w.set_ccr((PERIOD / 2) as u16));
    timer.rcr().write(|_| {});
    timer.egr().write(|w| w.set_ug(true));
    timer.sr().write(|_| {});
    // Past the compare value, so that the first event is the player's.
    timer
        .cnt()
        .write(|w| w.set_cnt((PERIOD / 2 + PERIOD / 4) as u16));
    timer.dier().write(|w| {
        w.set_ude(true);
        w.set_ccde(0, true);
    });
}

fn prepare_streams() {
    for stream in [player(), eraser()] {
        stream.cr().modify(|w| w.set_en(false));
        // Wait for the end of a transfer in progress: some cycles.
        while stream.cr().read().en() {}
        stream.fcr().write(|_| {}); // direct mode
        stream.ndtr().write(|w| w.set_ndt(RING as u16));
        // As unsafe as a raw pointer: the stream reads and writes RING words from here on, unknown
        // to the compiler. It is sound because WORDS has that many, is static, and consists of
        // atomics.
        stream.m0ar().write_value(WORDS.as_ptr() as u32);
    }
    // All flags of streams 0 to 3; streams 0 and 3 are not used.
    pac::DMA2.ifcr(0).write(|w| w.0 = 0x0f7d_0f7d);
    player().par().write_value(STEP_PORT.bsrr().as_ptr() as u32);
    eraser().par().write_value(ERASED.as_ptr() as u32);
    for (stream, direction, priority) in [
        (player(), Dir::MEMORY_TO_PERIPHERAL, Pl::VERY_HIGH),
        (eraser(), Dir::PERIPHERAL_TO_MEMORY, Pl::HIGH),
    ] {
        stream.cr().write(|w| {
            w.set_chsel(REQUEST);
            w.set_dir(direction);
            w.set_circ(true);
            w.set_minc(true);
            w.set_msize(Size::BITS32);
            w.set_psize(Size::BITS32);
            w.set_pl(priority);
        });
        stream.cr().modify(|w| w.set_en(true));
    }
}

/// Returns the number of words in a time of at most a second, µs.
pub const fn words(us: u32) -> usize {
    const PER_MS: u32 = WORD_RATE.hz() / 1_000;
    let us = if us < 1_000_000 { us } else { 1_000_000 };
    (us * PER_MS / 1_000) as usize
}

/// Returns true if both streams run, the player is at its place by time, and the eraser is right
/// behind it.
fn check(playing: Block) -> bool {
    let (now, played, erased, running) = cortex_m::interrupt::free(|_| {
        (
            Instant::now().as_micros(),
            player().ndtr().read().ndt(),
            eraser().ndtr().read().ndt(),
            player().cr().read().en() && eraser().cr().read().en(),
        )
    });
    // A stream counts down; a count of 0 means the same as RING.
    let at = |left: u16| RING.saturating_sub(usize::from(left)) % RING;
    let expected = (playing.place + words(now.saturating_sub(playing.at_us) as u32)) % RING;
    let slip = (at(played) + RING + SLIP - expected) % RING;
    // The eraser follows within a word, and a word may pass between the two readings.
    let behind = (at(played) + RING + 1 - at(erased)) % RING;
    running && slip <= 2 * SLIP && behind <= 2
}
