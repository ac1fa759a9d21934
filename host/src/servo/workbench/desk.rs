//! Way of the pages' requests to the loop.

use crate::servo::stop_answer::answer_stop;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::{Duration, Instant};
use trinocular_client::serial::Stopper;
use trinocular_live::Controls;
use trinocular_live::controls::{Action, Offers, Reply};

/// Name of the page in messages.
pub(super) const PAGE: &str = "the live page";

/// Age from which on a request other than a stop is not done any more: the user has seen no effect,
/// and may have done something else since.
const STALE: Duration = Duration::from_secs(5);

/// Request of a page, and the way back to it.
#[derive(Debug)]
pub(super) struct Request {
    pub action: Action,
    pub reply: Reply,
    /// Name of who asks, in messages.
    pub by: &'static str,
    asked: Instant,
}

impl Request {
    fn new(action: Action, reply: Reply, by: &'static str) -> Self {
        Self {
            action,
            reply,
            by,
            asked: Instant::now(),
        }
    }

    /// Returns true if the request is too old to be done.
    pub fn is_stale(&self) -> bool {
        !matches!(self.action, Action::Stop {}) && self.asked.elapsed() > STALE
    }
}

/// Controls of a workbench, for the threads of its pages.
#[derive(Clone, Debug)]
pub struct Desk {
    /// Name of who uses it, in messages.
    pub(super) by: &'static str,
    pub(super) stopper: Option<Stopper>,
    pub(super) offers: Offers,
    pub(super) requests: SyncSender<Request>,
}

impl Desk {
    /// Returns the same controls for others than the pages, who have this name in messages.
    pub fn named(&self, by: &'static str) -> Self {
        Self { by, ..self.clone() }
    }
}

impl Controls for Desk {
    fn offers(&self) -> Offers {
        self.offers
    }

    fn stop(&self, reply: Reply) {
        if let Some(stopper) = &self.stopper {
            stopper.stop(self.by);
        }
        answer_stop(self.stopper.clone(), reply);
        // The loop notices the stop by itself; a full queue is no reason to fail.
        let stop = Request::new(Action::Stop {}, Reply::new(|_| {}), self.by);
        let _ = self.requests.try_send(stop);
    }

    fn request(&self, action: Action, reply: Reply) {
        // A request that comes back after the end of the run says so by itself.
        let request = Request::new(action, reply, self.by);
        if let Err(TrySendError::Full(request)) = self.requests.try_send(request) {
            let reason = "the station is busy; try again".to_owned();
            request.reply.send(Err(reason));
        }
    }
}
