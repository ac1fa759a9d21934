//! Properties of this board: the twin's figures, so that the same log has the same meaning on both.

use trinocular_core::frame::message::{LastRun, ResetCause};
use trinocular_core::machine::Board;
use trinocular_core::steps::{PortMap, WordRate};

/// STEP and DIR pins of the port.
pub const PORT: PortMap = PortMap {
    step: [0, 1, 2],
    dir: [3, 4, 5],
    invert: [false; 3],
};

/// Words that the step engine queues ahead of the pins.
pub const RING_WORDS: u32 = 512;

/// Words in a segment.
pub const SEGMENT_WORDS: usize = 2 * WordRate::MHZ_1.slots_per_segment() as usize;

/// Board for the machine.
pub const BOARD: Board = Board {
    name: "qemu-mps2-an386",
    version: [0, 1, 0],
    word_rate: WordRate::MHZ_1,
    delay_us: RING_WORDS, // at 1 MHz
    session: 1,
    reset_cause: ResetCause::PowerOn,
    last_run: LastRun::UNKNOWN,
    camera_pin: Some(8),
};
