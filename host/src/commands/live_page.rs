//! The live page of a command: hub, server and control link.

use crate::commands::failure::Failure;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;
use trinocular_live::access::Access;
use trinocular_live::{Controls, Hub, LiveError, Server, Setup};
use trinocular_rig::notice;

/// Time in which the pages get the end of the run before the connection closes.
const FAREWELL: Duration = Duration::from_millis(200);

/// Open page of a command. Dropping it closes the page.
pub struct LivePage {
    hub: Arc<Hub>,
    address: SocketAddr,
    _server: Server,
    #[cfg(feature = "foxglove")]
    stream: Option<trinocular_live::foxglove::Stream>,
}

impl LivePage {
    /// Serves the page on a listener of [`Server::listen`], and prints its URL.
    pub fn open(listener: TcpListener, setup: Setup) -> Result<Self, Failure> {
        let system = |cause: std::io::Error| Failure::of_page(LiveError::System(cause.to_string()));
        let hub = Hub::start(setup).map_err(system)?;
        let server = Server::start(listener, Arc::clone(&hub)).map_err(Failure::of_page)?;
        let address = server.address();
        if address.ip().is_loopback() {
            notice!("live page: {}", Server::url(address, None));
        } else {
            notice!(
                "warning: the live page is on {address} for every computer that reaches it, and \
                 not encrypted; only the control link opens it"
            );
        }
        Ok(Self {
            hub,
            address,
            _server: server,
            #[cfg(feature = "foxglove")]
            stream: None,
        })
    }

    /// Returns the hub, for observers of the loop.
    pub fn hub(&self) -> &Arc<Hub> {
        &self.hub
    }

    /// Serves the same state as a Foxglove websocket, and prints its URL.
    #[cfg(feature = "foxglove")]
    pub fn stream(&mut self, address: SocketAddr) -> Result<(), Failure> {
        let hub = Arc::clone(&self.hub);
        let stream =
            trinocular_live::foxglove::Stream::start(address, hub).map_err(Failure::of_page)?;
        notice!("Foxglove websocket: ws://{}", stream.address());
        self.stream = Some(stream);
        Ok(())
    }

    /// Refuses, because this program was built without the stream.
    #[cfg(not(feature = "foxglove"))]
    pub fn stream(&mut self, _: SocketAddr) -> Result<(), Failure> {
        let reason = "this program was built without the Foxglove websocket: build it with \
                      `cargo build --release --features trinocular/foxglove`";
        Err(Failure::Usage(reason.to_owned()))
    }

    /// Gives the page controls, and prints the link that opens them.
    pub fn control(&mut self, controls: Arc<dyn Controls>) -> Result<(), Failure> {
        let address = self.address;
        let print = move |token: &str| {
            let link = Server::url(address, Some(token));
            let elsewhere = match address.ip().is_unspecified() {
                true => " (on another computer with this one's address instead of 127.0.0.1)",
                false => "",
            };
            notice!("control link, works once: {link}{elsewhere}");
        };
        let access = Access::new(print)
            .map_err(|cause| Failure::of_page(LiveError::System(cause.to_string())))?;
        self.hub.set_controls(controls, Arc::new(access));
        Ok(())
    }
}

impl Drop for LivePage {
    fn drop(&mut self) {
        self.hub.end();
        if self.hub.clients() > 0 {
            std::thread::sleep(FAREWELL);
        }
    }
}
