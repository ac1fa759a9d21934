//! Live page of a run: what cameras, flow, station and stage do, in a browser on this computer.
//!
//! ```text
//! loop --Turn--> Hub --latest value--> server --websocket--> page
//! loop <-Action- Controls <------------------------------------'
//! ```
//!
//! The loop hands every turn to the [`Hub`], which copies it and returns at once. Each page has a
//! task of its own in the [`Server`], which sends the latest state when the page is ready for it:
//! a slow page gets fewer images, and a page that takes nothing for some seconds is dropped. The
//! loop never waits for a page.
//!
//! A page only shows what happens, unless the run has a control link ([`access`]): then the pages
//! that were opened by it may send an [`Action`](controls::Action) to the [`Controls`].
//!
//! With the feature `foxglove` the same state is also a Foxglove websocket ([`foxglove`]).
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
mod telemetry;

pub use controls::Controls;
pub use hub::{Hub, Setup, Turn};
pub use server::{LiveError, Server};

/// Address of the Foxglove websocket unless the user names another one.
pub const DEFAULT_FOXGLOVE_ADDRESS: &str = "127.0.0.1:8765";

/// Address of the page unless the user names another one.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:7411";
