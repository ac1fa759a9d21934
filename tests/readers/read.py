"""Reads a recording with mcap, mcap-ros2-support and rosbags; checks counts, stamps and pixels.

    read.py RUN.mcap ROWS.jsonl FOLDER    rows of `track --json`, folder of `export --images`
"""

import io
import json
import pathlib
import struct
import sys
import zlib

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

CAMERAS = ["left", "middle", "right"]


def pixels(png):
    """Returns width, height and rows of an 8-bit grey PNG, by the standard library alone."""
    file = io.BytesIO(png)
    assert file.read(8) == b"\x89PNG\r\n\x1a\n"
    packed = b""
    while head := file.read(8):
        length, kind = struct.unpack(">I4s", head)
        content = file.read(length)
        file.read(4)
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", content[:10])
            assert (depth, colour) == (8, 0)
        elif kind == b"IDAT":
            packed += content
    raw, rows, above = zlib.decompress(packed), [], bytes(width)
    for y in range(height):
        start = y * (width + 1)
        rows.append(unfiltered(raw[start], raw[start + 1:start + 1 + width], above))
        above = rows[-1]
    return width, height, b"".join(rows)


def unfiltered(kind, line, above):
    """Undoes the filter of one row of bytes."""
    row = bytearray()
    for x, value in enumerate(line):
        left, up = (row[-1] if x else 0), above[x]
        corner = above[x - 1] if x else 0
        guess = left + up - corner
        near = min((abs(guess - p), i) for i, p in enumerate((left, up, corner)))[1]
        row.append((value + (0, left, up, (left + up) // 2, (left, up, corner)[near])[kind]) & 255)
    return bytes(row)


def grey(message):
    """Returns width, height and rows of an Image or CompressedImage."""
    if hasattr(message, "encoding"):
        assert (message.encoding, message.step) == ("mono8", message.width)
        return message.width, message.height, bytes(message.data)
    return pixels(bytes(message.data))


def stamp_us(header):
    """Returns the time of a header, us."""
    nanosec = getattr(header.stamp, "nanosec")
    return header.stamp.sec * 1_000_000 + nanosec // 1_000


def check(name, messages, rows, folder):
    """Checks messages by topic against the rows that the program printed."""
    sets = len(rows) + 1
    assert len(messages["/measurement"]) == sets, len(messages["/measurement"])
    assert len(messages["/displacement"]) == len(rows)
    for row, measurement, pose in zip(rows, messages["/measurement"][1:],
                                      messages["/displacement"]):
        assert measurement.outcome == "used"
        for axis, part in enumerate("xyz"):
            mm = measurement.displacement_mm[axis]
            # The station computes in integers, and viewers want metres.
            assert abs(mm - row["displacement_mm"][axis]) < 1e-3, (mm, row)
            assert abs(getattr(pose.pose.pose.position, part) - mm * 1e-3) < 1e-12
            sigma_mm = (pose.pose.covariance[7 * axis] ** 0.5) * 1e3
            assert abs(sigma_mm - row["sigma_mm"][axis]) < 1e-4 + 0.02 * sigma_mm
    for camera in CAMERAS:
        topics = [topic for topic in messages if topic.startswith(f"/{camera}/image_raw")]
        images = messages[topics[0]]
        assert len(images) == sets
        stamps = [stamp_us(image.header) for image in images]
        assert stamps == [stamp_us(m.header) for m in messages["/measurement"]]
        for index, image in enumerate(images):
            file = (pathlib.Path(folder) / camera / f"{index:06}.png").read_bytes()
            assert grey(image) == pixels(file), (camera, index)
    count = sum(map(len, messages.values()))
    print(f"{name}: {count} messages, {3 * sets} images bit for bit")


def main(recording, rows, folder):
    rows = [json.loads(line) for line in open(rows, encoding="utf-8")]
    messages = {}
    with open(recording, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().library.startswith("trinocular ")
        for _, channel, _, message in reader.iter_decoded_messages():
            messages.setdefault(channel.topic, []).append(message)
        assert [a.name for a in reader.iter_attachments()] == ["rig.toml"]
        assert dict((m.name, 1) for m in reader.iter_metadata()).keys() == {
            "trinocular", "trinocular.end"}
    check("mcap and mcap-ros2-support", messages, rows, folder)
    messages = {}
    with AnyReader([pathlib.Path(recording)]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            messages.setdefault(connection.topic, []).append(message)
    check("rosbags", messages, rows, folder)


main(*sys.argv[1:])
