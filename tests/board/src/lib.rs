//! The flashed image on an emulated STM32F405, for tests.
//!
//! `firmware/build` makes an ELF for a chip; this crate loads the same file and runs it. The
//! processor is the Cortex-M4F of the crate `rsemu`; the chip around it is our own, after the
//! reference manual RM0090.
//!
//! | module | content |
//! |---|---|
//! | [`image`] | the ELF as it lies in flash |
//! | [`board`] | processor, chip and time, with faults from outside |
//! | [`chip`] | the peripherals that this firmware uses |
//! | [`wiring`] | the wires at the pins, and an instrument there |
//! | [`station`] | the board with the host's own link code at its other end |
//! | [`usb_host`] | a USB host, for the other link |
//! | [`order`] | configuration and moves of the tests |
//! | [`scene`] | points before the cameras, for flow frames |
//! | [`fault_table`] | FAULTS.md, compared with observations |
//! | [`reference`](mod@reference) | the twin with the same inputs |
//! | [`trial`] | a station in fast motion, and its state after a fault |
//! | [`time`] | the unit of time |
//!
//! # Alternative: rsemu's own STM32F407
//! Its machine was tried first. An idle second took six seconds, timers fired up to 250 µs early,
//! its clock tree does not follow the registers, and its USB device did not pass the first control
//! transfer. Tests hold the step engine to the microsecond, so time is kept in units that every
//! clock of the chip divides, and events happen in the order of their time, between two
//! instructions.
//!
//! # Limits
//! The interpreter charges one cycle per instruction and access and knows no bus conflicts; flash
//! takes its time only where a test enables it ([`chip::flash`]). DMA transfers take no time.
//! Nothing is analogue, no oscillator drifts unless a test sets it, and the errata of real silicon
//! are absent. firmware/README.md lists what remains for tests on a bench.

pub mod board;
pub mod chip;
pub mod fault_table;
pub mod image;
pub mod order;
pub mod reference;
pub mod scene;
pub mod station;
pub mod time;
pub mod trial;
pub mod usb_host;
pub mod wiring;
