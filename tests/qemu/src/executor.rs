//! embassy's executor with an idle loop that really sleeps.
//!
//! The stock executor waits with WFE, which QEMU treats as a yield: the processor stays busy, and
//! its clock, which counts instructions, is slow. WFI halts it, and time jumps to the next
//! interrupt.

use core::sync::atomic::{AtomicBool, Ordering};
use embassy_executor::Spawner;
use embassy_executor::raw::Executor;
use static_cell::StaticCell;

static EXECUTOR: StaticCell<Executor> = StaticCell::new();

/// True if a task can continue.
static WORK: AtomicBool = AtomicBool::new(true);

// SAFETY: embassy-executor asks for a function of this name and type.
#[unsafe(export_name = "__pender")]
fn pend(_context: *mut ()) {
    WORK.store(true, Ordering::SeqCst);
}

/// Runs the tasks that `spawn` starts, forever.
pub fn run(spawn: impl FnOnce(Spawner)) -> ! {
    let executor: &'static Executor = EXECUTOR.init(Executor::new(core::ptr::null_mut()));
    spawn(executor.spawner());
    loop {
        cortex_m::interrupt::disable();
        let work = WORK.swap(false, Ordering::SeqCst);
        if !work {
            // An interrupt that comes between the test and here is pending, and WFI returns at
            // once.
            cortex_m::asm::wfi();
        }
        // SAFETY: no critical section is open here.
        unsafe { cortex_m::interrupt::enable() };
        if work {
            // SAFETY: the executor was initialised above, and `poll` is called from here only,
            // never from within itself.
            unsafe { executor.poll() };
        }
    }
}
