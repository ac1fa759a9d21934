//! Queue of commands for the next control tick.
//!
//! A stop drops every command that came before it and still waits, so that no older reset, zero or
//! jog takes effect after it. A stop itself always finds room.

use crate::frame::message::{Command, Packet};
use heapless::Deque;

/// Largest number of commands that wait for one tick.
pub(super) const COMMANDS: usize = 8;

/// Largest number of stops of one tick that are answered.
pub(super) const STOPS: usize = 8;

/// Largest number of dropped commands of one tick that are answered.
pub(super) const DROPPED: usize = 16;

/// Queue of the commands since the last control tick.
#[derive(Clone, Debug, Default)]
pub(super) struct Inbox {
    /// Commands in the order of arrival, all after the last stop.
    commands: Deque<Packet, COMMANDS>,
    /// Sequence numbers of the commands that a stop dropped.
    dropped: Deque<u16, DROPPED>,
    /// Sequence numbers of the stops.
    stops: Deque<u16, STOPS>,
    stopped: bool,
}

/// Error of a command that found no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Full;

/// Counts of the commands that a stop dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    /// Flow frames among the dropped commands.
    pub frames: u32,
    /// Commands that get no answer, because there is no room.
    pub unanswered: u16,
}

impl Inbox {
    /// Queues a command.
    pub fn push(&mut self, packet: Packet) -> Result<(), Full> {
        self.commands.push_back(packet).map_err(|_| Full)
    }

    /// Queues a stop, and drops the commands that came before it.
    pub fn stop(&mut self, sequence: u16) -> Dropped {
        let mut dropped = Dropped::default();
        while let Some(packet) = self.commands.pop_front() {
            dropped.frames += u32::from(matches!(packet.command, Command::Frame(_)));
            let kept = self.dropped.push_back(packet.sequence);
            dropped.unanswered += u16::from(kept.is_err());
        }
        dropped.unanswered += u16::from(self.stops.push_back(sequence).is_err());
        self.stopped = true;
        dropped
    }

    /// Returns whether a stop came since the last call.
    pub fn take_stop(&mut self) -> bool {
        core::mem::take(&mut self.stopped)
    }

    /// Takes the next command that a stop dropped.
    pub fn next_dropped(&mut self) -> Option<u16> {
        self.dropped.pop_front()
    }

    /// Takes the next stop to be answered.
    pub fn next_stop(&mut self) -> Option<u16> {
        self.stops.pop_front()
    }

    /// Takes the next command to be executed.
    pub fn next(&mut self) -> Option<Packet> {
        self.commands.pop_front()
    }
}
