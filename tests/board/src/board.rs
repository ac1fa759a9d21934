//! Processor, chip and flash together, on one time base.

mod memory;

use crate::chip::dma::Bus as _;
use crate::chip::fabric::{Fabric, PinChange, RAM_BASE, RAM_LEN};
use crate::chip::flash::Accelerator;
use crate::chip::{Chip, Lines, Surroundings, rcc};
use crate::image::{FLASH_BASE, Image};
use crate::time::Beats;
use memory::{Junction, TimedFlash, Window};
use rsemu::core::space::{AddressSpace, RamStore, Region, RomStore, RomWrite};
use rsemu::cpu::arm::v7m::sys::Exception;
use rsemu::cpu::arm::v7m::{ArmV7m, Config, Regs, xpsr};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use trinocular_rig::random::Random;

/// Address of core-coupled memory, which DMA cannot reach.
const CCM_BASE: u32 = 0x1000_0000;

/// Length of core-coupled memory, bytes.
const CCM_LEN: u32 = 64 * 1024;

/// Address of the boot loader's memory.
const BOOT_LOADER: u32 = 0x1fff_0000;

/// Bytes of a task's header, which holds its state.
const HEADER: u32 = 0x40;

/// Duration of a reset (data sheet, typical).
const RESET_TIME: Beats = 1_500 * crate::time::US;

/// Cycles that the interpreter charges at least for the entry of an exception.
const ENTRY: u64 = 6;

/// Properties of the board that tests choose.
#[derive(Clone, Copy, Debug)]
pub struct Make {
    /// Crystal, watchdog's oscillator, UART's other end.
    pub around: Surroundings,
    /// Processor cycles per cycle of the interpreter, in quarters: 4 is the core's own timing
    /// without wait states.
    pub slowness: u64,
    /// True if flash has its wait states, with the accelerator that hides most of them.
    pub flash_waits: bool,
    /// True if the boot loader's jump started the program: address zero is still the boot loader's
    /// memory, with its vectors.
    pub boot_loader_at_zero: bool,
}

impl Default for Make {
    /// Returns the Olimex STM32-H405.
    fn default() -> Self {
        Self {
            around: Surroundings {
                crystal_hz: 8_000_000,
                lsi_hz: 32_000,
                uart_baud: 921_600,
                seed: 1,
                // An STM32F405, revision Z.
                idcode: 0x2001_6413,
            },
            slowness: 4,
            flash_waits: false,
            boot_loader_at_zero: false,
        }
    }
}

/// Board with power.
pub struct Board {
    cpu: ArmV7m,
    space: Arc<AddressSpace>,
    junction: Arc<Junction>,
    now: Beats,
    next: Beats,
    lines: Lines,
    /// True while the processor stands still, as under a debugger or with a dead clock.
    held: bool,
    /// Moment of the chip's last reset.
    began: Beats,
    /// Number of resets since power-on.
    resets: u32,
    cycle: Beats,
    make: Make,
    /// Time during which the processor was awake.
    busy: Beats,
    /// Number of instructions executed since power-on.
    instructions: u64,
    accelerator: Arc<Mutex<Accelerator>>,
}

impl Board {
    /// Powers on a chip with this program in its flash; memory has arbitrary content. `wire`
    /// connects its pins before that.
    pub fn power_on(image: &Image, make: Make, wire: impl FnOnce(&mut Fabric)) -> Self {
        let mut random = Random::seeded(make.around.seed);
        let mut memory = |length: u32| {
            let ram = Arc::new(RamStore::new(u64::from(length)));
            for at in (0..u64::from(length)).step_by(8) {
                let word = random.next_u64().to_le_bytes();
                ram.write_at(at, &word).expect("it lies in memory");
            }
            ram
        };
        let (ram, core_coupled) = (memory(RAM_LEN), memory(CCM_LEN));
        let mut fabric = Fabric::new(ram.clone());
        wire(&mut fabric);
        fabric.changes.clear();
        let junction = Arc::new(Junction {
            chip: Mutex::new(Chip::new(make.around, fabric)),
            now: AtomicU64::new(0),
            touched: AtomicBool::new(false),
        });
        let space = Arc::new(AddressSpace::new("chip", 32));
        let rom = Arc::new(RomStore::from_slice(&image.flash));
        let flash = |name| Region::rom(name, rom.clone(), RomWrite::Fault);
        // Unique number of the chip, and the size of its flash in KiB.
        let mut identity = [0; 0x20];
        identity[..12].copy_from_slice(b"\x2a\x00\x31\x00\x0d\x51\x34\x35\x39\x39\x36\x31");
        identity[0x12..0x14].copy_from_slice(&1024_u16.to_le_bytes());
        let rom_of = |name, bytes: &[u8]| {
            Region::rom(name, Arc::new(RomStore::from_slice(bytes)), RomWrite::Fault)
        };
        let identity = rom_of("identity", &identity);
        let accelerator = Arc::new(Mutex::new(Accelerator::default()));
        {
            let mut map = space.topology();
            let mut put = |region: Region, base: u32| {
                map.map(region, u64::from(base))
                    .expect("regions do not overlap");
            };
            if make.boot_loader_at_zero {
                let [vectors, code] = boot_loader(image);
                put(rom_of("boot loader's vectors", &vectors), 0);
                put(rom_of("boot loader", &code), BOOT_LOADER);
            } else {
                // BOOT0 is low: flash is at zero, too.
                put(flash("flash at zero"), 0);
            }
            if make.flash_waits {
                let timed = TimedFlash {
                    bytes: image.flash.clone(),
                    accelerator: accelerator.clone(),
                };
                let length = image.flash.len() as u64;
                put(Region::io("flash", length, Arc::new(timed)), FLASH_BASE);
            } else {
                put(flash("flash"), FLASH_BASE);
            }
            put(Region::ram("ccm", core_coupled), CCM_BASE);
            put(Region::ram("sram", ram), RAM_BASE);
            put(identity, 0x1fff_7a10);
            for (base, length) in [
                (0x4000_0000, 0x8_0000),
                (0x5000_0000, 0x6_1000),
                (0xe004_2000, 0x10),
            ] {
                let window = Window {
                    base,
                    junction: junction.clone(),
                };
                put(Region::io("registers", length, Arc::new(window)), base);
            }
        }
        let mut board = Self {
            cpu: processor(&space),
            space,
            junction,
            now: 0,
            next: 0,
            lines: [0; 3],
            held: false,
            began: 0,
            resets: 0,
            cycle: 1,
            make,
            busy: 0,
            instructions: 0,
            accelerator,
        };
        board.look();
        board
    }

    /// Returns the present moment.
    pub fn now(&self) -> Beats {
        self.now
    }

    /// Returns the moment of the chip's last reset, and the number of resets since power-on.
    pub fn last_reset(&self) -> (Beats, u32) {
        (self.began, self.resets)
    }

    /// Returns the time since power-on during which the processor was awake.
    pub fn busy(&self) -> Beats {
        self.busy
    }

    /// Returns the number of instructions executed since power-on.
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// Gives access to the chip from outside.
    pub fn chip<T>(&mut self, act: impl FnOnce(&mut Chip) -> T) -> T {
        let result = {
            let mut chip = self.junction.chip();
            chip.fabric.now = self.now;
            let result = act(&mut chip);
            chip.refresh();
            result
        };
        self.look();
        result
    }

    /// Returns the changes of a port's pins since power-on.
    pub fn changes(&mut self, port: usize) -> Vec<PinChange> {
        self.chip(|chip| {
            let of_port = chip
                .fabric
                .changes
                .iter()
                .filter(|change| change.port == port);
            of_port.copied().collect()
        })
    }

    /// Drives a pin from outside, or (`None`) releases it.
    pub fn drive(&mut self, port: usize, pin: u8, level: Option<bool>) {
        self.chip(|chip| chip.fabric.drive(port, pin, level));
    }

    /// Stops the processor's clock, or restarts it: timers, DMA and watchdog continue.
    pub fn hold(&mut self, held: bool) {
        self.held = held;
    }

    /// Masks all interrupts, like a critical section that never ends.
    pub fn mask_interrupts(&mut self) {
        let mut registers = self.cpu.regs();
        registers.primask = true;
        self.cpu.set_regs(registers);
    }

    /// Disables an interrupt.
    pub fn disable_interrupt(&mut self, number: u16) {
        let exception = Exception(16 + number);
        self.cpu.with_sys(|sys| sys.set_enable(exception, false));
    }

    /// Makes the processor continue at an address of the program, as soon as it is awake.
    pub fn derail(&mut self, address: u32) {
        while self.cpu.is_asleep() {
            self.run_until(self.now + crate::time::US);
        }
        self.cpu.set_pc(address & !1);
    }

    /// Sets the stack pointer of a sleeping processor to its value deep in a recursion.
    pub fn deepen_stack(&mut self, pointer: u32) {
        while !self.cpu.is_asleep() || self.cpu.regs().in_handler() {
            self.run_until(self.now + crate::time::US);
        }
        let registers = self.cpu.regs();
        self.cpu.set_regs(Regs {
            msp: pointer,
            ..registers
        });
    }

    /// Makes the executor believe that a waiting task is queued already, so that it is never polled
    /// again. `pool` is the address of the task's memory, whose header begins with a word that is 1
    /// for a task that exists, and has a further bit while the task is queued.
    ///
    /// # Panics
    /// If the task is not found waiting within a millisecond.
    pub fn kill_task(&mut self, pool: u32) {
        const EXISTS: u32 = 1;
        const QUEUED: u32 = 1 << 8;
        for _ in 0..1_000 {
            let killed = self.chip(|chip| {
                let fabric = &mut chip.fabric;
                let waits = (pool..pool + HEADER)
                    .step_by(4)
                    .find(|at| fabric.load(*at) == Some(EXISTS))?;
                fabric.store(waits, EXISTS | QUEUED)
            });
            if killed.is_some() {
                return;
            }
            self.run_until(self.now + crate::time::US);
        }
        panic!("no waiting task at {pool:#x}");
    }

    /// Writes a word of memory, as a debugger would.
    pub fn poke(&mut self, address: u32, value: u32) {
        let stored = self.chip(|chip| chip.fabric.store(address, value));
        stored.expect("it lies in memory");
    }

    /// Drops the supply below the chip's minimum and restores it so soon that memory is intact.
    pub fn lose_power(&mut self) {
        self.chip(|chip| chip.set_supply(3_300));
        self.reset(rcc::flag::POWER_ON | rcc::flag::BROWN_OUT);
    }

    /// Returns the program counter.
    pub fn program_counter(&self) -> u32 {
        self.cpu.pc()
    }

    /// Returns the processor itself, for tests of its state.
    pub fn cpu(&self) -> &ArmV7m {
        &self.cpu
    }

    /// Pulls the reset pin low for a moment.
    pub fn press_reset(&mut self) {
        self.reset(rcc::flag::PIN);
    }

    fn reset(&mut self, flags: u32) {
        self.junction.chip().fabric.now = self.now;
        self.junction.chip().reset(flags);
        self.cpu = processor(&self.space);
        self.lines = [0; 3];
        self.held = false;
        self.resets += 1;
        self.began = self.now;
        self.now += RESET_TIME;
        self.junction.chip().fabric.now = self.now;
        self.look();
    }

    /// Takes over changes in the chip's registers.
    fn look(&mut self) {
        let (lines, next, cycle, acr) = {
            let chip = self.junction.chip();
            (chip.lines(), chip.next(), chip.cycle(), chip.flash_acr)
        };
        self.next = next.unwrap_or(Beats::MAX);
        self.cycle = cycle;
        if self.make.flash_waits {
            self.accelerator.lock().expect("no model panics").acr = acr;
        }
        for (word, (old, new)) in self.lines.iter().zip(lines).enumerate() {
            let mut changed = old ^ new;
            while changed != 0 {
                let bit = changed.trailing_zeros();
                changed &= changed - 1;
                let number = 32 * word as u16 + bit as u16;
                self.cpu.set_irq(number, new & 1 << bit != 0);
            }
        }
        self.lines = lines;
    }

    /// Advances the chip until `end`, or until it has an event for the processor.
    fn pass(&mut self, end: Beats) {
        let reset = {
            let mut chip = self.junction.chip();
            // An event may lie within the instruction just executed.
            self.now = chip.advance(end).max(self.now);
            chip.reset
        };
        match reset {
            Some(flags) => self.reset(flags),
            None => self.look(),
        }
    }

    /// Executes one instruction, or enters an exception, and works around two faults of rsemu
    /// 0.0.7.
    ///
    /// On exception entry it forgets the progress of an IT block (it stacks xPSR without ITSTATE,
    /// which ARMv7-M keeps), so that the rest of the block runs unconditionally after the return.
    /// Therefore no exception is entered before a block's end: three instructions at most.
    ///
    /// It also clears FPSCR on entry, where ARMv7-M lets the first floating-point instruction of
    /// the handler set five mode bits. Flags of an interrupted comparison would be lost, so they
    /// are restored.
    fn step(&mut self) -> u64 {
        let before = self.cpu.regs();
        let fpscr = self.cpu.fpscr();
        let within_it = before.xpsr & xpsr::IT_MASK != 0;
        if within_it {
            self.cpu.set_regs(Regs {
                primask: true,
                ..before
            });
        }
        let used = self.cpu.step();
        if within_it {
            let after = self.cpu.regs();
            self.cpu.set_regs(Regs {
                primask: before.primask,
                ..after
            });
        } else if used >= ENTRY {
            let after = self.cpu.regs();
            // A return moves the stack pointer up; an entry moves it down, and one exception right
            // after another leaves it.
            let entered = after.exception() != before.exception() && after.msp <= before.msp;
            if entered {
                self.cpu.set_fpscr(fpscr);
            }
        }
        used
    }

    /// Lets time pass until `end`.
    pub fn run_until(&mut self, end: Beats) {
        while self.now < end {
            if self.now >= self.next {
                let now = self.now;
                self.pass(now);
                continue;
            }
            if self.held {
                self.pass(end);
                continue;
            }
            self.junction.now.store(self.now, Relaxed);
            let used = self.step();
            if used == 1 && self.cpu.is_asleep() {
                self.pass(end);
                continue;
            }
            self.instructions += 1;
            let waits = match self.make.flash_waits {
                true => self.accelerator.lock().expect("no model panics").used(used),
                false => 0,
            };
            let took = (used + waits) * self.cycle * self.make.slowness / 4;
            self.busy += took;
            self.now += took;
            if self.junction.touched.swap(false, Relaxed) {
                self.look();
            }
        }
    }
}

/// Returns the memory that ST's boot loader leaves at address zero when it jumps into flash, and
/// its code: all vectors but the first two lead to a loop.
fn boot_loader(image: &Image) -> [Vec<u8>; 2] {
    let handler = (BOOT_LOADER | 1).to_le_bytes();
    let vectors = [&image.flash[..8], &handler.repeat(96)].concat();
    // `b .`
    [vectors, vec![0xfe, 0xe7, 0xfe, 0xe7]]
}

fn processor(space: &Arc<AddressSpace>) -> ArmV7m {
    // Four priority bits (PM0214, the processor's programming manual for this chip).
    let cpu = ArmV7m::new(Config::CORTEX_M4F.with_priority_bits(4));
    cpu.attach_space(space.clone());
    cpu
}
