//! Session with the router, one channel per topic, and one subscription per topic of commands.

use super::{Account, CommandSink, PublisherError, Settings};
use crate::attachment;
use crate::command::CommandTopic;
use crate::graph::{self, Node, Topic};
use crate::message_type::{IMAGE, MessageType, POSE, TRANSFORMS};
use crate::name;
use std::time::{SystemTime, UNIX_EPOCH};
use trinocular_recording::message::{self, Measurement};
use trinocular_rig::notice;
use trinocular_vision::images::Image;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session, Wait as _};

/// Name of the node, and first part of the names of its topics.
const NODE: &str = "trinocular";

/// Topic of the frames of all nodes.
const FRAMES: &str = "/tf";

/// Open session with its topics.
pub struct Outlet {
    session: Session,
    cameras: Vec<Channel>,
    displacement: Channel,
    transforms: Channel,
    _subscriptions: Vec<Subscription>,
    _node: LivelinessToken,
    /// Instant of the stamps' zero, µs since 1970: known from the first frame set on.
    epoch_us: Option<i64>,
    bytes: Vec<u8>,
    account: Account,
}

/// Publisher of one topic.
struct Channel {
    publisher: zenoh::pubsub::Publisher<'static>,
    gid: [u8; 16],
    sent: i64,
    _token: LivelinessToken,
}

/// Subscription of one topic of commands.
struct Subscription {
    _subscriber: zenoh::pubsub::Subscriber<()>,
    _token: LivelinessToken,
}

/// Returns the present instant, µs since 1970.
fn now_us() -> i64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.map_or(0, |since| since.as_micros() as i64)
}

fn configuration(endpoint: &str) -> Result<Config, PublisherError> {
    let unfit = || PublisherError::Endpoint {
        endpoint: endpoint.to_owned(),
    };
    // A quotation mark would end the text in the configuration.
    if endpoint.contains(['"', '\\']) {
        return Err(unfit());
    }
    let mut config = Config::default();
    let settings = [
        ("mode", r#""client""#.to_owned()),
        ("connect/endpoints", format!(r#"["{endpoint}"]"#)),
        ("scouting/multicast/enabled", "false".to_owned()),
    ];
    for (name, value) in settings {
        config.insert_json5(name, &value).map_err(|_| unfit())?;
    }
    Ok(config)
}

impl Outlet {
    /// Opens the session and announces node and topics.
    pub fn open(settings: &Settings) -> Result<Self, PublisherError> {
        let names = name::parts(&settings.cameras)?;
        let config = configuration(&settings.endpoint)?;
        let session = zenoh::open(config).wait();
        let session = session.map_err(|_| PublisherError::Router)?;
        let node = Node::new(settings.domain, session.zid().to_string(), NODE);
        let mut number = 0;
        let mut channel = |name: String, message_type: MessageType| {
            number += 1;
            Channel::open(&session, &node, number, &Topic::new(name, message_type))
        };
        let token = session.liveliness().declare_token(node.token()).wait();
        let cameras = names.iter().map(|camera| {
            let name = format!("/{NODE}/{camera}/image_raw");
            channel(name, IMAGE)
        });
        let cameras = cameras.collect::<Result<_, _>>()?;
        let displacement = channel(format!("/{NODE}/displacement"), POSE)?;
        let transforms = channel(FRAMES.to_owned(), TRANSFORMS)?;
        let mut subscriptions = Vec::new();
        for topic in CommandTopic::ALL {
            if let Some(sink) = &settings.commands {
                number += 1;
                subscriptions.push(Subscription::open(&session, &node, number, topic, sink)?);
            }
        }
        Ok(Self {
            cameras,
            displacement,
            transforms,
            _subscriptions: subscriptions,
            _node: token.map_err(unfit)?,
            session,
            epoch_us: None,
            bytes: Vec::new(),
            account: Account::default(),
        })
    }

    /// Returns a stamp as time since 1970, µs. The first frame set is of the present instant.
    fn stamp_us(&mut self, stamp_us: u64) -> u64 {
        let stamp = stamp_us as i64;
        let epoch = self.epoch_us.get_or_insert_with(|| now_us() - stamp);
        u64::try_from(*epoch + stamp).unwrap_or(0)
    }

    /// Publishes the images of a frame set.
    pub fn images(&mut self, stamp_us: u64, images: &[Image]) {
        let stamp_us = self.stamp_us(stamp_us);
        for (channel, image) in self.cameras.iter_mut().zip(images) {
            // A camera without an image has an empty one.
            if !image.is_missing() {
                message::image(&mut self.bytes, stamp_us, image);
                channel.send(&self.bytes, &mut self.account);
            }
        }
    }

    /// Publishes displacement and frames.
    pub fn measurement(&mut self, mut measurement: Measurement) {
        measurement.stamp_us = self.stamp_us(measurement.stamp_us);
        if !measurement.cameras.is_empty() {
            message::pose(&mut self.bytes, &measurement);
            self.displacement.send(&self.bytes, &mut self.account);
        }
        if message::transforms(&mut self.bytes, &measurement) {
            self.transforms.send(&self.bytes, &mut self.account);
        }
    }

    /// Ends the session.
    pub fn close(self) -> Account {
        if let Err(cause) = self.session.close().wait() {
            notice!("warning: the Zenoh session did not end well: {cause}");
        }
        self.account
    }
}

/// Returns the error of a topic that the session does not take.
fn unfit(cause: zenoh::Error) -> PublisherError {
    PublisherError::Topic(cause.to_string())
}

impl Subscription {
    fn open(
        session: &Session,
        node: &Node,
        number: u32,
        topic: CommandTopic,
        sink: &CommandSink,
    ) -> Result<Self, PublisherError> {
        let named = Topic::new(format!("/{NODE}/{topic}"), topic.message_type());
        let sink = sink.clone();
        let take = move |sample: zenoh::sample::Sample| {
            sink(topic, topic.read(&sample.payload().to_bytes()));
        };
        let key = match topic.takes_any_type() {
            true => node.key_of_any_type(&named),
            false => node.key(&named),
        };
        let subscriber = session.declare_subscriber(key).callback(take).wait();
        let token = node.subscription_token(number, &named);
        let token = session.liveliness().declare_token(token).wait();
        Ok(Self {
            _subscriber: subscriber.map_err(unfit)?,
            _token: token.map_err(unfit)?,
        })
    }
}

impl Channel {
    fn open(
        session: &Session,
        node: &Node,
        number: u32,
        topic: &Topic,
    ) -> Result<Self, PublisherError> {
        let token = node.publisher_token(number, topic);
        let publisher = session.declare_publisher(node.key(topic));
        // The thread may wait for the network; the run does not wait for the thread.
        let publisher = publisher.congestion_control(CongestionControl::Block);
        Ok(Self {
            publisher: publisher.wait().map_err(unfit)?,
            gid: graph::gid(&token),
            sent: 0,
            _token: session
                .liveliness()
                .declare_token(token)
                .wait()
                .map_err(unfit)?,
        })
    }

    fn send(&mut self, bytes: &[u8], account: &mut Account) {
        self.sent += 1;
        let attachment = attachment::encode(self.sent, now_us() * 1_000, self.gid);
        let put = self.publisher.put(bytes).attachment(&attachment[..]);
        match put.wait() {
            Ok(()) => account.messages += 1,
            Err(cause) => {
                if account.failed == 0 {
                    notice!("warning: Zenoh does not take messages any more: {cause}");
                }
                account.failed += 1;
            }
        }
    }
}
