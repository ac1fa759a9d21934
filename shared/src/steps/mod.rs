//! Conversion of segments of motion to the port words that make the step pulses.
//!
//! # Terms
//!
//! * A *word* is one 32-bit value written to a port's set/reset register (an STM32's `BSRR`): bits
//!   0-15 set pins, bits 16-31 reset them, zero changes nothing. Hardware writes one word per
//!   period of the [`WordRate`], so an edge lies on a word border and nowhere else: software adds
//!   no jitter.
//! * A *slot* is two words. The first may raise STEP pins (and change DIR pins), the second lowers
//!   the STEP pins again. An axis makes at most one step per slot: 500 kHz with words at 1 MHz.
//! * A *segment* is a run of slots in which every axis keeps its direction and its velocity changes
//!   linearly: a quarter of a control tick, 250 µs.
//! * *Fine units* are 2⁻³² of a step. A [`Position`] counts them in an `i64`. An *increment* is the
//!   fine units by which an axis moves in one slot; a *change* is the difference of the increments
//!   of adjacent slots.
//!
//! # The floor law
//!
//! Let `p` be an axis's position in steps, the exact integer sum of all increments so far. The
//! motor has always been given `floor(p)` steps: `p` gains one increment per slot, and whenever
//! `floor(p)` changes, the slot raises STEP. With `p = count + phase / 2³²` that is one addition:
//! the carry out of the 32-bit `phase` is the step.
//!
//! The same adder serves for backward motion, through the complement. With `q = -1 - p` (fine
//! units, so `q = !p` bit for bit) moving backwards in `p` is moving forwards in `q`, and `floor(q)
//! = -1 - floor(p)` in steps. So an axis that reverses replaces `phase` by `!phase`; each carry is
//! then a step backwards. Reversing twice restores the same phase, hence back and forth over the
//! same path makes the same steps.
//!
//! Planner and generator add the same integers, so at every segment border the number of steps
//! emitted is exactly the floor of the planned position. No rounding is left that could add up.
//!
//! # Reversal
//!
//! When an axis moves against the present level of its DIR pin, the first slot of the segment
//! writes DIR and raises no STEP on that axis; this slot's increment is added in the second slot
//! along with its own. Hence DIR is stable for two words before the next STEP rises, and for at
//! least two words after the last one rose (one after it fell). Segments that reverse an axis must
//! start slowly enough for the two increments together to stay below one step, and must have at
//! least two slots; so at the segment's end the floor law holds again. An axis at rest leaves DIR
//! alone.
//!
//! # Cameras
//!
//! A further pin of the port can trigger cameras ([`CameraPin`]). Its edges lie in the second words
//! of slots, which raise no STEP and change no DIR: with and without triggers the edges of all
//! other pins are the same.

mod camera;
mod generator;
mod port_map;
mod position;
mod quiet;
mod segment;
mod timing;

pub use camera::{CameraEdges, CameraPin};
pub use generator::{Generator, LoadFault};
pub use port_map::{PortFault, PortMap};
pub use position::Position;
pub use segment::{AxisMotion, Segment, SegmentFault};
pub use timing::{DriverTiming, Requirement, TimingFault, WordRate, WordRateFault};

/// Number of axes on one port and one time base.
pub const AXES: usize = 3;
