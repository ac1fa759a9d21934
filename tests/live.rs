//! The live page: what it shows, what it may do, and what it refuses.
#![cfg(unix)]

#[path = "live/access.rs"]
mod access;
#[path = "live/attack.rs"]
mod attack;
#[path = "live/control.rs"]
mod control;
#[path = "live/ended.rs"]
mod ended;
#[path = "live/options.rs"]
mod options;
#[path = "live/peer.rs"]
mod peer;
#[path = "live/port.rs"]
mod port;
#[path = "live/record.rs"]
mod record;
#[path = "live/served.rs"]
mod served;
#[path = "live/slow.rs"]
mod slow;
#[path = "live/suspended.rs"]
mod suspended;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_core::rig::Rig;
use trinocular_live::access::Access;
use trinocular_live::controls::{Action, Offers, Reply};
use trinocular_live::{Controls, Hub, Server, Setup, Turn};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::{FrameSet, Image};

/// Time limit of every wait. It is long enough for any machine; a test that reaches it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Returns the facts of the paper's rig with the default stage.
fn setup() -> Setup {
    Setup {
        station: "a station".to_owned(),
        cameras: ["left", "middle", "right"].map(str::to_owned).into(),
        rig: Rig::paper(),
        stage: default_stage(),
        mounting: Mounting::OnStage,
        scale: None,
    }
}

/// Writes a rig file of the paper's cameras and the default stage; returns its path.
fn rig_with_default_stage(folder: &Path) -> PathBuf {
    let rig = RigFile {
        stage: Some(default_stage()),
        ..RigFile::paper()
    };
    let path = folder.join("rig.toml");
    std::fs::write(&path, rig.to_toml()).expect("the folder is ours");
    path
}

/// A page without a station: the test is the loop.
struct Site {
    hub: Arc<Hub>,
    server: Server,
    tokens: Arc<Mutex<Vec<String>>>,
    desk: Arc<Desk>,
}

/// Controls that only count.
#[derive(Default)]
struct Desk {
    stops: AtomicUsize,
    requests: Mutex<Vec<Action>>,
    is_busy: AtomicBool,
}

impl Controls for Desk {
    fn offers(&self) -> Offers {
        Offers {
            stop: true,
            motion: true,
            ..Offers::default()
        }
    }

    fn stop(&self, reply: Reply) {
        self.stops.fetch_add(1, Ordering::SeqCst);
        reply.send(Ok(()));
    }

    fn request(&self, action: Action, reply: Reply) {
        if self.is_busy.load(Ordering::SeqCst) {
            return reply.send(Err("busy".to_owned()));
        }
        self.requests.lock().unwrap().push(action);
        reply.send(Ok(()));
    }
}

impl Site {
    /// Serves a page with a control link on this address.
    fn on(address: &str) -> Self {
        let hub = Hub::start(setup()).expect("a thread");
        let address: SocketAddr = address.parse().expect("an address");
        let listener = Server::listen(address, true).expect("a free port");
        let server = Server::start(listener, Arc::clone(&hub)).expect("a thread");
        let tokens = Arc::new(Mutex::new(Vec::new()));
        let theirs = Arc::clone(&tokens);
        let access = Access::new(move |token| theirs.lock().unwrap().push(token.to_owned()));
        let desk = Arc::new(Desk::default());
        let controls: Arc<dyn Controls> = Arc::clone(&desk) as Arc<dyn Controls>;
        hub.set_controls(controls, Arc::new(access.expect("random bytes")));
        Self {
            hub,
            server,
            tokens,
            desk,
        }
    }

    fn new() -> Self {
        Self::on("127.0.0.1:0")
    }

    fn address(&self) -> SocketAddr {
        let mut address = self.server.address();
        address.set_ip([127, 0, 0, 1].into());
        address
    }

    /// Returns the token of the latest control link.
    fn token(&self) -> String {
        let tokens = self.tokens.lock().unwrap();
        tokens.last().expect("announced").clone()
    }

    /// Shows a turn whose images have this grey level.
    fn turn(&self, taken_us: u64, grey: u8) {
        let image = Image {
            width: 320,
            height: 240,
            grey: vec![grey; 320 * 240],
        };
        let images = FrameSet {
            time_us: taken_us,
            images: vec![image; 3],
        };
        self.hub.turn(&Turn {
            taken_us,
            images: &images,
            measurement: None,
            estimate: None,
            refusal: Some(("lost", "lost: the target is away")),
            absent: &[],
            stage_mm: [1.0, 2.0, 3.0],
            status: None,
        });
    }
}
