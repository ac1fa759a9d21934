"""Writes the images of a recording as ROS 2 bags by `rosbags`, as others would record them.

    write.py RUN.mcap DIR    makes DIR/<form>/, one per encoding, and DIR/rig.toml
"""

import pathlib
import sys
import tomllib

import numpy
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TOPICS = {"/left/image_raw": "/cam0/image", "/middle/image_raw": "/cam1/image",
          "/right/image_raw": "/cam2/image"}
STORE = get_typestore(Stores.ROS2_JAZZY)
Image = STORE.types["sensor_msgs/msg/Image"]
Header = STORE.types["std_msgs/msg/Header"]
Time = STORE.types["builtin_interfaces/msg/Time"]


def mono8(grey):
    return "mono8", 0, grey.shape[1], grey


def mono16(grey):
    """Each level times 257, big-endian."""
    wide = (grey.astype(numpy.uint16) * 257).astype(">u2")
    return "mono16", 1, 2 * grey.shape[1], wide


def bgr8(grey):
    """Rows with eight bytes of padding."""
    colour = numpy.repeat(grey[:, :, None], 3, axis=2).reshape(grey.shape[0], -1)
    return "bgr8", 0, colour.shape[1] + 8, numpy.pad(colour, ((0, 0), (0, 8)), constant_values=9)


def calibrated(path, images, rig):
    """Writes a bag of /left/image and the like, with camera_info from the text of a rig file."""
    rig = tomllib.loads(rig)
    width, height = rig["image_size_px"]
    connections = {}
    info = STORE.types["sensor_msgs/msg/CameraInfo"]
    roi = STORE.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for camera in rig["camera"]:
            (fx, fy), (cx, cy) = camera["focal_px"], camera["principal_px"]
            x, y = (mm * 1e-3 for mm in camera["offset_mm"])
            name = camera["name"]
            flat = lambda *values: numpy.array(values, numpy.float64)
            message = info(
                header=Header(Time(0, 0), name), height=height, width=width,
                distortion_model="plumb_bob", d=numpy.zeros(5),
                k=flat(fx, 0, cx, 0, fy, cy, 0, 0, 1), r=flat(1, 0, 0, 0, 1, 0, 0, 0, 1),
                p=flat(fx, 0, cx, -fx * x, 0, fy, cy, -fy * y, 0, 0, 1, 0),
                binning_x=0, binning_y=0, roi=roi)
            connection = writer.add_connection(f"/{name}/camera_info", info.__msgtype__,
                                               typestore=STORE)
            writer.write(connection, 0, STORE.serialize_cdr(message, info.__msgtype__))
            connections[f"/{name}/image_raw"] = writer.add_connection(
                f"/{name}/image_rect", Image.__msgtype__, typestore=STORE)
        for topic, at_ns, image in images:
            writer.write(connections[topic], at_ns,
                         STORE.serialize_cdr(image, Image.__msgtype__))


def write(path, images, encode, skew_ns, compression):
    """Writes one bag; the second camera's stamps differ by `skew_ns`."""
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    if compression:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {topic: writer.add_connection(name, Image.__msgtype__, typestore=STORE)
                       for topic, name in TOPICS.items()}
        for topic, at_ns, message in images:
            grey = numpy.asarray(message.data, numpy.uint8)
            grey = grey.reshape(message.height, message.width)
            encoding, is_bigendian, step, data = encode(grey)
            stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            stamp_ns += skew_ns if topic == "/middle/image_raw" else 0
            stamp = Time(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)
            image = Image(header=Header(stamp=stamp, frame_id="optical"), height=message.height,
                          width=message.width, encoding=encoding, is_bigendian=is_bigendian,
                          step=step, data=numpy.frombuffer(data.tobytes(), numpy.uint8))
            writer.write(connections[topic], at_ns,
                         STORE.serialize_cdr(image, Image.__msgtype__))


def main(recording, folder):
    folder = pathlib.Path(folder)
    folder.mkdir()
    images = []
    with AnyReader([pathlib.Path(recording)]) as reader:
        for connection, at_ns, raw in reader.messages():
            if connection.topic in TOPICS:
                message = reader.deserialize(raw, connection.msgtype)
                images.append((connection.topic, at_ns, message))
    write(folder / "mono8", images, mono8, 0, False)
    write(folder / "mono8-skewed", images, mono8, 2_000_000, False)
    write(folder / "mono16", images, mono16, 0, False)
    write(folder / "bgr8", images, bgr8, 0, False)
    write(folder / "zstd", images, mono8, 0, True)
    with open(recording, "rb") as file:
        attachments = make_reader(file).iter_attachments()
        rig = next(attachments).data
    (folder / "rig.toml").write_bytes(rig)
    calibrated(folder.parent / "calibrated", images, rig.decode())


main(*sys.argv[1:])
