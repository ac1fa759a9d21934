//! Answer to the stop of a page.

use trinocular_client::serial::Stopper;
use trinocular_live::controls::Reply;

/// Answers a page's stop when the station has answered it, or when the line is lost. A station
/// without a line is stopped by the loop.
pub fn answer_stop(stopper: Option<Stopper>, reply: Reply) {
    let Some(stopper) = stopper else {
        return reply.send(Ok(()));
    };
    let wait = move || {
        let outcome = stopper.until_stopped();
        reply.send(outcome.map_err(|error| error.to_string()));
    };
    // Without a thread, the reply is dropped, and the page says that the stop was not answered.
    let _ = std::thread::Builder::new()
        .name("stop".to_owned())
        .spawn(wait);
}
