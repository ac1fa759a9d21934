//! Types of the messages: names, and the hashes of their definitions (REP 2016, RIHS01).
//!
//! The hashes are those of ROS 2 Jazzy; `tests/zenoh` compares them with `rosbags`.

/// Type of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageType {
    /// Package.
    pub package: &'static str,
    /// Name within the package.
    pub name: &'static str,
    /// Hash of the definition: `RIHS01_` and 64 hexadecimal digits.
    pub hash: &'static str,
}

impl MessageType {
    /// Returns the name that DDS gives the type, which `rmw_zenoh_cpp` takes over.
    pub fn dds_name(&self) -> String {
        format!("{}::msg::dds_::{}_", self.package, self.name)
    }
}

/// Displacement of the target with its covariance.
pub const POSE: MessageType = MessageType {
    package: "geometry_msgs",
    name: "PoseWithCovarianceStamped",
    hash: "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
};

/// Frames of target and stage.
pub const TRANSFORMS: MessageType = MessageType {
    package: "tf2_msgs",
    name: "TFMessage",
    hash: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
};

/// Image of a camera.
pub const IMAGE: MessageType = MessageType {
    package: "sensor_msgs",
    name: "Image",
    hash: "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
};

/// Nothing: a command without a value.
pub const EMPTY: MessageType = MessageType {
    package: "std_msgs",
    name: "Empty",
    hash: "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
};

/// True or false.
pub const BOOL: MessageType = MessageType {
    package: "std_msgs",
    name: "Bool",
    hash: "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
};

/// Point in a frame.
pub const POINT: MessageType = MessageType {
    package: "geometry_msgs",
    name: "PointStamped",
    hash: "RIHS01_4c0296af86e01e562e9e0405d138a01537247580076c58ea38d7923ac1045897",
};
