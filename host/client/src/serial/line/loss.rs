//! Loss of a line, and its return.
//!
//! A line is up, down or given up. It goes down when the port fails or the station answers no ping
//! for [`SILENCE`]. From then on the port is closed, and opened again and greeted every [`RETRY`],
//! until a station answers or the patience ends. A pseudo-terminal is not opened again by its own
//! name ([`terminal`](super::super::terminal)). A line that came back stays interrupted, without
//! heartbeat, until the caller calls `resume`. So no motion goes on because a plug was put back. The
//! line also goes down when the station has forgotten its configuration: it restarted.

use super::Line;
use crate::StationError;
use crate::serial::holder::Holder;
use crate::serial::port::{self, Halves};
use crate::serial::terminal::Terminal;
use std::time::{Duration, Instant};
use trinocular_core::frame::message::{Hello, Mismatch};
use trinocular_core::safety::State;
use trinocular_rig::notice;

/// Silence after which a pinged station counts as lost.
const SILENCE: Duration = Duration::from_secs(2);

/// Silence after which an owner counts as lost: less than the station's, so that the error names
/// the owner.
const OWNER_SILENCE: Duration = Duration::from_millis(1_500);

/// Period at which a lost port is opened again and hello repeated.
const RETRY: Duration = Duration::from_millis(250);

/// Reason why a lost pseudo-terminal is given up.
const GONE: &str = "the program behind this pseudo-terminal has ended or was unplugged, and its \
                    name may lead to another program by now, so it is not opened again";

/// Condition of the line.
pub(super) enum Link {
    Up,
    /// Being reconnected: start of the loss, its reason, and the next attempt.
    Down {
        since: Instant,
        reason: String,
        next_try: Instant,
        /// True once the user has been told.
        is_told: bool,
    },
    /// Given up for this reason.
    Over(String),
}

/// Interruption of a line that is up again.
#[derive(Clone, Debug)]
pub(super) enum Interruption {
    /// Same station with all its state.
    Away { reason: String, away: Duration },
    /// Station without configuration and position, or another station.
    Restarted { cause: &'static str },
    /// Station with other firmware.
    Mismatch(Vec<Mismatch>),
}

impl Line {
    /// Detects a failed or silent line.
    pub(super) fn listen(&mut self) {
        if let Some(reason) = self.sender.broken() {
            return self.lose(reason);
        }
        if self.has_forgotten() {
            // The hello that follows tells the reset's cause.
            return self.go_down("the station restarted".to_owned());
        }
        let is_pinged = self.pings && self.interruption.is_none();
        let silence = match &self.owner {
            Some(_) => OWNER_SILENCE,
            None => SILENCE,
        };
        if is_pinged && self.heard.elapsed() > silence {
            let reason = match &self.owner {
                Some(owner) => crate::silent_owner(Some(owner)),
                None => format!("no answer for {} s", SILENCE.as_secs()),
            };
            // A silent pseudo-terminal is kept open, because its name may not be opened again. A
            // silent owner may go on; only one that closes the connection is lost.
            match (&self.terminal, &self.owner) {
                (None, None) => self.lose(reason),
                _ => self.go_down(reason),
            }
        }
    }

    /// Returns true if the station that this program drives lost its configuration: it restarted
    /// while the line stayed up, after a brown-out or by its watchdog. No command takes a
    /// configuration away.
    pub(super) fn has_forgotten(&mut self) -> bool {
        let status = self.client.status_since_hello();
        let Some(state) = status.map(|status| status.state).filter(|_| self.drives) else {
            return false;
        };
        // A stop and a fault also come without a configuration.
        self.is_configured |= state == State::Idle || state.is_moving();
        let has_none = state == State::Unconfigured;
        self.is_configured && has_none && self.interruption.is_none()
    }

    pub(super) fn lose(&mut self, reason: String) {
        // The socket's own error names neither program nor way out.
        let reason = match &self.owner {
            Some(Holder { pid, command }) => format!(
                "`{command}` (process {pid}), which had the port, has ended, or closed this \
                 connection because this program was silent; see what the stage has done, then run \
                 this again"
            ),
            None => reason,
        };
        self.set_port(None);
        self.go_down(reason);
    }

    pub(super) fn go_down(&mut self, reason: String) {
        if matches!(self.link, Link::Up) {
            if let Some(observer) = &self.observer {
                observer.line_lost(self.sender.now_us(), &reason);
            }
            self.sender.set_pings(false);
            self.was_configured = std::mem::take(&mut self.is_configured);
            let since = Instant::now();
            self.client.begin_again();
            self.link = Link::Down {
                since,
                reason,
                next_try: since,
                is_told: false,
            };
        }
    }

    pub(super) fn set_port(&mut self, halves: Option<Halves>) {
        let (reader, writer) = halves.unzip();
        self.port = reader;
        self.sender.set_port(writer);
    }

    /// Opens and greets; judges what answers.
    pub(super) fn look_for(&mut self) {
        let Link::Down {
            since,
            reason,
            next_try,
            is_told,
        } = &mut self.link
        else {
            return;
        };
        let now = Instant::now();
        let (since, cause) = (*since, reason.clone());
        let is_told = std::mem::replace(is_told, true);
        let due = now >= *next_try;
        if due {
            *next_try = now + RETRY;
        }
        self.take_in();
        if let Some(interruption) = self.judge(since, &cause) {
            self.interruption = Some(interruption);
            self.link = Link::Up;
            return;
        }
        // A link that was made anew leads to the station, and the silent line that it led to before
        // does not.
        let is_back = self
            .terminal
            .is_some_and(|terminal| terminal.is_back(&self.path));
        if self.sender.broken().is_some() || is_back {
            self.set_port(None);
        }
        let is_broken = self.port.is_none();
        let terminal = self.terminal.filter(|_| is_broken);
        let is_gone = terminal.is_some_and(|terminal| terminal.is_gone(&self.path));
        let is_spent = now.duration_since(since) > self.patience || self.session.is_none();
        if is_gone || is_spent {
            self.set_port(None);
            self.link = Link::Over(match terminal {
                Some(_) => format!("{cause}; {GONE}"),
                None => cause,
            });
            return;
        }
        if !is_told {
            // The caller waits for the line.
            notice!(
                "{}: the line is lost: {cause}; trying for {} s to find the station again",
                self.path,
                self.patience.as_secs()
            );
        }
        if due && terminal.is_none_or(|terminal| terminal.is_back(&self.path)) {
            if is_broken {
                let terminal = Terminal::at(&self.path);
                let halves = port::open(&self.path).ok();
                // A link that did not open yet is still one made anew.
                if halves.is_some() {
                    self.terminal = terminal;
                }
                self.set_port(halves);
            }
            self.greet();
        }
    }

    /// Returns the kind of interruption, once a station has answered on a line that was lost. The
    /// station's state is in its first status, which comes within a tenth of a second.
    pub(super) fn judge(&mut self, since: Instant, reason: &str) -> Option<Interruption> {
        let hello: &Hello = self.client.hello()?;
        let mismatches = hello.mismatches();
        if !mismatches.is_empty() {
            return Some(Interruption::Mismatch(mismatches.to_vec()));
        }
        let state = self.client.status()?.state;
        let had_one = self.configuration.is_some() || self.was_configured;
        let forgot = had_one && state == State::Unconfigured;
        if self.session != Some(hello.session) || forgot {
            let cause = crate::reset_cause(hello.reset_cause);
            self.client.forget_clock();
            // Its outputs went off with the restart.
            self.client.motion_mut().ended();
            return Some(Interruption::Restarted { cause });
        }
        Some(Interruption::Away {
            reason: reason.to_owned(),
            away: since.elapsed(),
        })
    }

    /// Returns true while a lost line is being reconnected.
    pub fn is_down(&self) -> bool {
        matches!(self.link, Link::Down { .. })
    }

    /// Returns true if a stop reaches the station, in whatever condition it is.
    pub fn is_up(&self) -> bool {
        matches!(self.link, Link::Up)
    }

    /// Checks that commands reach the station and its numbers are plausible.
    pub fn check(&self) -> Result<(), StationError> {
        if let Some(implausible) = self.client.implausible() {
            return Err(implausible.into());
        }
        if let Some(by) = &self.stopped_by {
            return Err(StationError::StoppedByOther { by: by.clone() });
        }
        self.check_link()
    }

    /// Checks that packets reach the station.
    pub fn check_link(&self) -> Result<(), StationError> {
        let path = || self.path.clone();
        match (&self.link, &self.interruption) {
            (Link::Up, None) => Ok(()),
            (Link::Down { reason, .. } | Link::Over(reason), _) => Err(StationError::Lost {
                path: path(),
                reason: reason.clone(),
            }),
            (Link::Up, Some(Interruption::Away { reason, away })) => {
                Err(StationError::Interrupted {
                    path: path(),
                    reason: reason.clone(),
                    away_ms: away.as_millis() as u64,
                })
            }
            (Link::Up, Some(Interruption::Restarted { cause })) => Err(StationError::Restarted {
                path: path(),
                cause,
            }),
            (Link::Up, Some(Interruption::Mismatch(fields))) => {
                Err(StationError::Mismatch(fields.clone()))
            }
        }
    }

    /// Resumes after an interruption, if the station lost no state and has no fault.
    pub fn resume(&mut self) -> Result<(), StationError> {
        if let (Link::Up, Some(Interruption::Away { .. })) = (&self.link, &self.interruption) {
            if let Some(fault) = self.client.status().and_then(|status| status.fault) {
                return Err(StationError::Faulted(fault));
            }
            self.interruption = None;
            self.set_pings(self.pings);
        }
        self.check()
    }
}
