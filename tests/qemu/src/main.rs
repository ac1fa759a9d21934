//! The station on an emulated Cortex-M4.
//!
//! QEMU has no timers, ports or DMA of any STM32, so the board's firmware cannot run there. This
//! image runs the essential parts on Arm's `mps2-an386` instead: the same machine and the same step
//! generator, compiled for the same processor, behind a UART.
//!
//! The first semihosting argument selects the mode:
//!
//! | arguments | action |
//! |---|---|
//! | `live [TRACE]` | a station on UART0, on the emulated clock; its trace goes to the file |
//! | `replay LOG TRACE [MICROSECONDS]` | runs through a recorded log on virtual time; prints all edges of the segment handed out at that instant |
//! | `bench` | counts instructions (needs `-icount shift=3`) and stack |
//!
//! `live` never ends; the others exit with 0 on success.
#![no_std]
#![no_main]

mod bench;
mod board;
mod count;
mod executor;
mod interrupts;
mod live;
mod port_log;
mod registers;
mod replay;
mod stack;
mod time;
mod uart;

use core::ffi::CStr;
use semihosting::process::ExitCode;
use semihosting::{eprintln, experimental::env};

/// Longest command line: two paths and some options.
const COMMAND_LINE: usize = 1024;

#[cortex_m_rt::entry]
fn main() -> ! {
    match start() {
        Ok(()) => ExitCode::SUCCESS.exit_process(),
        Err(failure) => {
            eprintln!("{}", failure.0);
            ExitCode::FAILURE.exit_process()
        }
    }
}

/// Reason for an abort, in words.
struct Failure(&'static str);

fn start() -> Result<(), Failure> {
    let arguments =
        env::args::<COMMAND_LINE>().map_err(|_| Failure("the command line is too long"))?;
    let mut words = arguments.into_iter().flatten();
    match words.next() {
        Some("live") => live::run(words.next().map(Path::new).transpose()?),
        Some("replay") => {
            let (Some(log), Some(trace)) = (words.next(), words.next()) else {
                return Err(Failure("replay LOG TRACE [MICROSECONDS]"));
            };
            let closer = words.next().map(str::parse).transpose();
            let closer = closer.map_err(|_| Failure("MICROSECONDS is a whole number"))?;
            replay::run(&Path::new(log)?, &Path::new(trace)?, closer)
        }
        Some("bench") => bench::run(),
        _ => Err(Failure("first argument: live, replay or bench")),
    }
}

/// Path for semihosting calls, which end it with a zero.
struct Path([u8; COMMAND_LINE]);

impl Path {
    fn new(path: &str) -> Result<Self, Failure> {
        let mut bytes = [0; COMMAND_LINE];
        let room = bytes.get_mut(..path.len());
        room.ok_or(Failure("the path is too long"))?
            .copy_from_slice(path.as_bytes());
        Ok(Self(bytes))
    }

    fn as_c_str(&self) -> Result<&CStr, Failure> {
        CStr::from_bytes_until_nul(&self.0).map_err(|_| Failure("the path is too long"))
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    eprintln!("{info}");
    ExitCode::FAILURE.exit_process()
}
