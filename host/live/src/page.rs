//! Conversation with one page over its websocket.
//!
//! | from the page | meaning |
//! |---|---|
//! | `{"drawn": 7}` | image set 7 was drawn: the next one may come |
//! | `{"token": "..."}` | exchanges the token of the control link for a key |
//! | `{"key": "..."}` | shows a key from before |
//! | `{"do": {"stop": {}}, "id": 3, "seen_ms": 8120}` | does an action; needs a key before |
//!
//! To the page go the messages `hello`, `state`, `control`, `done` and `alive` (JSON) and image
//! sets (binary, see `images`). The next image set waits until the last one was drawn. An action is
//! `done` when the station has answered it; meanwhile the page may send further messages. `alive`
//! comes every [`ALIVE`] whatever the run does, so that a page notices a program that hangs.
//!
//! `state` and `alive` carry `clock_ms`, and an action carries the latest one that its page had seen
//! as `seen_ms`. An action whose page saw nothing of the last [`UNSEEN`] is refused, unless it is a
//! stop: the program or the connection hung, the user saw old things, and may have gone.

use crate::access::Access;
use crate::controls::{Action, Reply};
use crate::hub::{ControlsHandle, Hub};
use axum::extract::ws::{Message, WebSocket};
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::{Instant, sleep_until, timeout};

/// Least time between two states: 60 a second.
const PERIOD: Duration = Duration::from_millis(16);

/// Longest time for a page to take a message, after which it is dropped.
const SEND_PATIENCE: Duration = Duration::from_secs(5);

/// Period of the sign of life.
const ALIVE: Duration = Duration::from_millis(500);

/// Age of what a page has seen from which on its actions are refused, except for a stop.
const UNSEEN: Duration = Duration::from_millis(1_500);

/// Longest time for the outcome of an action: longer than a stage ramps down before a reset.
const OUTCOME_PATIENCE: Duration = Duration::from_secs(12);

/// Largest number of actions of one page without an outcome.
const MOST_PENDING: usize = 16;

/// Longest time without a key on an address that other computers reach.
const KEY_PATIENCE: Duration = Duration::from_secs(5);

/// Message of a page.
#[derive(Debug, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
enum Request {
    Drawn {
        drawn: u64,
    },
    Token {
        token: String,
    },
    Key {
        key: String,
    },
    Do {
        r#do: Action,
        id: u64,
        seen_ms: Option<u64>,
    },
    /// An action of another version. The variants are tried in this order.
    Unknown {
        #[serde(rename = "do")]
        _do: IgnoredAny,
        id: u64,
        #[serde(rename = "seen_ms")]
        _seen_ms: Option<IgnoredAny>,
    },
}

/// A page, and what it has got.
struct Page {
    socket: WebSocket,
    hub: Arc<Hub>,
    controls: Option<ControlsHandle>,
    may_control: bool,
    /// True once the page gets what is seen.
    is_admitted: bool,
    /// Numbers of the last sample, note and image set that were sent.
    seen: u64,
    noted: u64,
    sent: u64,
    /// Number of the last image set that was drawn.
    drawn: u64,
    /// Instant from which `clock_ms` counts.
    since: Instant,
    /// Numbers of the actions without an outcome, each with its deadline, the earliest first.
    pending: VecDeque<(Instant, u64)>,
    outcomes: UnboundedReceiver<(u64, Outcome)>,
    outcome_sender: UnboundedSender<(u64, Outcome)>,
}

/// Outcome of an action: done, or the reason why not, in words.
type Outcome = Result<(), String>;

/// End of a conversation: the page left, is too slow, or sent nonsense.
struct Gone;

/// Serves a page until it leaves. One that is not `is_open` gets nothing before it has shown a key.
pub async fn attend(socket: WebSocket, hub: Arc<Hub>, is_open: bool) {
    let (outcome_sender, outcomes) = unbounded_channel();
    let mut page = Page {
        socket,
        controls: hub.controls(),
        hub: Arc::clone(&hub),
        may_control: false,
        is_admitted: is_open,
        seen: 0,
        noted: 0,
        sent: 0,
        drawn: 0,
        since: Instant::now(),
        pending: VecDeque::new(),
        outcomes,
        outcome_sender,
    };
    if !is_open && timeout(KEY_PATIENCE, page.until_key()).await.is_err() {
        return;
    }
    if !is_open && !page.may_control {
        return;
    }
    page.is_admitted = true;
    hub.client_came();
    let _ = page.serve().await;
    hub.client_left();
}

impl Page {
    /// Waits until the page has shown a key, or is gone.
    async fn until_key(&mut self) {
        while !self.may_control {
            let message = self.socket.recv().await;
            if self.take(message).await.is_err() {
                return;
            }
        }
    }

    async fn serve(&mut self) -> Result<(), Gone> {
        let hello = self.hub.hello();
        self.send(Message::text(hello.to_string())).await?;
        let mut changed = self.hub.subscribe();
        changed.mark_changed();
        let mut next = Instant::now();
        let mut alive = Instant::now() + ALIVE;
        loop {
            let deadline = self.pending.front().map(|(deadline, _)| *deadline);
            tokio::select! {
                // An outcome goes before the notes that follow from it.
                biased;
                // This page keeps a sender, so that there is always a next outcome.
                Some((id, outcome)) = self.outcomes.recv() => self.finish(id, outcome).await?,
                message = self.socket.recv() => self.take(message).await?,
                () = sleep_until(deadline.unwrap_or(alive)), if deadline.is_some() => {
                    self.give_up().await?;
                }
                () = sleep_until(alive) => {
                    alive = Instant::now() + ALIVE;
                    let sign = json!({"type": "alive", "clock_ms": self.clock_ms()});
                    self.send(Message::text(sign.to_string())).await?;
                }
                is_alive = async {
                    sleep_until(next).await;
                    changed.changed().await
                } => {
                    is_alive.map_err(|_| Gone)?;
                    next = Instant::now() + PERIOD;
                    self.update().await?;
                }
            }
        }
    }

    /// Returns the time since the page came, ms.
    fn clock_ms(&self) -> u64 {
        self.since.elapsed().as_millis() as u64
    }

    /// Sends what is new.
    async fn update(&mut self) -> Result<(), Gone> {
        let (mut state, seen, noted) = self.hub.state_since(self.seen, self.noted);
        state["clock_ms"] = json!(self.clock_ms());
        (self.seen, self.noted) = (seen, noted);
        self.send(Message::text(state.to_string())).await?;
        self.send_images().await
    }

    /// Sends the latest images, if the page has drawn the last ones.
    async fn send_images(&mut self) -> Result<(), Gone> {
        if self.drawn < self.sent {
            return Ok(());
        }
        match self.hub.encoded() {
            Some(encoded) if encoded.number > self.sent => {
                self.sent = encoded.number;
                self.send(Message::Binary(encoded.message)).await
            }
            _ => Ok(()),
        }
    }

    /// Sends a message; gives up a page that does not take it.
    async fn send(&mut self, message: Message) -> Result<(), Gone> {
        match timeout(SEND_PATIENCE, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(Gone),
        }
    }

    /// Takes in a message of the page.
    async fn take(&mut self, message: Option<Result<Message, axum::Error>>) -> Result<(), Gone> {
        let text = match message {
            Some(Ok(Message::Text(text))) => text,
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => return Ok(()),
            _ => return Err(Gone),
        };
        match serde_json::from_str::<Request>(&text).map_err(|_| Gone)? {
            Request::Drawn { .. } | Request::Do { .. } | Request::Unknown { .. }
                if !self.is_admitted =>
            {
                Err(Gone)
            }
            Request::Drawn { drawn } => {
                self.drawn = drawn;
                self.send_images().await
            }
            Request::Token { token } => {
                let key = self.access().and_then(|access| access.exchange(&token));
                self.admit(key).await
            }
            Request::Key { key } => {
                let is_known = self.access().is_some_and(|access| access.knows(&key));
                self.admit(is_known.then_some(key)).await
            }
            Request::Unknown { id, .. } => {
                let error = "unknown action, field or value".to_owned();
                self.answer(id, Some(error)).await
            }
            Request::Do {
                r#do: action,
                id,
                seen_ms,
            } => match self.act(action, id, seen_ms) {
                Some(outcome) => self.answer(id, outcome.err()).await,
                None => Ok(()),
            },
        }
    }

    /// Answers an action whose outcome has come, unless it was given up.
    async fn finish(&mut self, id: u64, outcome: Outcome) -> Result<(), Gone> {
        let Some(at) = self.pending.iter().position(|(_, known)| *known == id) else {
            return Ok(());
        };
        self.pending.remove(at);
        self.answer(id, outcome.err()).await
    }

    /// Answers the action whose outcome does not come.
    async fn give_up(&mut self) -> Result<(), Gone> {
        let Some((_, id)) = self.pending.pop_front() else {
            return Ok(());
        };
        let patience_s = OUTCOME_PATIENCE.as_secs();
        let reason =
            format!("the run did not answer within {patience_s} s; see what the stage does");
        self.answer(id, Some(reason)).await
    }

    /// Answers a request for an action.
    async fn answer(&mut self, id: u64, error: Option<String>) -> Result<(), Gone> {
        let done = json!({"type": "done", "id": id, "error": error});
        self.send(Message::text(done.to_string())).await
    }

    fn access(&self) -> Option<&Access> {
        self.controls.as_ref().map(|handle| &*handle.access)
    }

    /// Tells the page whether it may control the run.
    async fn admit(&mut self, key: Option<String>) -> Result<(), Gone> {
        self.may_control |= key.is_some();
        let answer: Value = json!({"type": "control", "key": key});
        self.send(Message::text(answer.to_string())).await
    }

    /// Notes an action as pending, and makes the way back for its outcome.
    fn reply(
        pending: &mut VecDeque<(Instant, u64)>,
        outcomes: &UnboundedSender<(u64, Outcome)>,
        id: u64,
    ) -> Reply {
        pending.push_back((Instant::now() + OUTCOME_PATIENCE, id));
        let outcomes = outcomes.clone();
        Reply::new(move |outcome| {
            // A page that has left needs no outcome.
            let _ = outcomes.send((id, outcome));
        })
    }

    /// Does an action; returns its outcome if that is known at once.
    fn act(&mut self, action: Action, id: u64, seen_ms: Option<u64>) -> Option<Outcome> {
        let handle = match &self.controls {
            Some(handle) if self.may_control => handle,
            _ => {
                return Some(Err(
                    "this page only watches: open the control link".to_owned()
                ));
            }
        };
        if let Err(reason) = action.check() {
            return Some(Err(reason));
        }
        if matches!(action, Action::Stop {}) {
            let reply = Self::reply(&mut self.pending, &self.outcome_sender, id);
            handle.controls.stop(reply);
            return None;
        }
        let Some(seen_ms) = seen_ms else {
            let reason = "this page is of another version of the program: load it again";
            return Some(Err(reason.to_owned()));
        };
        if self.clock_ms().saturating_sub(seen_ms) > UNSEEN.as_millis() as u64 {
            let reason = "the program or the connection hung when this was sent, so it was not \
                          done: see what the stage does, and send it again";
            return Some(Err(reason.to_owned()));
        }
        if self.pending.len() >= MOST_PENDING {
            let reason = format!("{MOST_PENDING} actions of this page have no answer yet; wait");
            return Some(Err(reason));
        }
        let reply = Self::reply(&mut self.pending, &self.outcome_sender, id);
        handle.controls.request(action, reply);
        None
    }
}
