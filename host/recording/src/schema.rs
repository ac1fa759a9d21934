//! Schemas of the messages: the definitions of ROS 2 (`ros2msg`), each followed by those of its
//! parts, and this program's own package `trinocular_msgs`.

/// Name and definition of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schema {
    /// Full name: package, `msg`, name.
    pub name: &'static str,
    /// Definition of the message itself.
    text: &'static str,
    /// Names and definitions of its parts.
    parts: &'static [(&'static str, &'static str)],
}

/// Line between two definitions, as ROS 2 writes it.
const RULE: &str =
    "================================================================================";

impl Schema {
    /// Returns the name without the middle part, as the reader has it: `trinocular_msgs/Status`.
    pub fn short_name(&self) -> String {
        self.name.replace("/msg/", "/")
    }

    /// Returns the definition with those of its parts, as MCAP's `ros2msg` has it.
    pub fn text(&self) -> String {
        let mut text = self.text.to_owned();
        for (name, part) in self.parts {
            text.push_str(&format!("{RULE}\nMSG: {name}\n{part}"));
        }
        text
    }
}

const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");

const HEADER: (&str, &str) = (
    "std_msgs/Header",
    "builtin_interfaces/Time stamp\nstring frame_id\n",
);

/// Uncompressed image.
pub const IMAGE: Schema = Schema {
    name: "sensor_msgs/msg/Image",
    text: "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n\
           uint8 is_bigendian\nuint32 step\nuint8[] data\n",
    parts: &[HEADER, TIME],
};

/// Image as a PNG or JPEG file.
pub const COMPRESSED_IMAGE: Schema = Schema {
    name: "sensor_msgs/msg/CompressedImage",
    text: "std_msgs/Header header\nstring format\nuint8[] data\n",
    parts: &[HEADER, TIME],
};

/// Displacement of the target, m, with its covariance.
pub const POSE: Schema = Schema {
    name: "geometry_msgs/msg/PoseWithCovarianceStamped",
    text: "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
    parts: &[
        HEADER,
        TIME,
        (
            "geometry_msgs/PoseWithCovariance",
            "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
        ),
        (
            "geometry_msgs/Pose",
            "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
        ),
        ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
        (
            "geometry_msgs/Quaternion",
            "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
        ),
    ],
};

/// One frame set: its measurement, and the station's answer.
pub const MEASUREMENT: Schema = Schema {
    name: "trinocular_msgs/msg/Measurement",
    text: "\
# One frame set: its measurement in the images, and the station's answer to it.
# Capture time on the clock of the images' source.
std_msgs/Header header
# Number of the frame set, the sequence number of its images; keyframes have one, too.
uint32 frame
# Capture time of the frame set and of the keyframe on the station's clock, us.
uint64 capture_us
uint64 reference_us
# keyframe, measured (no answer yet), used, refused (by the images), unused (by the station).
string outcome
# Reason of a refusal.
string reason
# Displacement of the target since the keyframe, mm, and its covariance, mm2, row by row. Zeros
# without a measurement.
float64[3] displacement_mm
float64[9] covariance_mm2
# Factor on the variance for correlated errors.
float64 variance_inflation
# Active cameras, from 0.
uint8[] cameras
# Inliers. Per point and active camera: x and y in the keyframe, x and y now, px.
float64[] pixels
# Points left out, by reason.
string[] reject_names
uint32[] reject_counts
# Cameras left out, from 0, each with its reason.
uint8[] absent
string[] absent_reasons
# Position of the stage at the capture, mm; in recordings whose metadata have no stage_mm, after the
# answer.
float64[3] stage_mm
# The station's own estimate, mm. Zeros without one.
float64[3] station_mm
float64[3] station_sigma_mm
# Time from the capture to the first step that it could change, us.
uint32 latency_us
# Rotation vector of the target since the keyframe about the cameras' axes, its standard deviation,
# and the point at the keyframe whose displacement is stated. Empty without an estimate of rotation.
float64[] rotation_deg
float64[] rotation_sigma_deg
float64[] pivot_mm
",
    parts: &[HEADER, TIME],
};

/// Status report of the station.
pub const STATUS: Schema = Schema {
    name: "trinocular_msgs/msg/Status",
    text: "\
# Status report of the station; the stamp is the station's clock.
std_msgs/Header header
string state
# Empty without a fault.
string fault
string trust
string sight
int32[3] position_steps
int32[3] target_steps
uint32 frames_used
uint32 frames_refused
# Packets that the station dropped since its start, all reasons.
uint32 packets_dropped
# Time since the last frame that was used, ms.
uint32 seen_ms
bool motors
",
    parts: &[HEADER, TIME],
};

/// Event of the run.
pub const EVENT: Schema = Schema {
    name: "trinocular_msgs/msg/Event",
    text: "\
# Event of the run. Kinds: state, fault, sight, switches, line, recording.
std_msgs/Header header
string kind
string text
",
    parts: &[HEADER, TIME],
};

/// Bytes of the station's replay log or trace.
pub const ENTRY: Schema = Schema {
    name: "trinocular_msgs/msg/Entry",
    text: "\
# Bytes of the station's replay. Numbers are little-endian, instants are us of the log's clock.
# On /station/input: one entry of the input log: instant (8 bytes), kind (1 byte: 0 bytes from the
# host, 1 switches, 2 wait), length (2 bytes), payload.
# On /station/output: one record of the trace: kind (1 byte: 0 packet, 1 segment), instant (8
# bytes), then a packet's length (2 bytes) and bytes, or a segment's checksums and edge counts.
# On /station/edges: instant of the segment (8 bytes), then 4 bytes per edge: number of the port
# word in the segment, levels of the 16 pins after it.
uint8[] data
",
    parts: &[],
};
