//! Stack use: the free part is painted first; what lost its paint was used.

use cortex_m::register::msp;

/// Size of the painted part below the present stack, words.
const PAINTED: usize = 8 * 1024;

const PAINT: u32 = 0x5ca1_ab1e;

/// Margin between painter and paint for its own frames, bytes.
const MARGIN: usize = 256;

/// Returns the bytes of stack that `work` uses.
#[inline(never)]
pub fn used(work: impl FnOnce()) -> usize {
    let top = (msp::read() as usize - MARGIN) & !3;
    let bottom = top - PAINTED * size_of::<u32>();
    for word in 0..PAINTED {
        // SAFETY: the stack lies alone in the upper half of a RAM of 4 MB and grows down; 32 kB
        // below it nothing else lives, and nothing interrupts.
        unsafe { ((bottom as *mut u32).add(word)).write_volatile(PAINT) };
    }
    work();
    // SAFETY: as above.
    let intact =
        |word: &usize| unsafe { ((bottom as *const u32).add(*word)).read_volatile() } == PAINT;
    let unused = (0..PAINTED).take_while(intact).count();
    top + MARGIN - (bottom + unused * size_of::<u32>())
}
