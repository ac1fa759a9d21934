//! The live page of a run of `track`.

use crate::commands::failure::Failure;
use crate::commands::live_page::LivePage;
use clap::Args;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use trinocular::servo::live::LiveObserver;
use trinocular::servo::observer::ServoObserver;
use trinocular::servo::station_link::StationLink;
use trinocular::servo::stop_answer::answer_stop;
use trinocular_client::StationError;
use trinocular_client::serial::Stopper;
use trinocular_core::frame::message::Mounting;
use trinocular_live::controls::{Action, Offers, Reply};
use trinocular_live::{
    Controls, DEFAULT_ADDRESS, DEFAULT_FOXGLOVE_ADDRESS, DropSource, Hub, Server, Setup,
};
use trinocular_recording::recorder::Tap;
use trinocular_rig::rig_file::{RigFile, Stage};

const PAGE: &str = "With --live: the page in a browser";

/// Name of the page in messages.
const NAME: &str = "the live page";

/// Page of a run.
#[derive(Clone, Debug, Args)]
pub struct PageOptions {
    /// Show the run on a page in the browser, at this address; with the twin and --sim the run then
    /// takes its real time
    #[arg(
        long,
        value_name = "ADDR:PORT",
        num_args = 0..=1,
        default_missing_value = DEFAULT_ADDRESS,
        require_equals = true,
        help_heading = PAGE
    )]
    live: Option<SocketAddr>,

    /// Serve the same as a Foxglove websocket, for Foxglove, Lichtblick and PlotJuggler. Needs a
    /// program that was built with `--features trinocular/foxglove`
    #[arg(
        long,
        value_name = "ADDR:PORT",
        num_args = 0..=1,
        default_missing_value = DEFAULT_FOXGLOVE_ADDRESS,
        require_equals = true,
        requires = "live",
        help_heading = PAGE
    )]
    foxglove: Option<SocketAddr>,

    /// Print a link that opens the page with a STOP button; it works once, then the next is printed
    #[arg(long, requires = "live", help_heading = PAGE)]
    control: bool,
}

impl PageOptions {
    /// Checks that the page can be served, before anything moves.
    pub fn check(&self) -> Result<(), Failure> {
        let Some(address) = self.live else {
            return Ok(());
        };
        let listener = Server::listen(address, self.control);
        listener.map(drop).map_err(Failure::of_page)
    }

    /// Opens the page of a run, if the user wants one.
    pub fn open(
        &self,
        rig: &RigFile,
        stage: &Stage,
        mounting: Mounting,
        station: &StationLink,
        tap: Option<Arc<Tap>>,
    ) -> Result<Option<TrackPage>, Failure> {
        let Some(address) = self.live else {
            return Ok(None);
        };
        let listener = Server::listen(address, self.control).map_err(Failure::of_page)?;
        let setup = Setup {
            station: station.name(),
            cameras: rig.names.clone(),
            rig: rig.rig.clone(),
            stage: stage.clone(),
            mounting,
            scale: None,
        };
        let mut page = LivePage::open(listener, setup)?;
        if let Some(address) = self.foxglove {
            page.stream(address)?;
        }
        let stop = Arc::new(RunControls {
            stopper: station.serial().map(|serial| serial.stopper()),
            is_asked: AtomicBool::new(false),
            hub: Arc::clone(page.hub()),
            tap,
        });
        if self.control {
            page.control(Arc::clone(&stop) as Arc<dyn Controls>)?;
        }
        page.hub().set_following(true);
        let started = Instant::now();
        Ok(Some(TrackPage {
            page,
            stop,
            started,
        }))
    }
}

/// Open page of a run.
pub struct TrackPage {
    page: LivePage,
    stop: Arc<RunControls>,
    started: Instant,
}

impl TrackPage {
    /// Makes the observer that shows the run.
    pub fn observer(&self) -> Box<dyn ServoObserver> {
        Box::new(LiveObserver::new(Arc::clone(self.page.hub())))
    }

    /// Shows the images that never came to the loop.
    pub fn count_drops(&self, source: DropSource) {
        self.page.hub().set_drop_source(source);
    }

    /// Returns true if a page asked for a stop.
    pub fn is_stopped(&self) -> bool {
        self.stop.is_asked.load(Ordering::Relaxed)
    }

    /// Waits until the run has lasted `time_s`, or a page asks for a stop.
    pub fn pace(&self, time_s: f64) {
        let end = self.started + Duration::from_secs_f64(time_s.max(0.0));
        while !self.is_stopped() {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            std::thread::sleep(left.min(Duration::from_millis(2)));
        }
    }
}

/// Returns the error of a run that a page stopped.
pub fn stopped() -> StationError {
    let by = NAME.to_owned();
    StationError::StoppedByOther { by }
}

/// Controls of a run that follows from its start to its end: the page may only stop it.
struct RunControls {
    stopper: Option<Stopper>,
    is_asked: AtomicBool,
    hub: Arc<Hub>,
    /// Taps of the recording, if there is one.
    tap: Option<Arc<Tap>>,
}

impl Controls for RunControls {
    fn offers(&self) -> Offers {
        Offers {
            stop: true,
            mark: true,
            ..Offers::default()
        }
    }

    fn stop(&self, reply: Reply) {
        if let Some(stopper) = &self.stopper {
            stopper.stop(NAME);
        }
        answer_stop(self.stopper.clone(), reply);
        self.is_asked.store(true, Ordering::Relaxed);
    }

    fn request(&self, action: Action, reply: Reply) {
        match action {
            Action::Mark { text } => {
                reply.send(Ok(()));
                if let Some(tap) = &self.tap {
                    tap.event("mark", text.clone());
                }
                self.hub.mark(text);
            }
            _ => {
                let reason = "this run follows until it is stopped; `trinocular serve` does it";
                reply.send(Err(reason.to_owned()));
            }
        }
    }
}
