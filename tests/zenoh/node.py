"""Runs the example node against a stand-in for rclpy, with messages of rosbags.

    node.py NODE.py

ROS 2 itself is no Python package; this shows that the node parses and computes.
"""

import runpy
import sys
import types

import numpy as np
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"


class Node:
    """The part of rclpy's node that the example uses."""

    said = []

    def __init__(self, name):
        self.name, self.parameters, self.subscriptions = name, {}, []

    def declare_parameter(self, name, value):
        """Sets the default of a parameter."""
        self.parameters[name] = types.SimpleNamespace(value=value)

    def get_parameter(self, name):
        """Returns a parameter."""
        return self.parameters[name]

    def create_subscription(self, kind, topic, callback, depth):
        """Keeps a subscription."""
        self.subscriptions.append((kind, topic, callback, depth))

    def get_logger(self):
        """Returns what keeps the lines."""
        def say(level):
            return lambda text: Node.said.append((level, text))
        return types.SimpleNamespace(info=say("info"), warning=say("warning"))

    def destroy_node(self):
        """Ends the node."""


def pose(displacement_m, sigma_m):
    """Returns a message after a way through CDR."""
    kinds = STORE.types
    header = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](1, 2), "cameras")
    covariance = np.zeros(36)
    covariance[[0, 7, 14]] = sigma_m ** 2
    position = kinds["geometry_msgs/msg/Point"](*displacement_m)
    orientation = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    inner = kinds["geometry_msgs/msg/Pose"](position, orientation)
    outer = kinds["geometry_msgs/msg/PoseWithCovariance"](inner, covariance)
    raw = STORE.serialize_cdr(kinds[POSE](header, outer), POSE)
    return STORE.deserialize_cdr(raw, POSE)


def spin(node):
    """Gives the node two messages, then ends as Ctrl-C does."""
    [(kind, topic, callback, _)] = node.subscriptions
    assert kind is STORE.types[POSE] and topic == "/trinocular/displacement"
    callback(pose((0.001, -0.002, 0.0), 0.0001))
    callback(pose((0.003, 0.0, 0.004001), 0.0001))
    raise KeyboardInterrupt


def main(path):
    """Runs the node as a program."""
    modules = {name: types.ModuleType(name) for name in
               ["rclpy", "rclpy.node", "geometry_msgs", "geometry_msgs.msg"]}
    sys.modules.update(modules)
    modules["rclpy"].init, modules["rclpy"].spin = lambda: None, spin
    modules["rclpy.node"].Node = Node
    modules["geometry_msgs.msg"].PoseWithCovarianceStamped = STORE.types[POSE]
    runpy.run_path(path, run_name="__main__")
    assert Node.said == [
        ("info", "x 1.000 ± 0.100, y -2.000 ± 0.100, z 0.000 ± 0.100 mm"),
        ("warning", "x 3.000 ± 0.100, y 0.000 ± 0.100, z 4.001 ± 0.100 mm: beyond 5.0 mm"),
    ], Node.said
    print(f"{path}: 2 messages")


main(*sys.argv[1:])
