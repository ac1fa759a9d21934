//! The image that is flashed, on an emulated STM32F405, in the hands of tests.
//!
//! `firmware/build` makes an ELF for a chip; this crate loads that very file and lets it run. The
//! processor is the Cortex-M4F of the crate `rsemu`; the chip around it is ours, after the
//! reference manual RM0090.
//!
//! | module | what it is |
//! |---|---|
//! | [`image`] | the ELF as it lies in flash |
//! | [`board`] | processor, chip and time; what can be done to them from outside |
//! | [`chip`] | the peripherals that this firmware uses |
//! | [`wiring`] | what is soldered to the pins, and what an instrument there sees |
//! | [`station`] | the board with the host's own link code at its other end |
//! | [`usb_host`] | a USB host, for the other link |
//! | [`order`] | configuration and moves, as tests order them |
//! | [`scene`] | what the cameras see, for flow frames |
//! | [`fault_table`] | FAULTS.md, held to what tests observed |
//! | [`reference`](mod@reference) | what the twin does with the same inputs |
//! | [`trial`] | a station in fast motion, and what became of it |
//! | [`time`] | the unit of time |
//!
//! # Why not rsemu's own STM32F407
//! Its machine was tried first. An idle second took six seconds, timers fired up to 250 µs early,
//! its clock tree does not follow the registers, and its USB device did not get past the first
//! control transfer. The step engine is held to the microsecond here, so time is kept in units that
//! every clock of the chip divides, and events happen in the order of their time, between two
//! instructions.
//!
//! # What it cannot show
//! The interpreter charges one cycle per instruction and access and knows no bus conflicts; flash
//! takes its time only where a test asks for it ([`chip::flash`]). DMA transfers take no time.
//! Nothing is analogue, no oscillator drifts unless a test says so, and the errata of real silicon
//! are absent. The list of what that leaves to a bench is in firmware/README.md.

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
