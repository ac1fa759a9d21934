"""Receives what `track --zenoh` publishes, as rmw_zenoh_cpp would, and compares it with the recording.

    receive.py TRINOCULAR FOLDER
"""

import os
import pathlib
import struct
import subprocess
import sys
import threading

import xxhash
import zenoh
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from router import configuration, free_endpoint

DOMAIN = 7
CAMERAS = ["left", "middle", "right"]
TYPES = {"/tf": "tf2_msgs/msg/TFMessage",
         "/trinocular/displacement": "geometry_msgs/msg/PoseWithCovarianceStamped",
         **{f"/trinocular/{camera}/image_raw": "sensor_msgs/msg/Image" for camera in CAMERAS}}
STORE = get_typestore(Stores.ROS2_JAZZY)


def run(trinocular, *arguments, domain=str(DOMAIN)):
    """Runs the program to its end."""
    environment = os.environ | {"ROS_DOMAIN_ID": domain}
    return subprocess.run([trinocular, "track", "--sim", *arguments], env=environment,
                          capture_output=True, text=True, check=False)


class Graph:
    """Tokens as they appear and disappear, and messages by topic."""

    def __init__(self):
        self.tokens, self.gone, self.messages = [], set(), {}
        self.all_gone = threading.Event()

    def token(self, sample):
        """Takes in a token."""
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self.tokens.append(key)
        else:
            self.gone.add(key)
        if self.tokens and self.gone == set(self.tokens):
            self.all_gone.set()

    def message(self, sample):
        """Takes in a message."""
        content = (sample.payload.to_bytes(), sample.attachment.to_bytes())
        self.messages.setdefault(str(sample.key_expr), []).append(content)


def check_tokens(graph):
    """Checks node and publishers; returns the identifier of each topic's publisher."""
    assert len(set(graph.tokens)) == len(graph.tokens) == 1 + len(TYPES), graph.tokens
    gids, numbers = {}, set()
    for token in graph.tokens:
        space, domain, session, node, number, kind, enclave, namespace, name, *rest = (
            token.split("/"))
        assert (space, domain, node) == ("@ros2_lv", str(DOMAIN), "0"), token
        assert (enclave, namespace, name) == ("%", "%", "trinocular"), token
        assert int(session, 16) > 0 and number not in numbers, token
        numbers.add(number)
        if kind == "NN":
            assert not rest and number == "0", token
            continue
        topic, dds_type, digest, quality = rest
        topic = topic.replace("%", "/")
        package, short = TYPES[topic].split("/msg/")
        assert (kind, dds_type) == ("MP", f"{package}::msg::dds_::{short}_"), token
        assert digest == STORE.hash_rihs01(TYPES[topic]), token
        # Reliable, volatile, the last 10, the rest by default.
        assert quality == "1:2:1,10:,:,:,,", token
        key = f"{DOMAIN}{topic}/{dds_type}/{digest}"
        gids[topic] = key, xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")
    assert gids.keys() == TYPES.keys()
    return gids


def decoded(graph, gids):
    """Returns the messages of each topic in sequence, as rosbags decodes them."""
    assert graph.messages.keys() == {key for key, _ in gids.values()}, graph.messages.keys()
    found = {}
    for topic, (key, gid) in gids.items():
        messages, last_ns = [], 0
        for expected, (payload, attachment) in enumerate(graph.messages[key], 1):
            sequence, time_ns, length = struct.unpack("<qqB", attachment[:17])
            assert (sequence, length, attachment[17:]) == (expected, 16, gid), topic
            assert time_ns >= last_ns, topic
            last_ns = time_ns
            messages.append(STORE.deserialize_cdr(payload, TYPES[topic]))
        found[topic] = messages
    return found


def stamp_us(header):
    """Returns the time of a header, us."""
    return header.stamp.sec * 1_000_000 + header.stamp.nanosec // 1_000


def vector(message):
    """Returns the components of a point, vector or quaternion."""
    return [getattr(message, name) for name in "xyzw" if hasattr(message, name)]


def recorded(path):
    """Returns the messages of a recording by topic."""
    messages = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            messages.setdefault(connection.topic, []).append(message)
    return messages


def compare(found, expected):
    """Compares the topics with the recording of the same run."""
    sets = expected["/measurement"]
    # Between the two clocks lies one constant.
    epoch_us = {stamp_us(image.header) - stamp_us(one.header) for image, one in
                zip(found["/trinocular/left/image_raw"], expected["/left/image_raw"])}
    assert len(epoch_us) == 1, epoch_us
    epoch_us = epoch_us.pop()
    assert epoch_us > 1_600_000_000_000_000, epoch_us
    for camera in CAMERAS:
        images = found[f"/trinocular/{camera}/image_raw"]
        originals = expected[f"/{camera}/image_raw"]
        assert len(images) == len(originals) == len(sets)
        for image, original in zip(images, originals):
            assert (image.encoding, image.width, image.height) == (
                "mono8", original.width, original.height)
            assert bytes(image.data) == bytes(original.data)
    poses = found["/trinocular/displacement"]
    assert len(poses) == len(expected["/displacement"]) > 10
    for pose, original in zip(poses, expected["/displacement"]):
        assert stamp_us(pose.header) == epoch_us + stamp_us(original.header)
        assert pose.header.frame_id == "cameras"
        assert vector(pose.pose.pose.position) == vector(original.pose.pose.position)
        assert vector(pose.pose.pose.orientation) == vector(original.pose.pose.orientation)
        assert list(pose.pose.covariance) == list(original.pose.covariance)
    turns = [one for one in sets if one.outcome != "keyframe"]
    assert len(found["/tf"]) == len(turns)
    for message, turn in zip(found["/tf"], turns):
        target, stage = message.transforms
        assert (target.header.frame_id, target.child_frame_id) == ("cameras", "target")
        assert (stage.header.frame_id, stage.child_frame_id) == ("stage", "carriage")
        for transform, mm in ((target, turn.displacement_mm), (stage, turn.stage_mm)):
            assert vector(transform.transform.translation) == [1e-3 * value for value in mm]
            assert stamp_us(transform.header) == epoch_us + stamp_us(turn.header)
    return sum(map(len, found.values()))


def main(trinocular, folder):
    """Runs the program with a router, and without one."""
    recording = pathlib.Path(folder) / "run.mcap"
    endpoint, graph = free_endpoint(), Graph()
    with zenoh.open(configuration("router", endpoint)) as router:
        router.liveliness().declare_subscriber("@ros2_lv/**", graph.token)
        router.declare_subscriber(f"{DOMAIN}/**", graph.message)
        ended = run(trinocular, "--seconds", "1", "--fps", "20", "--json", "--record",
                    str(recording), f"--zenoh={endpoint}")
        assert ended.returncode == 0, ended.stderr
        # Without an end of its own a lost token would hang here.
        assert graph.all_gone.wait(60), set(graph.tokens) - graph.gone
        count = compare(decoded(graph, check_tokens(graph)), recorded(recording))
        assert f"published {count} messages\n" in ended.stderr, ended.stderr
        print(f"zenoh: {len(graph.tokens)} tokens, {count} messages as in the recording")

    silent = free_endpoint()
    refused = run(trinocular, f"--zenoh={silent}")
    assert refused.returncode == 1, refused
    assert silent in refused.stderr and "rmw_zenohd" in refused.stderr, refused.stderr
    for endpoint, domain, word in [("nonsense", "0", "nonsense"), ('tcp/"', "0", 'tcp/"'),
                                   (silent, "233", "ROS_DOMAIN_ID")]:
        refused = run(trinocular, f"--zenoh={endpoint}", domain=domain)
        assert refused.returncode == 2 and word in refused.stderr, refused
    print("zenoh: 4 mistakes refused by name")


main(*sys.argv[1:])
