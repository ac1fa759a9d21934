//! A page as the server sees it: a websocket, without a browser.

use super::PATIENCE;
use serde_json::{Value, json};
use std::net::{SocketAddr, TcpStream};
use std::time::Instant;
use tungstenite::client::IntoClientRequest as _;
use tungstenite::http::{HeaderValue, StatusCode};
use tungstenite::{Message, WebSocket};

/// Connected page.
pub struct Peer {
    pub socket: WebSocket<TcpStream>,
    count: u64,
    /// The program's clock in the last message that carried it.
    seen_ms: u64,
}

impl Peer {
    /// Connects as the page itself does.
    pub fn open(address: SocketAddr) -> Self {
        let origin = format!("http://{address}");
        Self::open_from(address, &address.to_string(), Some(&origin)).expect("the page may connect")
    }

    /// Connects with this host and origin; returns the status of a refusal.
    pub fn open_from(
        address: SocketAddr,
        host: &str,
        origin: Option<&str>,
    ) -> Result<Self, StatusCode> {
        let stream = TcpStream::connect(address).expect("the server listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        let url = format!("ws://{address}/live");
        let mut request = url.into_client_request().expect("a URL");
        let header = |text: &str| HeaderValue::from_str(text).expect("a header");
        request.headers_mut().insert("host", header(host));
        if let Some(origin) = origin {
            request.headers_mut().insert("origin", header(origin));
        }
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(Self {
                socket,
                count: 0,
                seen_ms: 0,
            }),
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(response))) => {
                Err(response.status())
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// Sends a message; an action with what the page has seen.
    pub fn say(&mut self, message: &Value) {
        let mut message = message.clone();
        if message["do"].is_object() {
            message["seen_ms"] = json!(self.seen_ms);
        }
        let message = Message::text(message.to_string());
        self.socket.send(message).expect("the server takes it");
    }

    /// Waits for a message for which `wanted` returns a value; image sets count as drawn.
    #[track_caller]
    pub fn wait<T>(&mut self, wanted: impl Fn(&Value) -> Option<T>) -> T {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            match self.socket.read().expect("the server goes on") {
                Message::Text(text) => {
                    let message: Value = serde_json::from_str(&text).expect("JSON");
                    self.seen_ms = message["clock_ms"].as_u64().unwrap_or(self.seen_ms);
                    if let Some(value) = wanted(&message) {
                        return value;
                    }
                }
                Message::Binary(body) => self.say(&json!({ "drawn": header(&body)["number"] })),
                _ => {}
            }
        }
        panic!("the message did not come");
    }

    /// Waits for an image set; returns its header and its images.
    pub fn images(&mut self) -> (Value, Vec<u8>) {
        loop {
            if let Message::Binary(body) = self.socket.read().expect("the server goes on") {
                let header = header(&body);
                self.say(&json!({ "drawn": header["number"] }));
                let length = 4 + header.to_string().len();
                return (header, body[length.min(body.len())..].to_vec());
            }
        }
    }

    /// Waits for a state of the run that satisfies `wanted`.
    #[track_caller]
    pub fn state(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        self.wait(|message| {
            let is_wanted = message["type"] == "state" && wanted(message);
            is_wanted.then(|| message.clone())
        })
    }

    /// Exchanges a token for a key; `None` if it is refused.
    #[track_caller]
    pub fn exchange(&mut self, token: &str) -> Option<String> {
        self.say(&json!({ "token": token }));
        self.wait(|message| {
            let is_answer = message["type"] == "control";
            is_answer.then(|| message["key"].as_str().map(str::to_owned))
        })
    }

    /// Asks for an action; returns the reason of a refusal. Asks again if messages that this page
    /// had not read made what it saw too old.
    #[track_caller]
    pub fn ask(&mut self, action: &Value) -> Option<String> {
        loop {
            self.count += 1;
            let id = self.count;
            self.say(&json!({ "do": action, "id": id }));
            let refusal: Option<String> = self.wait(|message| {
                let is_answer = message["type"] == "done" && message["id"] == id;
                is_answer.then(|| message["error"].as_str().map(str::to_owned))
            });
            if !(refusal.as_ref()).is_some_and(|reason| reason.contains("hung when this was sent"))
            {
                return refusal;
            }
        }
    }

    /// Returns true if the server closes the connection.
    pub fn is_closed(&mut self) -> bool {
        loop {
            match self.socket.read() {
                Ok(Message::Close(_)) => return true,
                Ok(_) => {}
                Err(tungstenite::Error::Io(error)) => {
                    return error.kind() != std::io::ErrorKind::WouldBlock;
                }
                Err(_) => return true,
            }
        }
    }
}

/// Reads the header of an image set.
fn header(body: &[u8]) -> Value {
    let (length, rest) = body.split_first_chunk().expect("a length");
    let length = u32::from_le_bytes(*length) as usize;
    serde_json::from_slice(&rest[..length]).expect("JSON")
}
