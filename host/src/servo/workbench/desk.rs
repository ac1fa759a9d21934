//! Way of the pages' requests to the loop.

use std::sync::mpsc::{SyncSender, TrySendError};
use trinocular_client::serial::Stopper;
use trinocular_live::Controls;
use trinocular_live::controls::{Action, Offers, Reply};

/// Name of the page in messages.
const PAGE: &str = "the live page";

/// Request of a page, and the way back to it.
#[derive(Debug)]
pub(super) struct Request {
    pub action: Action,
    pub reply: Reply,
}

/// Controls of a workbench, for the threads of its pages.
#[derive(Debug)]
pub struct Desk {
    pub(super) stopper: Option<Stopper>,
    pub(super) offers: Offers,
    pub(super) requests: SyncSender<Request>,
}

impl Controls for Desk {
    fn offers(&self) -> Offers {
        self.offers
    }

    fn stop(&self) {
        if let Some(stopper) = &self.stopper {
            stopper.stop(PAGE);
        }
        // The loop notices the stop by itself; a full queue is no reason to fail.
        let _ = self.requests.try_send(Request {
            action: Action::Stop {},
            reply: Reply::new(|_| {}),
        });
    }

    fn request(&self, action: Action, reply: Reply) {
        // A request that comes back after the end of the run says so by itself.
        if let Err(TrySendError::Full(request)) = self.requests.try_send(Request { action, reply })
        {
            let reason = "the station is busy; try again".to_owned();
            request.reply.send(Err(reason));
        }
    }
}
