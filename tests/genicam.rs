//! GenICam cameras on a computer without cameras: Aravis's fake GigE Vision cameras, three at once,
//! each on an address of its own in the loopback network, losing packets.
//!
//! A test runs itself again with the [stand-in](../cameras) for network interfaces preloaded, because
//! the addresses of the loopback network are no interfaces otherwise. Fake cameras expose at the
//! multiples of their period on the system's clock, which is their stamp too. Their first pixel
//! tells the number of the image, modulo 255.
#![cfg(feature = "genicam")]

#[path = "genicam/command_line.rs"]
mod command_line;
#[path = "genicam/fakes.rs"]
mod fakes;
#[path = "genicam/stream.rs"]
mod stream;
