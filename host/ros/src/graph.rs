//! Key expressions, liveliness tokens and identifiers of a node, its publishers and subscriptions.
//!
//! ```text
//! key    DOMAIN/TOPIC/TYPE/HASH
//! token  @ros2_lv/DOMAIN/SESSION/NODE/ENTITY/KIND/ENCLAVE/NAMESPACE/NAME[/TOPIC/TYPE/HASH/QOS]
//! ```
//!
//! Within a part of a token each slash is a percent sign; an empty part is one percent sign. ROS 2
//! builds its graph (`ros2 topic list`) from the tokens.

use crate::message_type::MessageType;
use xxhash_rust::xxh3::xxh3_128;

/// First part of every token.
const ADMIN_SPACE: &str = "@ros2_lv";

/// Empty enclave, and the root namespace.
const ROOT: &str = "%";

/// Quality of service: reliable (1), volatile (2), the last (1) 10 messages are kept; deadline,
/// lifespan and liveliness are the defaults.
const QOS: &str = "1:2:1,10:,:,:,,";

/// Topic with the type of its messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    name: String,
    message_type: MessageType,
}

impl Topic {
    /// Makes a topic of this full name, such as `/tf`.
    pub fn new(name: impl Into<String>, message_type: MessageType) -> Self {
        Self {
            name: name.into(),
            message_type,
        }
    }

    /// Returns the full name.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Node in the root namespace.
#[derive(Clone, Debug)]
pub struct Node {
    domain: u32,
    session: String,
    name: String,
}

impl Node {
    /// Makes the only node of the Zenoh session with this identifier, in a ROS domain.
    pub fn new(domain: u32, session: impl Into<String>, name: impl Into<String>) -> Self {
        Self {
            domain,
            session: session.into(),
            name: name.into(),
        }
    }

    /// Returns the key expression on which messages of a topic are put.
    pub fn key(&self, topic: &Topic) -> String {
        let name = topic.name.trim_matches('/');
        let (kind, hash) = (topic.message_type.dds_name(), topic.message_type.hash);
        format!("{}/{name}/{kind}/{hash}", self.domain)
    }

    /// Returns the key expression of the messages of a topic, whatever their type.
    pub fn key_of_any_type(&self, topic: &Topic) -> String {
        format!("{}/{}/**", self.domain, topic.name.trim_matches('/'))
    }

    /// Returns the token of the node.
    pub fn token(&self) -> String {
        self.entity(0, "NN")
    }

    /// Returns the token of the node's publisher with this number, which is unique within the
    /// session and not 0.
    pub fn publisher_token(&self, number: u32, topic: &Topic) -> String {
        self.endpoint(number, "MP", topic)
    }

    /// Returns the token of the node's subscription with this number, which is unique within the
    /// session and not 0.
    pub fn subscription_token(&self, number: u32, topic: &Topic) -> String {
        self.endpoint(number, "MS", topic)
    }

    fn endpoint(&self, number: u32, kind: &str, topic: &Topic) -> String {
        let entity = self.entity(number, kind);
        let name = topic.name.replace('/', "%");
        let (kind, hash) = (topic.message_type.dds_name(), topic.message_type.hash);
        format!("{entity}/{name}/{kind}/{hash}/{QOS}")
    }

    fn entity(&self, number: u32, kind: &str) -> String {
        let Self {
            domain,
            session,
            name,
        } = self;
        format!("{ADMIN_SPACE}/{domain}/{session}/0/{number}/{kind}/{ROOT}/{ROOT}/{name}")
    }
}

/// Returns the identifier of the entity with this token: its XXH3 digest of 128 bits, little-endian.
pub fn gid(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    // The example of rmw_zenoh_cpp's design document, but for the quality of service.
    const TEXT: MessageType = MessageType {
        package: "std_msgs",
        name: "String",
        hash: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    };

    #[test]
    fn keys_and_tokens_are_those_of_the_design() {
        let node = Node::new(2, "8b20917502ee955ac4476e0266340d5c", "talker");
        let topic = Topic::new("/chatter", TEXT);
        let kind = format!("std_msgs::msg::dds_::String_/{}", TEXT.hash);
        assert_eq!(node.key(&topic), format!("2/chatter/{kind}"));
        assert_eq!(node.key_of_any_type(&topic), "2/chatter/**");
        let session = "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0";
        assert_eq!(node.token(), format!("{session}/0/NN/%/%/talker"));
        let expected = format!("{session}/10/MP/%/%/talker/%chatter/{kind}/{QOS}");
        assert_eq!(node.publisher_token(10, &topic), expected);
        let expected = expected.replace("/MP/", "/MS/");
        assert_eq!(node.subscription_token(10, &topic), expected);
    }

    #[test]
    fn inner_slashes_stay_in_keys_only() {
        let node = Node::new(0, "a", "n");
        let topic = Topic::new("/left/image_raw", TEXT);
        assert!(node.key(&topic).starts_with("0/left/image_raw/std_msgs"));
        let token = node.publisher_token(1, &topic);
        assert!(token.contains("/%left%image_raw/"), "{token}");
    }

    #[test]
    fn gid_is_the_digest_of_xxhash() {
        // `xxhash.xxh3_128_hexdigest("@ros2_lv")` of Python's xxhash 3, whose digits are big-endian.
        let digest = 0x1c5f_652f_2f99_8aa9_9838_b774_f847_ad35;
        assert_eq!(u128::from_le_bytes(gid(ADMIN_SPACE)), digest);
        assert_ne!(gid("a"), gid("b"));
    }
}
