#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! [`hub`] keeps the latest state, [`server`] sends it, [`controls`] are what a page may ask for, and
//! [`access`] decides who may. A page that takes nothing for some seconds is dropped.
//!
//! With the feature `foxglove` the same state is also a Foxglove websocket.
//!
//! *Invariant:* nothing here opens a connection of its own, and the page loads nothing from
//! elsewhere; its content security policy forbids it.

pub mod access;
mod aids;
mod assets;
pub mod controls;
#[cfg(feature = "foxglove")]
pub mod foxglove;
pub mod hub;
mod images;
mod overlap;
mod page;
pub mod server;
mod state;
mod telemetry;

pub use controls::Controls;
pub use hub::{DropSource, Hub, Setup, Turn};
pub use server::{LiveError, Server};

/// Address of the Foxglove websocket unless the user names another one.
pub const DEFAULT_FOXGLOVE_ADDRESS: &str = "127.0.0.1:8765";

/// Address of the page unless the user names another one.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:7411";
